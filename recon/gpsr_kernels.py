"""Fused passes over the coefficients for gradient projection (theory.md S, "GPSR and tau").

The split theta = u - v of the paper is never stored: after every step its common part is taken off, so that
u = max(theta, 0) and v = max(-theta, 0). Sums are kept for chunks of fixed length and added up in order,
so that no result depends on the number of threads. Every kernel works on chunks [a, b).
"""

from __future__ import annotations

import numpy as np
from numba import njit

CHUNK = 1 << 14
_FAST = {"reassoc", "contract"}  # sums may be vectorised; NaN and infinities keep their meaning


def chunk_count(size: int) -> int:
    """Return how many chunks cover an array of that size."""
    return -(-size // CHUNK)


@njit(nogil=True, cache=True, fastmath=_FAST)
def direction(a: int, b: int, theta: np.ndarray, back: np.ndarray, weight: float, step: float, delta: np.ndarray, sums: np.ndarray) -> None:
    """Write delta = (z - step grad)_+ - z, folded to theta; back = A^T r, weight = tau / 2.

    Row c of sums: grad . delta_z, |delta_z|^2, 0.
    """
    one = theta.dtype.type
    w, s, zero = one(weight), one(step), one(0)
    for c in range(a, b):
        slope = 0.0
        length = 0.0
        for i in range(c * CHUNK, min((c + 1) * CHUNK, theta.size)):
            x, p = theta[i], back[i]
            u, v = max(x, zero), max(-x, zero)
            gu, gv = w - p, w + p
            du = max(u - s * gu, zero) - u
            dv = max(v - s * gv, zero) - v
            delta[i] = du - dv
            slope += np.float64(gu) * np.float64(du) + np.float64(gv) * np.float64(dv)
            length += np.float64(du) * np.float64(du) + np.float64(dv) * np.float64(dv)
        sums[c, 0] = slope
        sums[c, 1] = length


@njit(nogil=True, cache=True, fastmath=_FAST)
def free_gradient(a: int, b: int, theta: np.ndarray, back: np.ndarray, weight: float, out: np.ndarray, sums: np.ndarray) -> None:
    """Write the gradient over the components that may move (z > 0 or gradient < 0), folded to theta.

    Row c of sums: its squared norm in z.
    """
    one = theta.dtype.type
    w, zero = one(weight), one(0)
    for c in range(a, b):
        length = 0.0
        for i in range(c * CHUNK, min((c + 1) * CHUNK, theta.size)):
            x, p = theta[i], back[i]
            gu, gv = w - p, w + p
            if not (x > zero or gu < zero):
                gu = zero
            if not (x < zero or gv < zero):
                gv = zero
            out[i] = gu - gv
            length += np.float64(gu) * np.float64(gu) + np.float64(gv) * np.float64(gv)
        sums[c, 0] = length


@njit(nogil=True, cache=True, fastmath=_FAST)
def advance(a: int, b: int, theta: np.ndarray, delta: np.ndarray, step: float, sums: np.ndarray) -> None:
    """Set theta += step delta. Row c of sums: |theta|_1 and the number of non-zeros."""
    s = theta.dtype.type(step)
    for c in range(a, b):
        norm = 0.0
        count = 0.0
        for i in range(c * CHUNK, min((c + 1) * CHUNK, theta.size)):
            x = theta[i] + s * delta[i]
            theta[i] = x
            norm += abs(np.float64(x))
            count += 1.0 if x != 0 else 0.0
        sums[c, 0] = norm
        sums[c, 1] = count


@njit(nogil=True, cache=True, fastmath=_FAST)
def violation(a: int, b: int, theta: np.ndarray, back: np.ndarray, weight: float, sums: np.ndarray) -> None:
    """Row c of sums: max |back| and the largest |min(z, grad)|, which is 0 exactly at a minimiser."""
    one = theta.dtype.type
    w, zero = one(weight), one(0)
    for c in range(a, b):
        largest = zero
        lcp = zero
        for i in range(c * CHUNK, min((c + 1) * CHUNK, theta.size)):
            x, p = theta[i], back[i]
            largest = max(largest, abs(p))
            lcp = max(lcp, max(abs(min(max(x, zero), w - p)), abs(min(max(-x, zero), w + p))))
        sums[c, 0] = largest
        sums[c, 1] = lcp


@njit(nogil=True, cache=True, fastmath=_FAST)
def add_scaled(a: int, b: int, target: np.ndarray, other: np.ndarray, factor: float, sums: np.ndarray) -> None:
    """Set target += factor other. Row c of sums: |target|^2."""
    f = target.dtype.type(factor)
    for c in range(a, b):
        square = 0.0
        for i in range(c * CHUNK, min((c + 1) * CHUNK, target.size)):
            y = target[i] + f * other[i]
            target[i] = y
            square += np.float64(y) * np.float64(y)
        sums[c, 0] = square


@njit(nogil=True, cache=True, fastmath=_FAST)
def squares(a: int, b: int, values: np.ndarray, sums: np.ndarray) -> None:
    """Row c of sums: |values|^2."""
    for c in range(a, b):
        square = 0.0
        for i in range(c * CHUNK, min((c + 1) * CHUNK, values.size)):
            square += np.float64(values[i]) * np.float64(values[i])
        sums[c, 0] = square
