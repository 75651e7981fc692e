"""Compiled change of spectral coordinates: a small matrix times the spectrum of every pixel (theory.md (S.7)).

A matrix comes as two packed halves: ``even`` acts on sums of mirrored bands and ``odd`` on their differences when its rows
are mirror-symmetric in turn, as those of the DCT are, which halves the work; else ``odd`` is empty and ``even`` is the whole matrix.
``packed[b, k, r]`` is entry (4 b + r, k), with rows of zeros to fill the last block of four.
"""

from typing import Any

import numpy as np
from numba import njit

from recon.compiled import kernel
from recon.simd import add, fma, lanes, load, load_some, splat, store, store_some, sub

FLOATS, DOUBLES = lanes(np.float32), lanes(np.float64)
BLOCK = 4 * FLOATS  # a product works on four vectors of floats at a time
TILE = 2 * BLOCK  # pixels


@njit(nogil=True, forceinline=True)
def per_vector(array: Any) -> int:
    """Count the elements of a vector of the array's type."""
    return FLOATS if array.itemsize == 4 else DOUBLES


@kernel()
def aligned(count: int, like: Any) -> Any:
    """Allocate zeros of an array's type that begin at a cache line."""
    out = np.zeros(count + FLOATS, like.dtype)
    return out[-(out.ctypes.data // out.itemsize) % FLOATS :]


@kernel()
def copy_some(source: Any, at: int, count: int, out: Any, to: int) -> None:
    """Copy some elements to places that don't overlap them."""
    n = per_vector(out)
    whole = count - count % n
    for j in range(0, whole, n):
        store(out, to + j, load(source, at + j))
    if whole < count:
        store_some(out, to + whole, load_some(source, at + whole, count - whole), count - whole)


@kernel()
def _block(packed: Any, b: int, count: int, x: Any, at: int, step: int, out: Any, to: int, stride: int) -> None:
    """Set four rows of ``out`` (``stride`` apart, four vectors each) to block ``b`` times ``count`` rows of ``x`` (``step`` apart)."""
    n = per_vector(x)
    zero = splat(packed.dtype.type(0))
    a0 = a1 = a2 = a3 = b0 = b1 = b2 = b3 = c0 = c1 = c2 = c3 = d0 = d1 = d2 = d3 = zero
    for k in range(count):
        here = at + k * step
        u, v, w, z = load(x, here), load(x, here + n), load(x, here + 2 * n), load(x, here + 3 * n)
        m = splat(packed[b, k, 0])
        a0, a1, a2, a3 = fma(m, u, a0), fma(m, v, a1), fma(m, w, a2), fma(m, z, a3)
        m = splat(packed[b, k, 1])
        b0, b1, b2, b3 = fma(m, u, b0), fma(m, v, b1), fma(m, w, b2), fma(m, z, b3)
        m = splat(packed[b, k, 2])
        c0, c1, c2, c3 = fma(m, u, c0), fma(m, v, c1), fma(m, w, c2), fma(m, z, c3)
        m = splat(packed[b, k, 3])
        d0, d1, d2, d3 = fma(m, u, d0), fma(m, v, d1), fma(m, w, d2), fma(m, z, d3)
    store(out, to, a0)
    store(out, to + n, a1)
    store(out, to + 2 * n, a2)
    store(out, to + 3 * n, a3)
    to += stride
    store(out, to, b0)
    store(out, to + n, b1)
    store(out, to + 2 * n, b2)
    store(out, to + 3 * n, b3)
    to += stride
    store(out, to, c0)
    store(out, to + n, c1)
    store(out, to + 2 * n, c2)
    store(out, to + 3 * n, c3)
    to += stride
    store(out, to, d0)
    store(out, to + n, d1)
    store(out, to + 2 * n, d2)
    store(out, to + 3 * n, d3)


@kernel()
def product(packed: Any, x: Any, at: int, step: int, size: int, out: Any, to: int, stride: int) -> None:
    """Multiply rows of ``size`` places, a multiple of ``BLOCK``; ``out`` gets four rows a block, those of padding too."""
    n = 4 * per_vector(x)
    for j in range(0, size, n):
        for b in range(packed.shape[0]):
            _block(packed, b, packed.shape[1], x, at + j, step, out, to + 4 * b * stride + j, stride)


@kernel()
def fold(x: Any, at: int, step: int, bands: int, half: int, size: int, out: Any, to: int, stride: int) -> None:
    """Set the first bands - half rows of ``out`` to sums of mirrored rows of ``x``, the next ``half`` to their differences."""
    n = per_vector(x)
    upper = bands - half
    for k in range(upper):
        p, q, high, low = at + k * step, at + (bands - 1 - k) * step, to + k * stride, to + (upper + k) * stride
        for j in range(0, size, n):
            if k < half:
                u, v = load(x, p + j), load(x, q + j)
                store(out, high + j, add(u, v))
                store(out, low + j, sub(u, v))
            else:
                store(out, high + j, load(x, p + j))


@kernel()
def turn_tiles(first: int, last: int, x: Any, even: Any, odd: Any, out: Any) -> None:
    """Multiply the spectra of the tiles ``first..last`` of ``x`` (K, pixels) by a packed matrix; ``out`` (R, pixels) may be ``x``."""
    bands, pixels, result = x.shape[0], x.shape[1], out.shape[0]
    half = odd.shape[1]
    upper = bands - half
    here, there = x.strides[0] // x.itemsize, out.strides[0] // out.itemsize
    raw, folded, made = aligned(bands * TILE, out), aligned(bands * TILE, out), aligned(4 * (even.shape[0] + odd.shape[0]) * TILE, out)
    lower = 4 * even.shape[0] * TILE
    for tile in range(first, last):
        at = tile * TILE
        size = min(TILE, pixels - at)
        for k in range(bands):
            copy_some(x, k * here + at, size, raw, k * TILE)
        fold(raw, 0, TILE, bands, half, TILE, folded, 0, TILE)
        product(even, folded, 0, TILE, TILE, made, 0, TILE)
        product(odd, folded, upper * TILE, TILE, TILE, made, lower, TILE)
        for q in range(result):
            row = q * TILE if half == 0 else (q // 2) * TILE + (q % 2) * lower
            copy_some(made, row, size, out, q * there + at)


@kernel()
def turn_back_tiles(first: int, last: int, x: Any, even: Any, odd: Any, out: Any) -> None:
    """Multiply by a transpose, given as its packed halves: coefficients ``x`` (R, pixels) give ``out`` (K, pixels)."""
    coefficients, pixels, bands = x.shape[0], x.shape[1], out.shape[0]
    half = odd.shape[1]
    n, here, there = per_vector(x), x.strides[0] // x.itemsize, out.strides[0] // out.itemsize
    raw, made = aligned(coefficients * TILE, out), aligned(4 * (even.shape[0] + odd.shape[0]) * TILE, out)
    step = TILE if half == 0 else 2 * TILE
    lower = 4 * even.shape[0] * TILE
    for tile in range(first, last):
        at = tile * TILE
        size = min(TILE, pixels - at)
        for q in range(coefficients):
            copy_some(x, q * here + at, size, raw, q * TILE)
        product(even, raw, 0, step, TILE, made, 0, TILE)
        product(odd, raw, TILE, step, TILE, made, lower, TILE)
        for k in range(bands - half):
            p, q = k * there + at, (bands - 1 - k) * there + at
            if k >= half:
                copy_some(made, k * TILE, size, out, p)
                continue
            for j in range(0, size, n):
                u, v = load(made, k * TILE + j), load(made, lower + k * TILE + j)
                if j + n <= size:
                    store(out, p + j, add(u, v))
                    store(out, q + j, sub(u, v))
                else:
                    store_some(out, p + j, add(u, v), size - j)
                    store_some(out, q + j, sub(u, v), size - j)
