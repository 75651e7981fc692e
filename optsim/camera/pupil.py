"""The relay's pupil as a set of points: rays through them stand for the light cone where a chief ray is not enough."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class Pupil(NamedTuple):
    """Hold points of the unit disc and their shares of the light.

    Args:
        points: (P, 2) of (u, v), u along the dispersion.
        weights: (P,), adding to 1.
    """

    points: np.ndarray
    weights: np.ndarray


def rings(at_least: int) -> Pupil:
    """Return the smallest set of 4 R^2 points, each for an equal area of the disc (theory.md (C.31)).

    Ring j of R holds 4 (2 j + 1) points at the root-mean-square radius of its area: the centroid is 0 and the second
    moments are those of the disc, 1/4 each, exactly.

    Args:
        at_least: fewest points, from 1.
    """
    count = math.isqrt(-(-at_least // 4) - 1) + 1
    points = []
    for j in range(count):
        n = 4 * (2 * j + 1)
        radius = math.sqrt((j * j + (j + 1) * (j + 1)) / 2) / count
        angle = 2 * np.pi * (np.arange(n) + 0.5 * (j % 2) + 0.25) / n
        points.append(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    together = np.concatenate(points)
    return Pupil(together, np.full(len(together), 1 / len(together)))
