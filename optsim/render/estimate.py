"""From transport replicates to band radiances: means, standard errors, and the error that decides when to stop."""

from __future__ import annotations

import numpy as np
from threadpoolctl import threadpool_limits

from optsim.render.replicates import Replicates

PIXELS_A_BLOCK = 2**16
FLOAT32_LEVELS = (1e-25, 1e30)
"""Mean radiances between these keep at least 12 decades below them in float32."""


def relative_errors(groups: list[Replicates], weights: list[np.ndarray]) -> np.ndarray:
    """Estimate each band's RMS standard error over the picture, divided by the band's mean radiance.

    Node errors are added as if fully correlated within a group, which they nearly are, as one path carries all nodes: an upper
    bound. Groups are independent (theory.md (R.28)). A black band has error 0.

    Args:
        groups: replicates of shape (n, pixels), at least two each.
        weights: (K, n) band weights of each group.
    """
    squares, means = 0.0, 0.0
    for group, weight in zip(groups, weights):
        squares = squares + (np.abs(weight) @ np.sqrt(group.squared_error().mean(1))) ** 2
        means = means + weight @ group.mean.mean(1)
    errors, level = np.sqrt(np.asarray(squares)), np.asarray(means)
    return np.divide(errors, level, out=np.zeros_like(errors), where=level > 0)


def relative_bound(radiance: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """Return each band's RMS error bound over the picture divided by the band's mean radiance; arrays (pixels, K)."""
    size = np.sqrt(np.mean(np.square(bound, dtype=np.float64), axis=0))
    level = np.mean(radiance, axis=0, dtype=np.float64)
    return np.divide(size, level, out=np.zeros_like(size), where=level > 0)


def kept_as(level: float) -> type[np.float32] | type[np.float64]:
    """Return the type that holds radiances of this mean: float32 unless it would lose them."""
    return np.float32 if level == 0 or FLOAT32_LEVELS[0] < level < FLOAT32_LEVELS[1] else np.float64


def band_radiance(groups: list[Replicates], weights: list[np.ndarray], pixels: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Return (pixels, K) radiance and standard error (None with a single pass), theory.md (R.24) and (R.28).

    They are float32, or float64 when the picture is so dim or so bright that float32 would lose it.
    """
    count = len(weights[0])
    level = max(float(np.max(weight @ group.mean.mean(1))) for group, weight in zip(groups, weights))
    dtype = kept_as(level)
    radiance = np.zeros((pixels, count), dtype)
    stderr = np.zeros((pixels, count), dtype) if all(group.count > 1 for group in groups) else None
    with threadpool_limits(1):  # one BLAS thread: the same bytes whatever the number of cores
        for start in range(0, pixels, PIXELS_A_BLOCK):
            block = slice(start, start + PIXELS_A_BLOCK)
            radiance[block] = sum(group.mean[:, block].T @ weight.T for group, weight in zip(groups, weights))
            if stderr is not None:
                variance = sum(
                    (np.sqrt(group.scatter[:, block].T / (group.count * (group.count - 1))) @ np.abs(weight).T) ** 2
                    for group, weight in zip(groups, weights)
                )
                stderr[block] = np.sqrt(variance)
    return radiance, stderr
