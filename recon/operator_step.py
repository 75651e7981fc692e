"""Data steps that need no more of an operator than forward and adjoint (theory.md (S.10))."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from recon import threads
from recon.operator import LinearOperator

LOST = 100
"""Conjugate gradients end when the residual has grown to so many times its least."""
Inverse = Callable[[np.ndarray], np.ndarray]
"""Solves ``(H H^T + rho I) y = right``, exactly or nearly."""


class Sums(NamedTuple):
    """Squared norms of an iteration: of w - x before it, of x's change, of x, and of x - z."""

    gap: float
    change: float
    size: float
    moved: float


class DataStep(Protocol):
    """The data half of a splitting iteration, on band-major arrays (K, M, N).

    ``notes`` are sentences about the conditioning that a user should read; ``condition`` is that of H H^T where it is known, else 1.
    """

    notes: tuple[str, ...]
    condition: float

    def advance(self, z: np.ndarray, w: np.ndarray, x: np.ndarray, relax: float, ratio: float = 1.0) -> Sums:
        """Set ``z += relax (w - x)``, ``x = step(z)``, ``z = x + ratio (z - x)`` and ``w = 2 x - z``."""
        ...


class OperatorStep:
    """A data step by forward, an inverse of ``H H^T + rho I``, and adjoint.

    Args:
        operator: H.
        frames: g.
        inverse: see ``Inverse``; None when a subclass overrides ``solve``.
        notes: passed on.
    """

    def __init__(self, operator: LinearOperator, frames: np.ndarray, inverse: Inverse | None, notes: tuple[str, ...] = ()) -> None:
        from recon import step_kernels

        self._relax, self._finish = step_kernels.relax_rows, step_kernels.finish_rows
        self.notes = notes
        self.condition: float = getattr(inverse, "condition", 1.0)
        self._operator, self._inverse = operator, inverse
        self._frames = frames.astype(operator.dtype)
        self._sums = np.zeros((operator.in_shape[0], 4))

    def advance(self, z: np.ndarray, w: np.ndarray, x: np.ndarray, relax: float, ratio: float = 1.0) -> Sums:
        """See ``DataStep.advance``."""
        real, rows = z.dtype.type, z.shape[1]
        threads.run(self._relax, rows, z, w, x, real(relax), self._sums)
        y = self.solve(self._frames - self._operator.forward(z.transpose(1, 2, 0)), relax != 0)
        step = np.ascontiguousarray(self._operator.adjoint(y).transpose(2, 0, 1))
        threads.run(self._finish, rows, z, step, x, w, real(ratio), self._sums)
        return Sums(*(float(v) for v in self._sums.sum(0)))

    def solve(self, right: np.ndarray, iterating: bool) -> np.ndarray:
        """Return y; ``iterating`` tells that more steps will follow."""
        assert self._inverse is not None
        return self._inverse(right)


class ConjugateStep(OperatorStep):
    """The step of any operator, by conjugate gradients on ``(H H^T + rho I) y = g - H z``, each started from the last y.

    Where H H^T is singular, rounding makes the residual grow again: the y of the least residual is kept.

    Args:
        operator: H.
        frames: g.
        rho: at least 0.
        near: an approximate inverse of ``H H^T + rho I`` that speeds it up (theory.md (S.43)); None: none.
        notes: passed on.
        tolerance: of the residual, relative to the right side; None: 8 times the rounding error, in float64 1e-10.
        iterations: at most, a step.
        forcing: a relaxed step may also stop at this part of the residual that it began with: later steps take up the rest.
    """

    def __init__(
        self,
        operator: LinearOperator,
        frames: np.ndarray,
        rho: float,
        near: Inverse | None = None,
        notes: tuple[str, ...] = (),
        tolerance: float | None = None,
        iterations: int = 500,
        forcing: float = 0.1,
    ) -> None:
        super().__init__(operator, frames, None, notes)
        self._rho, self._near = rho, near
        self._tolerance = max(8 * float(np.finfo(operator.dtype).eps), 1e-10) if tolerance is None else tolerance
        self._iterations, self._forcing = iterations, forcing
        self._y = np.zeros(operator.out_shape, operator.dtype)

    def solve(self, right: np.ndarray, iterating: bool) -> np.ndarray:
        """See ``OperatorStep.solve``."""
        y, forcing = self._y, self._forcing if iterating else 0.0
        left = right - self._normal(y)
        target = self._tolerance**2 * max(float(np.vdot(right, right)), np.finfo(y.dtype).tiny)
        target = max(target, forcing**2 * float(np.vdot(left, left)))
        turned = left if self._near is None else self._near(left)
        direction, size = turned.copy(), float(np.vdot(left, turned))
        best, least = y.copy(), float("inf")
        for _ in range(self._iterations):
            power = float(np.vdot(left, left))
            if power < least:
                best[...], least = y, power
            if power <= target or power > LOST**2 * least:
                break
            image = self._normal(direction)
            curvature = float(np.vdot(direction, image))
            if curvature <= 0 or size <= 0:
                break
            step = y.dtype.type(size / curvature)
            y += step * direction
            left -= step * image
            turned = left if self._near is None else self._near(left)
            size, before = float(np.vdot(left, turned)), size
            direction = turned + y.dtype.type(size / before) * direction
        if float(np.vdot(left, left)) > least:
            y[...] = best
        return y

    def _normal(self, y: np.ndarray) -> np.ndarray:
        result = self._operator.forward(self._operator.adjoint(y))
        result += y.dtype.type(self._rho) * y
        return result
