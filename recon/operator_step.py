"""Data steps that need no more of an operator than forward and adjoint (theory.md (S.10))."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from recon import threads
from recon.adapted import Adapted
from recon.gram import CUTOFF
from recon.lanczos import condition
from recon.operator import LinearOperator, RowWeighted

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
        moved = self.correction(self._frames - self._operator.forward(z.transpose(1, 2, 0)), relax != 0)
        step = np.ascontiguousarray(moved.transpose(2, 0, 1))
        threads.run(self._finish, rows, z, step, x, w, real(ratio), self._sums)
        return Sums(*(float(v) for v in self._sums.sum(0)))

    def correction(self, right: np.ndarray, iterating: bool) -> np.ndarray:
        """Return what the step adds to a cube whose misfit is ``right``; ``iterating`` tells that more steps will follow."""
        return self._operator.adjoint(self.solve(right, iterating))

    def solve(self, right: np.ndarray, iterating: bool) -> np.ndarray:
        """Return y of ``(H H^T + rho I) y = right``."""
        assert self._inverse is not None
        return self._inverse(right)


class ConjugateStep(OperatorStep):
    """The step of any operator, by conjugate gradients on ``(H H^T + rho I) y = g - H z``, each started from the last y.

    Where H H^T + rho I is nearly singular, rounding makes the residual grow again: the y of the least residual is kept.

    Args:
        operator: H.
        frames: g.
        rho: above 0; ``ProjectionStep`` stands for 0.
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


class ProjectionStep(OperatorStep):
    """The nearest least-squares cube of any operator, ``z + H^+ (g - H z)``, by conjugate gradients on the normal equations.

    Each call solves ``min ||right - H d||`` from the last d, which lies in the rows of H, as ``H^+ right`` does (CGLS). Frames that
    contradict each other do no harm: the misfit's gradient falls to zero where the misfit does not (theory.md (S.56)).

    Args:
        operator: H.
        frames: g.
        tolerance: of the misfit, relative to ``right``, or of its gradient, relative to |H| times the misfit; None: 8 times
            the rounding error, in float64 1e-10.
        cutoff: part of H H^T's largest eigenvalue; when only weaker directions are left they are left out, as blocks do.
        iterations: at most, a call.
        forcing: a relaxed step may also stop at this part of the gradient that it began with: later steps take up the rest.
        late: tells that the time is over.

    ``met`` tells whether the last call reached its tolerance, ``made`` counts the iterations of all calls.
    """

    def __init__(
        self,
        operator: LinearOperator,
        frames: np.ndarray,
        tolerance: float | None = None,
        cutoff: float = CUTOFF,
        iterations: int = 500,
        forcing: float = 0.1,
        late: Callable[[], bool] | None = None,
    ) -> None:
        super().__init__(operator, frames, None)
        self._tolerance = max(8 * rounding(operator), 1e-10) if tolerance is None else tolerance
        self._cutoff, self._iterations, self._forcing, self._late = cutoff, iterations, forcing, late
        self._d: np.ndarray | None = None
        self._top = 0.0
        self.met, self.made = True, 0

    def correction(self, right: np.ndarray, iterating: bool) -> np.ndarray:
        """See ``OperatorStep.correction``."""
        operator, forcing = self._operator, self._forcing if iterating else 0.0
        left = right.copy() if self._d is None else right - operator.forward(self._d)
        gradient = operator.adjoint(left)
        d = self._d = np.zeros_like(gradient) if self._d is None else self._d
        real, search, power = d.dtype.type, gradient.copy(order="K"), _dot(gradient, gradient)
        enough, forced = self._tolerance**2 * _dot(right, right), forcing**2 * power
        steps: list[float] = []
        turns: list[float] = []
        while True:
            misfit = _dot(left, left)
            self.met = misfit <= enough or power <= max(forced, self._tolerance**2 * self._top * misfit)
            if self.met or len(steps) >= self._iterations or (self._late is not None and self._late()):
                break
            image = operator.forward(search)
            curvature = _dot(image, image)
            self._top = max(self._top, curvature / power)
            if curvature <= self._cutoff * self._top * _dot(search, search):
                self._say(f"H H^T is ill-conditioned: directions below {self._cutoff:g} of its largest were left out")
                break
            d += real(power / curvature) * search
            left -= real(power / curvature) * image
            gradient = operator.adjoint(left)
            before, power = power, _dot(gradient, gradient)
            steps.append(before / curvature)
            turns.append(power / before)
            search *= real(turns[-1])
            search += gradient
        self.made += len(steps)
        self.condition = max(self.condition, condition(steps, turns))
        return d

    @property
    def seen(self) -> float:
        """Return the condition of H as far as the iterations saw it: it is at least that."""
        return math.sqrt(self.condition)

    def warning(self) -> tuple[str, ...]:
        """Say that H is ill-conditioned where blocks would leave directions out."""
        if self.condition * CUTOFF <= 1:
            return ()
        return (f"H has a condition of at least {self.seen:.1e}: without a tau above 0 its weak directions are unsafe",)

    def _say(self, note: str) -> None:
        if note not in self.notes:
            self.notes = (*self.notes, note)


def rounding(operator: LinearOperator) -> float:
    """Return the relative rounding error of what an operator gives: one of others may compute in less than it is asked for."""
    inner: Any = operator
    while isinstance(inner, RowWeighted | Adapted):
        inner = inner.operator
    coarse = np.float32 if getattr(inner, "dtype", operator.dtype) == np.float32 else operator.dtype
    return float(np.finfo(coarse).eps)


def _dot(a: np.ndarray, b: np.ndarray) -> float:
    """Return the inner product of two arrays of the same layout, whatever it is."""
    return float(np.vdot(a.ravel(order="K"), b.ravel(order="K")))
