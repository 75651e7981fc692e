"""Compiled periodised orthogonal filter bank and spectral transform, band-major (theory.md (S.6), (S.7)).

The filter bank works one band at a time, in place, so a band of 256 x 256 float32 stays in the second-level
cache through all levels. Four taps are combined in each pass over a row: that keeps the vector units busy for any
even filter length; filters come padded with zeros to a multiple of four.
"""

from typing import Any

import numpy as np
from numba import njit

FAST = {"contract", "reassoc", "nsz", "arcp"}
TILE = 128  # pixels of one spectral tile: 24 bands of float32 are 12 kB


@njit(nogil=True, cache=True, fastmath=FAST, inline="never")
def _combine(size: int, fresh: bool, p: Any, q: Any, a: Any, b: Any, r0: Any, r1: Any, r2: Any, r3: Any, low: Any, high: Any) -> None:
    """Add four weighted rows to ``low`` and to ``high``: weights ``a[p..p+3 step]`` and ``b``."""
    a0, a1, a2, a3 = a[p], a[p + q], a[p + 2 * q], a[p + 3 * q]
    b0, b1, b2, b3 = b[p], b[p + q], b[p + 2 * q], b[p + 3 * q]
    if fresh:
        for j in range(size):
            low[j] = a0 * r0[j] + a1 * r1[j] + a2 * r2[j] + a3 * r3[j]
            high[j] = b0 * r0[j] + b1 * r1[j] + b2 * r2[j] + b3 * r3[j]
    else:
        for j in range(size):
            low[j] += a0 * r0[j] + a1 * r1[j] + a2 * r2[j] + a3 * r3[j]
            high[j] += b0 * r0[j] + b1 * r1[j] + b2 * r2[j] + b3 * r3[j]


@njit(nogil=True, cache=True)
def _wrap(source: Any, size: int, start: int, count: int, out: Any) -> None:
    """Copy ``out[p] = source[(start + p) mod size]`` for p below ``count``."""
    at = start % size
    done = 0
    while done < count:
        chunk = min(size - at, count - done)
        for j in range(chunk):
            out[done + j] = source[at + j]
        done += chunk
        at = 0


@njit(nogil=True, cache=True)
def analysis_bands(first: int, last: int, cube: Any, low_pass: Any, high_pass: Any, length: int, levels: int, out: Any) -> None:
    """Analyse the bands ``first..last`` of ``cube`` (K, M, N) into packed coefficients ``out``; they may be one array."""
    rows, columns = cube.shape[1], cube.shape[2]
    taps = low_pass.size
    origin = 1 - length // 2
    middle = np.empty((rows, columns), out.dtype)
    row = np.empty(columns + taps, out.dtype)
    even = np.empty(columns // 2 + taps, out.dtype)
    odd = np.empty(columns // 2 + taps, out.dtype)
    for k in range(first, last):
        if levels == 0:
            out[k] = cube[k]
        for level in range(levels):
            r, c = rows >> level, columns >> level
            half = c // 2
            for i in range(r):
                _wrap(cube[k, i] if level == 0 else out[k, i], c, origin, c + taps, row)
                for j in range((c + taps) // 2):
                    even[j] = row[2 * j]
                    odd[j] = row[2 * j + 1]
                for t in range(0, taps, 4):
                    s = t // 2
                    _combine(
                        half, t == 0, t, 1, low_pass, high_pass, even[s:], odd[s:], even[s + 1 :], odd[s + 1 :], middle[i], middle[i, half:]
                    )
            for i in range(r // 2):
                for t in range(0, taps, 4):
                    at = 2 * i + origin + t
                    r0, r1, r2, r3 = middle[at % r], middle[(at + 1) % r], middle[(at + 2) % r], middle[(at + 3) % r]
                    _combine(c, t == 0, t, 1, low_pass, high_pass, r0, r1, r2, r3, out[k, i], out[k, r // 2 + i])


@njit(nogil=True, cache=True)
def synthesis_bands(first: int, last: int, packed: Any, low_pass: Any, high_pass: Any, length: int, levels: int, out: Any) -> None:
    """Invert ``analysis_bands`` (its transpose) for the bands ``first..last``; ``packed`` and ``out`` may be one array.

    The filters come interleaved: ``low_pass = [h0, g0, h2, g2, ...]`` makes even and ``high_pass = [h1, g1, ...]`` odd samples.
    """
    rows, columns = packed.shape[1], packed.shape[2]
    taps = low_pass.size
    origin = 1 - length // 2
    reach = taps // 2 - 1
    middle = np.empty((rows, columns), out.dtype)
    low = np.empty(columns // 2 + taps, out.dtype)
    high = np.empty(columns // 2 + taps, out.dtype)
    even = np.empty(columns, out.dtype)
    odd = np.empty(columns, out.dtype)
    row = np.empty(columns, out.dtype)
    for k in range(first, last):
        if levels == 0 or packed.ctypes.data != out.ctypes.data:
            out[k] = packed[k]
        for level in range(levels - 1, -1, -1):
            r, c = rows >> level, columns >> level
            n, half = r // 2, c // 2
            for i in range(n):
                top, below = (2 * i + origin) % r, (2 * i + 1 + origin) % r
                for t in range(0, taps, 4):
                    u = t // 2
                    a, b = (i - u) % n, (i - u - 1) % n
                    _combine(
                        c, t == 0, t, 1, low_pass, high_pass, out[k, a], out[k, n + a], out[k, b], out[k, n + b], middle[top], middle[below]
                    )
            for i in range(r):
                _wrap(middle[i], half, -reach, half + reach, low)
                _wrap(middle[i, half:], half, -reach, half + reach, high)
                for t in range(0, taps, 4):
                    u = reach - t // 2
                    _combine(half, t == 0, t, 1, low_pass, high_pass, low[u:], high[u:], low[u - 1 :], high[u - 1 :], even, odd)
                for j in range(half):
                    row[2 * j] = even[j]
                    row[2 * j + 1] = odd[j]
                _wrap(row, c, -origin, c, out[k, i])


@njit(nogil=True, cache=True, fastmath=FAST)
def _fold(matrix: Any, x: Any, out: Any, size: int) -> None:
    """Set ``out[i] = sum_k matrix[i, k] x[k]`` over tiles of ``size`` pixels, four terms a pass."""
    count = matrix.shape[1]
    for i in range(matrix.shape[0]):
        for j in range(size):
            out[i, j] = 0
        for k in range(0, count - 3, 4):
            a0, a1, a2, a3 = matrix[i, k], matrix[i, k + 1], matrix[i, k + 2], matrix[i, k + 3]
            for j in range(size):
                out[i, j] += a0 * x[k, j] + a1 * x[k + 1, j] + a2 * x[k + 2, j] + a3 * x[k + 3, j]
        for k in range(count - count % 4, count):
            a0 = matrix[i, k]
            for j in range(size):
                out[i, j] += a0 * x[k, j]


@njit(nogil=True, cache=True, fastmath=FAST)
def spectral_tiles(first: int, last: int, matrix: Any, x: Any, out: Any) -> None:
    """Multiply every pixel's spectrum by ``matrix`` (K, K): tiles ``first..last`` of ``x`` (K, pixels) into ``out``."""
    bands, pixels = x.shape
    held = np.empty((bands, TILE), out.dtype)
    made = np.empty((bands, TILE), out.dtype)
    for tile in range(first, last):
        at = tile * TILE
        size = min(TILE, pixels - at)
        for k in range(bands):
            for j in range(size):
                held[k, j] = x[k, at + j]
        _fold(matrix, held, made, size)
        for k in range(bands):
            for j in range(size):
                out[k, at + j] = made[k, j]
