"""Compiled banded Cholesky for cameras that spread a band over several columns (theory.md (S.15)).

Rows of the sensor never couple, so H H^T + rho I falls into one banded matrix a row, of half bandwidth
``S T - 1`` for S numbers a pixel and T taps. ``LANES`` rows are worked side by side: every instruction of the
recursion, which is sequential along a row, serves a whole vector of rows.
"""

from typing import Any

import numpy as np
from numba import njit

from recon.aperture_kernels import FAST

LANES = 16


@njit(nogil=True, cache=True, fastmath=FAST)
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


@njit(nogil=True, cache=True, fastmath=FAST)
def solve_groups(first: int, last: int, factor: Any, frames: Any, seen: Any, out: Any) -> None:
    """Solve ``A y = g - seen`` for the rows of the groups ``first..last``; all three are frames (L, C, M, W)."""
    size, half = factor.shape[1], factor.shape[2] - 1
    shots, channels, rows, width = frames.shape
    y = np.empty((size, LANES), out.dtype)
    total = np.empty(LANES, out.dtype)
    for group in range(first, last):
        base = group * LANES
        lanes = min(LANES, rows - base)
        y[:] = 0
        for l in range(shots):
            for c in range(channels):
                s = l * channels + c
                for v in range(lanes):
                    g, h = frames[l, c, base + v], seen[l, c, base + v]
                    for j in range(width):
                        y[j * shots * channels + s, v] = g[j] - h[j]
        block = factor[group]
        for i in range(size):
            for v in range(LANES):
                total[v] = y[i, v]
            for d in range(1, min(half, i) + 1):
                for v in range(LANES):
                    total[v] -= block[i, d, v] * y[i - d, v]
            for v in range(LANES):
                y[i, v] = total[v] * block[i, 0, v]
        for i in range(size - 1, -1, -1):
            for v in range(LANES):
                y[i, v] *= block[i, 0, v]
            for d in range(1, min(half, i) + 1):
                for v in range(LANES):
                    y[i - d, v] -= block[i, d, v] * y[i, v]
        for l in range(shots):
            for c in range(channels):
                s = l * channels + c
                for v in range(lanes):
                    target = out[l, c, base + v]
                    for j in range(width):
                        target[j] = y[j * shots * channels + s, v]
