"""The physical photograph against a brute-force tracer, closed forms, the discrete model in its limit, and conservation of energy."""

import functools

import numpy as np
import pytest
from pydantic import Field

from optsim.camera import (
    Bayer,
    CameraConfig,
    CenterTable,
    Distinct,
    DoubleAmici,
    Exposure,
    Foveon,
    Interpolate,
    Mono,
    Noise,
    Relay,
    UnitShift,
    band_model_of,
    masks_for,
    photograph,
    physical_model,
    sensors,
    signal_of,
    with_unit_shifts,
)
from optsim.camera.camera import DmdConfig, SensorConfig
from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from scenes.spectrum import Spectrum

pytestmark = pytest.mark.filterwarnings("ignore:the cube.s wavelengths lie up to")  # stepped dispersions are meant to jump
PLANCK, LIGHT = 6.62607015e-34, 299792458.0
ONE_TO_ONE = Relay(collimator_mm=138.2, focal_mm=138.2 * 9.9 / 13.68)
PAPER = Bands.paper()


class Steps:
    """Place each band wholly at one position: a dispersion without spread, smile or keystone."""

    def __init__(self, edges_nm, positions_px, magnification_px):
        self.edges, self.positions, self.magnification_px = np.asarray(edges_nm), np.asarray(positions_px, float), magnification_px

    def position_px(self, wavelength_nm, X_mm=0.0, Y_mm=0.0):
        k = np.clip(np.searchsorted(self.edges, wavelength_nm, side="right") - 1, 0, self.positions.size - 1)
        x, y = np.broadcast_arrays(
            self.positions[k] + self.magnification_px * np.asarray(X_mm, float), self.magnification_px * np.asarray(Y_mm, float)
        )
        return x, y, np.ones(x.shape, bool)

    def transmission(self, wavelength_nm, X_mm=0.0, Y_mm=0.0):
        return np.ones(np.broadcast(wavelength_nm, X_mm, Y_mm).shape)


class StepCamera(CameraConfig):
    """A camera with any dispersion put in."""

    given: object = Field(default=None, exclude=True)

    @property
    def dispersion(self):
        return self.given


def step_camera(bands, positions, **more):
    camera = CameraConfig(relay=ONE_TO_ONE, **more).ideal()
    edges = np.append(bands.lower, bands.upper[-1])
    return StepCamera(
        **{name: getattr(camera, name) for name in ("prism", "relay", "dmd", "sensor", "bandpass")},
        given=Steps(edges, positions, 1000 / 13.68),
    )


def fine_cube(size, bands, samples=2, parts=10, cover=None, seed=0):
    fine = bands.subdivide(parts, cover)
    values = np.random.default_rng(seed).random((size[0] * samples, size[1] * samples, fine.count)).astype(np.float32)
    return make_cube(values, fine)


def band_cube(size, bands, samples=2, parts=10, seed=0):
    """Make a cube that is constant inside every mirror and band; return it with its band values."""
    coarse = np.random.default_rng(seed).random((*size, bands.count)).astype(np.float32)
    values = np.repeat(np.repeat(np.repeat(coarse, samples, 0), samples, 1), parts, 2)
    return make_cube(values, bands.subdivide(parts)), coarse


def brute_force(cube, camera, sensor, masks, width):
    """Trace every sample exactly and lay its rectangle on the pixels in loops; electrons of one second."""
    rows, columns = masks.shape[1:]
    s = cube.sizes["y"] // rows
    pitch = camera.dmd.pitch_um / 1000
    etendue = (
        (camera.dmd.pitch_um * 1e-6) ** 2 * camera.dmd.fill_factor * np.pi / (2 * camera.relay.f_number) ** 2 * camera.relay.transmission
    )
    low = np.maximum(cube["band_lower"].values, camera.bandpass.lower_nm)
    high = np.minimum(cube["band_upper"].values, camera.bandpass.upper_nm)
    out = np.zeros((len(masks), 3 if sensor.name == "foveon" else 1, rows, width))
    mosaic = sensor.mosaic(rows, width)
    radiance = cube["radiance"].values.astype(float)
    for w in range(radiance.shape[2]):
        if high[w] <= low[w]:
            continue
        grid = np.linspace(low[w], high[w], 401)
        qe = np.stack([np.interp(grid, c.wavelength_nm, c.value) for c in sensor.curves])
        chi = etendue * np.trapezoid(qe * grid * 1e-9 / (PLANCK * LIGHT), grid, axis=1)
        here, right, below = (
            np.array(camera.optics.position_px(cube["wavelength"].values[w], *point)[:2]) for point in ((0, 0), (1e-4, 0), (0, 1e-4))
        )
        side_x, side_y = np.hypot(right - here, below - here) * pitch / s / 1e-4
        X, Y = (((np.arange(n * s) + 0.5) / s - n / 2) * pitch for n in (columns, rows))
        places = camera.optics.position_px(cube["wavelength"].values[w], X, Y[:, None])
        for v in range(rows * s):
            for u in range(columns * s):
                x, y, valid = (float(p[v, u]) for p in places)
                if not valid:
                    continue
                x, y = x + (columns - 1) / 2, y + (rows - 1) / 2
                for i in range(rows):
                    dy = min(y + side_y / 2, i + 0.5) - max(y - side_y / 2, i - 0.5)
                    if dy <= 0:
                        continue
                    for j in range(max(0, int(x - side_x)), min(width, int(x + side_x) + 2)):
                        dx = min(x + side_x / 2, j + 0.5) - max(x - side_x / 2, j - 0.5)
                        if dx > 0:
                            light = dx * dy / (side_x * side_y) / s**2 * radiance[v, u, w] * masks[:, v // s, u // s]
                            if mosaic is None:
                                out[:, :, i, j] += light[:, None] * chi
                            else:
                                out[:, 0, i, j] += light * chi[mosaic[i, j]]
    return out


@pytest.mark.parametrize("sensor", sensors(), ids=lambda s: s.name)
def test_the_photograph_is_the_sum_over_traced_samples_of_their_overlap(sensor):
    bands = Bands.from_edges([500, 520, 545])
    camera = CameraConfig().ideal()
    masks = masks_for(sensor, 2, Distinct(), (4, 5), 1)
    cube = fine_cube((4, 5), bands, cover=(497.0, 549.0))
    frames = photograph(cube, bands, camera, sensor, masks, Exposure(time_s=1.0))
    expected = brute_force(cube, camera, sensor, masks, frames.sizes["x"])
    np.testing.assert_allclose(frames["frames"].values, expected, rtol=2e-6, atol=1e-7 * expected.max())


def test_smile_and_wide_fields_are_followed_sample_by_sample():
    bands = Bands.from_edges([480, 520, 580])
    camera = CameraConfig.parse_toml("""
        [prism]
        outer = "N-BK7"
        inner = "F2"
        apex_inner_deg = 25.4761
        [relay]
        collimator_mm = 13.82
        focal_mm = 10.0
        [dmd]
        pitch_um = 400.0
        [sensor]
        pitch_um = 260.0
        """).ideal()
    masks = masks_for(Mono(), 1, Distinct(), (5, 6), 3)
    straight, _, _ = camera.dispersion.position_px(530.0, 0.0, 0.0)
    bent, _, _ = camera.dispersion.position_px(530.0, 0.0, 1.0)
    assert abs(bent - straight) > 1e-3
    cube = fine_cube((5, 6), bands, parts=10, cover=(460.0, 580.0))
    frames = photograph(cube, bands, camera, Mono(), masks, Exposure(time_s=1.0))
    expected = brute_force(cube, camera, Mono(), masks, frames.sizes["x"])
    np.testing.assert_allclose(frames["frames"].values, expected, rtol=2e-6, atol=1e-7 * expected.max())
    assert frames.attrs["field_error_px"] < 1e-7


@pytest.mark.parametrize("sensor", sensors(), ids=lambda s: s.name)
@pytest.mark.parametrize("samples", [2, 3])
def test_a_camera_with_unit_shifts_and_flat_bands_is_the_matched_model_times_its_radiometry(sensor, samples):
    bands = PAPER
    cube, coarse = band_cube((6, 7), bands, samples)
    masks = masks_for(sensor, 3, Distinct(), (6, 7), 2)
    camera = step_camera(bands, np.arange(24))
    frames = photograph(cube, bands, camera, sensor, masks, Exposure(time_s=2.0, shifts=UnitShift()))
    model = physical_model(camera, sensor, bands, masks, UnitShift(), 2.0)
    etendue = (13.68e-6) ** 2 * 0.92 * np.pi / 256
    g = np.zeros(frames["frames"].shape)
    mosaic = sensor.mosaic(6, 30)
    for k in range(24):
        grid = np.linspace(bands.lower[k], bands.upper[k], 20001)
        qe = np.stack([np.interp(grid, c.wavelength_nm, c.value) for c in sensor.curves])
        chi = 2.0 * etendue * np.trapezoid(qe * grid * 1e-9 / (PLANCK * LIGHT), grid, axis=1)
        np.testing.assert_allclose(model.response[:, k], chi, rtol=1e-7)
        for n in range(7):
            for row in range(6):
                weight = chi[mosaic[row, n + k]] if mosaic is not None else chi[: g.shape[1]]
                g[:, :, row, n + k] += (masks[:, row, n] * float(coarse[row, n, k]))[:, None] * weight
    np.testing.assert_allclose(frames["frames"].values, g, rtol=2e-7, atol=1e-12 * g.max())
    operator = band_model_of(frames).operator(np.float64)
    np.testing.assert_allclose(operator.forward(coarse.astype(float)), frames["frames"].values, rtol=1e-11, atol=1e-12 * g.max())


def test_the_photograph_converges_to_the_cameras_own_discrete_model_at_least_as_the_square_of_the_wavelength_step():
    bands = PAPER
    camera = CameraConfig(table={}, relay=ONE_TO_ONE).ideal()
    masks = masks_for(Mono(), 1, Distinct(), (4, 40), 2)
    errors = []
    for parts in (10, 20, 40, 80):
        cube, coarse = band_cube((4, 40), bands, 2, parts)
        frames = photograph(cube, bands, camera, Mono(), masks, Exposure(time_s=1.0))
        predicted = band_model_of(frames).operator(np.float64).forward(coarse.astype(float))
        errors.append(np.linalg.norm(frames["frames"].values - predicted) / np.linalg.norm(predicted))
    assert errors == sorted(errors, reverse=True)
    assert max(error * parts**2 for error, parts in zip(errors, (10, 20, 40, 80))) < 0.04


def test_what_unit_shifts_hide_is_in_the_data_of_the_default_prism():
    cube, coarse = band_cube((4, 60), PAPER)
    masks = masks_for(Mono(), 1, Distinct(), (4, 60), 2)
    frames = photograph(cube, PAPER, CameraConfig().ideal(), Mono(), masks)
    data = signal_of(frames)
    own, unit = (
        np.linalg.norm(band_model_of(f).operator(np.float64).forward(coarse.astype(float)) - data) / np.linalg.norm(data)
        for f in (frames, with_unit_shifts(frames))
    )
    assert own < 5e-3
    assert unit > 0.05


# --- energy ----------------------------------------------------------------------------------------------------


def balance(attrs):
    lost = attrs["photons_missed_sensor"] + attrs["photons_blocked"] + attrs["photons_reflected"]
    return (attrs["photons_detected"] + lost) / attrs["photons_sent"] - 1


@pytest.mark.parametrize("sensor", sensors(), ids=lambda s: s.name)
def test_photons_sent_are_detected_or_listed_as_lost(sensor):
    bands = Bands.from_edges([470, 520, 580, 640])
    cube = fine_cube((9, 11), bands, cover=(440.0, 679.0), parts=20)
    masks = masks_for(sensor, 6, Distinct(), (9, 11), 5)
    attrs = photograph(cube, bands, CameraConfig().ideal(), sensor, masks, Exposure(time_s=3.0)).attrs
    assert abs(balance(attrs)) < 1e-10
    wavelength, width = cube["wavelength"].values, cube["band_upper"].values - cube["band_lower"].values
    mirrors = cube["radiance"].values.astype(float).reshape(9, 2, 11, 2, -1).mean((1, 3))
    photons = 3.0 * (13.68e-6) ** 2 * 0.92 * np.pi / 256 * wavelength * 1e-9 / (PLANCK * LIGHT) * width
    spectrum = np.einsum("lyx,yxw->w", masks.astype(float), mirrors) * photons
    assert attrs["photons_sent"] == pytest.approx(spectrum.sum(), rel=1e-10)
    blocked = (wavelength < 450) | (wavelength > 670)
    assert attrs["photons_blocked"] == pytest.approx(spectrum[blocked].sum(), rel=0.02)
    outside = ~blocked & ((wavelength < 470) | (wavelength > 640))
    assert 0 < attrs["photons_outside_bands"] < spectrum[outside].sum()


@pytest.mark.parametrize("ratio", [1.0, 0.999, 1.5, 7 / 3, 0.4])
@pytest.mark.parametrize("offset", [0.0, 0.5, -0.25])
def test_D7_energy_is_conserved_for_any_ratio_of_pitches_and_offset(ratio, offset):
    bands = Bands.from_edges([500, 510])
    camera = step_camera(bands, [offset], dmd=DmdConfig(pitch_um=13.68 * ratio))
    camera = camera.model_copy(update={"given": Steps([500, 510], [offset], 1000 / 13.68)})
    masks = masks_for(Mono(), 1, Distinct(), (6, 8), 0)
    frames = photograph(fine_cube((6, 8), bands), bands, camera, Mono(), masks)
    assert abs(balance(frames.attrs)) < 1e-12
    if ratio == 1 and offset == 0:
        assert frames.attrs["photons_missed_sensor"] < 1e-12 * frames.attrs["photons_sent"]


def test_D7_equal_pitches_without_offset_are_the_identity():
    bands = Bands.from_edges([500, 510])
    cube, coarse = band_cube((6, 8), bands)
    frames = photograph(cube, bands, step_camera(bands, [0.0]), Mono(), np.ones((1, 6, 8)), Exposure(time_s=1.0))
    scale = frames["frames"].values[0, 0] / coarse[..., 0]
    np.testing.assert_allclose(scale, scale[0, 0], rtol=1e-12)


@pytest.mark.parametrize("shift", [-3, 3, -20, 20, 2.5, 1e5])
def test_S7_light_that_leaves_the_sensor_is_lost_by_the_closed_form(shift):
    bands = Bands.from_edges([500, 510, 520])
    values = np.ones((12, 20, 20), np.float32)
    values[..., 10:] = 0  # all light is in the first band
    cube = make_cube(values, bands.subdivide(10))
    camera = step_camera(bands, [shift, 0.0])
    camera.given.positions[1] = max(0.0, shift if shift == 0 else 0.0)
    frames = photograph(cube, bands, camera, Mono(), np.ones((1, 6, 10)), Exposure(time_s=1.0, shifts=UnitShift()))
    width = frames.sizes["x"]
    inside = np.clip(np.minimum(10, width - shift) - np.maximum(0, -shift), 0, 10)
    assert frames.attrs["photons_missed_sensor"] / frames.attrs["photons_sent"] == pytest.approx(1 - inside / 10, abs=1e-12)
    assert abs(balance(frames.attrs)) < 1e-12


def test_P5_wavelengths_that_the_prism_reflects_are_listed_as_lost():
    camera = CameraConfig.parse_toml("""
        [prism]
        outer = "N-SF66"
        inner = "N-SF66"
        apex_outer_deg = 21.2
        apex_inner_deg = 0.0
        design_nm = 660.0
        design_position_px = 30.0
        [relay]
        collimator_mm = 13.82
        focal_mm = 10.0
        """).ideal()
    bands = Bands.from_edges([450, 500, 550, 600, 650, 670])
    lost = ~camera.dispersion.position_px(bands.subdivide(10).center)[2]
    assert 0 < lost.sum() < lost.size
    cube = fine_cube((2, 3), bands)
    frames = photograph(cube, bands, camera, Mono(), np.ones((1, 2, 3)))
    light = cube["radiance"].values.astype(float) * cube["wavelength"].values * (cube["band_upper"] - cube["band_lower"]).values
    x, y = ((np.arange(n) + 0.5) * 0.00684 - n * 0.00342 for n in (6, 4))
    lost = ~camera.dispersion.position_px(cube["wavelength"].values, x[:, None], y[:, None, None])[2]
    assert (lost.any((0, 1)) != lost.all((0, 1))).any()  # at its critical angle the prism loses part of the field
    assert frames.attrs["photons_reflected"] / frames.attrs["photons_sent"] == pytest.approx(light[lost].sum() / light.sum(), rel=1e-9)
    assert abs(balance(frames.attrs)) < 1e-10
    assert np.isfinite(frames["frames"].values).all()


def test_P13_a_folded_dispersion_conserves_energy_and_stays_finite():
    class Fold(Steps):
        def position_px(self, wavelength_nm, X_mm=0.0, Y_mm=0.0):
            along = 3 - ((np.asarray(wavelength_nm) - 550.0) / 20) ** 2
            x, y = np.broadcast_arrays(
                along + self.magnification_px * np.asarray(X_mm, float), self.magnification_px * np.asarray(Y_mm, float)
            )
            return x, y, np.ones(x.shape, bool)

    bands = Bands.from_edges([510, 530, 550, 570, 590])
    camera = step_camera(bands, np.zeros(4)).model_copy(update={"given": Fold([0], [0], 1000 / 13.68)})
    masks = np.ones((1, 3, 9))
    cube, coarse = band_cube((3, 9), bands, parts=40)
    frames = photograph(cube, bands, camera, Mono(), masks)
    assert abs(balance(frames.attrs)) < 1e-12
    predicted = band_model_of(frames).operator(np.float64).forward(coarse.astype(float))
    assert np.abs(predicted - frames["frames"].values).max() < 2e-3 * predicted.max()


def test_S8_two_million_samples_into_one_pixel_add_up_without_float32_loss():
    bands = Bands.from_edges([500, 600])
    fine = Bands.from_edges(np.linspace(500, 600, 31_251))
    cube = make_cube(np.full((8, 8, 31_250), 0.1, np.float32), fine)
    frames = photograph(cube, bands, step_camera(bands, [0.0]), Mono(), np.ones((1, 1, 1)), Exposure(time_s=1.0))
    etendue = (13.68e-6) ** 2 * 0.92 * np.pi / 256
    expected = float(np.float32(0.1)) * etendue * (600**2 - 500**2) / 2 * 1e-9 / (PLANCK * LIGHT)
    assert frames["frames"].values.tolist() == [[[[pytest.approx(expected, rel=1e-10)]]]]


# --- masks, sensors, repeatability -----------------------------------------------------------------------------


@functools.cache
def shot(masks_bytes, size=(5, 6), sensor=None):
    masks = np.frombuffer(masks_bytes, np.uint8).reshape(-1, *size)
    sensor = Mono() if sensor is None else sensor
    return photograph(fine_cube(size, PAPER), PAPER, CameraConfig().ideal(), sensor, masks, Exposure(time_s=1.0))["frames"].values


def test_D1_D4_a_mask_and_its_complement_add_to_the_open_frame():
    masks = masks_for(Mono(), 1, Distinct(), (5, 6), 9)
    whole = shot(np.ones_like(masks).tobytes())
    np.testing.assert_allclose(
        shot(masks.tobytes()) + shot((1 - masks).astype(np.uint8).tobytes()), whole, rtol=1e-12, atol=1e-12 * whole.max()
    )


def test_D2_closed_mirrors_give_a_dark_frame_whatever_the_scene():
    closed = np.zeros((1, 5, 6), np.uint8)
    frames = photograph(
        fine_cube((5, 6), PAPER), PAPER, CameraConfig().ideal(), Mono(), closed, Exposure(noise=Noise(read_noise_e=0.0, offset_dn=9.0))
    )
    assert (frames["frames"].values == 9).all()
    assert frames.attrs["photons_sent"] == 0


def test_D3_one_open_mirror_is_that_mirrors_share_of_the_whole():
    total = 0
    for index in range(30):
        one = np.zeros(30, np.uint8)
        one[index] = 1
        total = total + shot(one.tobytes())
    whole = shot(np.ones(30, np.uint8).tobytes())
    np.testing.assert_allclose(total, whole, rtol=1e-12, atol=1e-12 * whole.max())
    first = np.zeros(30, np.uint8)
    first[0] = 1
    assert shot(first.tobytes())[0, 0, 3:].max() == 0  # light of row 0 stays in rows 0 and, by 0.02 px, its neighbours


def test_D8_masks_of_another_size_than_the_cube_are_refused():
    cube = fine_cube((5, 6), PAPER)
    for size in ((5, 7), (4, 6), (10, 13)):
        with pytest.raises(InputError, match="cube"):
            photograph(cube, PAPER, CameraConfig().ideal(), Mono(), np.ones((1, *size)))


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1)])
def test_D8_one_mirror_and_one_line_are_valid(size):
    frames = photograph(fine_cube(size, PAPER), PAPER, CameraConfig().ideal(), Foveon.sigma(), np.ones((1, *size)))
    assert frames["frames"].shape == (1, 3, size[0], size[1] + 23)
    assert abs(balance(frames.attrs)) < 1e-10


def test_S10_equal_flat_curves_give_the_same_frame_on_all_sensors():
    flat = Spectrum.constant(1.0, 400, 700)
    colours = {"red": flat, "green": flat, "blue": flat}
    cube, masks = fine_cube((5, 6), PAPER), masks_for(Mono(), 1, Distinct(), (5, 6), 0)
    frames = [
        photograph(cube, PAPER, CameraConfig().ideal(), s, masks, Exposure(time_s=1.0))["frames"].values
        for s in (Mono(), Bayer(**colours), Foveon(**colours))
    ]
    np.testing.assert_allclose(frames[1], frames[0], rtol=1e-13)
    for channel in range(3):
        np.testing.assert_allclose(frames[2][:, channel : channel + 1], frames[0], rtol=1e-13)


def test_the_same_photograph_has_the_same_bytes_and_shots_do_not_know_each_other():
    masks = masks_for(Mono(), 14, Distinct(), (5, 6), 1)  # more shots than one pass of the kernel
    first, again = (
        photograph(fine_cube((5, 6), PAPER), PAPER, CameraConfig().ideal(), Mono(), masks, Exposure(time_s=1.0)) for _ in range(2)
    )
    assert first["frames"].values.tobytes() == again["frames"].values.tobytes()
    for l in range(14):
        np.testing.assert_array_equal(first["frames"].values[l : l + 1], shot(masks[l].tobytes()))


def test_slabs_of_rows_do_not_change_a_photograph(monkeypatch):
    masks = masks_for(Mono(), 1, Distinct(), (12, 6), 1)
    cube = fine_cube((12, 6), PAPER)
    whole = photograph(cube, PAPER, CameraConfig().ideal(), Mono(), masks)
    monkeypatch.setattr("optsim.camera.gather.SLAB_BYTES", 5 * 12 * 240 * 4)
    slabs = photograph(cube, PAPER, CameraConfig().ideal(), Mono(), masks)
    np.testing.assert_array_equal(slabs["frames"].values, whole["frames"].values)
    assert slabs.attrs["photons_missed_sensor"] == pytest.approx(whole.attrs["photons_missed_sensor"], rel=1e-12)


@pytest.mark.parametrize("sensor", sensors(), ids=lambda s: s.name)
def test_without_llvm_numpy_gives_the_same_photograph(sensor, monkeypatch):
    masks = masks_for(sensor, 2, Distinct(), (5, 6), 1)
    cube = fine_cube((5, 6), PAPER, cover=(440.0, 672.0))
    first = photograph(cube, PAPER, CameraConfig().ideal(), sensor, masks, Exposure(time_s=1.0))
    monkeypatch.setattr("optsim.camera.collect.kernels", lambda: None)
    plain = photograph(cube, PAPER, CameraConfig().ideal(), sensor, masks, Exposure(time_s=1.0))
    np.testing.assert_allclose(plain["frames"].values, first["frames"].values, rtol=1e-11, atol=1e-13 * first["frames"].values.max())
    for name in ("sent", "detected", "missed_sensor", "blocked", "reflected", "outside_bands"):
        assert plain.attrs[f"photons_{name}"] == pytest.approx(first.attrs[f"photons_{name}"], rel=1e-9)


# --- coarse cubes ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("samples", "parts"), [(1, 1), (1, 10), (2, 9), (2, 1)])
def test_a_cube_too_coarse_is_refused_with_the_remedy(samples, parts):
    cube = fine_cube((4, 5), PAPER, samples, parts)
    with pytest.raises(InputError, match=r"--subdivide 10 --oversample 2.*--interpolate") as caught:
        photograph(cube, PAPER, CameraConfig().ideal(), Mono(), np.ones((1, 4, 5)))
    assert caught.value.field == "cube"


@pytest.mark.parametrize(("samples", "parts"), [(1, 1), (1, 10), (2, 4), (2, 1)])
def test_an_interpolated_photograph_is_marked_and_keeps_band_means(samples, parts):
    cube = fine_cube((4, 5), PAPER, samples, parts)
    masks = np.ones((1, 4, 5))
    frames = photograph(cube, PAPER, CameraConfig().ideal(), Mono(), masks, Exposure(time_s=1.0, interpolate=Interpolate()))
    assert frames.attrs["model"] == "physical-interpolated"
    coarse = cube["radiance"].values.astype(float)
    width = cube["band_upper"].values - cube["band_lower"].values
    band = np.add.reduceat(coarse * width, np.arange(0, width.size, parts), axis=2) / PAPER.width
    mirrors = band.reshape(4, samples, 5, samples, 24).mean((1, 3))
    per_band = (PAPER.upper**2 - PAPER.lower**2) / 2 * 1e-9 / (PLANCK * LIGHT) * (13.68e-6) ** 2 * 0.92 * np.pi / 256
    outside = frames.attrs["photons_outside_bands"]
    assert frames.attrs["photons_sent"] - outside == pytest.approx(float((mirrors * per_band).sum()), rel=4e-3)


def test_a_flat_scene_interpolates_to_itself():
    flat = make_cube(np.full((4, 5, 24), 0.25, np.float32), PAPER)
    fine = make_cube(np.full((8, 10, 246), 0.25, np.float32), PAPER.subdivide(10, (450, 670)))
    masks = masks_for(Mono(), 1, Distinct(), (4, 5), 0)
    interpolated = photograph(flat, PAPER, CameraConfig().ideal(), Mono(), masks, Exposure(interpolate=Interpolate()))
    exact = photograph(fine, PAPER, CameraConfig().ideal(), Mono(), masks)
    np.testing.assert_allclose(interpolated["frames"].values, exact["frames"].values, rtol=1e-6)
    assert exact.attrs["model"] == "physical"


def test_a_fine_cube_is_not_interpolated_though_allowed():
    frames = photograph(
        fine_cube((4, 5), PAPER), PAPER, CameraConfig().ideal(), Mono(), np.ones((1, 4, 5)), Exposure(interpolate=Interpolate())
    )
    assert frames.attrs["model"] == "physical"


def test_wavelengths_that_lie_apart_on_the_sensor_are_warned_of():
    bands = Bands.from_edges([500, 600])
    with pytest.warns(UserWarning, match=r"1\.4 px apart"):
        frames = photograph(fine_cube((3, 4), bands), bands, CameraConfig().ideal(), Mono(), np.ones((1, 3, 4)))
    assert frames.attrs["wavelength_step_px"] > 1
    assert (
        photograph(fine_cube((3, 4), PAPER), PAPER, CameraConfig().ideal(), Mono(), np.ones((1, 3, 4))).attrs["wavelength_step_px"] < 0.13
    )


def test_cubes_with_gaps_or_missing_bands_are_refused():
    fine = PAPER.subdivide(10)
    gap = Bands(np.delete(fine.lower, 30), np.delete(fine.upper, 30), np.delete(fine.center, 30))
    with pytest.raises(InputError, match="touching bands"):
        photograph(make_cube(np.ones((8, 10, 239)), gap), PAPER, CameraConfig().ideal(), Mono(), np.ones((1, 4, 5)))
    short = Bands(fine.lower[5:], fine.upper[5:], fine.center[5:])
    with pytest.raises(InputError, match="covering the bands"):
        photograph(make_cube(np.ones((8, 10, 235)), short), PAPER, CameraConfig().ideal(), Mono(), np.ones((1, 4, 5)))
    with pytest.raises(InputError, match="at least 0"):
        photograph(make_cube(-np.ones((8, 10, 240)), fine), PAPER, CameraConfig().ideal(), Mono(), np.ones((1, 4, 5)))


# --- exposure --------------------------------------------------------------------------------------------------


def test_light_that_the_band_pass_blocks_may_lie_outside_the_glasses_range():
    bands = Bands.from_edges([500, 510])
    wide = Bands.from_edges([200, *np.linspace(445, 675, 231), 3000])
    frames = photograph(make_cube(np.ones((4, 6, 232)), wide), bands, CameraConfig().ideal(), Mono(), np.ones((1, 2, 3)))
    photons = np.diff(np.array([200.0, 450, 670, 3000]) ** 2)
    assert frames.attrs["photons_blocked"] / frames.attrs["photons_sent"] == pytest.approx(
        (photons[0] + photons[2]) / photons.sum(), rel=1e-9
    )


def test_the_brightest_pixel_reaches_nine_tenths_of_the_full_well():
    camera = CameraConfig(sensor=SensorConfig(full_well_e=7000.0))
    for sensor in sensors():
        frames = photograph(fine_cube((4, 5), PAPER), PAPER, camera, sensor, np.ones((1, 4, 5)))
        assert frames["frames"].values.max() == pytest.approx(6300, rel=1e-12)
        assert frames.attrs["units"] == "electron"


def test_frames_and_response_are_proportional_to_time_and_S6_no_time_gives_no_light():
    cube, masks = fine_cube((4, 5), PAPER), np.ones((1, 4, 5))
    once, twice, never = (photograph(cube, PAPER, CameraConfig().ideal(), Mono(), masks, Exposure(time_s=t)) for t in (1e-3, 2e-3, 0.0))
    for name in ("frames", "response"):
        np.testing.assert_allclose(twice[name].values, 2 * once[name].values, rtol=1e-13)
        assert (never[name].values == 0).all()


def test_digital_numbers_minus_their_offset_are_h_times_the_cube():
    cube, coarse = band_cube((30, 30), PAPER)
    noise = Noise(bits=16, offset_dn=1000.0, read_noise_e=3.0, dark_e_per_s=0.0)
    masks = masks_for(Mono(), 3, Distinct(), (30, 30), 0)
    camera = step_camera(PAPER, np.arange(24))
    frames = photograph(cube, PAPER, camera, Mono(), masks, Exposure(noise=noise, seed=4))
    assert frames.attrs["units"] == "DN"
    assert frames.attrs["bits"] == 16
    model = band_model_of(frames)
    mean = model.operator(np.float64).forward(coarse.astype(float))
    gain = frames.attrs["gain"]
    sigma = np.sqrt(gain * mean + (3 * gain) ** 2 + 1 / 12)
    z = (signal_of(frames) - mean) / sigma
    assert abs(z.mean()) < 4 / np.sqrt(z.size)
    assert abs(z.var() - 1) < 4 * np.sqrt(2 / z.size)
    again = photograph(cube, PAPER, camera, Mono(), masks, Exposure(noise=noise, seed=4))
    assert again["frames"].values.tobytes() == frames["frames"].values.tobytes()


def test_light_outside_the_bands_is_in_the_data_and_not_in_h():
    cube = fine_cube((4, 30), PAPER, cover=(450.0, 670.0))
    frames = photograph(cube, PAPER, CameraConfig().ideal(), Mono(), np.ones((1, 4, 30)))
    share = frames.attrs["photons_outside_bands"] / frames.attrs["photons_detected"]
    expected = (452.5**2 - 450**2 + 670**2 - 668.5**2) / (670**2 - 450**2)
    assert share == pytest.approx(expected, rel=0.05)
    assert frames.attrs["bandpass_nm"] == "450-670"


def test_the_default_prism_and_the_table_are_both_dispersions():
    from optsim.camera.prism import Dispersion

    for dispersion in (DoubleAmici.default(), CenterTable(), CameraConfig().dispersion):
        assert isinstance(dispersion, Dispersion)
        assert dispersion.magnification_px * 0.01368 == pytest.approx(13.68 * 100 / 138.2 / 9.9)
