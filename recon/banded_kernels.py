"""Compiled banded Cholesky for cameras that spread a band over several columns (theory.md (S.15)).

Rows of the sensor never couple, so H H^T + rho I falls into one banded matrix a row, of half bandwidth
``S T - 1`` for S numbers a pixel and T taps. ``LANES`` rows are worked side by side: every instruction of the
recursion, which is sequential along a row, serves a whole vector of rows.
"""

from typing import Any

import numpy as np

from recon.aperture_kernels import FAST, give_back, mask_row, row_apart, row_step, see, work_of
from recon.compiled import kernel
from recon.simd import load, mul, store, sub
from recon.spectral_kernels import BLOCK, aligned, per_vector
from recon.step_kernels import finish_row, relax_row

LANES = 16


@kernel(fastmath=FAST)
def factor_groups(first: int, last: int, band: Any, half: int, stored: Any) -> None:
    """Factor the groups ``first..last``: ``band[group, i, d, lane] = A[i, i - d]`` (float64, overwritten) into ``stored``.

    ``stored[..., 0, :]`` holds the inverse of the diagonal; a pivot that is not positive is left out (inverse 0).
    """
    size = band.shape[1]
    total = np.empty(LANES)
    for group in range(first, last):
        block = band[group]
        for i in range(size):
            for d in range(min(half, i), -1, -1):
                for v in range(LANES):
                    total[v] = block[i, d, v]
                for e in range(1, min(half - d, i - d) + 1):
                    for v in range(LANES):
                        total[v] -= block[i, d + e, v] * block[i - d, e, v]
                if d > 0:
                    for v in range(LANES):
                        block[i, d, v] = total[v] * block[i - d, 0, v]
                else:
                    for v in range(LANES):
                        block[i, 0, v] = 1.0 / np.sqrt(total[v]) if total[v] > 1e-300 else 0.0
        for i in range(size):
            for d in range(half + 1):
                for v in range(LANES):
                    stored[group, i, d, v] = block[i, d, v]


@kernel()
def solve_band(factor: Any, group: int, y: Any) -> None:
    """Solve ``A y = right`` for the rows of a group, in place: ``y[i LANES + lane]``."""
    size, half, n = factor.shape[1], factor.shape[2] - 1, per_vector(y)
    for lane in range(0, LANES, n):
        block = group * size * (half + 1) * LANES + lane
        for i in range(size):
            row = block + i * (half + 1) * LANES
            rest = load(y, i * LANES + lane)
            for d in range(min(half, i), 0, -1):
                rest = sub(rest, mul(load(factor, row + d * LANES), load(y, (i - d) * LANES + lane)))
            store(y, i * LANES + lane, mul(rest, load(factor, row)))
        for i in range(size - 1, -1, -1):
            row = block + i * (half + 1) * LANES
            found = mul(load(y, i * LANES + lane), load(factor, row))
            store(y, i * LANES + lane, found)
            for d in range(1, min(half, i) + 1):
                at = (i - d) * LANES + lane
                store(y, at, sub(load(y, at), mul(load(factor, row + d * LANES), found)))


@kernel()
def solve_groups(first: int, last: int, factor: Any, frames: Any, seen: Any, out: Any) -> None:
    """Solve ``A y = g - seen`` for the rows of the groups ``first..last``; all three are frames (L, C, M, W)."""
    count, rows, width = frames.shape[0] * frames.shape[1], frames.shape[2], frames.shape[3]
    y = aligned(width * count * LANES, out)
    g, h, result = frames.reshape(-1), seen.reshape(-1), out.reshape(-1)
    for group in range(first, last):
        base = group * LANES
        lanes = min(LANES, rows - base)
        for s in range(count):
            for v in range(lanes):
                row = (s * rows + base + v) * width
                for j in range(width):
                    y[(j * count + s) * LANES + v] = g[row + j] - h[row + j]
        solve_band(factor, group, y)
        for s in range(count):
            for v in range(lanes):
                row = (s * rows + base + v) * width
                for j in range(width):
                    result[row + j] = y[(j * count + s) * LANES + v]


@kernel()
def advance_groups(
    first: int, last: int, z: Any, w: Any, x: Any, relax: Any, frames: Any, weights: Any, optics: Any, factor: Any, ratio: Any, sums: Any
) -> None:
    """As ``step_kernels.advance_rows`` for the groups of rows ``first..last`` of a camera that spreads a band over columns.

    ``frames`` are weighted; ``weights`` (L, C, M, W) multiply H, or are of size 0.
    """
    bands, columns, rows, width = z.shape[0], z.shape[2], frames.shape[2], frames.shape[3]
    step, there = row_apart(columns), row_step(width) + 2 * BLOCK
    count = frames.shape[0] * frames.shape[1]
    work, raw, moved = work_of(optics, step, z), aligned(LANES * bands * step, z), aligned((bands + 8) * step, z)
    mask, left = aligned(frames.shape[0] * step, z), aligned(count * there, z)
    y = aligned(width * count * LANES, z)
    g, d = frames.reshape(-1), weights.reshape(-1)
    for group in range(first, last):
        base = group * LANES
        lanes = min(LANES, rows - base)
        for v in range(lanes):
            mask_row(optics, base + v, step, mask)
            here = raw[v * bands * step : (v + 1) * bands * step]
            sums[base + v, 0] = relax_row(z, w, x, base + v, relax, step, here)
            see(optics, base + v, mask, here, step, width, work, left)
            for s in range(count):
                row, at = (s * rows + base + v) * width, s * there + BLOCK
                for j in range(width):
                    seen = left[at + j] * d[row + j] if d.size > 0 else left[at + j]
                    y[(j * count + s) * LANES + v] = g[row + j] - seen
        solve_band(factor, group, y)
        for v in range(lanes):
            for s in range(count):
                row, at = (s * rows + base + v) * width, s * there + BLOCK
                for j in range(width):
                    found = y[(j * count + s) * LANES + v]
                    left[at + j] = found * d[row + j] if d.size > 0 else found
            mask_row(optics, base + v, step, mask)
            give_back(optics, base + v, mask, left, step, width, work, moved)
            finish_row(z, w, x, base + v, ratio, step, raw[v * bands * step : (v + 1) * bands * step], moved, sums)
