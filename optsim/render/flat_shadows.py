"""Sharp shadows of flat faces, as polygons of the picture (theory.md (R.42))."""

from __future__ import annotations

import numpy as np

from optsim.render.cells import crossed_pixels
from optsim.render.flat_light import FlatLight, LightPoint
from optsim.render.flat_view import FlatView, Seen
from optsim.render.polygons import PolygonSet, area, clip_to_box

SMALLEST_SHADOW = 1e-12
"""Shadows that cover less of the picture than this, in pixels, are left out."""


class Shadows:
    """Cast the shadows of all faces on all faces, for one point of a light.

    Args:
        view: the faces as they are seen.
        light: whose point.
        point: from where.
        level: heights below this above a plane are in it.

    Attributes:
        point: from where.
        count: number of shadows that may be seen.
        empty: whether there are none.
        pixel, inside: the borders of shadows in pixels, as of :func:`optsim.render.cells.crossed_pixels`.
    """

    def __init__(self, view: FlatView, light: FlatLight, point: LightPoint, level: float) -> None:
        self.point, self._view = point, view
        polygons, receivers = [], []
        height, width = view.film
        most = max((len(face.corners) for face in view.faces), default=0)
        corners = np.array([np.concatenate([f.corners, np.repeat(f.corners[-1:], most - len(f.corners), 0)]) for f in view.faces])
        for receiver in np.unique(view.face[view.front[view.face]]):
            own = view.faces[receiver]
            if own.light >= 0 or own.black:
                continue
            hiders = light.hiders(int(receiver), level)
            for number in hiders[point.may_reach(corners[hiders], own, level)]:
                cast = point.shadow(view.faces[number], own, level)
                outline = clip_to_box(view.project(cast), width, height)
                if abs(area(outline)) > SMALLEST_SHADOW:
                    polygons.append(outline)
                    receivers.append(receiver)
        self.count, self.empty = len(polygons), not polygons
        self._polygons, self._receiver = PolygonSet(polygons), np.array(receivers, np.int64)
        self.pixel, self.inside = crossed_pixels(self._polygons.segments, height, width)

    def touched(self, first: int, last: int, shown: np.ndarray) -> np.ndarray:
        """Return the pixels from first to last - 1, ascending, that may lie in a shadow.

        ``shown`` tells which face fills each of them: -1 for none, -2 where borders cross.
        """
        width, receiving = self._view.film[1], np.zeros(len(self._view.faces) + 2, bool)
        receiving[self._receiver] = receiving[-2] = True
        pixels = first + np.flatnonzero(receiving[shown])
        covered, _ = self._polygons.covering(pixels % width + 0.5, pixels // width + 0.5)
        touched = np.zeros(last - first, bool)
        touched[pixels[covered] - first] = True
        touched[self.pixel[slice(*np.searchsorted(self.pixel, [first, last]))] - first] = True
        return first + np.flatnonzero(touched)

    def on(self, seen: Seen) -> np.ndarray:
        """Return which of the cells lie in a shadow on the face that they show."""
        cell, polygon = self._polygons.covering(*seen.cells.middle())
        return np.unique(cell[self._receiver[polygon] == seen.face[cell]])
