"""The discrete model against the dense formula, quadrature, and the paper's own special case."""

import numpy as np
import pytest
from scipy.integrate import quad

from optsim.camera import (
    Bayer,
    BayerPhase,
    CameraConfig,
    CenterTable,
    Distinct,
    Exact,
    Foveon,
    Mono,
    Noise,
    Quattro,
    Relay,
    UnitShift,
    band_model_of,
    check_frames,
    masks_for,
    matched_model,
    measure_matched,
    physical_model,
    sensors,
    signal_of,
    with_unit_shifts,
)
from optsim.camera.band_model import spread_taps
from optsim.camera.frames import make_frames
from optsim.cube import Bands, make_cube
from optsim.errors import InputError

PAPER = Bands.paper()
ONE_TO_ONE = Relay(collimator_mm=138.2, focal_mm=138.2 * 9.9 / 13.68)
ALL = (*sensors(), Bayer.nikon(BayerPhase.GBRG))


def cube_of(size, bands, seed=0):
    return make_cube(np.random.default_rng(seed).random((*size, bands.count)), bands)


@pytest.mark.parametrize("sensor", ALL, ids=["mono", "bayer", "foveon", "bayer-gbrg"])
@pytest.mark.parametrize("shots", [1, 3])
def test_matched_frames_are_the_papers_formula_entry_by_entry(sensor, shots):
    bands = Bands.from_edges([460, 480, 520, 560, 610])
    size = (6, 5)
    masks = masks_for(sensor, shots, Distinct(), size, 3)
    cube = cube_of(size, bands)
    frames = measure_matched(cube, sensor, masks)
    f = cube["radiance"].values
    expected = np.zeros((shots, sensor.channels, 6, 8))
    for c, curve in enumerate(sensor.curves):
        for k in range(4):
            nodes = curve.wavelength_nm[(curve.wavelength_nm > bands.lower[k]) & (curve.wavelength_nm < bands.upper[k])]
            chi = quad(
                lambda x, s=curve: np.interp(x, s.wavelength_nm, s.value),
                bands.lower[k],
                bands.upper[k],
                points=nodes if nodes.size else None,
            )[0] / (bands.upper[k] - bands.lower[k])
            for l in range(shots):
                for m in range(6):
                    for n in range(5):
                        j = n + k
                        light = chi * masks[l, m, n] * f[m, n, k]
                        if sensor.name == "bayer":
                            letter = sensor.phase.name[2 * (m % 2) + j % 2]
                            expected[l, 0, m, j] += light * (letter == "RGB"[c])
                        else:
                            expected[l, c, m, j] += light
    np.testing.assert_allclose(frames["frames"].values, expected, rtol=1e-10, atol=1e-14)
    assert frames.attrs["units"] == "relative"
    assert frames.attrs["model"] == "matched"


def test_the_frame_has_n_plus_k_minus_1_columns_for_the_paper_bands_in_every_model():
    masks = np.ones((1, 4, 9))
    for model in (
        matched_model(Mono(), PAPER, masks),
        physical_model(CameraConfig(), Mono(), PAPER, masks),
        physical_model(CameraConfig(table={}), Mono(), PAPER, masks),
    ):
        assert model.width == 9 + 23


@pytest.mark.parametrize(("edges", "reach"), [((453.84, 670.0), 23), ((500, 600), 19), ((455, 456), 0), ((450, 452), 0)])
def test_the_frame_ends_with_the_pixel_in_which_the_last_band_ends(edges, reach):
    assert physical_model(CameraConfig(), Mono(), Bands.from_edges(list(edges)), np.ones((1, 2, 8))).width == 8 + reach


def test_D2_closed_mirrors_measure_nothing():
    frames = measure_matched(cube_of((4, 5), PAPER), Foveon.sigma(), np.zeros((2, 4, 5)))
    assert frames["frames"].shape == (2, 3, 4, 28)
    assert (frames["frames"].values == 0).all()


def test_D3_one_open_mirror_is_its_column_of_the_dense_h():
    bands = Bands.from_edges([460, 500, 560, 610])
    cube = make_cube(np.ones((4, 5, 3)), bands)
    one = np.zeros((1, 4, 5))
    one[0, 2, 3] = 1
    dense = matched_model(Bayer.nikon(), bands, np.ones((1, 4, 5))).operator(np.float64).dense()
    columns = [(k * 5 + 3) * 4 + 2 for k in range(3)]
    expected = dense[:, columns].sum(1).reshape(7, 4).T
    np.testing.assert_allclose(measure_matched(cube, Bayer.nikon(), one)["frames"].values[0, 0], expected, rtol=1e-14)


def test_D1_D4_masks_add_and_all_open_is_the_camera_without_mask():
    cube = cube_of((6, 7), PAPER)
    masks = masks_for(Mono(), 1, Distinct(), (6, 7), 1)
    parts = [measure_matched(cube, Mono(), m)["frames"].values for m in (masks, 1 - masks, np.ones_like(masks))]
    np.testing.assert_allclose(parts[0] + parts[1], parts[2], rtol=1e-12)
    f = cube["radiance"].values
    shifted = sum(np.pad(f[:, :, k], ((0, 0), (k, 23 - k))) for k in range(24))
    np.testing.assert_allclose(parts[2][0, 0], shifted, rtol=1e-12)


def test_D8_a_mask_of_another_size_is_refused():
    with pytest.raises(InputError, match="masks"):
        measure_matched(cube_of((4, 5), PAPER), Mono(), np.ones((1, 5, 4)))


def test_S1_bands_that_a_curve_does_not_cover_are_refused():
    bands = Bands.from_edges([600, 650, 700])
    with pytest.raises(InputError, match="missing: 680-700 nm"):
        matched_model(Foveon.sigma(), bands, np.ones((1, 2, 2)))
    with pytest.raises(InputError, match="missing: 680-690 nm"):
        physical_model(CameraConfig(bandpass={"upper_nm": 690.0}), Foveon.sigma(), bands, np.ones((1, 2, 2)))


def test_S9_three_mono_shots_are_set_against_one_colour_shot():
    mono, bayer, foveon = sensors()
    assert mono.shots_per_group / bayer.shots_per_group == mono.shots_per_group / foveon.shots_per_group == 3


# --- taps ------------------------------------------------------------------------------------------------------


def test_a_band_one_pixel_wide_on_a_pixels_centre_spreads_as_an_eighth_three_quarters_an_eighth():
    table = CenterTable(centers_nm=tuple(np.arange(4000.0, 4011.0)), relay=ONE_TO_ONE)  # far red: photons hardly vary
    first, taps = spread_taps(table, 1.0, np.array([4004.5]), np.array([4005.5]))
    assert first.tolist() == [4]
    np.testing.assert_allclose(taps, [[1 / 8, 3 / 4, 1 / 8]], atol=5e-5)


@pytest.mark.parametrize("mirror_px", [1.0, 0.7, 1.6])
def test_taps_are_the_photons_that_fall_on_each_column(mirror_px):
    camera = CameraConfig(relay=Relay(collimator_mm=138.2, focal_mm=100.0))
    lower, upper = PAPER.lower, np.minimum(PAPER.upper, 670)
    first, taps = spread_taps(camera.dispersion, mirror_px, lower, upper)
    for k in (0, 7, 23):
        photons = (upper[k] ** 2 - lower[k] ** 2) / 2
        for t in range(taps.shape[1]):
            column = first[k] + t

            def light(wavelength, column=column):
                x = float(camera.dispersion.position_px(wavelength)[0])
                overlap = min(x + mirror_px / 2, column + 0.5) - max(x - mirror_px / 2, column - 0.5)
                return wavelength * max(0.0, overlap) / mirror_px

            expected = quad(light, lower[k], upper[k], limit=200, epsabs=1e-9)[0] / photons
            assert taps[k, t] == pytest.approx(expected, abs=3e-6)
    np.testing.assert_allclose(taps.sum(1), 1, atol=1e-12)
    assert (taps >= 0).all()


def test_P4_a_prism_without_dispersion_lays_every_band_on_its_own_mirrors_column():
    camera = CameraConfig.parse_toml("[prism]\nouter = 'N-BK7'\ninner = 'N-BK7'\napex_outer_deg = 0\napex_inner_deg = 0")
    first, taps = spread_taps(camera.dispersion, 1.0, PAPER.lower, PAPER.upper)
    column = first[:, None] + np.arange(taps.shape[1])
    np.testing.assert_allclose(np.where(column == 0, taps, 0).sum(1), 1, atol=1e-9)
    model = physical_model(camera, Mono(), PAPER, np.ones((1, 3, 4)))
    assert model.width == 4
    cube = cube_of((3, 4), PAPER)
    g = model.operator(np.float64).forward(cube["radiance"].values)
    np.testing.assert_allclose(g[0, 0], (cube["radiance"].values * model.response[0]).sum(2), rtol=1e-9)


def test_P5_a_band_that_the_prism_loses_has_weight_0():
    class Lost(CenterTable):
        def position_px(self, wavelength_nm, X_mm=0.0, Y_mm=0.0):
            x, y, valid = super().position_px(wavelength_nm, X_mm, Y_mm)
            return x, y, valid & (np.asarray(wavelength_nm) > 500)

    _, taps = spread_taps(Lost(relay=ONE_TO_ONE), 1.0, PAPER.lower, PAPER.upper)
    total = taps.sum(1)
    assert (total[:8] == 0).all()
    assert 0 < total[8] < 1
    np.testing.assert_allclose(total[9:], 1, atol=1e-12)
    assert np.isfinite(taps).all()


# --- responses and frames --------------------------------------------------------------------------------------


def test_a_flat_sensors_response_is_its_closed_form_in_electrons():
    camera = CameraConfig().ideal()
    model = physical_model(camera, Mono(), PAPER, np.ones((1, 2, 2)), exposure_s=0.3)
    per_nm2 = 0.3 * (13.68e-6) ** 2 * 0.92 * np.pi / 256 * 1e-9 / (6.62607015e-34 * 299792458.0)
    np.testing.assert_allclose(model.response[0], per_nm2 * (PAPER.upper**2 - PAPER.lower**2) / 2, rtol=1e-13)


def test_bands_outside_the_band_pass_are_refused_and_cut_ones_lose_their_share():
    with pytest.raises(InputError, match="band-pass 450-670 nm"):
        physical_model(CameraConfig(), Mono(), Bands.from_edges([430, 440, 460]), np.ones((1, 2, 2)))
    cut = physical_model(CameraConfig(), Mono(), Bands.from_edges([440, 460]), np.ones((1, 2, 2))).response
    whole = physical_model(CameraConfig(), Mono(), Bands.from_edges([450, 460]), np.ones((1, 2, 2))).response
    np.testing.assert_allclose(cut, whole, rtol=1e-14)


def test_unit_shifts_change_columns_only():
    masks = np.ones((1, 3, 4))
    own, unit = (physical_model(CameraConfig(), Foveon.sigma(), PAPER, masks, s) for s in (None, UnitShift()))
    np.testing.assert_array_equal(own.response, unit.response)
    assert unit.first_column.tolist() == list(range(24))
    assert unit.taps.tolist() == [[1.0]] * 24
    assert own.taps.shape == (24, 3)


def test_a_strangers_copy_of_the_file_reconstructs_the_same_operator(tmp_path):
    import xarray as xr

    masks = masks_for(Mono(), 2, Distinct(), (6, 5), 1)
    for sensor in sensors():
        cube = cube_of((6, 5), PAPER)
        frames = measure_matched(cube, sensor, masks, seed=1)
        frames.to_netcdf(tmp_path / "frames.nc", engine="h5netcdf")
        with xr.open_dataset(tmp_path / "frames.nc", engine="h5netcdf") as file:
            again = file.load()
        check_frames(again)
        forward = band_model_of(again).operator(np.float64).forward(cube["radiance"].values)
        np.testing.assert_allclose(forward, signal_of(frames), rtol=1e-14)
        unit = with_unit_shifts(again)
        check_frames(unit)
        assert band_model_of(unit).operator(np.float64).forward(cube["radiance"].values) == pytest.approx(forward)


def test_noisy_matched_frames_come_back_in_the_cubes_units():
    cube = cube_of((40, 40), PAPER)
    masks = masks_for(Mono(), 3, Distinct(), (40, 40), 0)
    frames = measure_matched(cube, Mono(), masks, noise=Noise(bits=16, offset_dn=500.0, read_noise_e=5.0), seed=2)
    mean = band_model_of(frames).operator(np.float64).forward(cube["radiance"].values)
    gain = frames.attrs["gain"]
    assert mean.max() == pytest.approx(0.9 * 20_000 * gain, rel=1e-12)
    z = (signal_of(frames) - mean) / np.sqrt(gain * mean + (5 * gain) ** 2 + 1 / 12)
    assert abs(z.mean()) < 4 / np.sqrt(z.size)
    assert abs(z.var() - 1) < 4 * np.sqrt(2 / z.size)
    assert frames.attrs["units"] == "DN"


def test_broken_files_are_refused_by_variable():
    frames = measure_matched(cube_of((4, 5), PAPER), Mono(), np.ones((1, 4, 5)))
    with pytest.raises(InputError, match="mask"):
        check_frames(frames.drop_vars("mask"))
    with pytest.raises(InputError, match="format"):
        check_frames(frames.assign_attrs(format="other"))
    with pytest.raises(InputError, match="units"):
        check_frames(frames.assign_attrs(units="volt"))
    bad = frames.copy(deep=True)
    bad["frames"].values[0, 0, 1, 2] = np.nan
    with pytest.raises(InputError, match=r"\(0, 0, 1, 2\)"):
        check_frames(bad)


def _full_frames(sensor, seed=3):
    """Frames that the camera's own H makes, with everything in it."""
    camera = CameraConfig(dmd={"rotation_deg": 2.0}, sensor={"crosstalk": 0.03})
    bands = Bands.from_edges([470, 480, 560, 580])
    masks = masks_for(sensor, 2, Distinct(), (9, 8), seed)
    model = physical_model(camera, sensor, bands, masks, Exact())
    cube = np.random.default_rng(seed).random((9, 8, 3))
    return make_frames(
        model.operator(np.float64).forward(cube), model, {"units": "electron", "model": "physical", "masks": "distinct"}
    ), cube


@pytest.mark.parametrize("sensor", [Mono(), Bayer.nikon(), Quattro.physical()], ids=["mono", "bayer", "quattro"])
def test_a_file_of_the_full_h_gives_a_stranger_the_same_operator(tmp_path, sensor):
    from optsim.files import read, write

    frames, cube = _full_frames(sensor)
    assert {"first_row", "mirror", "pixel_gain"} < set(frames.data_vars)
    write(frames, tmp_path / "frames.nc")
    again = read(tmp_path / "frames.nc")
    np.testing.assert_allclose(band_model_of(again).operator(np.float64).forward(cube), frames["frames"].values, rtol=1e-14)
    unit = band_model_of(with_unit_shifts(again))
    assert unit.mirrors is unit.gain is unit.first_row is None
    assert unit.operator(np.float64).forward(cube).shape == frames["frames"].shape


def test_files_of_format_1_are_still_read():
    frames = measure_matched(cube_of((4, 5), PAPER), Mono(), np.ones((1, 4, 5)))
    old = frames.assign_attrs(format="optsim-frames-1")
    del old.attrs["crosstalk"]
    cube = np.random.default_rng(0).random((4, 5, 24))
    np.testing.assert_array_equal(
        band_model_of(old).operator(np.float64).forward(cube), band_model_of(frames).operator(np.float64).forward(cube)
    )
