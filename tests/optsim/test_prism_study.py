"""The prism's study against closed forms, finite differences of the traced prism and quantiles of the normal law."""

import json

import numpy as np
import pytest

from optsim.camera import CameraConfig, plot_prism, prism_report
from optsim.camera.calibrate import Tolerances
from optsim.camera.prism_study import sensitivity, smile, study, told_apart, unstretched
from optsim.camera.prism_tolerance import summary, tolerance_study
from optsim.errors import InputError

CAMERA = CameraConfig()
NM = np.linspace(450, 670, 23)
ANCHOR = "\ndesign_nm = 650.0\ndesign_position_px = 0.0"
BY_FACES = """
[prism]
glasses = ["N-FK5", "F5", "N-FK5"]
face_tilt_deg = [{}, {}, {}, {}]
design_nm = 550.0
design_position_px = 14.5451
[relay]
focal_mm = {}
"""


def by_faces(apexes, tilt=0.0, focal=100.0):
    """Return the default prism with other wedge angles, its middle wedge's bisector across the axis turned by tilt."""
    a1, a2, a3 = apexes
    faces = [(a1 + a2 + a3) / 2, (-a1 + a2 + a3) / 2, (-a1 - a2 + a3) / 2, (-a1 - a2 - a3) / 2]
    return CameraConfig.parse_toml(BY_FACES.format(*(f + tilt for f in faces), focal))


def test_the_smile_grows_as_the_square_of_the_height_and_falls_with_the_focal_length():
    one, two = smile(CAMERA, NM, (256, 256)), smile(CAMERA, NM, (512, 512))
    np.testing.assert_allclose(two["smile_px"], 4 * np.array(one["smile_px"]), rtol=1e-3)
    assert one["Y_mm"] == pytest.approx(128 * 0.01368)
    assert max(one["smile_px"]) < 0.007
    flat = smile(CAMERA.model_copy(update={"prism": CAMERA.prism.model_copy(update={"field": False})}), NM)
    assert np.abs(flat["smile_px"]).max() < 1e-12


def test_sensitivities_are_differences_of_traced_prisms():
    found = sensitivity(CAMERA, NM)
    prism = CAMERA.dispersion
    a1, a2 = np.degrees(prism.apex_outer_rad), -np.degrees(prism.apex_inner_rad)
    changes = {
        "apex_1_deg": (1e-3, lambda d: by_faces((a1 + d, a2, a1))),
        "apex_2_deg": (1e-3, lambda d: by_faces((a1, a2 + d, a1))),
        "tilt_deg": (1e-3, lambda d: by_faces((a1, a2, a1), tilt=d)),
        "focal_mm": (1e-2, lambda d: by_faces((a1, a2, a1), focal=100 + d)),
    }
    for name, (step, build) in changes.items():
        above, below = (build(sign * step).dispersion.chief(NM).position_mm for sign in (1, -1))
        expected = (above - below) / (2 * step) / 0.0099
        np.testing.assert_allclose(found["px_per_unit"][found["names"].index(name)], expected, atol=1e-5 * np.abs(expected).max() + 1e-6)
    assert not {"collimator_mm", "scale"} & set(found["names"])


def test_focal_length_only_stretches_the_spectrum():
    found = sensitivity(CAMERA, NM)
    k = found["names"].index("focal_mm")
    assert found["bend_px"][k] < 1e-9
    assert found["stretch_px"][k] == pytest.approx(0.01 * 24.885, rel=1e-3)


def test_what_a_shift_and_a_stretch_leave_of_a_parabola_is_orthogonal_to_both():
    x = np.linspace(-1, 2, 40)
    left = unstretched(np.stack([3 + 2 * x, x**2]), x)
    assert np.abs(left[0]).max() < 1e-12
    assert abs(left[1].sum()) < 1e-9
    assert abs(left[1] @ x) < 1e-9
    assert np.abs(left[1]).max() > 0.1


def test_five_combinations_are_told_apart_and_registration_is_four_of_them():
    rows = told_apart(CAMERA)["combinations"]
    apart = [row for row in rows if row["told_apart"]]
    assert len(apart) == 5
    assert {next(iter(row["parts"])) for row in apart[:4]} == {"offset_x_px", "offset_y_px", "rotation_deg", "scale"}
    finer = told_apart(CAMERA, sigma_px=0.001)["combinations"]
    assert sum(row["told_apart"] for row in finer) > 5


def test_spots_tell_the_focal_length_only_if_the_angles_are_known():
    def known(apex_deg):
        rows = told_apart(CAMERA, tolerances=Tolerances(apex_deg=apex_deg, index=1e-9, dispersion=1e-9))["combinations"]
        return [row["told_apart"] for row in rows if abs(row["parts"].get("focal_mm", 0)) > 0.9]

    assert known(1e-3) == [True]
    assert known(1.0) == [False]


def test_monte_carlo_of_small_tolerances_is_the_linear_prediction():
    small = Tolerances(apex_deg=1e-4, tilt_deg=1e-4, focal=1e-5, index=1e-6, dispersion=1e-5)
    found = tolerance_study(CAMERA, NM, draws=20_000, tolerances=small)
    assert found["linear_ratio"] == pytest.approx(1, abs=0.02)
    assert found["lost"] == 0
    low, middle, high = found["length_px"]["quantile"]
    assert high - middle == pytest.approx(middle - low, rel=0.1)


def test_focal_length_alone_stretches_by_its_own_normal_law():
    one = Tolerances(apex_deg=1e-12, tilt_deg=1e-12, focal=0.01, index=1e-15, dispersion=1e-15)
    found = tolerance_study(CAMERA, NM, draws=4000, tolerances=one)
    drawn = found["length_px"]["drawn"]
    for k, deviation in enumerate((-1.959964, 0.0, 1.959964)):
        expected = drawn * (1 + 0.01 * deviation)
        assert found["length_px"]["low"][k] <= expected <= found["length_px"]["high"][k]
    assert found["bent_rms_px"]["quantile"][2] < 1e-9


def test_intervals_of_quantiles_hold_the_true_quantile_in_95_of_100_samples():
    rng = np.random.default_rng(0)
    held = np.zeros(3)
    for _ in range(1000):
        found = summary(rng.standard_normal(400))
        held += [low <= true <= high for low, true, high in zip(found["low"], (-1.959964, 0, 1.959964), found["high"])]
    assert np.all(held > 925)
    assert np.all(held < 990)


def test_prisms_near_total_reflection_are_counted_as_lost():
    steep = CameraConfig.parse_toml(
        '[prism]\nglasses = ["N-SF10"]\nface_tilt_deg = [0.0, 34.2]\ndesign_nm = 650.0\ndesign_position_px = 0.0'
    )
    found = tolerance_study(steep, np.array([445.0, 550.0, 650.0]), draws=400, tolerances=Tolerances(apex_deg=0.5))
    assert 0 < found["lost"] < 1
    json.dumps(found, allow_nan=False)


def test_misuse_of_the_tolerance_study_is_refused():
    for wrong in ({"draws": 10}, {"seed": -1}):
        with pytest.raises(InputError, match="--"):
            tolerance_study(CAMERA, NM, **wrong)
    with pytest.raises(InputError, match="three increasing"):
        tolerance_study(CAMERA, NM[::-1])
    with pytest.raises(InputError, match="traced prism"):
        sensitivity(CameraConfig.parse_toml("[table]"), NM)


def test_the_whole_study_is_plain_json_and_is_drawn_with_units(tmp_path):
    for camera in (CAMERA, CameraConfig.parse_toml("[table]")):
        report = {**prism_report(camera.dispersion), **study(camera, draws=200)}
        assert json.loads(json.dumps(report, allow_nan=False)) == report
        plot_prism(report, tmp_path / "study.svg")
        assert (report["tolerance"] is None) == (camera.table is not None)
    assert (tmp_path / "study.svg").stat().st_size > 10_000
