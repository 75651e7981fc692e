"""Calibration against the whole optical path, finite differences, the Cramer-Rao bound and SciPy's least squares."""

import numpy as np
import pytest
from scipy.optimize import least_squares as scipy_least_squares

from optsim.camera import CameraConfig
from optsim.camera.arrays import kernels
from optsim.camera.calibrate import Spots, calibrate, prism_model, simulate_spots, spot_grid
from optsim.camera.calibrate.fitted_camera import fitted_camera
from optsim.camera.calibrate.jacobian import complex_step_jacobian, jacobian
from optsim.camera.calibrate.levenberg import least_squares
from optsim.errors import InputError

CAMERA = CameraConfig()
STACK = """
[prism]
glasses = ["N-SK2", "air", "N-SF10", "N-SK2"]
face_tilt_deg = [5.1, -10.0, -9.0, 14.0, -5.5]
[relay]
collimator_mm = 69.1
focal_mm = 50.0
"""
GRID = spot_grid(CAMERA, 24, (256, 256))
NM = np.linspace(452, 668, 24)
SUBSET = ("apex_1_deg", "apex_2_deg", "offset_x_px", "offset_y_px", "rotation_deg", "scale")


def built(seed, camera=CAMERA):
    model = prism_model(camera)
    return model, model.drawn + model.tolerance * np.random.default_rng(seed).standard_normal(model.drawn.size)


def measured(x, y, sigma, seed):
    rng = np.random.Generator(np.random.Philox(seed))
    error = np.full(x.size, sigma)
    return Spots(*GRID, x + sigma * rng.standard_normal(x.size), y + sigma * rng.standard_normal(x.size), error, error)


def optics_jacobian(model, values, rays, names, camera=CAMERA, step=1e-3):
    """Differentiate the camera's own optical path, built anew for every value, by central differences."""

    def place(v):
        x, y, _ = fitted_camera(model, v, camera).optics.position_px(*rays)
        return np.concatenate([x, y])

    columns = []
    for name in names:
        k = model.index_of[name]
        move = np.zeros(values.size)
        move[k] = step * model.tolerance[k]
        wide = (place(values + move) - place(values - move)) / 2
        columns.append(wide / move[k])
    return np.stack(columns, axis=1)


# --- the model --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["", STACK, "[dmd]\noffset_x_px = 3.5\noffset_y_px = -2.0\nrotation_deg = 0.4\nscale = 1.02"])
def test_the_drawn_model_lands_where_the_cameras_optics_land(text):
    camera = CameraConfig.parse_toml(text)
    model = prism_model(camera)
    expected = camera.optics.position_px(*GRID)
    for registered in (True, False):
        at = prism_model(camera, registered=registered).at(model.drawn, *GRID)
        np.testing.assert_allclose(at[0], expected[0], atol=1e-9)
        np.testing.assert_allclose(at[1], expected[1], atol=1e-9)


def test_a_built_camera_written_as_a_file_lands_where_the_model_puts_it():
    model, values = built(4)
    camera = CameraConfig.parse_toml(fitted_camera(model, values, CAMERA).to_toml())
    for axis in (0, 1):
        np.testing.assert_allclose(camera.optics.position_px(*GRID)[axis], model.at(values, *GRID)[axis], atol=2e-6)


def test_forward_mode_derivatives_are_differences_of_the_optical_path():
    model, values = built(1)
    at = jacobian(model, values, *GRID)
    expected = optics_jacobian(model, values, GRID, model.names)
    found = np.concatenate([at.dx, at.dy])
    scale = np.abs(expected).max(0) + 1e-3 / model.tolerance
    assert np.all(np.abs(found - expected) < 2e-4 * scale)


def test_forward_mode_and_complex_steps_agree_to_rounding():
    model, values = built(2, CameraConfig.parse_toml(STACK))
    one, two = jacobian(model, values, *GRID), complex_step_jacobian(model, values, *GRID)
    for a, b in ((one.dx, two.dx), (one.dy, two.dy)):
        np.testing.assert_allclose(a, b, atol=1e-10 * np.abs(b).max(0).max())
    np.testing.assert_array_equal(one.valid, two.valid)


def test_a_new_value_compiles_no_kernel():
    k = kernels()
    if k is None:
        pytest.skip("needs a usable libLLVM")
    model, values = built(1)
    jacobian(model, values, *GRID)
    with k.dr.scoped_set_flag(k.dr.JitFlag.KernelHistory, True):
        for seed in range(4):
            jacobian(model, built(seed)[1], *GRID)
        history = [entry for entry in k.dr.kernel_history() if "cache_hit" in entry]
        k.dr.kernel_history_clear()
    assert len(history) >= 4
    assert all(entry["cache_hit"] for entry in history)


def test_P16_derivatives_beyond_total_reflection_are_zero_and_finite():
    model = prism_model(CameraConfig())
    lost = prism_model(CameraConfig.parse_toml('[prism]\nglasses = ["N-SF10"]\nface_tilt_deg = [0.0, 30.0]'))
    values = lost.drawn.copy()
    values[lost.index_of["apex_1_deg"]] = -60.0
    at = jacobian(lost, values, NM, 0 * NM, 0 * NM)
    assert not at.valid.any()
    for values in (at.dx, at.dy, at.x_px):
        assert np.all(values == 0)
    assert np.isfinite(jacobian(model, model.drawn, *GRID).dx).all()


# --- the fit ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])
def test_without_noise_the_curve_is_found_within_1e_9_px(seed):
    simulated = simulate_spots(CAMERA, noise_px=0.0, seed=seed)
    found = calibrate(CAMERA, simulated.spots)
    assert found.minimum.converged
    assert np.abs(found.curve(NM).x_px - simulated.truth.position_px(NM)[0]).max() < 1e-9


def test_over_200_seeds_the_curve_varies_by_the_cramer_rao_bound_and_intervals_cover():
    coverage_and_bound(range(200), ratio=0.1, cover=(0.93, 0.97))


@pytest.mark.slow
def test_over_1000_seeds_the_curve_varies_by_the_cramer_rao_bound_and_intervals_cover():
    coverage_and_bound(range(1000, 2000), ratio=0.06, cover=(0.935, 0.965))


def coverage_and_bound(seeds, ratio, cover, sigma=0.1):
    model, values = built(7)
    (x, y, _), truth = model.at(values, *GRID), model.at(values, NM, 0, 0)[0]
    missed, stated = [], []
    for seed in seeds:
        found = calibrate(CAMERA, measured(x, y, sigma, seed))
        curve = found.curve(NM)
        missed.append(curve.x_px - truth)
        stated.append(curve.sigma_x_px)
    moved, spread = found.split.basis, np.array(missed).var(0).mean()
    spots = optics_jacobian(model, values, GRID, model.names) @ moved / sigma
    along = optics_jacobian(model, values, (NM, 0 * NM, 0 * NM), model.names)[: NM.size] @ moved
    bound = np.einsum("ij,jk,ik->i", along, np.linalg.inv(spots.T @ spots), along).mean()
    assert abs(spread / bound - 1) < ratio
    assert cover[0] <= np.mean(np.abs(missed) < 1.96 * np.array(stated)) <= cover[1]


def test_scipys_least_squares_finds_the_same_curve():
    model, values = built(3)
    x, y, _ = model.at(values, *GRID)
    spots = measured(x, y, 0.1, 5)
    places = [model.index_of[name] for name in SUBSET]

    def residual(q):
        at = fitted_camera(model, _put(model.drawn, places, q * model.tolerance[places]), CAMERA).optics.position_px(*GRID)
        return np.concatenate([at[0] - spots.x_px, at[1] - spots.y_px]) / 0.1

    other = scipy_least_squares(residual, np.zeros(len(places)), method="lm", xtol=1e-12, ftol=1e-14)
    theirs = model.at(_put(model.drawn, places, other.x * model.tolerance[places]), NM, 0, 0)[0]
    mine = calibrate(CAMERA, spots, free=SUBSET, combinations=len(SUBSET))
    np.testing.assert_allclose(mine.curve(NM).x_px, theirs, atol=2e-5)
    assert mine.chi2 <= 2 * other.cost * (1 + 1e-9)


def _put(values, places, change):
    moved = values.copy()
    moved[places] += change
    return moved


def test_errors_that_are_not_given_come_from_the_misfit():
    simulated = simulate_spots(CAMERA, noise_px=0.05, seed=3).spots
    found = calibrate(CAMERA, Spots(*(getattr(simulated, n) for n in ("wavelength_nm", "X_mm", "Y_mm", "x_px", "y_px"))))
    assert found.sigma[0] == pytest.approx(0.05, rel=0.1)
    assert found.p_value is None
    assert found.as_dict()["sigma_from"] == "misfit"


def test_registration_is_told_apart_from_prism_and_lenses():
    found = calibrate(CAMERA, simulate_spots(CAMERA, 0.1, seed=2).spots)
    assert {"offset_x_px", "offset_y_px", "rotation_deg", "scale"} <= set(found.as_dict()["identifiable"])
    for name in ("offset_x_px", "offset_y_px", "rotation_deg", "scale"):
        assert abs(found.correlation(name, "apex_1_deg")) < 0.6
    blind = found.split.describe()[-1]
    assert blind["parts"] == {"collimator_mm": 1.0}
    assert blind["std_in_tolerances"] is None


def test_the_collimator_is_named_as_what_spots_of_the_whole_field_cannot_tell():
    rows = calibrate(CAMERA, simulate_spots(CAMERA, 0.1, seed=2).spots).as_dict()["combinations"]
    assert [row["told_apart"] for row in rows] == sorted((row["told_apart"] for row in rows), reverse=True)
    assert sum(row["told_apart"] for row in rows) == 5
    assert np.all(np.diff([row["std_in_tolerances"] for row in rows[:-1]]) > 0)


def test_a_model_that_cannot_fit_is_betrayed_by_its_p_value():
    model, values = built(7)
    values[model.index_of["focal_mm"]] *= 1.05
    x, y, _ = model.at(values, *GRID)
    spots = measured(x, y, 0.1, 1)
    assert calibrate(CAMERA, spots, free=("offset_x_px", "offset_y_px", "rotation_deg", "scale")).p_value < 1e-12
    assert calibrate(CAMERA, spots).p_value > 1e-3


@pytest.mark.parametrize("text", ["[relay]\ndistortion_per_mm2 = 1e-4\n[dmd]\ntilt_deg = 24.0", "[relay]\nconverging = true", STACK])
def test_tilted_distorting_converging_and_air_spaced_cameras_are_calibrated(text):
    camera = CameraConfig.parse_toml(text)
    simulated = simulate_spots(camera, noise_px=0.05, seed=1)
    found = calibrate(camera, simulated.spots)
    assert found.minimum.converged
    assert found.p_value > 1e-3
    rays = simulated.spots.wavelength_nm, simulated.spots.X_mm, simulated.spots.Y_mm
    missed = found.curve(*rays).x_px - simulated.truth.position_px(*rays)[0]
    assert np.abs(missed).max() < 5 * found.curve(*rays).sigma_x_px.max()
    np.testing.assert_allclose(found.fitted_camera.optics.position_px(*rays)[0], found.map.position_px(*rays)[0], atol=2e-5)


def test_the_map_inverts_and_passes_what_the_prism_passes():
    found = calibrate(CAMERA, simulate_spots(CAMERA, 0.1, seed=2).spots)
    np.testing.assert_allclose(found.map.position_px(found.map.wavelength_at([1.0, 12.0, 23.0]))[0], [1, 12, 23], atol=1e-8)
    np.testing.assert_allclose(found.map.transmission(NM), CAMERA.dispersion.transmission(NM), atol=1e-3)
    assert found.map.magnification_px == pytest.approx(found.fitted_camera.optics.magnification_px)


# --- refusals ---------------------------------------------------------------------------------------------------


def test_what_cannot_be_fitted_is_refused():
    spots = simulate_spots(CAMERA, 0.1, seed=2).spots
    with pytest.raises(InputError, match="a traced prism"):
        calibrate(CameraConfig.parse_toml("[table]"), spots)
    with pytest.raises(InputError, match="free: must be one of"):
        calibrate(CAMERA, spots, free=("apex",))
    with pytest.raises(InputError, match="wavelength_nm"):
        calibrate(CAMERA, Spots(np.array([100.0]), *(np.zeros(1) for _ in range(4))))
    with pytest.raises(InputError, match="at least"):
        calibrate(CAMERA, Spots(*(a[:2] for a in GRID), np.zeros(2), np.zeros(2)), combinations=6)


# --- the search -------------------------------------------------------------------------------------------------


def test_a_linear_problem_is_solved_as_by_dense_least_squares():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((30, 5)), rng.standard_normal(30)
    found = least_squares(lambda q: a @ q - b, lambda q: a, np.zeros(5))
    np.testing.assert_allclose(found.at, np.linalg.lstsq(a, b, rcond=None)[0], atol=1e-9)
    assert found.converged


def test_the_search_follows_rosenbrocks_valley_and_avoids_places_without_a_value():
    def residual(q):
        x, y = q
        return None if x > 1.5 else np.array([10 * (y - x * x), 1 - x])

    def derivative(q):
        return np.array([[-20 * q[0], 10.0], [-1.0, 0.0]])

    found = least_squares(residual, derivative, np.array([-1.2, 1.0]))
    np.testing.assert_allclose(found.at, [1, 1], atol=1e-7)
    lost = least_squares(residual, derivative, np.array([2.0, 0.0]))
    assert not lost.converged
    assert "no value" in lost.reason
