"""Compiled loops of the coded-aperture operator, over detector rows (theory.md (S.1)).

Cubes are band-major (K, M, N), frames (L, C, M, W). Each kernel handles the rows ``first..last`` and touches no other, so slabs can
run on any number of threads and give the same bytes. A row of all bands is worked in buffers of whole vectors with zeros
around, so that a shifted row is an unaligned load and nothing has to be cut. Cubes may hold spectral coefficients in place of
bands: the matrices in ``Optics`` then turn each row to bands and back on the way (theory.md (S.16)).
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from recon.simd import add, fma, load, load_some, mul, splat, store, store_some, sub, total
from recon.spectral_kernels import BLOCK, aligned, copy_some, fold, per_vector, product

FAST = {"contract", "reassoc", "nsz", "arcp"}


class Optics(NamedTuple):
    """What a camera's kernels need, in one argument.

    Args:
        masks: (L, M, N).
        response: (C, K); used without a mosaic.
        tile: (R, K, row_step(W) + 2 BLOCK) response of each different row of the mosaic, zeros around; empty without a mosaic.
        tile_of: (M,) which of them each sensor row is.
        start: (K,) column of the first tap.
        taps: (K, T).
        even: packed matrix from bands to spectral coefficients, its even half; empty when cubes hold bands.
        odd: its odd half.
        even_back: packed matrix of the way back, its even half.
        odd_back: its odd half.
    """

    masks: Any
    response: Any
    tile: Any
    tile_of: Any
    start: Any
    taps: Any
    even: Any
    odd: Any
    even_back: Any
    odd_back: Any


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


@njit(nogil=True, cache=True)
def row_step(columns: int) -> int:
    """Round up to whole blocks."""
    return (columns + BLOCK - 1) // BLOCK * BLOCK


@njit(nogil=True, cache=True)
def read_row(cube: Any, m: int, step: int, out: Any) -> None:
    """Copy row m of every band, ``step`` apart, with zeros behind."""
    bands, columns, n = cube.shape[0], cube.shape[2], per_vector(cube)
    band, line = cube.strides[0] // cube.itemsize, cube.strides[1] // cube.itemsize
    whole = columns - columns % n
    for k in range(bands):
        at, to = k * band + m * line, k * step
        for j in range(0, whole, n):
            store(out, to + j, load(cube, at + j))
        if whole < columns:
            store(out, to + whole, load_some(cube, at + whole, columns - whole))


@njit(nogil=True, cache=True)
def to_bands(optics: Any, x: Any, step: int, bands: int, made: Any, out: Any) -> None:
    """Turn a row of coefficients to bands; ``made`` holds one block of it."""
    half, n = optics.odd.shape[1], per_vector(x)
    lower = 4 * optics.even_back.shape[0] * BLOCK
    apart = step if half == 0 else 2 * step
    for at in range(0, step, BLOCK):
        product(optics.even_back, x, at, apart, BLOCK, made, 0, BLOCK)
        product(optics.odd_back, x, step + at, apart, BLOCK, made, lower, BLOCK)
        for k in range(bands - half):
            p, q = k * step + at, (bands - 1 - k) * step + at
            for j in range(0, BLOCK, n):
                u = load(made, k * BLOCK + j)
                if k < half:
                    v = load(made, lower + k * BLOCK + j)
                    store(out, q + j, sub(u, v))
                    u = add(u, v)
                store(out, p + j, u)


@njit(nogil=True, cache=True)
def to_coefficients(optics: Any, x: Any, step: int, bands: int, made: Any, out: Any) -> None:
    """Turn a row of bands to coefficients; ``made`` holds one block of it, ``out`` has room for 8 rows of padding."""
    half = optics.odd.shape[1]
    apart = step if half == 0 else 2 * step
    for at in range(0, step, BLOCK):
        fold(x, at, step, bands, half, BLOCK, made, 0, BLOCK)
        product(optics.even, made, 0, BLOCK, BLOCK, out, at, apart)
        product(optics.odd, made, (bands - half) * BLOCK, BLOCK, BLOCK, out, step + at, apart)


@njit(nogil=True, cache=True)
def see_row(optics: Any, m: int, x: Any, step: int, width: int, seen: Any, masked: Any) -> None:
    """Photograph one row of bands: ``seen`` gets a row of row_step(W) + 2 BLOCK places a shot and channel, zeros around it.

    ``masked`` is K rows of step + 2 BLOCK places, zeros in the first and last BLOCK.
    """
    shots, columns = optics.masks.shape[0], optics.masks.shape[2]
    bands, taps = optics.taps.shape
    mosaic, n = optics.tile.shape[0] > 0, per_vector(x)
    channels = 1 if mosaic else optics.response.shape[0]
    long, there = step + 2 * BLOCK, row_step(width) + 2 * BLOCK
    across = optics.masks.shape[1] * columns
    tile0 = optics.tile_of[m] * bands * there
    zero = splat(x.dtype.type(0))
    for l in range(shots):
        at = l * across + m * columns
        for j in range(0, step, n):
            mask = load_some(optics.masks, at + j, columns - j)
            for k in range(bands):
                store(masked, k * long + BLOCK + j, mul(mask, load(x, k * step + j)))
        for c in range(channels):
            to = (l * channels + c) * there + BLOCK
            for j in range(0, row_step(width), 4 * n):
                a0 = a1 = a2 = a3 = zero
                for k in range(bands):
                    for t in range(taps):
                        o = k * long + BLOCK + min(max(j - optics.start[k] - t, -BLOCK), step)
                        u0, u1, u2, u3 = load(masked, o), load(masked, o + n), load(masked, o + 2 * n), load(masked, o + 3 * n)
                        if mosaic:
                            w, o = splat(optics.taps[k, t]), tile0 + k * there + BLOCK + j
                            u0, u1 = mul(u0, load(optics.tile, o)), mul(u1, load(optics.tile, o + n))
                            u2, u3 = mul(u2, load(optics.tile, o + 2 * n)), mul(u3, load(optics.tile, o + 3 * n))
                        else:
                            w = splat(optics.taps[k, t] * optics.response[c, k])
                        a0, a1, a2, a3 = fma(w, u0, a0), fma(w, u1, a1), fma(w, u2, a2), fma(w, u3, a3)
                store(seen, to + j, a0)
                store(seen, to + j + n, a1)
                store(seen, to + j + 2 * n, a2)
                store(seen, to + j + 3 * n, a3)
            for j in range(width, row_step(width)):
                seen[to + j] = 0


@njit(nogil=True, cache=True)
def return_row(optics: Any, m: int, left: Any, step: int, width: int, mask: Any, out: Any) -> None:
    """Spread one row of frames back over every band: ``out`` gets K rows of ``step`` places.

    ``left`` is laid out as ``see_row`` leaves ``seen``; ``mask`` holds the masks of the row, L rows of ``step``.
    """
    shots = optics.masks.shape[0]
    bands, taps = optics.taps.shape
    mosaic, n = optics.tile.shape[0] > 0, per_vector(left)
    channels = 1 if mosaic else optics.response.shape[0]
    longest = row_step(width)
    there = longest + 2 * BLOCK
    tile0 = optics.tile_of[m] * bands * there
    zero = splat(left.dtype.type(0))
    for k in range(bands):
        for j in range(0, step, 4 * n):
            b0 = b1 = b2 = b3 = zero
            for l in range(shots):
                a0 = a1 = a2 = a3 = zero
                for t in range(taps):
                    o = BLOCK + min(max(j + optics.start[k] + t, -BLOCK), longest)
                    for c in range(channels):
                        p = (l * channels + c) * there + o
                        u0, u1, u2, u3 = load(left, p), load(left, p + n), load(left, p + 2 * n), load(left, p + 3 * n)
                        if mosaic:
                            w, p = splat(optics.taps[k, t]), tile0 + k * there + o
                            u0, u1 = mul(u0, load(optics.tile, p)), mul(u1, load(optics.tile, p + n))
                            u2, u3 = mul(u2, load(optics.tile, p + 2 * n)), mul(u3, load(optics.tile, p + 3 * n))
                        else:
                            w = splat(optics.taps[k, t] * optics.response[c, k])
                        a0, a1, a2, a3 = fma(w, u0, a0), fma(w, u1, a1), fma(w, u2, a2), fma(w, u3, a3)
                p = l * step + j
                b0, b1 = fma(load(mask, p), a0, b0), fma(load(mask, p + n), a1, b1)
                b2, b3 = fma(load(mask, p + 2 * n), a2, b2), fma(load(mask, p + 3 * n), a3, b3)
            store(out, k * step + j, b0)
            store(out, k * step + j + n, b1)
            store(out, k * step + j + 2 * n, b2)
            store(out, k * step + j + 3 * n, b3)


@njit(nogil=True, cache=True)
def mask_row(optics: Any, m: int, step: int, out: Any) -> None:
    """Copy the masks of a row, ``step`` apart, with zeros behind."""
    rows, columns = optics.masks.shape[1], optics.masks.shape[2]
    n = per_vector(out)
    for l in range(optics.masks.shape[0]):
        for j in range(0, columns, n):
            store(out, l * step + j, load_some(optics.masks, (l * rows + m) * columns + j, columns - j))


@njit(nogil=True, cache=True)
def forward_rows(first: int, last: int, x: Any, optics: Any, out: Any) -> None:
    """Apply H to the rows ``first..last`` of a cube."""
    bands, columns, width = x.shape[0], x.shape[2], out.shape[3]
    step, there = row_step(columns), row_step(width) + 2 * BLOCK
    frames, across = out.shape[0] * out.shape[1], out.shape[2] * width
    raw, made = aligned(bands * step, out), aligned((bands + 8) * BLOCK, out)
    turned = aligned(bands * step, out) if optics.even.shape[0] > 0 else raw
    masked, seen = aligned(bands * (step + 2 * BLOCK), out), aligned(frames * there, out)
    for m in range(first, last):
        read_row(x, m, step, raw)
        if optics.even.shape[0] > 0:
            to_bands(optics, raw, step, bands, made, turned)
        see_row(optics, m, turned, step, width, seen, masked)
        for s in range(frames):
            copy_some(seen, s * there + BLOCK, width, out, s * across + m * width)


@njit(nogil=True, cache=True)
def adjoint_rows(first: int, last: int, y: Any, optics: Any, out: Any) -> None:
    """Apply H^T to the rows ``first..last`` of frames."""
    bands, columns, width = out.shape[0], out.shape[2], y.shape[3]
    step, there = row_step(columns), row_step(width) + 2 * BLOCK
    frames, across = y.shape[0] * y.shape[1], y.shape[2] * width
    band, line = out.strides[0] // out.itemsize, out.strides[1] // out.itemsize
    left, mask = aligned(frames * there, out), aligned(y.shape[0] * step, out)
    back, made = aligned(bands * step, out), aligned((bands + 8) * BLOCK, out)
    spectral = optics.even.shape[0] > 0
    turned = aligned((bands + 8) * step, out) if spectral else back
    for m in range(first, last):
        for s in range(frames):
            copy_some(y, s * across + m * width, width, left, s * there + BLOCK)
        mask_row(optics, m, step, mask)
        return_row(optics, m, left, step, width, mask, back)
        if spectral:
            to_coefficients(optics, back, step, bands, made, turned)
        for k in range(bands):
            copy_some(turned, k * step, columns, out, k * band + m * line)


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


@njit(nogil=True, cache=True)
def descend_rows(first: int, last: int, x: Any, old: Any, seen_old: Any, beta: Any, rate: Any, frames: Any, optics: Any, sums: Any) -> None:
    """Take FISTA's gradient step on the rows ``first..last``: ``old = y + rate H^T (g - H y)``, ``y = x + beta (x - old)``.

    ``seen_old`` holds ``H old`` and gets ``H x``; ``sums[m]`` gets ``||g - H x||^2`` of the row.
    """
    bands, columns, width = x.shape[0], x.shape[2], frames.shape[3]
    step, there, n = row_step(columns), row_step(width) + 2 * BLOCK, per_vector(x)
    count, across = frames.shape[0] * frames.shape[1], frames.shape[2] * width
    band, line = old.strides[0] // old.itemsize, old.strides[1] // old.itemsize
    raw, made = aligned(bands * step, x), aligned((bands + 8) * BLOCK, x)
    spectral = optics.even.shape[0] > 0
    turned = aligned(bands * step, x) if spectral else raw
    masked, left, mask = aligned(bands * (step + 2 * BLOCK), x), aligned(count * there, x), aligned(frames.shape[0] * step, x)
    back = aligned(bands * step, x)
    change = aligned((bands + 8) * step, x) if spectral else back
    speed, length = splat(beta), splat(rate)
    for m in range(first, last):
        read_row(x, m, step, raw)
        if spectral:
            to_bands(optics, raw, step, bands, made, turned)
        see_row(optics, m, turned, step, width, left, masked)
        misfit = splat(x.dtype.type(0))
        for s in range(count):
            to, at = s * there + BLOCK, s * across + m * width
            for j in range(0, width, n):
                now = load(left, to + j)
                if j + n <= width:
                    gap, before = sub(load(frames, at + j), now), load(seen_old, at + j)
                    store(seen_old, at + j, now)
                else:
                    gap, before = sub(load_some(frames, at + j, width - j), now), load_some(seen_old, at + j, width - j)
                    store_some(seen_old, at + j, now, width - j)
                misfit = fma(gap, gap, misfit)
                store(left, to + j, fma(speed, sub(before, now), gap))
        sums[m] = total(misfit)
        mask_row(optics, m, step, mask)
        return_row(optics, m, left, step, width, mask, back)
        if spectral:
            to_coefficients(optics, back, step, bands, made, change)
        for k in range(bands):
            to = k * band + m * line
            for j in range(0, columns, n):
                here, rest = load(raw, k * step + j), columns - j
                before = load(old, to + j) if rest >= n else load_some(old, to + j, rest)
                new = fma(length, load(change, k * step + j), fma(speed, sub(here, before), here))
                if rest >= n:
                    store(old, to + j, new)
                else:
                    store_some(old, to + j, new, rest)
