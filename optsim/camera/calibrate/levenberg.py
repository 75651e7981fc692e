"""Levenberg-Marquardt with geodesic acceleration, for a sum of squares in coordinates of about unit scale (theory.md (C.62))."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

MAX_STEPS = 100
CLOSE = 1e-9
"""A step that moves the spots by no more than this many standard errors ends the search."""
PROBE = 0.1
"""Share of a step at which its curvature is felt."""
BEND = 0.75
"""A step whose correction for curvature is longer than this share of it is not trusted (Transtrum and Sethna 2012)."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """Hold where a sum of squares is least.

    Args:
        at: (q,) coordinates.
        residual: (m,) there.
        steps: derivatives taken.
        converged: whether the last step was negligible.
        reason: a sentence.
    """

    at: np.ndarray
    residual: np.ndarray
    steps: int
    converged: bool
    reason: str


Residual = Callable[[np.ndarray], np.ndarray | None]
"""Return the residual (m,) at (q,) coordinates; None where the model has no value."""
Derivative = Callable[[np.ndarray], np.ndarray]
"""Return the residual's derivatives (m, q) at coordinates where it has a value."""


@dataclass(frozen=True, eq=False)
class _Local:
    """Hold a residual, its derivatives and their singular values at a place."""

    residual: np.ndarray
    u: np.ndarray
    s: np.ndarray
    vt: np.ndarray

    @classmethod
    def of(cls, residual: np.ndarray, derivative: np.ndarray) -> _Local:
        """Decompose."""
        return cls(residual, *np.linalg.svd(derivative, full_matrices=False))

    @property
    def cost(self) -> float:
        """Return the sum of squares."""
        return float(self.residual @ self.residual)

    def solve(self, target: np.ndarray, damping: float) -> np.ndarray:
        """Return d that minimises |J d - target|^2 + damping |d|^2."""
        return np.asarray(self.vt.T @ (self.s / (self.s**2 + damping) * (self.u.T @ target)))

    def along(self, move: np.ndarray) -> np.ndarray:
        """Return J d."""
        return np.asarray(self.u @ (self.s * (self.vt @ move)))


def least_squares(
    residual: Residual, derivative: Derivative, start: np.ndarray, close: float = CLOSE, max_steps: int = MAX_STEPS
) -> Minimum:  # fmt: skip
    """Minimise the sum of squared residuals from a start.

    Each step solves min |J d + r|^2 + damping |d|^2 and is bent along the valley by its second derivative, felt at a
    tenth of the step; the damping follows the ratio of the true to the predicted gain (Nielsen 1999). A place without
    a value counts as infinitely bad.

    Args:
        residual, derivative: of the sum.
        start: (q,) where the residual has a value.
        close: a step that moves the residual by no more than this is negligible; not below the residual's rounding.
        max_steps: at least 1.
    """
    at, first = np.asarray(start, float), residual(start)
    if first is None:
        return Minimum(at, np.zeros(0), 0, False, "the model has no value at the start: light is lost in the prism")
    here, damping, growth = _Local.of(first, derivative(at)), 1e-3, 2.0
    for step in range(1, max_steps + 1):
        if np.linalg.norm(here.u.T @ here.residual) <= close:
            return Minimum(
                at, here.residual, step, True, f"converged: the next step moves no spot by more than {close:.1g} standard errors"
            )
        move = here.solve(-here.residual, damping)
        predicted = here.cost - float(np.sum((here.residual + here.along(move)) ** 2))
        bent = _bent(residual, at, here, move, damping)
        there = None if bent is None else residual(at + bent)
        if bent is not None and there is not None and there @ there < here.cost:
            gain = (here.cost - float(there @ there)) / max(predicted, 1e-300)
            at = at + bent
            here = _Local.of(there, derivative(at))
            damping, growth = max(damping * max(1 / 3, 1 - (2 * min(gain, 1.0) - 1) ** 3), 1e-14), 2.0
            continue
        if predicted <= 1e-13 * here.cost:
            return Minimum(at, here.residual, step, True, "converged: no step lowers the sum of squares beyond rounding")
        damping, growth = damping * growth, growth * 2
        if damping > 1e20:
            return Minimum(at, here.residual, step, False, "no step lowers the sum of squares: the drawing is too far from the spots")
    return Minimum(at, here.residual, max_steps, False, f"stopped after {max_steps} steps: give a drawing that is closer to the camera")


def _bent(residual: Residual, at: np.ndarray, here: _Local, move: np.ndarray, damping: float) -> np.ndarray | None:
    """Return the step corrected for the model's curvature along it; None where the correction is not small."""
    probe = residual(at + PROBE * move)
    if probe is None:
        return None
    second = 2 / PROBE * ((probe - here.residual) / PROBE - here.along(move))
    turn = here.solve(-second, damping) / 2
    length = float(np.linalg.norm(move))
    if float(np.linalg.norm(turn)) * 2 > BEND * length:
        return None
    return move + turn
