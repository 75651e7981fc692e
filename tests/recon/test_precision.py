"""X16: float32 where it loses under 0.01 dB, float64 by itself where it would lose more, and a note that says so."""

import numpy as np
import pytest

from recon import Admm, BasisPursuit, CodedAperture, Fista, Gpsr, reconstruct

BANDS = 12


def slow(*values):
    """Mark a case that repeats what others show already."""
    return pytest.param(*values, marks=pytest.mark.slow)


def scores(psnr_of, truth, camera, frames, **settings):
    """PSNR of the solve in float64 and of the one that was asked for in float32, and whether that one took float64."""
    double = reconstruct(camera.astype(np.float64), frames, **settings)
    single = reconstruct(camera.astype(np.float32), frames, **settings)
    chosen = any("solved in float64" in note for note in single.notes)
    assert single.cube.dtype == (np.float64 if chosen else np.float32)
    return psnr_of(double.cube, truth), psnr_of(single.cube, truth), chosen


@pytest.mark.parametrize(
    ("sensor", "shots"), [("mono", 3), slow("mono", 12), ("bayer", 1), slow("bayer", 4), slow("foveon", 1), ("foveon", 4), slow("mono", 24)]
)
def test_X16_basis_pursuit_of_every_sensor_loses_under_0_01_db(sensor, shots, camera_of, cube_of, psnr_of):
    truth, camera = cube_of(32, BANDS), camera_of(sensor, shots, 32, BANDS)
    solver = BasisPursuit(tolerance=1e-4, max_iterations=1000)
    double, single, chosen = scores(psnr_of, truth, camera, camera.forward(truth), solver=solver)
    assert chosen == (np.prod(camera.out_shape) >= truth.size)
    assert single == pytest.approx(double, abs=0.01)


@pytest.mark.parametrize(("sensor", "shots"), [slow("mono", 3), ("bayer", 1), slow("foveon", 1)])
def test_X16_basis_pursuit_with_several_columns_a_band_says_that_float32_limits_it(sensor, shots, camera_of, cube_of, psnr_of):
    truth, camera = cube_of(32, BANDS), camera_of(sensor, shots, 32, BANDS, spread=True)
    frames, solver = camera.forward(truth), BasisPursuit(tolerance=1e-3)
    double, single, chosen = scores(psnr_of, truth, camera, frames, solver=solver)
    assert not chosen
    assert single == pytest.approx(double, abs=0.25)
    for dtype, limited in ((np.float32, True), (np.float64, False)):
        notes = reconstruct(camera.astype(dtype), frames, solver=solver).notes
        assert any("limited by float32" in note for note in notes) == limited


@pytest.mark.parametrize("fraction", [slow(1e-2), slow(1e-4), 2e-6, 1e-7, slow(1e-8)])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 3), slow("mono", 12), slow("bayer", 4), ("foveon", 4)])
def test_X16_eq4_loses_under_0_01_db_at_any_tau(sensor, shots, fraction, camera_of, cube_of, psnr_of):
    truth, camera = cube_of(32, BANDS), camera_of(sensor, shots, 32, BANDS)
    frames = camera.forward(truth)
    tau = fraction * reconstruct(camera, frames, tau=1e30).tau_max
    double, single, chosen = scores(psnr_of, truth, camera, frames, tau=tau, solver=Admm())
    assert chosen == (fraction < 1e-6)
    assert single == pytest.approx(double, abs=0.01)


@pytest.mark.parametrize("solver", [Fista(max_iterations=50), Gpsr(max_iterations=50)])
def test_X16_the_rule_holds_for_every_solver_of_eq4(solver, camera_of, cube_of):
    camera, truth = camera_of("mono", 2, 16, 6, dtype=np.float32), cube_of(16, 6)
    frames = camera.astype(np.float64).forward(truth)
    top = reconstruct(camera, frames, tau=1e30).tau_max
    for fraction, double in ((1e-5, False), (1e-7, True)):
        found = reconstruct(camera, frames, tau=fraction * top, solver=solver)
        assert found.cube.dtype == (np.float64 if double else np.float32)
        assert any("tau is 1.0e-07 of tau_max" in note for note in found.notes) == double
    assert reconstruct(camera, frames, tau=0.0, solver=solver).cube.dtype == np.float32


@pytest.mark.parametrize("difference", [0.3, 0.03, 0.01, 0.001])
def test_X16_masks_that_hardly_differ_are_solved_in_float64(difference, camera_of, cube_of, psnr_of):
    truth = cube_of(32, BANDS)
    masks = np.ones((2, 32, 32))
    masks[1] -= difference * np.random.Generator(np.random.Philox(0)).random((32, 32))
    camera = CodedAperture(masks, np.ones((1, BANDS)), np.arange(BANDS), np.ones((BANDS, 1)), gray=True)
    frames = camera.forward(truth)
    double, single, chosen = scores(psnr_of, truth, camera, frames)
    assert chosen == (difference in (0.03, 0.01))  # at 0.001 the difference falls below the cutoff and both leave it out
    assert single == pytest.approx(double, abs=0.01)
    if chosen:
        assert any("condition of" in note for note in reconstruct(camera.astype(np.float32), frames).notes)


@pytest.mark.parametrize("solver", [Admm(), Fista(tolerance=1e-12, max_iterations=5000), Gpsr(tolerance=1e-10)])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 16), ("foveon", 4), ("mono", 2)])
def test_X16_least_squares_loses_under_0_01_db(sensor, shots, solver, camera_of, cube_of, psnr_of):
    truth, camera = cube_of(16, 4), camera_of(sensor, shots, 16, 4)
    double, single, chosen = scores(psnr_of, truth, camera, camera.forward(truth), tau=0.0, solver=solver)
    assert chosen == (np.prod(camera.out_shape) >= truth.size)
    assert single == pytest.approx(double, abs=0.01)
