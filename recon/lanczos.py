"""What conjugate gradients tell of the condition of their matrix on the way (theory.md (S.35))."""

from typing import Any

import numpy as np

WORST = 1e6
"""Condition of H above which an unregularised answer is called unsafe (less where 1e-3 / rounding error is less: 8e3 in float32)."""


def worst(dtype: Any) -> float:
    """Return the condition of H above which an unregularised answer in this type is unsafe."""
    return min(WORST, 1e-3 / float(np.finfo(dtype).eps))


def condition(steps: list[float], turns: list[float]) -> float:
    """Estimate the condition of the matrix that conjugate gradients inverted, from below; 1 without steps.

    Its eigenvalues are nearly those of the Lanczos matrix that the iterations build (Golub and Van Loan, 11.3.5).

    Args:
        steps: length a_i of each step.
        turns: b_i, the ratio of squared residuals after and before it.
    """
    from scipy.linalg import eigvalsh_tridiagonal

    if not steps:
        return 1.0
    a, b = np.array(steps), np.array(turns)
    diagonal = 1 / a
    diagonal[1:] += b[:-1] / a[:-1]
    values = eigvalsh_tridiagonal(diagonal, np.sqrt(b[:-1]) / a[:-1])
    return float(values[-1] / max(values[0], values[-1] * 1e-32))
