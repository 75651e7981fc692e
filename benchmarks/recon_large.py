"""Large pictures, each in a process of its own so that its memory can be told: ``python -m benchmarks.recon_large [--json]``.

1024 x 1024 x 31 whole, one shot, and 2048 x 2048 x 31 in overlapping strips whose seams are compared with the error. A process's
memory is its peak resident size less what it held before the solve.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import time
from typing import Any

import numpy as np

from benchmarks.recon_peers import camera, patches
from recon import BasisPursuit
from recon.solve import reconstruct
from recon.tiles import Tiling, reconstruct_tiled

BANDS = 31


def large(sides: tuple[int, int] = (1024, 2048), iterations: tuple[int, int] = (40, 40)) -> dict[str, Any]:
    """Return figures of both and the lines of a table."""
    found = {f"{side}": _apart(job, side, count) for job, side, count in zip((whole, strips), sides, iterations)}
    first, second = found.values()
    lines = [
        f"{sides[0]} x {sides[0]} x {BANDS}, one shot, whole: peak memory {first['cubes']:.1f} cubes ({first['gib']:.2f} GiB), "
        f"{first['ns']:.2f} ns a voxel and iteration",
        f"{sides[1]} x {sides[1]} x {BANDS} in strips of {second['rows']:g} + {second['overlap']:g} rows: "
        f"peak memory {second['cubes']:.2f} cubes besides the answer ({second['gib']:.2f} GiB in all), "
        f"{second['ns']:.2f} ns a voxel and iteration",
        f"  seams: rms step {second['seam']:.2e}, rms error {second['error']:.2e}, residual {second['residual']:.1e}; "
        f"error of steps between rows at the seams / elsewhere {second['steps']:.3f}",
    ]
    return found | {"text": lines}


def whole(side: int, iterations: int) -> dict[str, float]:
    """Solve a picture at once."""
    operator = camera(side, BANDS)
    frames = operator.forward(patches(side, BANDS))
    before, began = _resident(), time.perf_counter()
    reconstruct(operator, frames, solver=BasisPursuit(max_iterations=iterations))
    took = time.perf_counter() - began
    return _figures(operator.in_shape, before, took, iterations)


def strips(side: int, iterations: int) -> dict[str, float]:
    """Solve a picture in strips."""
    operator, truth = camera(side, BANDS), patches(side, BANDS)
    frames = operator.forward(truth)
    tiling = Tiling(rows=round(side / 9), overlap=min(64, side // 18))  # nine strips: their seams lie on none of the patches' edges
    out = np.zeros((BANDS, side, side), np.float32).transpose(1, 2, 0)
    out[...] = 1
    before, began = _resident(), time.perf_counter()
    tiled = reconstruct_tiled(operator, frames, tiling, out=out, solver=BasisPursuit(max_iterations=iterations))
    found = _figures(operator.in_shape, before, time.perf_counter() - began, iterations)
    error = np.array([np.sqrt(np.mean((tiled.cube[m] - truth[m]) ** 2, dtype=np.float64)) for m in range(side)])
    steps = np.array([_step_error(tiled.cube, truth, m) for m in range(1, side)])
    seams = np.array([b for _, b in tiling.strips(side)][:-1]) - tiling.overlap // 2
    flat = [m - 1 for m in range(1, side) if np.array_equal(truth[m], truth[m - 1])]
    return found | {
        "seam": tiled.seam,
        "residual": tiled.residual,
        "error": float(np.sqrt(np.mean(error**2))),
        "steps": float(steps[seams - 1].mean() / steps[flat].mean()),
        "rows": tiling.rows,
        "overlap": tiling.overlap,
    }


def _step_error(cube: np.ndarray, truth: np.ndarray, m: int) -> float:
    """Return the rms error of the step from row m - 1 to row m."""
    return float(np.sqrt(np.mean(((cube[m] - cube[m - 1]) - (truth[m] - truth[m - 1])) ** 2, dtype=np.float64)))


def _figures(shape: tuple[int, ...], before: float, took: float, iterations: int) -> dict[str, float]:
    voxels = float(np.prod(shape))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {"cubes": (peak - before) / (4 * voxels), "gib": peak / 2**30, "ns": took * 1e9 / (voxels * iterations), "seconds": took}


def _resident() -> float:
    with open("/proc/self/statm") as file:
        return float(file.read().split()[1]) * resource.getpagesize()


def _apart(job: Any, side: int, iterations: int) -> dict[str, float]:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return dict(pool.apply(job, (side, iterations)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true", help="sides of 256 and 512")
    options = parser.parse_args()
    found = large((256, 512)) if options.quick else large()
    print(json.dumps(found) if options.json else "\n".join(found["text"]))


if __name__ == "__main__":
    main()
