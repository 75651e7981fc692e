"""Compiled periodised orthogonal filter bank, band by band in place (theory.md (S.6)).

A level filters a window of rows down the columns, straight from the band, splits the new low and high row into even and
odd places and filters those along the row; the pair then overwrites the two rows that no later window reads. So a band of
256 x 256 float32 stays in the second-level cache and is read and written once a level. The price is an order of rows of its own:
at level l, row i is row ``(start + i 2^l) mod M`` of the band, and each level moves ``start`` by the filter's origin; columns are packed
as PyWavelets packs them. ``analysis_bands`` and ``synthesis_bands`` translate, ``shrink_bands`` has no need to.

``filters`` (2, taps) are low and high pass, padded with zeros to a multiple of four taps; ``length`` is the true number of taps.
"""

from typing import Any

import numpy as np
from numba import njit

from recon.compiled import kernel
from recon.simd import (
    add,
    evens,
    fma,
    highest,
    load,
    load_some,
    lowest,
    magnitude,
    mul,
    odds,
    splat,
    store,
    store_some,
    sub,
    total,
    zip_high,
    zip_low,
)  # fmt: skip
from recon.spectral_kernels import FLOATS, aligned, copy_some, per_vector

PAD = 64  # places on both sides of a row: at least half a filter


@njit(nogil=True, forceinline=True)
def _soft(v: Any, limit: Any) -> Any:
    """Return the vector with each value moved towards 0 by at most ``limit``."""
    return sub(v, lowest(highest(v, sub(sub(limit, limit), limit)), limit))


@kernel()
def _row_size(columns: int) -> int:
    """Count the places kept for half a row: whole vectors, so that all begin at a cache line."""
    return (columns // 2 + 2 * PAD + FLOATS - 1) // FLOATS * FLOATS


@kernel()
def _places(base: int, start: int, step: int, rows: int, columns: int, count: int, out: Any) -> None:
    """Set ``out[p]`` to the offset of row ``(start + p step) mod rows`` for p below ``count``."""
    at = start % rows
    for p in range(count):
        out[p] = base + at * columns
        at += step
        if at >= rows:
            at -= rows


@kernel()
def _extend(row: Any, at: int, size: int, before: int, after: int) -> None:
    """Continue ``row[at .. at + size)`` periodically by some places on either side."""
    for i in range(1, before + 1):
        row[at - i] = row[at - i + size]
    for i in range(after):
        row[at + size + i] = row[at + i]


@njit(nogil=True, forceinline=True)
def _four(weights: Any, row: int) -> Any:
    """Return the first four weights of a filter as vectors."""
    return splat(weights[row, 0]), splat(weights[row, 1]), splat(weights[row, 2]), splat(weights[row, 3])


@njit(nogil=True, forceinline=True)
def _sum4(w: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Return w[0] a + w[1] b + w[2] c + w[3] d."""
    return fma(w[3], d, fma(w[2], c, fma(w[1], b, mul(w[0], a))))


@kernel()
def _down_columns(source: Any, rows: Any, first: int, weights: Any, columns: int, halves: Any, size: int) -> None:
    """Filter the rows ``first ..`` into a low and a high one, each split: ``halves`` gets low even, low odd, high even, high odd."""
    n, taps = per_vector(source), weights.shape[1]
    low, high = _four(weights, 0), _four(weights, 1)
    p, q, r, s = rows[first], rows[first + 1], rows[first + 2], rows[first + 3]
    for j in range(0, columns, 2 * n):
        i = PAD + j // 2
        if j + 2 * n <= columns:
            u, v, x, y = load(source, p + j), load(source, q + j), load(source, r + j), load(source, s + j)
            a, c = _sum4(low, u, v, x, y), _sum4(high, u, v, x, y)
            u, v, x, y = load(source, p + j + n), load(source, q + j + n), load(source, r + j + n), load(source, s + j + n)
            b, d = _sum4(low, u, v, x, y), _sum4(high, u, v, x, y)
            for t in range(4, taps):
                at = rows[first + t] + j
                u, v = load(source, at), load(source, at + n)
                f, g = splat(weights[0, t]), splat(weights[1, t])
                a, b, c, d = fma(f, u, a), fma(f, v, b), fma(g, u, c), fma(g, v, d)
        else:
            a = b = c = d = splat(weights.dtype.type(0))
            for t in range(taps):
                at = rows[first + t] + j
                u, v = load_some(source, at, columns - j), load_some(source, at + n, columns - j - n)
                f, g = splat(weights[0, t]), splat(weights[1, t])
                a, b, c, d = fma(f, u, a), fma(f, v, b), fma(g, u, c), fma(g, v, d)
        store(halves, i, evens(a, b))
        store(halves, size + i, odds(a, b))
        store(halves, 2 * size + i, evens(c, d))
        store(halves, 3 * size + i, odds(c, d))


@kernel()
def _along_row(halves: Any, f: int, g: int, weights: Any, count: int, lower: Any, upper: Any, out: Any, to: int) -> float:
    """Filter one split row into ``count`` low and as many high places; ``f``, ``g``: where even and odd taps begin to read.

    Both are soft-thresholded, by ``lower`` and ``upper``; a negative limit leaves them alone. Returns the l1 norm of what was thresholded.
    """
    n, taps = per_vector(halves), weights.shape[1]
    low, high = _four(weights, 0), _four(weights, 1)
    zero = weights.dtype.type(0)
    left = right = splat(zero)
    low_limit, high_limit = splat(max(lower, zero)), splat(max(upper, zero))
    for i in range(0, count, n):
        u, v, x, y = load(halves, f + i), load(halves, g + i), load(halves, f + i + 1), load(halves, g + i + 1)
        a, b = _sum4(low, u, v, x, y), _sum4(high, u, v, x, y)
        for t in range(4, taps, 2):
            x, y = load(halves, f + i + t // 2), load(halves, g + i + t // 2)
            a = fma(splat(weights[0, t + 1]), y, fma(splat(weights[0, t]), x, a))
            b = fma(splat(weights[1, t + 1]), y, fma(splat(weights[1, t]), x, b))
        a, b = _soft(a, low_limit), _soft(b, high_limit)
        if i + n <= count:
            store(out, to + i, a)
            store(out, to + count + i, b)
        else:
            store_some(out, to + i, a, count - i)
            store_some(out, to + count + i, b, count - i)
            a, b = load_some(out, to + i, count - i), load_some(out, to + count + i, count - i)
        left, right = add(left, magnitude(a)), add(right, magnitude(b))
    return (total(left) if lower >= 0 else zero) + (total(right) if upper >= 0 else zero)


@kernel()
def _up_columns(source: Any, rows: Any, first: int, weights: Any, half: int, quarters: Any, size: int) -> None:
    """Join the pairs of low and high rows ``first, first - 2, ..`` to two rows: ``quarters`` gets low and high columns of either."""
    n, taps = per_vector(source), weights.shape[1]
    low, high = _four(weights, 0), _four(weights, 1)
    p, q, r, s = rows[first], rows[first + 1], rows[first - 2], rows[first - 1]
    for side in range(2):
        for j in range(0, half, n):
            at = side * half + j
            if j + n <= half:
                u, v, x, y = load(source, p + at), load(source, q + at), load(source, r + at), load(source, s + at)
                a = fma(high[2], y, fma(low[2], x, fma(high[0], v, mul(low[0], u))))
                b = fma(high[3], y, fma(low[3], x, fma(high[1], v, mul(low[1], u))))
                for t in range(4, taps, 2):
                    u, v = load(source, rows[first - t] + at), load(source, rows[first - t + 1] + at)
                    a = fma(splat(weights[1, t]), v, fma(splat(weights[0, t]), u, a))
                    b = fma(splat(weights[1, t + 1]), v, fma(splat(weights[0, t + 1]), u, b))
            else:
                a = b = splat(weights.dtype.type(0))
                for t in range(0, taps, 2):
                    u, v = load_some(source, rows[first - t] + at, half - j), load_some(source, rows[first - t + 1] + at, half - j)
                    a = fma(splat(weights[1, t]), v, fma(splat(weights[0, t]), u, a))
                    b = fma(splat(weights[1, t + 1]), v, fma(splat(weights[0, t + 1]), u, b))
            store(quarters, side * size + PAD + j, a)
            store(quarters, (2 + side) * size + PAD + j, b)


@kernel()
def _join_row(rows: Any, f: int, g: int, size: int, weights: Any, count: int, swap: bool, out: Any, to: int) -> None:
    """Join ``count`` low and high places (``size`` further on) to 2 ``count``; even taps read from ``f``, odd ones from ``g`` downwards.

    Even taps make the even places, or with ``swap`` the odd ones.
    """
    n, taps = per_vector(rows), weights.shape[1]
    low, high = _four(weights, 0), _four(weights, 1)
    for i in range(0, count, n):
        p, q = f + i, g + i
        u, v, x, y = load(rows, p), load(rows, p + size), load(rows, p - 1), load(rows, p + size - 1)
        a = fma(high[2], y, fma(low[2], x, fma(high[0], v, mul(low[0], u))))
        u, v, x, y = load(rows, q), load(rows, q + size), load(rows, q - 1), load(rows, q + size - 1)
        b = fma(high[3], y, fma(low[3], x, fma(high[1], v, mul(low[1], u))))
        for t in range(4, taps, 2):
            p, q = f + i - t // 2, g + i - t // 2
            a = fma(splat(weights[1, t]), load(rows, p + size), fma(splat(weights[0, t]), load(rows, p), a))
            b = fma(splat(weights[1, t + 1]), load(rows, q + size), fma(splat(weights[0, t + 1]), load(rows, q), b))
        if swap:
            a, b = b, a
        if i + n <= count:
            store(out, to + 2 * i, zip_low(a, b))
            store(out, to + 2 * i + n, zip_high(a, b))
        else:
            store_some(out, to + 2 * i, zip_low(a, b), 2 * (count - i))
            store_some(out, to + 2 * i + n, zip_high(a, b), 2 * (count - i) - n)


@kernel()
def _analyse(
    band: Any, base: int, rows: int, columns: int, weights: Any, origin: int, levels: int, limit: Any, places: Any, work: Any
) -> float:
    """Analyse one band in place; with ``limit`` >= 0 soft-threshold it too and return the l1 norm of what is left."""
    taps = weights.shape[1]
    ahead, size = (-origin) // 2, _row_size(columns)
    window = 4 * size
    f, g = (PAD - ahead, size + PAD - ahead) if origin % 2 == 0 else (size + PAD - ahead - 1, PAD - ahead)
    unlimited = work.dtype.type(-1)
    norm, start = 0.0, 0
    for level in range(levels):
        r, c = rows >> level, columns >> level
        saved = window + taps * c
        start += origin << level
        _places(base, start, 1 << level, rows, columns, r, places)
        for p in range(min(taps - 2, r)):
            copy_some(band, places[p], c, work, saved + p * c)
        for p in range(0, r, 2):
            if p + taps <= r:
                _down_columns(band, places, p, weights, c, work, size)
            else:
                for t in range(taps):
                    places[r + t] = window + t * c
                    if p + t < r:
                        copy_some(band, places[p + t], c, work, window + t * c)
                    else:
                        copy_some(work, saved + (p + t) % r * c, c, work, window + t * c)
                _down_columns(work, places, r, weights, c, work, size)
            for s in range(4):
                _extend(work, s * size + PAD, c // 2, ahead + 1, taps // 2)
            lower = limit if level == levels - 1 else unlimited
            norm += _along_row(work, f, g, weights, c // 2, lower, limit, band, places[p])
            norm += _along_row(work, 2 * size + f, 2 * size + g, weights, c // 2, limit, limit, band, places[p + 1])
    return norm


@kernel()
def _synthesise(band: Any, base: int, rows: int, columns: int, weights: Any, origin: int, levels: int, places: Any, work: Any) -> None:
    """Invert ``_analyse`` of one band in place."""
    taps = weights.shape[1]
    ahead, size = (-origin) // 2, _row_size(columns)
    window = 4 * size
    swap = origin % 2 != 0
    f, g = PAD + ahead + (1 if swap else 0), PAD + ahead
    for level in range(levels - 1, -1, -1):
        r, c = rows >> level, columns >> level
        saved = window + taps * c
        _places(base, origin * ((2 << level) - 1), 1 << level, rows, columns, r, places)
        for p in range(min(taps - 2, r)):
            copy_some(band, places[r - 1 - p], c, work, saved + p * c)
        for p in range(r - 2, -1, -2):
            if p >= taps - 2:
                _up_columns(band, places, p, weights, c // 2, work, size)
            else:
                for t in range(taps):
                    at = p + 1 - t
                    places[r + taps - 1 - t] = window + t * c
                    if at >= 0:
                        copy_some(band, places[at], c, work, window + t * c)
                    else:
                        copy_some(work, saved + (r - 1 - at % r) * c, c, work, window + t * c)
                _up_columns(work, places, r + taps - 2, weights, c // 2, work, size)
            for s in range(4):
                _extend(work, s * size + PAD, c // 2, taps // 2, ahead + 1)
            _join_row(work, f, g, size, weights, c // 2, swap, band, places[p])
            _join_row(work, 2 * size + f, 2 * size + g, size, weights, c // 2, swap, band, places[p + 1])


@kernel()
def _threshold(band: Any, base: int, count: int, limit: Any) -> float:
    """Soft-threshold a band without any wavelet and return the l1 norm of what is left."""
    n = per_vector(band)
    norm = 0.0
    bound = splat(limit)
    for j in range(0, count, n):
        if j + n <= count:
            v = _soft(load(band, base + j), bound)
            store(band, base + j, v)
        else:
            v = _soft(load_some(band, base + j, count - j), bound)
            store_some(band, base + j, v, count - j)
        norm += total(magnitude(v))
    return norm


@kernel()
def _pack(band: Any, base: int, rows: int, columns: int, origin: int, levels: int, places: Any, packed: Any, to: int, back: bool) -> None:
    """Copy a band from the kernel's order of rows to PyWavelets' packed one, or ``back``."""
    start = 0
    for level in range(levels + 1):
        r, c = rows >> level, columns >> level
        last = level == levels
        if not last:
            start += origin << level
        _places(base, start, 1 << level, rows, columns, r, places)
        for p in range(r):
            if last:
                here, row, first, count = places[p], p, 0, c
            elif p % 2 == 0:
                here, row, first, count = places[p], p // 2, c // 2, c - c // 2
            else:
                here, row, first, count = places[p], (r + p) // 2, 0, c
            if back:
                copy_some(packed, to + row * columns + first, count, band, here + first)
            else:
                copy_some(band, here + first, count, packed, to + row * columns + first)


@kernel()
def _work(columns: int, taps: int, like: Any) -> Any:
    """Allocate the split rows, one window of rows and the rows that a level saves."""
    return aligned(4 * _row_size(columns) + 2 * taps * columns, like)


@kernel()
def shrink_bands(first: int, last: int, cube: Any, filters: Any, length: int, levels: int, limits: Any, sums: Any) -> None:
    """Replace the bands ``first..last`` of ``cube`` (K, M, N) by ``W soft(W^T f, limits[k])``; ``sums[k]`` gets the l1 norm left."""
    rows, columns = cube.shape[1], cube.shape[2]
    stride = cube.strides[0] // cube.itemsize
    places = np.empty(rows + filters.shape[1], np.int64)
    work = _work(columns, filters.shape[1], cube)
    for k in range(first, last):
        if levels == 0:
            sums[k] = _threshold(cube, k * stride, rows * columns, limits[k])
        else:
            sums[k] = _analyse(cube, k * stride, rows, columns, filters, 1 - length // 2, levels, limits[k], places, work)
            _synthesise(cube, k * stride, rows, columns, filters, 1 - length // 2, levels, places, work)


@kernel()
def analysis_bands(first: int, last: int, cube: Any, filters: Any, length: int, levels: int, out: Any) -> None:
    """Analyse the bands ``first..last`` of ``cube`` (K, M, N) into packed coefficients ``out``; they may be one array."""
    rows, columns = cube.shape[1], cube.shape[2]
    here, there = cube.strides[0] // cube.itemsize, out.strides[0] // out.itemsize
    band = aligned(rows * columns, out)
    places = np.empty(rows + filters.shape[1], np.int64)
    work = _work(columns, filters.shape[1], out)
    unlimited = out.dtype.type(-1)
    for k in range(first, last):
        copy_some(cube, k * here, rows * columns, band, 0)
        _analyse(band, 0, rows, columns, filters, 1 - length // 2, levels, unlimited, places, work)
        _pack(band, 0, rows, columns, 1 - length // 2, levels, places, out, k * there, False)


@kernel()
def synthesis_bands(first: int, last: int, packed: Any, filters: Any, length: int, levels: int, out: Any) -> None:
    """Invert ``analysis_bands`` (its transpose) for the bands ``first..last``; ``packed`` and ``out`` may be one array."""
    rows, columns = packed.shape[1], packed.shape[2]
    here, there = packed.strides[0] // packed.itemsize, out.strides[0] // out.itemsize
    band = aligned(rows * columns, out)
    places = np.empty(rows + filters.shape[1], np.int64)
    work = _work(columns, filters.shape[1], out)
    for k in range(first, last):
        _pack(band, 0, rows, columns, 1 - length // 2, levels, places, packed, k * here, True)
        _synthesise(band, 0, rows, columns, filters, 1 - length // 2, levels, places, work)
        copy_some(band, 0, rows * columns, out, k * there)
