"""Every fact of a camera in its photograph: accounts of photons, leak, gray masks, blur, pupil rays, flanks, pixels, convergence."""

import math

import numpy as np
import pytest
from pydantic import Field

from optsim.camera import Bayer, CameraConfig, Distinct, Exposure, Foveon, Mono, Noise, masks_for, photograph
from optsim.camera.bandpass import passed_photons
from optsim.camera.convolve import kernel
from optsim.camera.optics_config import BandpassConfig, DmdConfig, SensorConfig
from optsim.camera.pixels import shared
from optsim.camera.pupil import Pupil
from optsim.camera.relay import Relay
from optsim.cube import Bands, make_cube
from optsim.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore:the cube.s wavelengths lie up to")
PLANCK, LIGHT = 6.62607015e-34, 299792458.0
EVERYTHING = """
[dmd]
rotation_deg = 2.0
offset_x_px = 0.3
offset_y_px = -1.4
tilt_deg = 12.0
scale = 1.05
leak = 0.01
dead_share = 0.05
stuck_share = 0.02
[relay]
distortion_per_mm2 = 1e-3
defocus_mm = 0.05
transmission = 0.8
[bandpass]
edge_nm = 6.0
[sensor]
crosstalk = 0.03
prnu = 0.01
dsnu_e = 3.0
"""
LOSSES = ("missed_sensor", "blocked", "absorbed", "reflected")


def fine_cube(size, bands, samples=2, parts=10, cover=None, seed=0):
    fine = bands.subdivide(parts, cover)
    values = np.random.default_rng(seed).random((size[0] * samples, size[1] * samples, fine.count)).astype(np.float32)
    return make_cube(values, fine)


def imbalance(attrs):
    return (attrs["photons_detected"] + sum(attrs[f"photons_{name}"] for name in LOSSES)) / attrs["photons_sent"] - 1


class Stand:
    """A path of shifts, one blur for all wavelengths and any pupil: what closed forms describe."""

    magnification_px = 1000 / 13.68
    pixels = 0.0

    def __init__(self, shift_px=0.0, sigma_px=0.0, rays=None, down_px=0.0):
        self.shift, self.down, self.sigma, self.rays, self.has_blur = shift_px, down_px, sigma_px, rays, sigma_px > 0

    def position_px(self, wavelength_nm, X_mm=0.0, Y_mm=0.0, pupil=None):
        u = 0.0 if pupil is None else pupil[0]
        x, y, _ = np.broadcast_arrays(
            self.shift + u + self.magnification_px * np.asarray(X_mm), self.down + self.magnification_px * np.asarray(Y_mm), wavelength_nm
        )
        return x, y, np.ones(x.shape, bool)

    def transmission(self, wavelength_nm, X_mm=0.0, Y_mm=0.0):
        return np.ones(np.broadcast(wavelength_nm, X_mm, Y_mm).shape)

    def pupil(self):
        return self.rays

    def otf(self, wavelength_nm, fy, fx):
        return np.exp(-2 * (math.pi * self.sigma) ** 2 * (fy**2 + fx**2))


class StandCamera(CameraConfig):
    """A camera with that path put in."""

    given: object = Field(default=None, exclude=True)

    @property
    def dispersion(self):
        return Stand()

    @property
    def optics(self):
        return self.given


def stand_camera(stand, **more):
    camera = CameraConfig(relay=Relay(collimator_mm=138.2, focal_mm=138.2 * 9.9 / 13.68), **more).ideal()
    names = ("prism", "relay", "dmd", "sensor", "bandpass")
    return StandCamera(**{name: more.get(name, getattr(camera, name)) for name in names}, given=stand)


BAND = Bands.from_edges([540, 550])


def one_mirror(size, at):
    values = np.zeros((2 * size[0], 2 * size[1], 10), np.float32)
    values[2 * at[0] : 2 * at[0] + 2, 2 * at[1] : 2 * at[1] + 2] = 1
    return make_cube(values, BAND.subdivide(10))


# --- accounts ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sensor", [Mono(), Bayer.nikon(), Foveon.sigma()], ids=lambda s: s.name)
def test_with_every_effect_on_photons_sent_are_detected_or_listed_as_lost(sensor):
    bands = Bands.from_edges([470, 520, 580, 640])
    camera = CameraConfig.parse_toml(EVERYTHING)
    frames = photograph(
        fine_cube((9, 11), bands, cover=(440.0, 679.0), parts=15), bands, camera, sensor, masks_for(sensor, 3, Distinct(), (9, 11), 5)
    )
    attrs = frames.attrs
    assert abs(imbalance(attrs)) < 1e-10
    for name in LOSSES:
        assert attrs[f"photons_{name}"] > 1e-3 * attrs["photons_sent"]
    assert attrs["photons_absorbed"] == pytest.approx(0.2 * attrs["photons_sent"], rel=1e-12)
    assert frames["frames"].values.min() >= 0


def test_the_frame_of_a_perfect_flat_sensor_holds_as_many_electrons_as_photons_were_detected_blur_included():
    camera = CameraConfig.parse_toml("[sensor]\nprnu = 0.0\n")
    cube = fine_cube((7, 9), BAND)
    frames = photograph(cube, BAND, camera, Mono(), np.ones((1, 7, 9)), Exposure(time_s=1.0))
    assert frames.attrs["blur_reach_px"] > 0
    assert frames["frames"].values.sum() == pytest.approx(frames.attrs["photons_detected"], rel=1e-12)


def test_without_llvm_numpy_gives_the_same_photograph_with_every_effect(monkeypatch):
    bands = Bands.from_edges([500, 520, 545])
    camera = CameraConfig.parse_toml(EVERYTHING)
    cube, masks = fine_cube((4, 5), bands, cover=(490.0, 549.0)), masks_for(Mono(), 2, Distinct(), (4, 5), 1)
    first = photograph(cube, bands, camera, Mono(), masks, Exposure(time_s=1.0))
    monkeypatch.setattr("optsim.camera.collect.kernels", lambda: None)
    plain = photograph(cube, bands, camera, Mono(), masks, Exposure(time_s=1.0))
    np.testing.assert_allclose(plain["frames"].values, first["frames"].values, rtol=1e-10, atol=1e-12 * first["frames"].values.max())
    for name in ("sent", "detected", *LOSSES):
        assert plain.attrs[f"photons_{name}"] == pytest.approx(first.attrs[f"photons_{name}"], rel=1e-9)


def test_blurred_photographs_repeat_bit_for_bit():
    cube, masks = fine_cube((5, 6), BAND), masks_for(Mono(), 3, Distinct(), (5, 6), 1)
    first, again = (photograph(cube, BAND, CameraConfig(), Mono(), masks, Exposure(time_s=1.0))["frames"].values for _ in range(2))
    assert first.tobytes() == again.tobytes()


@pytest.mark.parametrize("scale", [0.999, 1.5, 7 / 3])
def test_D7_registration_of_any_scale_and_offset_conserves_energy(scale):
    camera = CameraConfig(dmd=DmdConfig(scale=scale, offset_x_px=0.5, offset_y_px=-0.7, rotation_deg=3.0, leak=0.0)).ideal()
    camera = camera.model_copy(update={"dmd": DmdConfig(scale=scale, offset_x_px=0.5, offset_y_px=-0.7, rotation_deg=3.0, leak=0.0)})
    attrs = photograph(fine_cube((6, 8), BAND), BAND, camera, Mono(), np.ones((1, 6, 8))).attrs
    assert abs(imbalance(attrs)) < 1e-12
    assert attrs["photons_missed_sensor"] > 0


# --- mirrors -----------------------------------------------------------------------------------------------------


def test_D2_D9_a_leak_adds_its_share_of_the_open_frame_and_contrast_one_opens_all():
    cube, masks = fine_cube((5, 6), BAND), masks_for(Mono(), 1, Distinct(), (5, 6), 1)

    def shot(mask, leak):
        camera = CameraConfig().ideal().model_copy(update={"dmd": DmdConfig(leak=leak)})
        return photograph(cube, BAND, camera, Mono(), mask, Exposure(time_s=1.0))["frames"].values

    whole, masked = shot(np.ones_like(masks), 0.0), shot(masks, 0.0)
    scale = {"rtol": 1e-12, "atol": 1e-12 * whole.max()}
    np.testing.assert_allclose(shot(masks, 0.02), 0.02 * whole + 0.98 * masked, **scale)
    np.testing.assert_allclose(shot(np.zeros_like(masks), 0.02), 0.02 * whole, **scale)
    np.testing.assert_allclose(shot(masks, 1.0), whole, **scale)


def test_D6_gray_masks_are_refused_unless_allowed_and_then_weigh_light():
    cube = fine_cube((3, 4), BAND)
    half = np.full((1, 3, 4), 0.5)
    with pytest.raises(InputError, match="masks"):
        photograph(cube, BAND, CameraConfig().ideal(), Mono(), half)
    for bad in (-1.0, math.nan, 1.5):
        with pytest.raises(InputError, match="masks"):
            photograph(cube, BAND, CameraConfig().ideal(), Mono(), np.full((1, 3, 4), bad), Exposure(gray=True))
    gray, whole = (
        photograph(cube, BAND, CameraConfig().ideal(), Mono(), mask, Exposure(time_s=1.0, gray=True))["frames"].values
        for mask in (half, np.ones((1, 3, 4)))
    )
    np.testing.assert_allclose(gray, whole / 2, rtol=1e-13)


# --- blur and pupil ----------------------------------------------------------------------------------------------


def erf_box(edge, side, sigma):
    """Integrate a box of this side round 0, convolved with a Gaussian, up to ``edge``: mean of the normal distribution over the box."""

    def ramp(t):
        return t * (1 + math.erf(t / sigma / math.sqrt(2))) / 2 + sigma * math.exp(-((t / sigma) ** 2) / 2) / math.sqrt(2 * math.pi)

    return (ramp(edge + side / 2) - ramp(edge - side / 2)) / side


@pytest.mark.parametrize(("sub", "error"), [(4, 2.5e-2), (9, 5e-3)])
@pytest.mark.parametrize(("sigma", "shift", "down"), [(0.4, 0.0, 0.0), (0.8, 0.37, -0.21), (1.5, 0.5, 0.5)])
def test_a_gaussian_blur_of_one_mirror_is_the_closed_form(sigma, shift, down, sub, error):
    camera = stand_camera(Stand(shift, sigma, down_px=down))
    size = (13, 13)
    how = Exposure(time_s=1.0, sub_pixels=sub)
    frame = photograph(one_mirror(size, (6, 6)), BAND, camera, Mono(), np.ones((1, *size)), how)["frames"].values[0, 0]
    column, row = (np.diff([erf_box(edge - 0.5 - 6 - place, 1.0, sigma) for edge in range(size[0] + 1)]) for place in (shift, down))
    expected = row[:, None] * column[: frame.shape[1]]
    assert np.abs(frame / frame.sum() - expected / expected.sum()).max() < error * expected.max()


def test_blurred_light_leaves_the_frame_and_does_not_wrap_to_the_other_side():
    camera = stand_camera(Stand(0.0, 1.5))
    frame = photograph(one_mirror((9, 16), (4, 0)), BAND, camera, Mono(), np.ones((1, 9, 16)), Exposure(time_s=1.0))
    values = frame["frames"].values[0, 0]
    assert values[:, 10:].max() < 1e-12 * values.max()
    inside = 1 - erf_box(-0.5, 1.0, 1.5)
    rows = erf_box(4.5, 1.0, 1.5) - erf_box(-4.5, 1.0, 1.5)
    assert frame.attrs["photons_detected"] / frame.attrs["photons_sent"] == pytest.approx(inside * rows, rel=3e-3)
    assert abs(imbalance(frame.attrs)) < 1e-12


def test_a_kernel_adds_to_one_is_nowhere_negative_and_is_symmetric():
    shares = kernel(CameraConfig().optics, 550.0, 3, 8)
    assert shares.sum() == pytest.approx(1, abs=1e-12)
    assert shares.min() >= 0
    np.testing.assert_allclose(shares, shares[::-1, ::-1], atol=1e-15)


def test_pupil_rays_are_an_average_of_photographs():
    rays = Pupil(np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.0]]), np.array([0.25, 0.25, 0.5]))
    cube, masks = fine_cube((4, 9), BAND), masks_for(Mono(), 2, Distinct(), (4, 9), 1)

    def shot(stand):
        return photograph(cube, BAND, stand_camera(stand), Mono(), masks, Exposure(time_s=1.0))

    both = shot(Stand(0.2, rays=rays))
    apart = [shot(Stand(0.2 + d)) for d in (-1, 1, 0)]
    mean = sum(w * f["frames"].values for w, f in zip(rays.weights, apart))
    np.testing.assert_allclose(both["frames"].values, mean, rtol=1e-12, atol=1e-12 * mean.max())
    assert both.attrs["pupil_rays"] == 3
    assert abs(imbalance(both.attrs)) < 1e-12


def test_finer_sub_pixels_change_the_default_photograph_by_the_hundredth_stated():
    cube, masks = fine_cube((8, 9), BAND), masks_for(Mono(), 1, Distinct(), (8, 9), 1)
    usual, fine = (
        photograph(cube, BAND, CameraConfig(), Mono(), masks, Exposure(time_s=1.0, sub_pixels=sub))["frames"].values for sub in (4, 9)
    )
    assert np.linalg.norm(usual - fine) < 0.015 * np.linalg.norm(fine)


# --- filter, prism, pixels ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("edge", [0.0, 8.0, 100.0])
def test_flanks_of_the_band_pass_are_integrated_exactly(edge):
    config = BandpassConfig(lower_nm=480.0, upper_nm=620.0, edge_nm=edge)
    curve = Mono.silicon().curve
    lower, upper = np.array([470.0, 477.0, 500.0, 610.0]), np.array([477.0, 500.0, 610.0, 640.0])
    grid = np.linspace(0, 1, 200_001)
    for k, (low, high) in enumerate(zip(lower, upper)):
        wavelength = low + (high - low) * grid
        if edge == 0:
            passed = ((wavelength >= 480) & (wavelength <= 620)).astype(float)
        else:
            passed = np.clip(np.minimum((wavelength - 480) / edge + 0.5, (620 - wavelength) / edge + 0.5), 0, 1)
        expected = (
            np.trapezoid(np.interp(wavelength, curve.wavelength_nm, curve.value) * passed * wavelength, wavelength)
            * 1e-9
            / (PLANCK * LIGHT)
        )
        assert passed_photons(config, lower, upper, curve)[k] == pytest.approx(expected, rel=1e-5, abs=1e-9)


def test_fresnel_losses_are_listed_and_dim_the_frame_by_the_prisms_transmission():
    cube, masks = fine_cube((3, 4), BAND), np.ones((1, 3, 4))
    with_losses = CameraConfig().ideal()
    assert with_losses.prism is not None
    with_losses = with_losses.model_copy(update={"prism": with_losses.prism.model_copy(update={"fresnel": True})})
    dim, bright = (photograph(cube, BAND, c, Mono(), masks, Exposure(time_s=1.0)) for c in (with_losses, CameraConfig().ideal()))
    share = float(with_losses.optics.transmission(545.0))
    assert 0.85 < share < 0.95
    np.testing.assert_allclose(dim["frames"].values, share * bright["frames"].values, rtol=1e-3)
    assert dim.attrs["photons_reflected"] / dim.attrs["photons_sent"] == pytest.approx(1 - share, rel=1e-3)


def test_crosstalk_moves_charge_to_the_four_neighbours_and_the_prnu_scales_each_pixel():
    rng = np.random.default_rng(1)
    charge = rng.random((2, 1, 5, 6))
    dense = np.eye(30) * (1 - 4 * 0.04)
    for i, j in np.ndindex(5, 6):
        for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            if 0 <= i + di < 5 and 0 <= j + dj < 6:
                dense[(i + di) * 6 + j + dj, i * 6 + j] = 0.04
    np.testing.assert_allclose(shared(charge, 0.04).reshape(2, 30), charge.reshape(2, 30) @ dense.T, rtol=1e-13)
    cube, masks = fine_cube((20, 20), BAND), np.ones((1, 20, 20))
    even, uneven = (
        photograph(
            cube, BAND, CameraConfig().ideal().model_copy(update={"sensor": SensorConfig(prnu=p)}), Mono(), masks, Exposure(time_s=1.0)
        )
        for p in (0.0, 0.05)
    )
    lit = even["frames"].values > 0.5 * even["frames"].values.max()
    ratio = uneven["frames"].values[lit] / even["frames"].values[lit]
    assert ratio.std() == pytest.approx(0.05, rel=0.15)
    assert uneven.attrs["photons_detected"] == even.attrs["photons_detected"]


def test_dark_patterns_of_pixels_are_in_digital_numbers_and_alike_in_all_shots():
    camera = CameraConfig().ideal().model_copy(update={"sensor": SensorConfig(prnu=0.0, dsnu_e=40.0)})
    closed = np.zeros((2, 12, 12))
    how = Exposure(time_s=1.0, noise=Noise(read_noise_e=0.0, offset_dn=500.0, shot_noise=False))
    values = photograph(fine_cube((12, 12), BAND), BAND, camera, Mono(), closed, how)["frames"].values
    np.testing.assert_array_equal(values[0], values[1])
    gain = (4095 - 500) / camera.sensor.full_well_e
    assert values[0].std() == pytest.approx(40 * gain, rel=0.25)


# --- convergence -------------------------------------------------------------------------------------------------


def test_halving_the_wavelength_step_or_the_mirror_sampling_changes_the_default_photograph_by_less_than_stated():
    bands = Bands.from_edges([540, 550, 560])

    def shot(samples, parts):
        y, x, w = np.meshgrid(*((np.arange(n) + 0.5) / n for n in (6 * samples, 8 * samples, 2 * parts)), indexing="ij")
        values = (1 + 0.5 * np.sin(5 * x + 3 * y) + 0.3 * np.cos(4 * w + 2 * x)).astype(np.float32)
        cube = make_cube(values, bands.subdivide(parts))
        masks = masks_for(Mono(), 1, Distinct(), (6, 8), 3)
        return photograph(cube, bands, CameraConfig(), Mono(), masks, Exposure(time_s=1.0))["frames"].values

    usual = shot(2, 10)
    for other in (shot(2, 20), shot(4, 10)):
        assert np.linalg.norm(usual - other) < 5e-3 * np.linalg.norm(usual)
