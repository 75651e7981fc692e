"""Compiled loops of the total-variation proximal map (theory.md (S.52)).

Pictures are denoised one by one by accelerated projected gradients on the dual (Beck and Teboulle 2009). The dual field
``p`` lives in the unit disc at every pixel, whatever the threshold, so that it stays a good first
guess when the threshold changes. One iteration is one pass over the picture's rows.
"""

from typing import Any

import numpy as np
from numba import njit

from recon.compiled import kernel

# error_model="numpy": a check for division by zero would keep a loop from being vectorised

LOOK = 4  # iterations between two looks at the duality gap
FAST = {"contract", "reassoc", "nsz", "arcp"}  # never "nnan" or "ninf": a NaN must stay a NaN


@njit(error_model="numpy", nogil=True, fastmath=FAST, forceinline=True)
def _remains(c: Any, p: Any, m: int, limit: Any, out: Any) -> None:
    """Set ``out`` to row m of ``c - limit D^T p``; ``p`` (2, M, N) holds the dual of the steps down and to the right."""
    columns = c.shape[1]
    row, down, across = c[m], p[0, m], p[1, m]
    if m > 0:
        above = p[0, m - 1]
        for n in range(columns):
            out[n] = row[n] + limit * (down[n] - above[n])
    else:
        for n in range(columns):
            out[n] = row[n] + limit * down[n]
    out[0] += limit * across[0]
    for n in range(1, columns):
        out[n] += limit * (across[n] - across[n - 1])


@njit(error_model="numpy", nogil=True, fastmath=FAST, forceinline=True)
def _slopes(u: Any, below: Any, weight: Any, r0: Any, r1: Any, a: Any, b: Any) -> None:
    """Set ``a = r0 + weight D_y u`` and ``b = r1 + weight D_x u`` of one row; nothing flows over the right edge."""
    columns = u.size
    for n in range(columns):
        a[n] = r0[n] + weight * (below[n] - u[n])
    for n in range(columns - 1):
        b[n] = r1[n] + weight * (u[n + 1] - u[n])
    b[columns - 1] = 0


@njit(error_model="numpy", nogil=True, fastmath=FAST, forceinline=True)
def _move(a: Any, scale: Any, beta: Any, r: Any, p: Any) -> None:
    """Set ``p, r = a scale, a scale + beta (a scale - p)``: the new dual and its extrapolation."""
    for n in range(a.size):
        a[n] *= scale[n]
    for n in range(a.size):
        r[n] = a[n] + beta * (a[n] - p[n])
    for n in range(a.size):
        p[n] = a[n]


@njit(error_model="numpy", nogil=True, fastmath=FAST, forceinline=True)
def _ascend_row(u: Any, below: Any, step: Any, beta: Any, r: Any, p: Any, m: int, work: Any) -> None:
    """One projected step of the dual of row m: ``q = project(r + step D u)``, ``r = q + beta (q - p)``, ``p = q``.

    One array is written a loop: with more, LLVM gives up on proving that they don't overlap and leaves the loop scalar.
    """
    a, b, scale = work[0], work[1], work[2]
    one = np.ones(1, u.dtype)[0]
    _slopes(u, below, step, r[0, m], r[1, m], a, b)
    for n in range(u.size):
        reach = a[n] * a[n] + b[n] * b[n]
        scale[n] = one / np.sqrt(reach if reach > one else one)
    _move(a, scale, beta, r[0, m], p[0, m])
    _move(b, scale, beta, r[1, m], p[1, m])


@njit(error_model="numpy", nogil=True, fastmath=FAST, forceinline=True)
def _weigh_row(u: Any, below: Any, p: Any, m: int, work: Any) -> tuple[float, float]:
    """Return the row's share of ``sum |D u|`` and of ``<D u, p>``."""
    a, b = work[0], work[1]
    total = np.zeros(1, u.dtype)[0]
    along = total
    for n in range(u.size):
        a[n] = below[n] - u[n]
    for n in range(u.size - 1):
        b[n] = u[n + 1] - u[n]
    b[u.size - 1] = 0
    for n in range(u.size):
        total += np.sqrt(a[n] * a[n] + b[n] * b[n])
    for n in range(u.size):
        along += a[n] * p[0, m, n] + b[n] * p[1, m, n]
    return total, along


@kernel(error_model="numpy", fastmath=FAST)
def _settle(c: Any, p: Any, limit: Any, work: Any, out: Any) -> tuple[float, float, float]:
    """Set ``out = c - limit D^T p``; return ``sum |D out|``, the duality gap over ``limit`` and ``||out - c||^2``."""
    rows = c.shape[0]
    total, along, moved = 0.0, 0.0, 0.0
    for m in range(rows):
        _remains(c, p, m, limit, out[m])
        part = np.zeros(1, c.dtype)[0]
        for n in range(c.shape[1]):
            part += (out[m, n] - c[m, n]) ** 2
        moved += part
        if m > 0:
            t, a = _weigh_row(out[m - 1], out[m], p, m - 1, work)
            total += t
            along += a
    t, a = _weigh_row(out[rows - 1], out[rows - 1], p, rows - 1, work)
    return total + t, total + t - along - a, moved


@kernel(error_model="numpy", fastmath=FAST)
def _sweep(c: Any, p: Any, r: Any, limit: Any, beta: Any, work: Any) -> None:
    """One iteration on one picture, rolling over its rows; ``work`` is (5, N)."""
    rows = c.shape[0]
    step = np.full(1, 0.125, c.dtype)[0] / limit  # 1 / ||D||^2
    above, here = work[3], work[4]
    _remains(c, r, 0, limit, here)
    for m in range(1, rows):
        above, here = here, above
        _remains(c, r, m, limit, here)
        _ascend_row(above, here, step, beta, r, p, m - 1, work)
    _ascend_row(here, here, step, beta, r, p, rows - 1, work)


@kernel(error_model="numpy")
def denoise_pictures(first: int, last: int, pictures: Any, limits: Any, dual: Any, iterations: int, tolerance: float, sums: Any) -> None:
    """Replace pictures ``first..last`` of (Q, M, N) by ``argmin 1/2 ||u - c||^2 + limit sum |D u|`` from the dual before.

    ``dual`` (Q, 2, M, N) is the warm start and is updated. Stops when the duality gap is below ``tolerance`` times the objective,
    looked at every fourth iteration, or after ``iterations``. ``sums[q]`` gets ``sum |D u|``, the gap and the objective.
    """
    rows, columns = pictures.shape[1:]
    r = np.empty((2, rows, columns), pictures.dtype)
    out = np.empty((rows, columns), pictures.dtype)
    work = np.empty((5, columns), pictures.dtype)
    for q in range(first, last):
        c, p, limit = pictures[q], dual[q], limits[q]
        if limit > 0:
            _descend(c, p, r, limit, work, out, iterations, tolerance)
        total, gap, moved = _settle(c, p, limit, work, out)
        for m in range(rows):
            for n in range(columns):
                c[m, n] = out[m, n]
        sums[q, 0] = total
        sums[q, 1] = limit * gap
        sums[q, 2] = 0.5 * moved + limit * total


@kernel(error_model="numpy")
def _descend(c: Any, p: Any, r: Any, limit: Any, work: Any, out: Any, iterations: int, tolerance: float) -> None:
    """Iterate the dual ``p`` of one picture until the duality gap is small."""
    for i in range(2):
        for m in range(c.shape[0]):
            for n in range(c.shape[1]):
                r[i, m, n] = p[i, m, n]
    momentum = 1.0
    for done in range(iterations):
        if done > 0 and done % LOOK == 0:
            total, gap, moved = _settle(c, p, limit, work, out)
            if limit * gap <= tolerance * (0.5 * moved + limit * total):
                break
        grown = 0.5 + np.sqrt(0.25 + momentum * momentum)
        beta = np.asarray((momentum - 1) / grown).astype(c.dtype).item()
        _sweep(c, p, r, limit, beta, work)
        momentum = grown


@kernel(error_model="numpy")
def weigh_pictures(first: int, last: int, pictures: Any, sums: Any) -> None:
    """Set ``sums[q] = sum |D u|`` for the pictures ``first..last`` of (Q, M, N)."""
    rows, columns = pictures.shape[1:]
    for q in range(first, last):
        total = 0.0
        for m in range(rows):
            below = min(m + 1, rows - 1)
            for n in range(columns):
                a = pictures[q, below, n] - pictures[q, m, n]
                b = pictures[q, m, min(n + 1, columns - 1)] - pictures[q, m, n]
                total += np.sqrt(np.float64(a) * a + np.float64(b) * b)
        sums[q] = total
