"""Compiled loops of the coded-aperture operator, over detector rows (theory.md (S.1)).

Cubes are band-major (K, M, N), frames (L, C, M, W). Each kernel handles the rows ``first..last`` and touches no other, so slabs can
run on any number of threads and give the same bytes. A row of all bands is worked in buffers of whole vectors with zeros
around, so that a shifted row is an unaligned load and nothing has to be cut. Cubes may hold spectral coefficients in place of
bands: the matrices in ``Optics`` then turn each row to bands and back on the way (theory.md (S.70)).
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from recon.compiled import kernel
from recon.simd import add, fma, load, load_some, mul, splat, store, store_some, sub, total
from recon.spectral_kernels import BLOCK, FLOATS, aligned, copy_some, fold, per_vector, product

FAST = {"contract", "reassoc", "nsz", "arcp"}


class Optics(NamedTuple):
    """What a camera's kernels need, in one argument. A tap is one sensor column that a band lands on; taps go by band.

    Args:
        masks: (L, M, N).
        strength: (C, I) response times weight of each tap; with a mosaic (1, I), the weight alone.
        tile: (R, K, row_step(W) + 2 BLOCK) response of each different row of the mosaic, zeros around; empty without a mosaic.
        tile_of: (M,) which of them each sensor row is.
        band: (I,) band of each tap.
        place: (I,) sensor column of mirror column 0.
        first: (K + 1,) first tap of each band.
        even: packed matrix from bands to spectral coefficients, its even half; empty when cubes hold bands.
        odd: its odd half.
        even_back: packed matrix of the way back, its even half.
        odd_back: its odd half.
    """

    masks: Any
    strength: Any
    tile: Any
    tile_of: Any
    band: Any
    place: Any
    first: Any
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


@kernel()
def row_step(columns: int) -> int:
    """Round up to whole blocks."""
    return (columns + BLOCK - 1) // BLOCK * BLOCK


@kernel()
def row_apart(columns: int) -> int:
    """Return how far apart rows of ``row_step(columns)`` places lie: a power of two would put all bands in few sets of the cache."""
    return row_step(columns) + FLOATS


@kernel()
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


@kernel()
def to_bands(optics: Any, x: Any, step: int, mask: Any, made: Any, out: Any, to: int, apart: int) -> None:
    """Turn a row of coefficients, ``step`` apart, to bands, ``apart`` apart from ``to`` on; ``made`` holds one block of it.

    With one shot the bands are multiplied by its mask at once.
    """
    bands, half, n = optics.first.size - 1, optics.odd.shape[1], per_vector(x)
    lower, one_shot = 4 * optics.even_back.shape[0] * BLOCK, optics.masks.shape[0] == 1
    stride = step if half == 0 else 2 * step
    for at in range(0, step - FLOATS, BLOCK):
        product(optics.even_back, x, at, stride, BLOCK, made, 0, BLOCK)
        product(optics.odd_back, x, step + at, stride, BLOCK, made, lower, BLOCK)
        for j in range(0, BLOCK, n):
            light = load(mask, at + j)
            for k in range(bands - half):
                u = load(made, k * BLOCK + j)
                if k < half:
                    v = load(made, lower + k * BLOCK + j)
                    q = sub(u, v)
                    store(out, to + (bands - 1 - k) * apart + at + j, mul(light, q) if one_shot else q)
                    u = add(u, v)
                store(out, to + k * apart + at + j, mul(light, u) if one_shot else u)


@kernel()
def to_coefficients(optics: Any, x: Any, step: int, made: Any, out: Any) -> None:
    """Turn a row of bands to coefficients, both ``step`` apart; ``made`` holds one block of it, ``out`` has room for 8 rows of padding."""
    bands, half = optics.first.size - 1, optics.odd.shape[1]
    apart = step if half == 0 else 2 * step
    for at in range(0, step - FLOATS, BLOCK):
        fold(x, at, step, bands, half, BLOCK, made, 0, BLOCK)
        product(optics.even, made, 0, BLOCK, BLOCK, out, at, apart)
        product(optics.odd, made, (bands - half) * BLOCK, BLOCK, BLOCK, out, step + at, apart)


@kernel()
def see_row(optics: Any, m: int, mask: Any, x: Any, step: int, width: int, seen: Any, masked: Any) -> None:
    """Photograph one row of bands: ``seen`` gets a row of row_step(W) + 2 BLOCK places a shot and channel, zeros around it.

    ``mask`` holds the masks of the row, L rows, and ``x`` its bands, both ``step`` apart; ``masked`` is K rows of step + 2 BLOCK
    places, zeros in the first and last BLOCK.
    """
    n, long = per_vector(x), step + 2 * BLOCK
    for l in range(optics.masks.shape[0]):
        for k in range(optics.first.size - 1):
            for j in range(0, step - FLOATS, n):
                store(masked, k * long + BLOCK + j, mul(load(mask, l * step + j), load(x, k * step + j)))
        see_masked(optics, m, l, step, width, seen, masked)


@kernel()
def see_masked(optics: Any, m: int, l: int, step: int, width: int, seen: Any, masked: Any) -> None:
    """Photograph one row behind the mask of shot ``l``; see ``see_row``."""
    bands, n = optics.first.size - 1, per_vector(masked)
    mosaic, taps, channels = optics.tile.shape[0] > 0, optics.place.size, optics.strength.shape[0]
    size, long, longest = step - FLOATS, step + 2 * BLOCK, row_step(width)
    there = longest + 2 * BLOCK
    tile0 = optics.tile_of[m] * bands * there
    zero = splat(masked.dtype.type(0))
    for c in range(channels):
        to = (l * channels + c) * there + BLOCK
        for j in range(0, longest, 4 * n):
            a0 = a1 = a2 = a3 = zero
            for i in range(taps):
                w = splat(optics.strength[c, i])
                o = optics.band[i] * long + BLOCK + min(max(j - optics.place[i], -BLOCK), size)
                u0, u1, u2, u3 = load(masked, o), load(masked, o + n), load(masked, o + 2 * n), load(masked, o + 3 * n)
                if mosaic:
                    o = tile0 + optics.band[i] * there + BLOCK + j
                    u0, u1 = mul(u0, load(optics.tile, o)), mul(u1, load(optics.tile, o + n))
                    u2, u3 = mul(u2, load(optics.tile, o + 2 * n)), mul(u3, load(optics.tile, o + 3 * n))
                a0, a1, a2, a3 = fma(w, u0, a0), fma(w, u1, a1), fma(w, u2, a2), fma(w, u3, a3)
            store(seen, to + j, a0)
            store(seen, to + j + n, a1)
            store(seen, to + j + 2 * n, a2)
            store(seen, to + j + 3 * n, a3)
        for j in range(width, longest):
            seen[to + j] = 0


@kernel()
def _add_row(
    weight: Any, mask: Any, mask_at: int, tile: Any, tile_at: int, left: Any, row: int, place: int, longest: int, more: bool, out: Any,
    to: int, size: int,
) -> None:  # fmt: skip
    """Set, or with ``more`` raise, ``size`` places of ``out`` by weight, mask, with ``tile_at`` >= 0 tile, and shifted frame."""
    n = per_vector(left)
    w = splat(weight)
    for j in range(0, size, 4 * n):
        o = min(max(j + place, -BLOCK), longest)
        u0, u1, u2, u3 = load(left, row + o), load(left, row + o + n), load(left, row + o + 2 * n), load(left, row + o + 3 * n)
        p = mask_at + j
        u0, u1 = mul(u0, mul(w, load(mask, p))), mul(u1, mul(w, load(mask, p + n)))
        u2, u3 = mul(u2, mul(w, load(mask, p + 2 * n))), mul(u3, mul(w, load(mask, p + 3 * n)))
        if tile_at >= 0:
            p = tile_at + o
            u0, u1 = mul(u0, load(tile, p)), mul(u1, load(tile, p + n))
            u2, u3 = mul(u2, load(tile, p + 2 * n)), mul(u3, load(tile, p + 3 * n))
        q = to + j
        if more:
            u0, u1, u2, u3 = add(load(out, q), u0), add(load(out, q + n), u1), add(load(out, q + 2 * n), u2), add(load(out, q + 3 * n), u3)
        store(out, q, u0)
        store(out, q + n, u1)
        store(out, q + 2 * n, u2)
        store(out, q + 3 * n, u3)


@kernel()
def return_row(optics: Any, m: int, mask: Any, left: Any, step: int, width: int, out: Any) -> None:
    """Spread one row of frames back over every band: ``out`` gets K rows, ``step`` apart.

    ``left`` is laid out as ``see_row`` leaves ``seen``; ``mask`` holds the masks of the row, L rows, ``step`` apart.
    """
    bands, n, channels = optics.first.size - 1, per_vector(left), optics.strength.shape[0]
    longest = row_step(width)
    there = longest + 2 * BLOCK
    zero = splat(left.dtype.type(0))
    for k in range(bands):
        tile = (optics.tile_of[m] * bands + k) * there + BLOCK if optics.tile.shape[0] > 0 else -1
        more = False
        for l in range(optics.masks.shape[0]):
            for i in range(optics.first[k], optics.first[k + 1]):
                for c in range(channels):
                    row = (l * channels + c) * there + BLOCK
                    w, place = optics.strength[c, i], optics.place[i]
                    _add_row(w, mask, l * step, optics.tile, tile, left, row, place, longest, more, out, k * step, step - FLOATS)
                    more = True
        if not more:
            for j in range(0, step - FLOATS, n):
                store(out, k * step + j, zero)


@kernel()
def mask_row(optics: Any, m: int, step: int, out: Any) -> None:
    """Copy the masks of a row, ``step`` apart, with zeros behind."""
    rows, columns = optics.masks.shape[1], optics.masks.shape[2]
    n = per_vector(out)
    for l in range(optics.masks.shape[0]):
        for j in range(0, columns, n):
            store(out, l * step + j, load_some(optics.masks, (l * rows + m) * columns + j, columns - j))


class Work(NamedTuple):
    """Buffers of one thread: see ``work_of``."""

    masked: Any
    bands: Any
    made: Any


@kernel()
def work_of(optics: Any, step: int, like: Any) -> Any:
    """Allocate the buffers that ``see`` and ``give_back`` need: masked bands, bands, and one block of halves."""
    count = optics.first.size - 1
    spectral = optics.even.shape[0] > 0
    return Work(
        aligned(count * (step + 2 * BLOCK), like),
        aligned(count * step if spectral else 0, like),
        aligned((count + 8) * BLOCK if spectral else 0, like),
    )


@kernel()
def see(optics: Any, m: int, mask: Any, x: Any, step: int, width: int, work: Any, seen: Any) -> None:
    """Photograph one row of a cube: ``x`` holds its coefficients or bands, ``step`` apart; see ``see_row`` and ``Work``."""
    if optics.even.shape[0] == 0:
        see_row(optics, m, mask, x, step, width, seen, work.masked)
    elif optics.masks.shape[0] == 1:
        to_bands(optics, x, step, mask, work.made, work.masked, BLOCK, step + 2 * BLOCK)
        see_masked(optics, m, 0, step, width, seen, work.masked)
    else:
        to_bands(optics, x, step, mask, work.made, work.bands, 0, step)
        see_row(optics, m, mask, work.bands, step, width, seen, work.masked)


@kernel()
def give_back(optics: Any, m: int, mask: Any, left: Any, step: int, width: int, work: Any, out: Any) -> None:
    """Spread one row of frames back: ``out`` gets the row's coefficients or bands, ``step`` apart, and 8 rows of padding."""
    if optics.even.shape[0] == 0:
        return_row(optics, m, mask, left, step, width, out)
    else:
        return_row(optics, m, mask, left, step, width, work.bands)
        to_coefficients(optics, work.bands, step, work.made, out)


@kernel()
def forward_rows(first: int, last: int, x: Any, optics: Any, out: Any) -> None:
    """Apply H to the rows ``first..last`` of a cube."""
    columns, width = x.shape[2], out.shape[3]
    step, there = row_apart(columns), row_step(width) + 2 * BLOCK
    frames, across = out.shape[0] * out.shape[1], out.shape[2] * width
    work, raw = work_of(optics, step, out), aligned(x.shape[0] * step, out)
    seen, mask = aligned(frames * there, out), aligned(out.shape[0] * step, out)
    for m in range(first, last):
        mask_row(optics, m, step, mask)
        read_row(x, m, step, raw)
        see(optics, m, mask, raw, step, width, work, seen)
        for s in range(frames):
            copy_some(seen, s * there + BLOCK, width, out, s * across + m * width)


@kernel()
def adjoint_rows(first: int, last: int, y: Any, optics: Any, out: Any) -> None:
    """Apply H^T to the rows ``first..last`` of frames."""
    bands, columns, width = out.shape[0], out.shape[2], y.shape[3]
    step, there = row_apart(columns), row_step(width) + 2 * BLOCK
    frames, across = y.shape[0] * y.shape[1], y.shape[2] * width
    band, line = out.strides[0] // out.itemsize, out.strides[1] // out.itemsize
    work, left = work_of(optics, step, out), aligned(frames * there, out)
    mask, back = aligned(y.shape[0] * step, out), aligned((bands + 8) * step, out)
    for m in range(first, last):
        for s in range(frames):
            copy_some(y, s * across + m * width, width, left, s * there + BLOCK)
        mask_row(optics, m, step, mask)
        give_back(optics, m, mask, left, step, width, work, back)
        for k in range(bands):
            copy_some(back, k * step, columns, out, k * band + m * line)


@kernel(fastmath=FAST)
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


@kernel()
def descend_rows(first: int, last: int, x: Any, old: Any, seen_old: Any, beta: Any, rate: Any, frames: Any, optics: Any, sums: Any) -> None:
    """Take FISTA's gradient step on the rows ``first..last``: ``old = y + rate H^T (g - H y)``, ``y = x + beta (x - old)``.

    ``seen_old`` holds ``H old`` and gets ``H x``; ``sums[m]`` gets ``||g - H x||^2`` of the row.
    """
    bands, columns, width = x.shape[0], x.shape[2], frames.shape[3]
    step, there, n = row_apart(columns), row_step(width) + 2 * BLOCK, per_vector(x)
    count, across = frames.shape[0] * frames.shape[1], frames.shape[2] * width
    band, line = old.strides[0] // old.itemsize, old.strides[1] // old.itemsize
    work, raw, change = work_of(optics, step, x), aligned(bands * step, x), aligned((bands + 8) * step, x)
    left, mask = aligned(count * there, x), aligned(frames.shape[0] * step, x)
    speed, length = splat(beta), splat(rate)
    for m in range(first, last):
        mask_row(optics, m, step, mask)
        read_row(x, m, step, raw)
        see(optics, m, mask, raw, step, width, work, left)
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
        give_back(optics, m, mask, left, step, width, work, change)
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
