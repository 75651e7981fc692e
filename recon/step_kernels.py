"""Compiled loops of the exact data step for cameras whose voxels land on one sensor column each (theory.md (S.10)).

There H H^T is block diagonal, one S x S block a sensor pixel (S = shots x channels), and the whole step
``z -> z + H^T (H H^T + rho I)^+ (g - H z)`` is local to a sensor row. Blocks are stored packed, ``inverse[m, p, j]``
with ``p = s (s + 1) / 2 + q`` for ``q <= s``, so that the sensor column j runs fastest.
"""

from typing import Any

import numpy as np
from numba import njit

from recon.aperture_kernels import FAST, _add_product, give_back, mask_row, read_row, row_apart, row_step, see, work_of
from recon.compiled import kernel
from recon.simd import add, fma, load, load_some, mul, splat, store, store_some, sub, total
from recon.spectral_kernels import BLOCK, aligned, copy_some, per_vector


@kernel()
def relax_row(z: Any, w: Any, x: Any, m: int, relax: Any, step: int, out: Any) -> float:
    """Set row m of every band in ``out`` (``step`` apart) to ``z + relax (w - x)``, zeros behind; returns ``||w - x||^2``."""
    bands, columns, n = z.shape[0], z.shape[2], per_vector(z)
    zb, wb, xb = z.strides[0] // z.itemsize, w.strides[0] // w.itemsize, x.strides[0] // x.itemsize
    zl, wl, xl = z.strides[1] // z.itemsize, w.strides[1] // w.itemsize, x.strides[1] // x.itemsize
    factor, gap = splat(relax), 0.0
    for k in range(bands):
        p, q, r = k * zb + m * zl, k * wb + m * wl, k * xb + m * xl
        square = splat(z.dtype.type(0))
        for j in range(0, columns, n):
            if j + n <= columns:
                delta = sub(load(w, q + j), load(x, r + j))
                here = load(z, p + j)
            else:
                delta = sub(load_some(w, q + j, columns - j), load_some(x, r + j, columns - j))
                here = load_some(z, p + j, columns - j)
            square = fma(delta, delta, square)
            store(out, k * step + j, fma(factor, delta, here))
        gap += total(square)
    return gap


@kernel()
def finish_row(z: Any, w: Any, x: Any, m: int, ratio: Any, step: int, before: Any, moved: Any, sums: Any) -> None:
    """Set row m of ``x = before + moved``, ``z = x - ratio moved`` and ``w = 2 x - z``.

    ``before`` and ``moved`` hold the row of every band, ``step`` apart. ``sums[m, 1:]`` gets the
    squares of x's change, of x and of ``moved``.
    """
    bands, columns, n = z.shape[0], z.shape[2], per_vector(z)
    zb, wb, xb = z.strides[0] // z.itemsize, w.strides[0] // w.itemsize, x.strides[0] // x.itemsize
    zl, wl, xl = z.strides[1] // z.itemsize, w.strides[1] // w.itemsize, x.strides[1] // x.itemsize
    factor = splat(ratio)
    change = size = length = 0.0
    for k in range(bands):
        p, q, r = k * zb + m * zl, k * wb + m * wl, k * xb + m * xl
        a = b = c = splat(z.dtype.type(0))
        for j in range(0, columns, n):
            by = load(moved, k * step + j)
            new = add(load(before, k * step + j), by)
            more = mul(factor, by)
            if j + n <= columns:
                delta = sub(new, load(x, r + j))
                store(x, r + j, new)
                store(z, p + j, sub(new, more))
                store(w, q + j, add(new, more))
            else:
                delta = sub(new, load_some(x, r + j, columns - j))
                store_some(x, r + j, new, columns - j)
                store_some(z, p + j, sub(new, more), columns - j)
                store_some(w, q + j, add(new, more), columns - j)
            a, b, c = fma(delta, delta, a), fma(new, new, b), fma(by, by, c)
        change += total(a)
        size += total(b)
        length += total(c)
    sums[m, 1], sums[m, 2], sums[m, 3] = change, size, length


@kernel()
def _apply_inverse(inverse: Any, m: int, width: int, frames: int, left: Any, there: int, out: Any) -> None:
    """Set ``out[s] = sum_q B[s, q] left[q]`` for the packed symmetric blocks of sensor row m; rows are ``there`` apart."""
    n = per_vector(left)
    row = m * inverse.shape[1] * width
    for j in range(0, width, n):
        for s in range(frames):
            sum_ = splat(left.dtype.type(0))
            for q in range(frames):
                p = s * (s + 1) // 2 + q if q <= s else q * (q + 1) // 2 + s
                sum_ = fma(load_some(inverse, row + p * width + j, width - j), load(left, q * there + BLOCK + j), sum_)
            store(out, s * there + BLOCK + j, sum_)


@kernel()
def advance_rows(
    first: int, last: int, z: Any, w: Any, x: Any, relax: Any, frames: Any, optics: Any, inverse: Any, ratio: Any, sums: Any
) -> None:
    """One half of a Douglas-Rachford iteration on the rows ``first..last``: ``z += relax (w - x); x = P(z); w = 2 x - z``.

    ``ratio`` rescales ``z - x`` to the next threshold. ``sums[m]`` gets the squared norms of w - x (before), of x's
    change, of x and of x - z.
    """
    bands, columns, width = z.shape[0], z.shape[2], frames.shape[3]
    step, there, n = row_apart(columns), row_step(width) + 2 * BLOCK, per_vector(z)
    count, across = frames.shape[0] * frames.shape[1], frames.shape[2] * width
    work, raw, moved = work_of(optics, step, z), aligned(bands * step, z), aligned((bands + 8) * step, z)
    left, weight, mask = aligned(count * there, z), aligned(count * there, z), aligned(frames.shape[0] * step, z)
    for m in range(first, last):
        mask_row(optics, m, step, mask)
        sums[m, 0] = relax_row(z, w, x, m, relax, step, raw)
        see(optics, m, mask, raw, step, width, work, left)
        for s in range(count):
            to, at = s * there + BLOCK, s * across + m * width
            for j in range(0, width, n):
                store(left, to + j, sub(load_some(frames, at + j, width - j), load(left, to + j)))
        _apply_inverse(inverse, m, width, count, left, there, weight)
        give_back(optics, m, mask, weight, step, width, work, moved)
        finish_row(z, w, x, m, ratio, step, raw, moved, sums)


@kernel()
def relax_rows(first: int, last: int, z: Any, w: Any, x: Any, relax: Any, sums: Any) -> None:
    """First half of ``advance_rows`` for the other data steps: ``z += relax (w - x)``."""
    bands, columns = z.shape[0], z.shape[2]
    step = row_apart(columns)
    band, line = z.strides[0] // z.itemsize, z.strides[1] // z.itemsize
    raw = aligned(bands * step, z)
    for m in range(first, last):
        sums[m, 0] = relax_row(z, w, x, m, relax, step, raw)
        for k in range(bands):
            copy_some(raw, k * step, columns, z, k * band + m * line)


@kernel()
def finish_rows(first: int, last: int, z: Any, step: Any, x: Any, w: Any, ratio: Any, sums: Any) -> None:
    """Second half of ``advance_rows`` for the other data steps: ``x = z + step`` and ``w = 2 x - z``; ``w`` may be ``step``."""
    apart = row_apart(z.shape[2])
    before, moved = aligned(z.shape[0] * apart, z), aligned(z.shape[0] * apart, z)
    for m in range(first, last):
        read_row(z, m, apart, before)
        read_row(step, m, apart, moved)
        finish_row(z, w, x, m, ratio, apart, before, moved, sums)


@njit(nogil=True, forceinline=True)
def _copy(source: Any, out: Any) -> None:
    """Copy a row (numba's own slice assignment takes seconds to compile)."""
    for j in range(out.size):
        out[j] = source[j]


@kernel(fastmath=FAST)
def invert_blocks(first: int, last: int, gram: Any, rho: float, inverse: Any, trust: Any) -> None:
    """Invert ``gram + rho I`` of the rows ``first..last`` by Cholesky, all sensor columns of a row side by side.

    ``gram`` (rows, S, S, W) float64 is overwritten. ``trust[m, j]`` gets ``1 / (trace(B) trace(B^-1))``, which never
    exceeds the ratio of B's least to its largest eigenvalue; 0 where a pivot was not positive.
    """
    size, width = gram.shape[1], gram.shape[3]
    lower = np.zeros((size, size, width))
    for m in range(first, last):
        block = gram[m]
        trace = np.zeros(width)
        good = np.ones(width)
        for s in range(size):
            for j in range(width):
                block[s, s, j] += rho
                trace[j] += block[s, s, j]
        for s in range(size):
            for q in range(s + 1):
                total = lower[s, q]
                _copy(block[s, q], total)
                for i in range(q):
                    _add_product(-1.0, lower[s, i], lower[q, i], total)
                if q == s:
                    for j in range(width):
                        if not total[j] > 1e-15 * trace[j]:
                            good[j] = 0.0
                            total[j] = 1.0
                        total[j] = np.sqrt(total[j])
                else:
                    pivot = lower[q, q]
                    for j in range(width):
                        total[j] /= pivot[j]
        _invert_triangle(lower, block)
        inverse_trace = np.zeros(width)
        p = 0
        for s in range(size):
            for q in range(s + 1):
                total = lower[0, 0]
                total[:] = 0
                for i in range(s, size):
                    _add_product(1.0, block[i, s], block[i, q], total)
                for j in range(width):
                    inverse[m, p, j] = total[j]
                if q == s:
                    for j in range(width):
                        inverse_trace[j] += total[j]
                p += 1
        for j in range(width):
            trust[m, j] = good[j] / (trace[j] * inverse_trace[j]) if good[j] > 0 else 0.0


@kernel(fastmath=FAST)
def _invert_triangle(lower: Any, out: Any) -> None:
    """Set the lower triangle ``out[s, q] = (lower^-1)[s, q]``, column by column of every pixel."""
    size, width = lower.shape[0], lower.shape[2]
    for q in range(size):
        for s in range(q, size):
            total = out[s, q]
            total[:] = 1.0 if s == q else 0.0
            for i in range(q, s):
                _add_product(-1.0, lower[s, i], out[i, q], total)
            for j in range(width):
                total[j] /= lower[s, s, j]
