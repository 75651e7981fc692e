"""Random cameras: the gathered photograph equals the scattered one, and no photon is made or lost unseen."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from optsim.camera import CameraConfig, Distinct, Exposure, masks_for, photograph, sensors
from optsim.camera.band_model import spread_taps
from optsim.cube import Bands, make_cube

pytestmark = pytest.mark.filterwarnings("ignore:the cube.s wavelengths lie up to")


@st.composite
def cameras(draw):
    ratio = draw(st.floats(0.5, 2.5))
    focal = draw(st.floats(5.0, 200.0))
    camera = CameraConfig(
        prism={
            "outer": draw(st.sampled_from(["N-FK5", "N-BK7", "N-SK2", "N-SK16"])),
            "inner": draw(st.sampled_from(["F5", "F2", "N-SF4", "N-LASF40"])),
            "apex_inner_deg": draw(st.floats(-25.0, 25.0)),
            "design_nm": draw(st.floats(480.0, 640.0)),
            "design_position_px": draw(st.floats(-4.0, 30.0)),
        },
        relay={"collimator_mm": focal * draw(st.floats(0.7, 1.5)), "focal_mm": focal},
        dmd={"pitch_um": 9.9 * ratio},
    )
    return camera if draw(st.integers(0, 4)) == 0 else camera.ideal()  # a blur costs ten times as much


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
@given(cameras(), st.integers(1, 6), st.integers(1, 7), st.integers(2, 3), st.sampled_from(sensors()), st.integers(1, 4), st.data())
def test_gather_equals_scatter_and_light_is_conserved_for_random_cameras(camera, rows, columns, samples, sensor, shots, data):
    low = data.draw(st.floats(455.0, 600.0))
    bands = Bands.from_edges(low + np.cumsum([0, *data.draw(st.lists(st.floats(1.0, 20.0), min_size=1, max_size=3))]))
    fine = bands.subdivide(10, (bands.lower[0] - 12, bands.upper[-1] + 3))
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    cube = make_cube(rng.random((rows * samples, columns * samples, fine.count), dtype=np.float32), fine)
    masks = masks_for(sensor, shots, Distinct(), (rows, columns), 3)
    gathered = photograph(cube, bands, camera, sensor, masks, Exposure(time_s=1.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("optsim.camera.collect.kernels", lambda: None)
        scattered = photograph(cube, bands, camera, sensor, masks, Exposure(time_s=1.0))
    largest = max(scattered["frames"].values.max(), 1e-300)
    np.testing.assert_allclose(gathered["frames"].values, scattered["frames"].values, rtol=1e-10, atol=1e-12 * largest)
    for frames in (gathered, scattered):
        photons = {name.removeprefix("photons_"): value for name, value in frames.attrs.items() if name.startswith("photons_")}
        lost = photons["missed_sensor"] + photons["blocked"] + photons["reflected"] + photons["absorbed"]
        assert photons["detected"] + lost == pytest.approx(photons["sent"], rel=1e-10)
        assert all(value >= -1e-12 * photons["sent"] for value in photons.values())


@settings(max_examples=50, deadline=None, derandomize=True)
@given(cameras(), st.floats(0.3, 3.0), st.floats(455.0, 640.0), st.floats(1e-3, 25.0))
def test_taps_share_out_all_the_light_of_a_band_for_random_cameras(camera, mirror_px, low, width):
    first, taps = spread_taps(camera.dispersion, mirror_px, np.array([low]), np.array([low + width]))
    assert taps.sum() == pytest.approx(1, abs=1e-12)
    assert (taps >= 0).all()
    wavelength = low + width * (np.arange(20_000) + 0.5) / 20_000
    x, _, _ = camera.dispersion.position_px(wavelength)
    column = first[0] + np.arange(taps.shape[1])[:, None]
    overlap = np.minimum(x + mirror_px / 2, column + 0.5) - np.maximum(x - mirror_px / 2, column - 0.5)
    judge = (np.clip(overlap, 0, None) / mirror_px) @ (wavelength / wavelength.sum())
    np.testing.assert_allclose(taps[0], judge, atol=2e-5 + 1e-3 * np.ptp(x) / 64)
