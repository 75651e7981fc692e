"""Least squares by Levenberg and Marquardt inside a box, with steps refused where light is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Residuals = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray] | None]
"""Returns (r, dr/dp) at parameters p, or None where r does not exist."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """Hold the end of a fit: parameters, residuals there, steps taken, and the sum of squares after each."""

    parameters: np.ndarray
    residuals: np.ndarray
    steps: int
    history: tuple[float, ...]


def fit(residuals: Residuals, start: np.ndarray, limit: float, steps: int = 60, tolerance: float = 1e-9) -> Fitted | None:
    """Minimise |r(p)|^2 with |p_i| <= limit (Marquardt 1963: the damping is scaled by each parameter's own curvature).

    A step that leaves the box is cut at its border, one that loses light or does not lower the sum is refused and
    the damping raised.

    Args:
        residuals: see :data:`Residuals`.
        start: (P,) inside the box.
        limit: half side of the box.
        steps: at most.
        tolerance: ends when a step lowers the sum by less than this share.

    Returns:
        The end, or None when there are no residuals at the start.
    """
    found = residuals(start)
    if found is None:
        return None
    p, (r, jacobian), damping = start.copy(), found, 1e-3
    history = [float(r @ r)]
    for _ in range(steps):
        normal, slope = jacobian.T @ jacobian, jacobian.T @ r
        free = ~(((p >= limit) & (slope < 0)) | ((p <= -limit) & (slope > 0)))
        if not free.any():
            break
        moved = None
        while damping < 1e12:
            scaled = normal + damping * np.diag(np.maximum(np.diag(normal), 1e-300))
            change = np.zeros_like(p)
            change[free] = -np.linalg.solve(scaled[np.ix_(free, free)], slope[free])
            trial = np.clip(p + change, -limit, limit)
            moved = residuals(trial)
            if moved is not None and float(moved[0] @ moved[0]) < history[-1]:
                break
            moved, damping = None, damping * 4
        if moved is None:
            break
        p, (r, jacobian), damping = trial, moved, max(damping / 10, 1e-12)
        history.append(float(r @ r))
        if history[-2] - history[-1] <= tolerance * history[-2]:
            break
    return Fitted(p, r, len(history) - 1, tuple(history))
