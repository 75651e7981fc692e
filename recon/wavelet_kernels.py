"""Compiled periodised orthogonal filter bank and spectral transform, band-major (theory.md (S.6), (S.7)).

The filter bank works one band at a time, in place, so a band of 256 x 256 float32 stays in the second-level
cache through all levels. Eight (or four) taps are combined in each pass over a row: that keeps the vector units busy
for any filter length; filters come padded with zeros to a multiple of four.
"""

from typing import Any

import numpy as np
from numba import njit

FAST = {"contract", "reassoc", "nsz", "arcp"}
TILE = 128  # pixels of one spectral tile: 24 bands of float32 are 12 kB


@njit(nogil=True, fastmath=FAST, forceinline=True)
def _add8(fresh: bool, w: Any, t: int, r0: Any, r1: Any, r2: Any, r3: Any, r4: Any, r5: Any, r6: Any, r7: Any, out: Any) -> None:
    """Set (``fresh``) or raise ``out`` by eight rows weighted with ``w[t..t+7]``; one store keeps LLVM's alias checks few."""
    a, b, c, d, e, f, g, h = w[t], w[t + 1], w[t + 2], w[t + 3], w[t + 4], w[t + 5], w[t + 6], w[t + 7]
    if fresh:
        for j in range(out.size):
            out[j] = a * r0[j] + b * r1[j] + c * r2[j] + d * r3[j] + e * r4[j] + f * r5[j] + g * r6[j] + h * r7[j]
    else:
        for j in range(out.size):
            out[j] += a * r0[j] + b * r1[j] + c * r2[j] + d * r3[j] + e * r4[j] + f * r5[j] + g * r6[j] + h * r7[j]


@njit(nogil=True, fastmath=FAST, forceinline=True)
def _add4(fresh: bool, w: Any, t: int, r0: Any, r1: Any, r2: Any, r3: Any, out: Any) -> None:
    """As ``_add8`` with four rows."""
    a, b, c, d = w[t], w[t + 1], w[t + 2], w[t + 3]
    if fresh:
        for j in range(out.size):
            out[j] = a * r0[j] + b * r1[j] + c * r2[j] + d * r3[j]
    else:
        for j in range(out.size):
            out[j] += a * r0[j] + b * r1[j] + c * r2[j] + d * r3[j]


@njit(nogil=True, cache=True)
def _wrap(source: Any, size: int, start: int, count: int, out: Any) -> None:
    """Copy ``out[p] = source[(start + p) mod size]`` for p below ``count``; 0 <= start < size."""
    at = start
    done = 0
    while done < count:
        chunk = min(size - at, count - done)
        a, b = source[at : at + chunk], out[done : done + chunk]
        for j in range(chunk):
            b[j] = a[j]
        done += chunk
        at = 0


@njit(nogil=True, cache=True)
def _count(start: int, step: int, size: int, out: Any) -> None:
    """Set ``out[p] = (start + p step) mod size`` without a division each; 0 <= start < size, 0 <= step <= size."""
    at = start
    for p in range(out.size):
        out[p] = at
        at += step
        if at >= size:
            at -= size


@njit(nogil=True, cache=True, fastmath=FAST)
def _along_row(weights: Any, first: Any, second: Any, start: int, step: int, out: Any) -> None:
    """Set ``out[i] = sum_u weights[2u] first[i + start + step u] + weights[2u+1] second[...]``."""
    taps, n = weights.size, out.size
    t = 0
    while t + 8 <= taps:
        s = start + step * (t // 2)
        p, q, r = s + step, s + 2 * step, s + 3 * step
        _add8(
            t == 0, weights, t, first[s : s + n], second[s : s + n], first[p : p + n], second[p : p + n],
            first[q : q + n], second[q : q + n], first[r : r + n], second[r : r + n], out,
        )  # fmt: skip
        t += 8
    if t < taps:
        s = start + step * (t // 2)
        p = s + step
        _add4(t == 0, weights, t, first[s : s + n], second[s : s + n], first[p : p + n], second[p : p + n], out)


@njit(nogil=True, cache=True, fastmath=FAST)
def _across_rows(weights: Any, source: Any, columns: int, rows: Any, out: Any) -> None:
    """Set ``out = sum_t weights[t] source[rows[t], :columns]``."""
    taps = weights.size
    t = 0
    while t + 8 <= taps:
        _add8(
            t == 0, weights, t, source[rows[t], :columns], source[rows[t + 1], :columns], source[rows[t + 2], :columns],
            source[rows[t + 3], :columns], source[rows[t + 4], :columns], source[rows[t + 5], :columns],
            source[rows[t + 6], :columns], source[rows[t + 7], :columns], out,
        )  # fmt: skip
        t += 8
    if t < taps:
        _add4(
            t == 0, weights, t, source[rows[t], :columns], source[rows[t + 1], :columns], source[rows[t + 2], :columns],
            source[rows[t + 3], :columns], out,
        )  # fmt: skip


@njit(nogil=True, cache=True)
def analysis_bands(first: int, last: int, cube: Any, filters: Any, length: int, levels: int, out: Any) -> None:
    """Analyse the bands ``first..last`` of ``cube`` (K, M, N) into packed coefficients ``out``; they may be one array.

    ``filters`` (2, taps): low pass and high pass; one call site for both halves the time to compile.
    """
    rows, columns = cube.shape[1], cube.shape[2]
    taps = filters.shape[1]
    origin = 1 - length // 2
    middle = np.empty((rows, columns), out.dtype)
    row = np.empty(columns + taps, out.dtype)
    even = np.empty(columns // 2 + taps, out.dtype)
    odd = np.empty(columns // 2 + taps, out.dtype)
    used = np.empty(rows + taps, np.int64)
    for k in range(first, last):
        if levels == 0 or cube.ctypes.data != out.ctypes.data:
            for i in range(rows):
                _wrap(cube[k, i], columns, 0, columns, out[k, i])
        for level in range(levels):
            r, c = rows >> level, columns >> level
            half, shift = c // 2, origin % c
            _count(origin % r, 1, r, used[: r + taps])
            for i in range(r):
                _wrap(out[k, i], c, shift, c + taps, row)
                for j in range((c + taps) // 2):
                    even[j] = row[2 * j]
                    odd[j] = row[2 * j + 1]
                for p in range(2):
                    _along_row(filters[p], even, odd, 0, 1, middle[i, p * half : (p + 1) * half])
            for i in range(r // 2):
                for p in range(2):
                    _across_rows(filters[p], middle, c, used[2 * i :], out[k, p * (r // 2) + i, :c])


@njit(nogil=True, cache=True)
def synthesis_bands(first: int, last: int, packed: Any, phases: Any, length: int, levels: int, out: Any) -> None:
    """Invert ``analysis_bands`` (its transpose) for the bands ``first..last``; ``packed`` and ``out`` may be one array.

    The filters come as ``phases`` (2, taps): ``[h0, g0, h2, g2, ...]`` makes even samples, ``[h1, g1, h3, ...]`` odd ones.
    """
    rows, columns = packed.shape[1], packed.shape[2]
    taps = phases.shape[1]
    origin = 1 - length // 2
    reach = taps // 2 - 1
    middle = np.empty((rows, columns), out.dtype)
    low = np.empty(columns // 2 + taps, out.dtype)
    high = np.empty(columns // 2 + taps, out.dtype)
    made = np.empty((2, columns // 2), out.dtype)
    row = np.empty(columns, out.dtype)
    down = np.empty(rows // 2 + taps, np.int64)
    used = np.empty(rows + 2 * taps, np.int64)
    for k in range(first, last):
        if levels == 0 or packed.ctypes.data != out.ctypes.data:
            for i in range(rows):
                _wrap(packed[k, i], columns, 0, columns, out[k, i])
        for level in range(levels - 1, -1, -1):
            r, c = rows >> level, columns >> level
            n, half = r // 2, c // 2
            top, before, shift = origin % r, -reach % half, -origin % c
            _count(n - 1, n - 1, n, down[: n + taps // 2])
            for p in range(n + taps // 2):
                used[2 * p], used[2 * p + 1] = down[p], n + down[p]
            for i in range(n):
                for p in range(2):
                    at = top + 2 * i + p
                    _across_rows(phases[p], out[k], c, used[2 * (n - 1 - i) :], middle[at if at < r else at - r, :c])
            for i in range(r):
                _wrap(middle[i], half, before, half + reach, low)
                _wrap(middle[i, half:c], half, before, half + reach, high)
                for p in range(2):
                    _along_row(phases[p], low, high, reach, -1, made[p, :half])
                for j in range(half):
                    row[2 * j] = made[0, j]
                    row[2 * j + 1] = made[1, j]
                _wrap(row, c, shift, c, out[k, i])


@njit(nogil=True, cache=True, fastmath=FAST)
def _fold(matrix: Any, x: Any, out: Any, size: int) -> None:
    """Set ``out[i] = sum_k matrix[i, k] x[k]`` over the first ``size`` pixels of a tile."""
    count = matrix.shape[1]
    for i in range(matrix.shape[0]):
        w, total = matrix[i], out[i, :size]
        k = 0
        while k + 8 <= count:
            _add8(
                k == 0, w, k, x[k, :size], x[k + 1, :size], x[k + 2, :size], x[k + 3, :size], x[k + 4, :size],
                x[k + 5, :size], x[k + 6, :size], x[k + 7, :size], total,
            )  # fmt: skip
            k += 8
        if k + 4 <= count:
            _add4(k == 0, w, k, x[k, :size], x[k + 1, :size], x[k + 2, :size], x[k + 3, :size], total)
            k += 4
        if count < 4:
            total[:] = 0
        while k < count:
            for j in range(size):
                total[j] += w[k] * x[k, j]
            k += 1


@njit(nogil=True, cache=True)
def _transposed(matrix: Any) -> Any:
    """Return a contiguous transpose."""
    out = np.empty((matrix.shape[1], matrix.shape[0]), matrix.dtype)
    for i in range(matrix.shape[0]):
        for k in range(matrix.shape[1]):
            out[k, i] = matrix[i, k]
    return out


@njit(nogil=True, cache=True, fastmath=FAST)
def _shrink(values: Any, size: int, limit: float) -> float:
    """Soft-threshold ``values`` in place and return the sum of what is left in absolute value."""
    total = np.zeros(1, values.dtype)[0]
    for j in range(size):
        v = values[j]
        v -= min(max(v, -limit), limit)
        values[j] = v
        total += abs(v)
    return total


@njit(nogil=True, cache=True, fastmath=FAST)
def cosine_tiles(
    first: int, last: int, even: Any, odd: Any, x: Any, out: Any, analyse: bool, threshold: float, synthesise: bool, sums: Any
) -> None:
    """DCT-II, soft threshold and inverse DCT of every pixel's spectrum, in one pass through the cache.

    Tiles ``first..last`` of ``x`` (K, pixels) go to ``out`` (may be ``x``). The mirror symmetry of the cosines halves
    the work: ``even`` holds the even rows of the DCT on the first ceil(K/2) bands, ``odd`` the odd rows on the first
    floor(K/2). A negative threshold leaves the coefficients alone. ``sums[tile]`` gets the l1 norm of what is left.
    """
    bands, pixels = x.shape
    half = bands // 2
    upper = even.shape[0]
    even_back, odd_back = _transposed(even), _transposed(odd)
    a = np.empty((upper, TILE), out.dtype)
    b = np.empty((upper, TILE), out.dtype)
    c = np.empty((upper, TILE), out.dtype)
    d = np.empty((upper, TILE), out.dtype)
    limit = np.asarray(threshold).astype(out.dtype).item()
    for tile in range(first, last):
        at = tile * TILE
        size = min(TILE, pixels - at)
        if analyse:
            for k in range(half):
                for j in range(size):
                    p, q = x[k, at + j], x[bands - 1 - k, at + j]
                    a[k, j] = p + q
                    b[k, j] = p - q
            if upper > half:
                for j in range(size):
                    a[half, j] = x[half, at + j]
            _fold(even, a, c, size)
            _fold(odd, b, d, size)
        else:
            for k in range(upper):
                for j in range(size):
                    c[k, j] = x[2 * k, at + j]
            for k in range(half):
                for j in range(size):
                    d[k, j] = x[2 * k + 1, at + j]
        if threshold >= 0:
            total = 0.0
            for k in range(upper):
                total += _shrink(c[k], size, limit)
            for k in range(half):
                total += _shrink(d[k], size, limit)
            sums[tile] = total
        if synthesise:
            _fold(even_back, c, a, size)
            _fold(odd_back, d, b, size)
            for k in range(half):
                for j in range(size):
                    p, q = a[k, j], b[k, j]
                    out[k, at + j] = p + q
                    out[bands - 1 - k, at + j] = p - q
            if upper > half:
                for j in range(size):
                    out[half, at + j] = a[half, j]
        else:
            for k in range(upper):
                for j in range(size):
                    out[2 * k, at + j] = c[k, j]
            for k in range(half):
                for j in range(size):
                    out[2 * k + 1, at + j] = d[k, j]
