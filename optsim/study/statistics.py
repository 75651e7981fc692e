"""Intervals and tests for paired differences whose scene and mask are both random (docs/study.md, "How the numbers are judged").

Every scene has masks of its own, drawn for it alone. So the means of scenes are independent, and their spread holds what
scenes and masks add: Var(mean) = s_scene^2 / n + s_mask^2 / (n m). Where one scene is the question (a target of the paper), its masks
are the independent trials instead.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from optsim.errors import InputError

CONFIDENCE = 0.95
RESAMPLES = 9999


@dataclass(frozen=True)
class Estimate:
    """Hold a mean difference with its interval.

    Args:
        mean: over scenes, each the mean over its masks, in dB.
        low, high: the bootstrap's 95 % interval, in dB.
        p: of Student's one-sided test of "not above 0" on the same independent means, in [0, 1].
        scenes, cells: how many scenes, and pairs of a scene and a mask.
        between_scenes, between_masks: standard deviations, in dB; None where there is one scene, or one mask a scene.
    """

    mean: float
    low: float
    high: float
    p: float
    scenes: int
    cells: int
    between_scenes: float | None
    between_masks: float | None


def paired_estimate(differences: Mapping[str, Sequence[float]], seed: int = 0, resamples: int = RESAMPLES) -> Estimate:
    """Estimate a mean paired difference with scenes and masks both random.

    Independent units (scenes; for one scene its masks) are drawn again with replacement, all masks of a scene together:
    that keeps both sources of spread (Davison and Hinkley 1997, 3.8). The percentile interval of n units is
    sqrt((n-1)/n) too narrow and knows no Student's t; it is stretched about the mean by sqrt(n/(n-1)) t / z
    (Hesterberg 2015).

    Args:
        differences: for each scene its values, one a mask; every scene counts alike.
        seed: of the resampling.
        resamples: how many.

    Raises:
        InputError: ``differences`` with fewer than two scenes, or two masks of one scene; or a value that is not finite.
    """
    from scipy.stats import norm, t

    units = _units(differences)
    n, mean = units.size, float(units.mean())
    drawn = _shares(n, seed, resamples) @ units
    low, high = np.quantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    upper = (1 + CONFIDENCE) / 2
    stretch = math.sqrt(n / (n - 1)) * float(t.ppf(upper, n - 1) / norm.ppf(upper))
    scenes, masks = _components([np.asarray(values, np.float64) for values in differences.values()])
    cells = sum(len(values) for values in differences.values())
    ends = (mean + stretch * float(low - mean), mean + stretch * float(high - mean))
    return Estimate(mean, *ends, one_sided_p(differences), len(differences), cells, scenes, masks)


def mean_of(differences: Mapping[str, Sequence[float]]) -> float:
    """Return the mean of :func:`paired_estimate`: over scenes, each the mean over its masks.

    Raises:
        InputError: as there.
    """
    return float(_units(differences).mean())


def one_sided_p(differences: Mapping[str, Sequence[float]]) -> float:
    """Return Student's p of "the mean is not above 0", on the same independent means as :func:`paired_estimate`.

    Raises:
        InputError: as there.
    """
    from scipy.stats import t

    units = _units(differences)
    mean, spread = float(units.mean()), float(units.std(ddof=1))
    if spread <= 1e-12 * max(1.0, abs(mean)):  # alike, to rounding
        return float(mean <= 0)
    return float(t.sf(mean / (spread / math.sqrt(units.size)), units.size - 1))


def weakest(parts: Sequence[Mapping[str, Sequence[float]]]) -> Mapping[str, Sequence[float]]:
    """Return the part with the largest p: "all are above 0" is shown exactly when that one is (Berger 1982)."""
    return max(parts, key=lambda part: (one_sided_p(part), -float(_units(part).mean())))


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values adjusted for asking so many questions at once (Holm 1979), in the order given."""
    p = np.asarray(p_values, np.float64)
    if p.size and not (np.all(p >= 0) and np.all(p <= 1)):
        raise InputError("p_values", float(p[~((p >= 0) & (p <= 1))][0]), "in [0, 1]")
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate(p[order] * np.arange(p.size, 0, -1)).clip(max=1.0)
    adjusted = np.empty_like(p)
    adjusted[order] = stepped
    return [float(value) for value in adjusted]


@lru_cache(maxsize=64)
def _shares(n: int, seed: int, resamples: int) -> np.ndarray:
    """Return (resamples, n) shares of each unit in a resample."""
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(0x626F6F74, n))))
    return random.multinomial(n, np.full(n, 1 / n), resamples) / n


def _units(differences: Mapping[str, Sequence[float]]) -> np.ndarray:
    """Return the independent values: means of scenes, or of one scene the values of its masks."""
    groups = [np.asarray(values, np.float64) for values in differences.values()]
    if any(group.ndim != 1 or group.size == 0 or not np.all(np.isfinite(group)) for group in groups):
        raise InputError("differences", "not finite or empty", "finite values for every scene, at least one")
    units = groups[0] if len(groups) == 1 else np.array([group.mean() for group in groups])
    if units.size < 2:
        raise InputError("differences", units.size, "of at least two scenes, or two masks of one scene: one trial has no interval")
    return units


def _components(groups: Sequence[np.ndarray]) -> tuple[float | None, float | None]:
    """Return the standard deviations between scenes and between masks of a scene (one-way analysis of variance)."""
    free = sum(group.size - 1 for group in groups)
    within = sum(float(((group - group.mean()) ** 2).sum()) for group in groups) / free if free else None
    masks = None if within is None else math.sqrt(within)
    if len(groups) < 2:
        return None, masks
    between = float(np.var([group.mean() for group in groups], ddof=1))
    share = float(np.mean([1 / group.size for group in groups]))
    return (None if within is None else math.sqrt(max(0.0, between - within * share))), masks
