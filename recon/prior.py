"""What a solver needs of a prior: its value, its proximal map, and the tau from which its answer is zero (theory.md (S.50))."""

from typing import Any, Protocol, runtime_checkable

import numpy as np


class Penalty(Protocol):
    """A prior R bound to one solve: it may keep buffers and warm-started duals between calls.

    R is convex and scales as its argument does, R(c f) = |c| R(f). Cubes are (M, N, K) views of band-major memory.
    """

    def value(self, cube: np.ndarray) -> float:
        """Return R(f), summed in float64."""
        ...

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """Replace f in place by the u that minimises ``||u - f||^2 / 2 + threshold R(u)``; return R(u)."""
        ...

    def tau_max(self, correlation: np.ndarray) -> float | None:
        """Return the least tau of ``||g - H f||^2 + tau R(f)`` whose answer is zero, from ``H^T g``; None when no formula is known."""
        ...


@runtime_checkable
class Prior(Protocol):
    """A frozen configuration of a prior."""

    def bind(self, shape: tuple[int, ...], dtype: Any) -> Penalty:
        """Return a fresh penalty for cubes of this shape (M, N, K) and type.

        Raises:
            InputError: when the prior doesn't fit the shape.
        """
        ...
