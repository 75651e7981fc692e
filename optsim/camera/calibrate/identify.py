"""Which combinations of parameters spots determine, and which cannot be told apart (theory.md (C.60), (C.61))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optsim.errors import InputError

HELD_BEYOND = 5.0
"""A combination that the spots alone place no better than this many tolerances is held at the drawing."""
NAMED_ABOVE = 0.25
"""Share of a unit combination above which a parameter is named as a part of it."""


@dataclass(frozen=True, eq=False)
class Combinations:
    """Hold the orthogonal combinations of parameters, each in units of its tolerance, from best to worst determined.

    Args:
        names: the P parameters.
        tolerance: (P,) the parameters' tolerances.
        direction: (P, P) orthonormal columns: change of each parameter, in tolerances, per unit of the combination.
        strength: (P,) how many standard errors the spots change, all together, per unit of each combination.
        count: q, how many combinations are fitted, the first ones; the others stay as drawn.
    """

    names: tuple[str, ...]
    tolerance: np.ndarray
    direction: np.ndarray
    strength: np.ndarray
    count: int

    @property
    def determined(self) -> np.ndarray:
        """Tell which combinations are fitted (P,) bool."""
        return np.arange(self.strength.size) < self.count

    @property
    def told_apart(self) -> np.ndarray:
        """Tell which combinations the spots know better than the drawing (P,) bool."""
        return self.strength > 1

    @property
    def basis(self) -> np.ndarray:
        """Return (P, q): change of the parameters, in their units, per standard error of each fitted combination."""
        keep = self.determined
        if np.any(self.strength[keep] <= 0):
            raise InputError("combinations", self.count, f"at most {int(np.sum(self.strength > 0))}: the spots say nothing about more")
        return self.tolerance[:, None] * self.direction[:, keep] / self.strength[keep]

    @property
    def held(self) -> np.ndarray:
        """Return (P, P - q): change of the parameters, in their units, per tolerance of each combination that is not fitted."""
        return self.tolerance[:, None] * self.direction[:, ~self.determined]

    def describe(self) -> list[dict[str, object]]:
        """Return each combination as ``{"parts": {name: share}, "std_in_tolerances", "told_apart", "fitted"}``, best first.

        ``std_in_tolerances`` is what the spots alone leave open, None where they say nothing at all.
        """
        rows: list[dict[str, object]] = []
        for k in range(len(self.names)):
            share = self.direction[:, k]
            order = np.argsort(-np.abs(share), kind="stable")
            parts = {self.names[j]: round(float(share[j]), 3) for j in order if abs(share[j]) >= NAMED_ABOVE or j == order[0]}
            blind = self.strength[k] <= 1e-9 * self.strength.max(initial=1e-300)
            rows.append(
                {
                    "parts": parts,
                    "std_in_tolerances": None if blind else float(1 / self.strength[k]),
                    "told_apart": bool(self.told_apart[k]),
                    "fitted": bool(self.determined[k]),
                }
            )
        return rows


def combinations(whitened: np.ndarray, names: tuple[str, ...], tolerance: np.ndarray, count: int | None = None) -> Combinations:
    """Split parameter space by what spots say about it: a singular value decomposition in units of the tolerances.

    Args:
        whitened: (m, P) derivatives of measured coordinates per unit of each parameter, over each coordinate's standard error.
        names, tolerance: of the P parameters.
        count: how many combinations to fit; None: those that the spots place within HELD_BEYOND tolerances.
    """
    scaled = whitened * tolerance
    _, strength, rows = np.linalg.svd(scaled, full_matrices=scaled.shape[0] < scaled.shape[1])
    full = np.zeros(len(names))
    full[: strength.size] = strength
    direction = rows.T
    sign = np.sign(direction[np.argmax(np.abs(direction), axis=0), np.arange(direction.shape[1])])
    fitted = int(np.sum(full * HELD_BEYOND > 1)) if count is None else count
    return Combinations(names, np.asarray(tolerance, float), direction * sign, full, fitted)
