"""Error estimates: closed form where there is one, coverage against the truth elsewhere."""

import numpy as np
import pytest

from recon import Admm, CodedAperture, InputError, reconstruct
from recon.tau import Discrepancy, Given
from recon.uncertainty import Displaced, ErrorEstimate, estimate_error


def covered(estimate: ErrorEstimate, truth: np.ndarray, level: float) -> float:
    return float((np.abs(estimate.solution.cube - truth) <= estimate.half_width(level)).mean())


def test_of_plain_least_squares_the_error_is_that_of_the_noise():
    # Three masks that see every mirror twice, one band: each voxel is the mean of two measurements.
    rng = np.random.Generator(np.random.Philox(4))
    closed = rng.integers(0, 3, (24, 24))
    masks = (np.arange(3)[:, None, None] != closed).astype(float)
    camera = CodedAperture(masks, np.ones((1, 1)), np.arange(1), np.ones((1, 1)), dtype=np.float64)
    truth, sigma = rng.uniform(0.3, 1, (24, 24, 1)), np.full((3, 1, 24, 24), 0.02)
    sigma[:, :, :12] = 0.1
    frames = camera.forward(truth) + sigma * rng.standard_normal(sigma.shape)
    how = Displaced(repeats=16, reach=0.05, share=0.01)
    estimate = estimate_error(camera, frames, Given(noise=sigma**2), solver=Admm(), tau=0.0, how=how)
    for rows, level in ((slice(1, 10), 0.1), (slice(14, 23), 0.02)):
        assert np.median(estimate.error[rows] / estimate.scale) == pytest.approx(level / np.sqrt(2), rel=0.1)


@pytest.mark.parametrize(("sensor", "shots"), [("mono", 3), ("bayer", 3), ("foveon", 2)])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_intervals_hold_about_the_share_of_voxels_that_they_promise(camera_of, cube_of, sensor, shots, noise):
    camera = camera_of(sensor, shots, 32, 8, dtype=np.float32)
    truth = cube_of(32, 8)
    rng = np.random.Generator(np.random.Philox(7))
    frames = camera.forward(truth).astype(float)
    sigma = noise * frames.max()
    frames += sigma * rng.standard_normal(frames.shape)
    known = {} if noise == 0 else {"solver": Admm(max_iterations=150), "tau": Discrepancy()}
    given = Given() if noise == 0 else Given(noise=np.array(sigma**2))
    estimate = estimate_error(camera, frames, given, **known)
    assert 0.58 <= covered(estimate, truth, 0.68) <= 0.82
    assert 0.88 <= covered(estimate, truth, 0.95) <= 0.99
    wrong = np.abs(estimate.solution.cube - truth)
    assert np.sqrt((wrong**2).mean()) == pytest.approx(np.sqrt((estimate.error**2).mean()), rel=0.3)
    low, high = np.quantile(estimate.error, [0.25, 0.75])
    assert wrong[estimate.error > high].mean() > wrong[estimate.error < low].mean()


def test_the_estimate_itself_is_that_of_reconstruct(camera_of, cube_of):
    camera = camera_of("foveon", 1, 16, 4)
    frames = camera.forward(cube_of(16, 4))
    found = estimate_error(camera, frames, solver=Admm(), tau=0.01, how=Displaced(repeats=4))
    np.testing.assert_array_equal(found.solution.cube, reconstruct(camera, frames, solver=Admm(), tau=0.01).cube)
    assert found.error.shape == found.solution.cube.shape
    assert np.isfinite(found.error).all()
    assert (found.error > 0).all()


def test_the_same_seed_gives_the_same_errors_for_any_number_of_threads(camera_of, cube_of):
    camera = camera_of("bayer", 1, 16, 4)
    frames = camera.forward(cube_of(16, 4))
    one, two = (estimate_error(camera, frames, Given(threads=n), how=Displaced(repeats=4)).error for n in (1, 2))
    assert one.tobytes() == two.tobytes()
    other = estimate_error(camera, frames, Given(threads=1), how=Displaced(repeats=4, seed=1)).error
    assert (one != other).any()


@pytest.mark.parametrize("scale", [1e-20, 1e20])
def test_X8_errors_scale_with_the_frames(camera_of, cube_of, scale):
    camera = camera_of("mono", 1, 16, 4)
    frames = camera.forward(cube_of(16, 4))
    plain, scaled = (
        estimate_error(camera, f, solver=Admm(), tau=t, how=Displaced(repeats=4))
        for f, t in ((frames, 0.01), (frames * scale, 0.01 * scale))
    )
    np.testing.assert_allclose(scaled.error, scale * plain.error, rtol=0.02)
    assert scaled.scale == pytest.approx(plain.scale, rel=0.01)


def test_wider_intervals_hold_more(camera_of, cube_of):
    camera = camera_of("mono", 3, 16, 4)
    estimate = estimate_error(camera, camera.forward(cube_of(16, 4)), how=Displaced(repeats=4))
    assert (estimate.half_width(0.5) < estimate.half_width(0.9)).all()
    for level in (0.0, 1.0, float("nan")):
        with pytest.raises(InputError, match="level"):
            estimate.half_width(level)


def test_misuse_is_refused_by_name(camera_of):
    camera = camera_of("mono", 1, 16, 4)
    with pytest.raises(InputError, match="light"):
        estimate_error(camera, np.zeros(camera.out_shape))
    for bad in ({"repeats": 3}, {"reach": 0.0}, {"share": 0.6}, {"seed": -1}):
        with pytest.raises(InputError, match=next(iter(bad))):
            Displaced(**bad)
