"""Strips of rows: seams against the error, exact data, a picture in one strip is the plain answer."""

from itertools import pairwise

import numpy as np
import pytest

from recon import BasisPursuit, Fista, reconstruct
from recon.coded_aperture import empty_cube
from recon.errors import InputError
from recon.operator import RowWeighted
from recon.tiles import Tiling, reconstruct_tiled

SOLVER = BasisPursuit(max_iterations=150)


CUTS = [(96, Tiling(rows=32, overlap=16)), (97, Tiling(rows=20, overlap=5)), (7, Tiling(rows=64)), (9, Tiling(rows=1, overlap=0))]


@pytest.mark.parametrize(("rows", "tiling"), CUTS)
def test_strips_cover_every_row_and_share_as_many_as_asked(rows, tiling):
    strips = tiling.strips(rows)
    assert strips[0][0] == 0
    assert strips[-1][1] == rows
    assert all(a[1] - b[0] == tiling.overlap for a, b in pairwise(strips))


@pytest.mark.parametrize("sensor", ["mono", "bayer"])
def test_seams_are_below_the_error_and_the_frames_are_explained(camera_of, cube_of, sensor):
    camera, truth = camera_of(sensor, 2, 64, 8, dtype=np.float32), cube_of(64, 8)
    frames = camera.astype(np.float64).forward(truth)
    whole = reconstruct(camera, frames, solver=SOLVER).cube
    tiled = reconstruct_tiled(camera, frames, Tiling(rows=32, overlap=16), solver=SOLVER)
    error = np.sqrt(np.mean((whole - truth) ** 2))
    assert tiled.residual < 1e-4
    assert len(tiled.stops) == 2
    near = slice(28, 36)
    assert np.sqrt(np.mean((tiled.cube - whole)[near] ** 2)) < error
    assert tiled.seam < error
    assert np.sqrt(np.mean((tiled.cube - truth) ** 2)) < 1.1 * error


def test_one_strip_is_the_plain_answer_and_out_takes_it(camera_of, cube_of):
    camera = camera_of("foveon", 1, 16, 4)
    frames = camera.forward(cube_of(16, 4))
    noise = np.random.Generator(np.random.Philox(2)).uniform(0.5, 2, frames.shape)
    out = empty_cube(camera.in_shape, np.float32)
    arguments = {"solver": Fista(max_iterations=20), "tau": 0.01, "noise": noise, "start": cube_of(16, 4) / 2}
    seen = []
    tiled = reconstruct_tiled(camera, frames, Tiling(rows=16), out=out, on_strip=lambda *done: seen.append(done), **arguments)
    assert tiled.cube is out
    assert tiled.seam == 0
    assert seen == [(1, 1)]
    np.testing.assert_array_equal(out, reconstruct(camera, frames, **arguments).cube.astype(np.float32))


def test_a_strip_behind_closed_masks_is_zero_and_says_so(camera_of, cube_of):
    camera = camera_of("mono", 1, 16, 4)
    masks = camera.masks.copy()
    masks[:, 8:] = 0
    half = camera.replace(masks=masks)
    tiled = reconstruct_tiled(half, half.forward(cube_of(16, 4)), Tiling(rows=8, overlap=0), solver=BasisPursuit(max_iterations=5))
    assert not tiled.cube[8:].any()
    assert tiled.cube[:8].any()
    assert "all masks are closed in the rows 8..15" in tiled.stops[1].reason


def test_misuse_is_refused_by_name(camera_of):
    camera = camera_of("mono", 1, 8, 4)
    frames = np.ones(camera.out_shape)
    with pytest.raises(InputError, match=r"^operator"):
        reconstruct_tiled(RowWeighted(camera, np.ones(camera.out_shape)), frames)
    with pytest.raises(InputError, match=r"^frames"):
        reconstruct_tiled(camera, frames[:, :, 1:])
    with pytest.raises(InputError, match=r"^Tiling\.overlap"):
        reconstruct_tiled(camera, frames, Tiling(rows=2, overlap=3))
    with pytest.raises(InputError, match=r"^out"):
        reconstruct_tiled(camera, frames, out=np.zeros((1, 2, 3)))
    with pytest.raises(InputError, match=r"^tau"):
        reconstruct_tiled(camera, frames, tau=object())
