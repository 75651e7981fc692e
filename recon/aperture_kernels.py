"""Compiled loops of the coded-aperture operator, over detector rows (theory.md (S.1)).

Arrays are band-major: cubes (K, M, N), frames (L, C, M, W), masks (L, M, N). Each kernel handles the rows
``first..last`` and touches no other, so slabs can run on any number of threads and give the same bytes.
With a mosaic the response depends on the sensor's column: ``tile[r, k, j]`` holds it for the r-th different
row of the mosaic and ``tile_of[m]`` says which one row m is; without, ``tile`` is empty and ``response`` is used.
"""

from typing import Any

import numpy as np
from numba import njit

FAST = {"contract", "reassoc", "nsz", "arcp"}


@njit(nogil=True, fastmath=FAST, forceinline=True)
def _add_scaled(weight: Any, x: Any, out: Any) -> None:
    """Raise ``out`` by ``weight * x``."""
    for j in range(x.size):
        out[j] += weight * x[j]


@njit(nogil=True, fastmath=FAST, forceinline=True)
def _add_product(weight: Any, x: Any, y: Any, out: Any) -> None:
    """Raise ``out`` by ``weight * x * y``, element by element."""
    for j in range(x.size):
        out[j] += weight * x[j] * y[j]


@njit(nogil=True, cache=True, fastmath=FAST)
def forward_rows(
    first: int, last: int, x: Any, masks: Any, response: Any, tile: Any, tile_of: Any, start: Any, taps: Any, out: Any
) -> None:
    """Apply H to the rows ``first..last`` of a cube."""
    shots, columns = masks.shape[0], masks.shape[2]
    bands, width = x.shape[0], out.shape[3]
    mosaic = tile.shape[0] > 0
    seen = np.empty(columns, x.dtype)
    for m in range(first, last):
        for l in range(shots):
            out[l, :, m, :] = 0
            for k in range(bands):
                for n in range(columns):
                    seen[n] = masks[l, m, n] * x[k, m, n]
                for t in range(taps.shape[1]):
                    shift = start[k] + t
                    a, b = max(0, -shift), min(columns, width - shift)
                    tap = taps[k, t]
                    if tap == 0 or b <= a:
                        continue
                    if mosaic:
                        _add_product(tap, tile[tile_of[m], k, a + shift : b + shift], seen[a:b], out[l, 0, m, a + shift : b + shift])
                    else:
                        for c in range(response.shape[0]):
                            _add_scaled(tap * response[c, k], seen[a:b], out[l, c, m, a + shift : b + shift])


@njit(nogil=True, cache=True, fastmath=FAST)
def adjoint_rows(
    first: int, last: int, y: Any, masks: Any, response: Any, tile: Any, tile_of: Any, start: Any, taps: Any, out: Any
) -> None:
    """Apply H^T to the rows ``first..last`` of frames."""
    shots, columns = masks.shape[0], masks.shape[2]
    bands, width = out.shape[0], y.shape[3]
    mosaic = tile.shape[0] > 0
    back = np.empty(columns, out.dtype)
    total = np.empty(columns, out.dtype)
    for m in range(first, last):
        for k in range(bands):
            total[:] = 0
            for l in range(shots):
                back[:] = 0
                for t in range(taps.shape[1]):
                    shift = start[k] + t
                    a, b = max(0, -shift), min(columns, width - shift)
                    tap = taps[k, t]
                    if tap == 0 or b <= a:
                        continue
                    if mosaic:
                        _add_product(tap, tile[tile_of[m], k, a + shift : b + shift], y[l, 0, m, a + shift : b + shift], back[a:b])
                    else:
                        for c in range(response.shape[0]):
                            _add_scaled(tap * response[c, k], y[l, c, m, a + shift : b + shift], back[a:b])
                for n in range(columns):
                    total[n] += masks[l, m, n] * back[n]
            for n in range(columns):
                out[k, m, n] = total[n]


@njit(nogil=True, cache=True, fastmath=FAST)
def gram_rows(
    first: int, last: int, offset: int, masks: Any, response: Any, tile: Any, tile_of: Any, start: Any, taps: Any, out: Any
) -> None:
    """Sum ``out[m, p, q, j] = (H H^T)[(p, m, j), (q, m, j + offset)]`` with p = shot * C + channel, in float64."""
    shots, columns = masks.shape[0], masks.shape[2]
    channels, bands, width = response.shape[0], response.shape[1], out.shape[3]
    mosaic = tile.shape[0] > 0
    if mosaic:
        channels = 1
    both = np.empty(columns)
    for m in range(first, last):
        out[m] = 0
        for l in range(shots):
            for i in range(shots):
                for n in range(columns):
                    both[n] = masks[l, m, n] * masks[i, m, n]
                for k in range(bands):
                    for t in range(taps.shape[1] - offset):
                        shift = start[k] + t
                        a, b = max(0, -shift), min(columns, width - offset - shift)
                        pair = taps[k, t] * taps[k, t + offset]
                        if pair == 0 or b <= a:
                            continue
                        u, v = a + shift, b + shift
                        if mosaic:
                            here, there = tile[tile_of[m], k, u:v], tile[tile_of[m], k, u + offset : v + offset]
                            for n in range(b - a):
                                out[m, l, i, u + n] += pair * here[n] * there[n] * both[a + n]
                        else:
                            for c in range(channels):
                                for e in range(channels):
                                    _add_scaled(
                                        pair * response[c, k] * response[e, k], both[a:b], out[m, l * channels + c, i * channels + e, u:v]
                                    )


@njit(nogil=True, cache=True, fastmath=FAST)
def descend_rows(
    first: int, last: int, x: Any, old: Any, seen_old: Any, beta: Any, step: Any, frames: Any, masks: Any, response: Any, tile: Any,
    tile_of: Any, start: Any, taps: Any, sums: Any,
) -> None:  # fmt: skip
    """Take FISTA's gradient step on the rows ``first..last``: ``old = y + step H^T (g - H y)``, ``y = x + beta (x - old)``.

    ``seen_old`` holds ``H old`` and gets ``H x``; ``sums[m]`` gets ``||g - H x||^2`` of the row.
    """
    band_major = (x.shape[0], 1, x.shape[2])
    back = np.empty(band_major, x.dtype)
    shots, channels, width = frames.shape[0], frames.shape[1], frames.shape[3]
    seen = np.empty((shots, channels, 1, width), x.dtype)
    left = np.empty((shots, channels, 1, width), x.dtype)
    for m in range(first, last):
        mask, of = masks[:, m : m + 1], tile_of[m : m + 1]
        forward_rows(0, 1, x[:, m : m + 1], mask, response, tile, of, start, taps, seen)
        misfit = 0.0
        for l in range(shots):
            for c in range(channels):
                g, now, before, rest = frames[l, c, m], seen[l, c, 0], seen_old[l, c, m], left[l, c, 0]
                for j in range(width):
                    gap = g[j] - now[j]
                    misfit += gap * gap
                    rest[j] = gap - beta * (now[j] - before[j])
                    before[j] = now[j]
        sums[m] = misfit
        adjoint_rows(0, 1, left, mask, response, tile, of, start, taps, back)
        for k in range(x.shape[0]):
            new, here, last_row = back[k, 0], x[k, m], old[k, m]
            for n in range(new.size):
                last_row[n] = here[n] + beta * (here[n] - last_row[n]) + step * new[n]
