"""Compiled loops of the operator whose light lands on several rows and columns, as the field has it (theory.md (S.40)).

Arrays as in ``aperture_kernels``; ``row0`` and ``column0`` (K, 1|M, 1|N) are the sensor row (relative to the mirror's)
and column of the first tap, ``taps`` (K, 1|M, Tr, Tc, 1|N) its weights, mirrors fastest. Neighbouring mirrors mostly share their
first row and column: each run of such mirrors is one vector loop. Each kernel writes the rows ``first..last`` of its
result alone and adds up in an order that no slab changes.
"""

from typing import Any

import numpy as np
from numba import njit

from recon.aperture_kernels import FAST, _add_product, _add_scaled
from recon.compiled import kernel


@njit(nogil=True, forceinline=True)
def _own(index: int, size: int) -> int:
    """Return the index into an axis that has either every element or one for all."""
    return index if size > 1 else 0


@njit(nogil=True)
def _run_end(rows: Any, columns: Any, n: int, count: int) -> int:
    """Return where the run of mirrors that share the first row and column of mirror n ends."""
    i, j = _own(n, rows.size), _own(n, columns.size)
    end = n + 1
    if rows.size == 1 and columns.size == 1:
        return count
    while end < count and rows[_own(end, rows.size)] == rows[i] and columns[_own(end, columns.size)] == columns[j]:
        end += 1
    return end


@njit(nogil=True, fastmath=FAST)
def _lay(seen: Any, m: int, rows: Any, columns: Any, taps: Any, top: int, plane: Any) -> None:
    """Add one mirror row's light to the sensor rows ``top..`` of ``plane``."""
    count, height, width = seen.size, plane.shape[0], plane.shape[1]
    a = 0
    while a < count:
        b = _run_end(rows, columns, a, count)
        row, shift0 = m + rows[_own(a, rows.size)] - top, columns[_own(a, columns.size)]
        for s in range(taps.shape[0]):
            i = row + s
            if i < 0 or i >= height:
                continue
            for t in range(taps.shape[1]):
                shift = shift0 + t
                u, v = max(a, -shift), min(b, width - shift)
                if v <= u:
                    continue
                if taps.shape[2] > 1:
                    _add_product(seen.dtype.type(1), taps[s, t, u:v], seen[u:v], plane[i, u + shift : v + shift])
                elif taps[s, t, 0] != 0:
                    _add_scaled(taps[s, t, 0], seen[u:v], plane[i, u + shift : v + shift])
        a = b


@njit(nogil=True, fastmath=FAST)
def _collect(plane: Any, m: int, rows: Any, columns: Any, taps: Any, top: int, back: Any) -> None:
    """Add to ``back`` what one mirror row's light would have met on the sensor: the transpose of ``_lay``."""
    count, height, width = back.size, plane.shape[0], plane.shape[1]
    a = 0
    while a < count:
        b = _run_end(rows, columns, a, count)
        row, shift0 = m + rows[_own(a, rows.size)] - top, columns[_own(a, columns.size)]
        for s in range(taps.shape[0]):
            i = row + s
            if i < 0 or i >= height:
                continue
            for t in range(taps.shape[1]):
                shift = shift0 + t
                u, v = max(a, -shift), min(b, width - shift)
                if v <= u:
                    continue
                if taps.shape[2] > 1:
                    _add_product(back.dtype.type(1), taps[s, t, u:v], plane[i, u + shift : v + shift], back[u:v])
                elif taps[s, t, 0] != 0:
                    _add_scaled(taps[s, t, 0], plane[i, u + shift : v + shift], back[u:v])
        a = b


@kernel(fastmath=FAST)
def forward_field(
    first: int, last: int, x: Any, masks: Any, response: Any, tile: Any, tile_of: Any, row0: Any, column0: Any, taps: Any, reach: Any,
    out: Any,
) -> None:  # fmt: skip
    """Apply H to a cube and fill the sensor rows ``first..last``; ``reach`` = (lowest, highest) row offset of any tap."""
    shots, mirrors, columns = masks.shape
    one = x.dtype.type(1)
    plane = np.empty((last - first, out.shape[3]), x.dtype)
    seen = np.empty(columns, x.dtype)
    for l in range(shots):
        out[l, :, first:last] = 0
        for k in range(x.shape[0]):
            plane[:] = 0
            for m in range(max(0, first - reach[1]), min(mirrors, last - reach[0])):
                for n in range(columns):
                    seen[n] = masks[l, m, n] * x[k, m, n]
                rows, starts = row0[k, _own(m, row0.shape[1])], column0[k, _own(m, column0.shape[1])]
                _lay(seen, m, rows, starts, taps[k, _own(m, taps.shape[1])], first, plane)
            for i in range(first, last):
                if tile.shape[0] > 0:
                    _add_product(one, tile[tile_of[i], k], plane[i - first], out[l, 0, i])
                else:
                    for c in range(response.shape[0]):
                        _add_scaled(response[c, k], plane[i - first], out[l, c, i])


@kernel(fastmath=FAST)
def adjoint_field(
    first: int, last: int, y: Any, masks: Any, response: Any, tile: Any, tile_of: Any, row0: Any, column0: Any, taps: Any, reach: Any,
    out: Any,
) -> None:  # fmt: skip
    """Apply H^T to frames and fill the mirror rows ``first..last`` of the cube."""
    shots, columns, height = masks.shape[0], masks.shape[2], y.shape[2]
    one = out.dtype.type(1)
    top, bottom = max(0, first + reach[0]), min(height, last + reach[1])
    plane = np.empty((max(0, bottom - top), y.shape[3]), out.dtype)
    back = np.empty(columns, out.dtype)
    for k in range(out.shape[0]):
        out[k, first:last] = 0
    for l in range(shots):
        for k in range(out.shape[0]):
            plane[:] = 0
            for i in range(top, bottom):
                if tile.shape[0] > 0:
                    _add_product(one, tile[tile_of[i], k], y[l, 0, i], plane[i - top])
                else:
                    for c in range(response.shape[0]):
                        _add_scaled(response[c, k], y[l, c, i], plane[i - top])
            for m in range(first, last):
                back[:] = 0
                rows, starts = row0[k, _own(m, row0.shape[1])], column0[k, _own(m, column0.shape[1])]
                _collect(plane, m, rows, starts, taps[k, _own(m, taps.shape[1])], top, back)
                for n in range(columns):
                    out[k, m, n] += masks[l, m, n] * back[n]


@kernel(fastmath=FAST)
def gram_field(
    first: int, last: int, offset: int, masks: Any, response: Any, tile: Any, tile_of: Any, column0: Any, taps: Any, out: Any
) -> None:
    """Sum ``out[m, p, q, j] = (H H^T)[(p, m, j), (q, m, j + offset)]`` with p = shot * C + channel, where rows don't couple.

    ``column0`` (K, 1|M, 1|N) and ``taps`` (K, 1|M, Tc, 1|N); all in float64.
    """
    shots, columns = masks.shape[0], masks.shape[2]
    bands, width = response.shape[1], out.shape[3]
    channels = 1 if tile.shape[0] > 0 else response.shape[0]
    pair = np.empty(columns)
    for m in range(first, last):
        out[m] = 0
        for l in range(shots):
            for i in range(shots):
                for k in range(bands):
                    starts, w = column0[k, _own(m, column0.shape[1])], taps[k, _own(m, taps.shape[1])]
                    for t in range(w.shape[0] - offset):
                        for n in range(columns):
                            v = _own(n, w.shape[1])
                            pair[n] = w[t, v] * w[t + offset, v] * masks[l, m, n] * masks[i, m, n]
                        for n in range(columns):
                            j = n + starts[_own(n, starts.size)] + t
                            if j < 0 or j + offset >= width or pair[n] == 0:
                                continue
                            if tile.shape[0] > 0:
                                out[m, l, i, j] += pair[n] * tile[tile_of[m], k, j] * tile[tile_of[m], k, j + offset]
                            else:
                                for c in range(channels):
                                    for e in range(channels):
                                        out[m, l * channels + c, i * channels + e, j] += pair[n] * response[c, k] * response[e, k]
