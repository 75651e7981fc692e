"""Differences between runs that share scene and masks: their mean and its 95 % interval over seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """Hold a mean and the interval that holds the true mean with 95 % confidence; without a second seed there is none."""

    mean: float
    low: float | None
    high: float | None

    def __str__(self) -> str:
        if self.low is None or self.high is None:
            return f"{self.mean:+.2f}"
        return f"{self.mean:+.2f} [{self.low:+.2f}, {self.high:+.2f}]"


def interval(values: Sequence[float]) -> Interval:
    """Return the mean of independent values and Student's 95 % interval."""
    from scipy.stats import t

    data = np.asarray(values, np.float64)
    mean = float(data.mean())
    if data.size < 2:
        return Interval(mean, None, None)
    half = float(t.ppf((1 + CONFIDENCE) / 2, data.size - 1) * data.std(ddof=1) / math.sqrt(data.size))
    return Interval(mean, mean - half, mean + half)


def paired_loss(best: Mapping[tuple[str, int], float], other: Mapping[tuple[str, int], float]) -> Interval:
    """Return how much lower ``other`` scores than ``best``.

    Args:
        best, other: score by (scene, seed). Differences are averaged over scenes first: seeds are the independent trials,
            scenes are what was chosen to look at.
    """
    seeds = sorted({seed for _, seed in other})
    return interval([float(np.mean([best[key] - other[key] for key in other if key[1] == seed])) for seed in seeds])
