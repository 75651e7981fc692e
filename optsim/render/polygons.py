"""Convex polygons: clipped in space, projected to the picture, asked for the points they cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

POINTS_A_BLOCK = 4096
SMALLEST = 1e-18
"""Polygons of less area than this, in pixels, cover nothing."""


def clip(corners: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Keep the part of a convex polygon whose heights are not negative (Sutherland and Hodgman 1974).

    Args:
        corners: (m, d).
        heights: (m,) any affine function at the corners.

    Returns:
        (n, d), n = 0 when nothing is left.
    """
    if np.all(heights >= 0):
        return corners
    if np.all(heights < 0):
        return corners[:0]
    found = []
    for a, b, ha, hb in zip(corners, np.roll(corners, -1, 0), heights, np.roll(heights, -1)):
        if ha >= 0:
            found.append(a)
        if (ha >= 0) != (hb >= 0):
            found.append(a + (b - a) * (ha / (ha - hb)))
    return np.array(found)


def clip_to_box(corners: np.ndarray, width: float, height: float) -> np.ndarray:
    """Keep the part of a plane polygon inside [0, width] x [0, height]."""
    for axis, size in ((0, width), (1, height)):
        if len(corners):
            corners = clip(corners, corners[:, axis])
        if len(corners):
            corners = clip(corners, size - corners[:, axis])
    return corners


def area(corners: np.ndarray) -> float:
    """Return the signed area of a plane polygon."""
    if len(corners) < 3:
        return 0.0
    x, y = (corners - corners[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


class PolygonSet:
    """Hold convex polygons of the picture.

    Args:
        polygons: each (m, 2).

    Attributes:
        segments: (S, 4) all sides.
    """

    def __init__(self, polygons: Sequence[np.ndarray]) -> None:
        self.count = len(polygons)
        most = max((len(p) for p in polygons), default=0)
        self._sides = np.zeros((self.count, most, 3))
        self._sides[:, :, 2] = 1  # missing sides: 0 x + 0 y + 1 is never negative
        self._box = np.zeros((self.count, 4))
        sides = [np.zeros((0, 4))]
        for i, polygon in enumerate(polygons):
            after = np.roll(polygon, -1, 0)
            sides.append(np.concatenate([polygon, after], 1))
            sign = 1.0 if area(polygon) > 0 else -1.0
            a, b = sign * (polygon[:, 1] - after[:, 1]), sign * (after[:, 0] - polygon[:, 0])
            self._sides[i, : len(polygon)] = np.stack([a, b, -a * polygon[:, 0] - b * polygon[:, 1]], 1)
            self._box[i] = [*polygon.min(0), *polygon.max(0)]
        self.segments = np.concatenate(sides)

    def covering(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return every pair (number of a point, number of a polygon that covers it), by point; quick when y ascends."""
        pairs = [(np.zeros(0, np.int64), np.zeros(0, np.int64))]
        for start in range(0, len(x), POINTS_A_BLOCK):
            px, py = x[start : start + POINTS_A_BLOCK, None], y[start : start + POINTS_A_BLOCK, None]
            box = self._box
            near = np.flatnonzero((box[:, 1] <= py.max()) & (box[:, 3] >= py.min()) & (box[:, 0] <= px.max()) & (box[:, 2] >= px.min()))
            box = box[near]
            point, place = np.nonzero((box[:, 0] <= px) & (px <= box[:, 2]) & (box[:, 1] <= py) & (py <= box[:, 3]))
            polygon = near[place]
            inside = np.ones(len(point), bool)
            for a, b, c in np.moveaxis(self._sides, 0, 2):
                inside &= a[polygon] * px[point, 0] + b[polygon] * py[point, 0] + c[polygon] >= 0
            pairs.append((start + point[inside], polygon[inside]))
        return np.concatenate([p for p, _ in pairs]), np.concatenate([q for _, q in pairs])
