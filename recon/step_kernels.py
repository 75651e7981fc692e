"""Compiled loops of the exact data step for cameras whose voxels land on one sensor column each (theory.md (S.10)).

There H H^T is block diagonal, one S x S block a sensor pixel (S = shots x channels), and the whole step
``z -> z + H^T (H H^T + rho I)^+ (g - H z)`` is local to a sensor row. Blocks are stored packed, ``inverse[m, p, j]``
with ``p = s (s + 1) / 2 + q`` for ``q <= s``, so that the sensor column j runs fastest.
"""

from typing import Any

import numpy as np
from numba import njit

from recon.aperture_kernels import FAST, _add_product, _add_scaled


@njit(nogil=True, fastmath=FAST, forceinline=True)
def _relax(z: Any, w: Any, x: Any, relax: Any) -> float:
    """Raise ``z`` by ``relax (w - x)`` and return ``||w - x||^2``."""
    gap = np.zeros(1, x.dtype)[0]
    for n in range(z.size):
        delta = w[n] - x[n]
        gap += delta * delta
        z[n] += relax * delta
    return gap


@njit(nogil=True, fastmath=FAST, forceinline=True)
def _finish(z: Any, step: Any, x: Any, w: Any, ratio: Any) -> tuple[float, float, float]:
    """Set ``x = z + step``, ``z = x - ratio step`` and ``w = 2 x - z``; return the squares of x's change, of x and of the step."""
    zero = np.zeros(1, x.dtype)[0]
    change, size, moved = zero, zero, zero
    for n in range(z.size):
        new = z[n] + step[n]
        delta = new - x[n]
        change += delta * delta
        size += new * new
        moved += step[n] * step[n]
        x[n] = new
        z[n] = new - ratio * step[n]
        w[n] = new + ratio * step[n]
    return change, size, moved


@njit(nogil=True, forceinline=True)
def _copy(source: Any, out: Any) -> None:
    """Copy a row (numba's own slice assignment takes seconds to compile)."""
    for j in range(out.size):
        out[j] = source[j]


@njit(nogil=True, fastmath=FAST, cache=True)
def _apply_inverse(inverse: Any, left: Any, out: Any) -> None:
    """Set ``out[s] = sum_q B[s, q] left[q]`` for the packed symmetric blocks of one sensor row."""
    size, width = left.shape
    for s in range(size):
        total = out[s]
        total[:] = 0
        q = 0
        while q + 4 <= size:
            p0, p1, p2, p3 = _packed(s, q), _packed(s, q + 1), _packed(s, q + 2), _packed(s, q + 3)
            _add_products4(inverse[p0], left[q], inverse[p1], left[q + 1], inverse[p2], left[q + 2], inverse[p3], left[q + 3], total)
            q += 4
        while q < size:
            block, rest = inverse[_packed(s, q)], left[q]
            for j in range(width):
                total[j] += block[j] * rest[j]
            q += 1


@njit(nogil=True, forceinline=True)
def _packed(s: int, q: int) -> int:
    """Return where entry (s, q) of a symmetric block is stored."""
    return s * (s + 1) // 2 + q if q <= s else q * (q + 1) // 2 + s


@njit(nogil=True, fastmath=FAST, forceinline=True)
def _add_products4(a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any, out: Any) -> None:
    """Raise ``out`` by ``a b + c d + e f + g h``."""
    for j in range(out.size):
        out[j] += a[j] * b[j] + c[j] * d[j] + e[j] * f[j] + g[j] * h[j]


@njit(nogil=True, cache=True, fastmath=FAST)
def advance_rows(
    first: int, last: int, z: Any, w: Any, x: Any, relax: Any, frames: Any, masks: Any, response: Any, tile: Any, tile_of: Any,
    start: Any, inverse: Any, ratio: Any, sums: Any,
) -> None:  # fmt: skip
    """One half of a Douglas-Rachford iteration on the rows ``first..last``: ``z += relax (w - x); x = P(z); w = 2 x - z``.

    ``ratio`` rescales ``z - x`` to the next threshold. ``sums[m]`` gets the squared norms of w - x (before), of x's
    change, of x and of x - z.
    """
    bands, columns, width = z.shape[0], z.shape[2], frames.shape[3]
    shots, channels = frames.shape[0], frames.shape[1]
    one = np.ones(1, z.dtype)[0]
    seen = np.empty(columns, z.dtype)
    back = np.empty(columns, z.dtype)
    left = np.empty((shots * channels, width), z.dtype)
    weight = np.empty((shots * channels, width), z.dtype)
    for m in range(first, last):
        gap = 0.0
        for l in range(shots):
            for c in range(channels):
                _copy(frames[l, c, m], left[l * channels + c])
        for k in range(bands):
            shift = start[k]
            a = min(max(0, -shift), columns)
            b = max(a, min(columns, width - shift))
            row, wrow, xrow = z[k, m], w[k, m], x[k, m]
            gap += _relax(row, wrow, xrow, relax)
            for l in range(shots):
                mask = masks[l, m]
                if tile.shape[0] == 0 and channels == 1:
                    _add_product(-response[0, k], mask[a:b], row[a:b], left[l, a + shift : b + shift])
                    continue
                for n in range(columns):
                    seen[n] = mask[n] * row[n]
                if tile.shape[0] > 0:
                    _add_product(-one, tile[tile_of[m], k, a + shift : b + shift], seen[a:b], left[l, a + shift : b + shift])
                else:
                    for c in range(channels):
                        _add_scaled(-response[c, k], seen[a:b], left[l * channels + c, a + shift : b + shift])
        _apply_inverse(inverse[m], left, weight)
        change = 0.0
        size = 0.0
        moved = 0.0
        for k in range(bands):
            shift = start[k]
            a = min(max(0, -shift), columns)
            b = max(a, min(columns, width - shift))
            row, wrow, xrow = z[k, m], w[k, m], x[k, m]
            seen[:] = 0
            for l in range(shots):
                mask = masks[l, m]
                if tile.shape[0] == 0 and channels == 1:
                    _add_product(response[0, k], mask[a:b], weight[l, a + shift : b + shift], seen[a:b])
                    continue
                back[:] = 0
                if tile.shape[0] > 0:
                    _add_product(one, tile[tile_of[m], k, a + shift : b + shift], weight[l, a + shift : b + shift], back[a:b])
                else:
                    for c in range(channels):
                        _add_scaled(response[c, k], weight[l * channels + c, a + shift : b + shift], back[a:b])
                for n in range(columns):
                    seen[n] += mask[n] * back[n]
            delta, total, step = _finish(row, seen, xrow, wrow, ratio)
            change += delta
            size += total
            moved += step
        sums[m, 0] = gap
        sums[m, 1] = change
        sums[m, 2] = size
        sums[m, 3] = moved


@njit(nogil=True, cache=True, fastmath=FAST)
def relax_rows(first: int, last: int, z: Any, w: Any, x: Any, relax: Any, sums: Any) -> None:
    """First half of ``advance_rows`` for the other data steps: ``z += relax (w - x)``."""
    for m in range(first, last):
        gap = 0.0
        for k in range(z.shape[0]):
            gap += _relax(z[k, m], w[k, m], x[k, m], relax)
        sums[m, 0] = gap


@njit(nogil=True, cache=True, fastmath=FAST)
def finish_rows(first: int, last: int, z: Any, step: Any, x: Any, w: Any, ratio: Any, sums: Any) -> None:
    """Second half of ``advance_rows`` for the other data steps: ``x = z + step`` and ``w = 2 x - z``; ``w`` may be ``step``."""
    for m in range(first, last):
        change, size, moved = 0.0, 0.0, 0.0
        for k in range(z.shape[0]):
            a, b, c = _finish(z[k, m], step[k, m], x[k, m], w[k, m], ratio)
            change += a
            size += b
            moved += c
        sums[m, 1] = change
        sums[m, 2] = size
        sums[m, 3] = moved


@njit(nogil=True, cache=True, fastmath=FAST)
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


@njit(nogil=True, fastmath=FAST, cache=True)
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
