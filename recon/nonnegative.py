"""Any prior together with the bound f >= 0, by projected steps on the bound's multiplier (theory.md (S.53))."""

import numpy as np

from recon.prior import Penalty

STEPS = 3
"""Inner steps at most: the multiplier stays from one call to the next, so that a solve carries the rest over."""
ENOUGH = 1e-6
"""A part of the cube's norm below zero that needs no further inner step."""


class NonNegative:
    """``R(f)`` where f >= 0, infinite elsewhere.

    Its proximal map is ``u(p) = prox_R(f + p)`` with the multiplier p >= 0 for which u(p) >= 0 and p u(p) = 0; p is found by
    projected gradient steps ``p <- max(p - u(p), 0)``, of which a call makes a few, each starting from the last call's p.

    Args:
        inner: R.
    """

    def __init__(self, inner: Penalty) -> None:
        self.inner = inner
        self._multiplier: np.ndarray | None = None
        self._threshold = 0.0

    def value(self, cube: np.ndarray) -> float:
        """Return R(f); f is taken to be within the bound."""
        return self.inner.value(cube)

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """See ``Penalty.shrink``; the result is exactly non-negative."""
        p = self._scaled_multiplier(cube, threshold)
        given = cube.copy(order="K")
        for _ in range(STEPS):
            np.add(given, p, out=cube)
            value = self.inner.shrink(cube, threshold)
            below = np.minimum(cube, 0)
            p -= cube
            np.maximum(p, 0, out=p)
            if float(np.vdot(below, below)) <= ENOUGH**2 * float(np.vdot(cube, cube)):
                break
        np.maximum(cube, 0, out=cube)
        return value

    def tau_max(self, correlation: np.ndarray) -> float | None:
        """Return a tau whose answer is surely zero: that of R without the bound."""
        return self.inner.tau_max(correlation)

    def _scaled_multiplier(self, cube: np.ndarray, threshold: float) -> np.ndarray:
        """Return the last multiplier, in proportion to the threshold, as subgradients are."""
        if self._multiplier is None:
            self._multiplier = np.zeros_like(cube, order="K")
        elif self._threshold > 0 and threshold != self._threshold:
            self._multiplier *= cube.dtype.type(threshold / self._threshold)
        self._threshold = threshold
        return self._multiplier
