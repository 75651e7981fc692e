"""Any prior together with the bound f >= 0, by projected steps on the bound's multiplier (theory.md (S.53))."""

import numpy as np

from recon.prior import Penalty

STEPS = 20
"""Inner steps at most."""
FORCING = 0.3
"""A call ends when the multiplier moves by this part of its first step: it stays for the next call, which takes up the rest."""
ENOUGH = 1e-9
"""A change of the multiplier, as a part of the cube's norm, that needs no further step."""


class Bound:
    """The bound f >= 0 alone: what is left of a prior at tau = 0."""

    def value(self, cube: np.ndarray) -> float:
        """Return 0."""
        return 0.0

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """Cut what is negative."""
        np.maximum(cube, 0, out=cube)
        return 0.0

    def tau_max(self, correlation: np.ndarray) -> float | None:
        """Return None: there is no tau."""
        return None


class NonNegative:
    """``R(f)`` where f >= 0, infinite elsewhere.

    Its proximal map is ``u(p) = prox_R(f + p)`` with the multiplier p >= 0 for which u(p) >= 0 and p u(p) = 0; p is found by
    projected gradient steps ``p <- max(p - u(p), 0)``, starting from the last call's p, until they have become short.

    Args:
        inner: R.
    """

    def __init__(self, inner: Penalty) -> None:
        self.inner = inner
        self.levels = getattr(inner, "levels", None)
        self._multiplier: np.ndarray | None = None
        self._threshold = 0.0

    def value(self, cube: np.ndarray) -> float:
        """Return R(f); f is taken to be within the bound."""
        return self.inner.value(cube)

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """See ``Penalty.shrink``; the result is exactly non-negative."""
        p = self._scaled_multiplier(cube, threshold)
        given = cube.copy(order="K")
        wanted = 0.0
        for step in range(STEPS):
            np.add(given, p, out=cube)
            value = self.inner.shrink(cube, threshold)
            before = p.copy(order="K")
            p -= cube
            np.maximum(p, 0, out=p)
            before -= p
            moved = float(np.vdot(before, before))
            if step == 0:
                wanted = max(FORCING**2 * moved, ENOUGH**2 * float(np.vdot(cube, cube)))
            if moved <= wanted:
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
