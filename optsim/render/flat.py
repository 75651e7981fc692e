"""Pictures of flat diffuse scenes under direct light, without samples: exact coverage of pixels, light in closed form.

What a pixel sees is cut along all borders into trapezoids of one surface each (theory.md (R.38)); the light on each is a closed form,
integrated over the trapezoid by Gauss points (R.39), less what shadows take from it, which are polygons as well (R.42).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from optsim.cube import Bands
from optsim.render.cells import Cells, NotFlat, crossed_pixels, cut_pixels, join, whole_pixels
from optsim.render.choice import Physics
from optsim.render.flat_faces import LEVEL, band_table, faces_of, why_ambiguous, why_not_flat
from optsim.render.flat_light import flat_light
from optsim.render.flat_shadows import Shadows
from optsim.render.flat_view import FlatView, Seen
from optsim.render.frame import frame_of
from optsim.render.needs import explain
from optsim.render.settings import RenderSettings
from optsim.render.spectral import light_groups
from scenes.lights import SKIES
from scenes.scene import Scene

VALUES_A_STRIP, PIXELS_A_STRIP = 2**23, 2**17
"""Largest number of pixels x bands, and of pixels, that are rendered at a time."""
ORDERS = (1, 2, 4, 8, 16)
"""Gauss points along each side of a trapezoid, until two orders agree."""
SHADOW_ORDERS = (1, 2, 3, 4, 6, 8, 12, 16, 24)
"""Points along each side of an area light that casts shadows, until two orders agree."""
MAX_SHADOWS = 2500
"""Shadows of all points of all lights together; more take longer than samples."""
SHARE, SHADOW_SHARE = 0.1, 0.5
"""Shares of the error asked for that are left to the quadrature over pixels and over lights."""
MAX_DIVISIONS = 8
"""How often a trapezoid is cut in four at most."""
DENSE_VALUES = 2**18
"""Pictures of so few pixels x materials are spread by a dense product: as quick, and SciPy need not be imported."""
ROUNDING = 2.0**-23
"""Relative error of values kept as float32, and of the arithmetic before."""
LEVEL_POINTS = 24


Irradiance = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From points (C, m, 3) and the numbers (C,) of their faces to irradiances (C, m)."""


@dataclass(frozen=True)
class Strip:
    """Hold some rows of a picture: radiance and a bound of its error, both (rows x width, K)."""

    first_pixel: int
    radiance: np.ndarray
    error: np.ndarray


class FlatPicture:
    """Render one flat scene without samples.

    Args:
        scene: what to render.
        bands: K bands.
        film: (height, width) in samples.
        settings: as of the render.

    Raises:
        NotFlat: with the reason why the scene needs samples.
        InputError: as :class:`optsim.render.transport.Transport`.
    """

    route = "flat faces without samples"

    def __init__(self, scene: Scene, bands: Bands, film: tuple[int, int], settings: RenderSettings) -> None:
        self.scene, self.film, self.settings = scene, film, settings
        self.needs = explain(scene, settings.tolerance, settings.choices)
        scene = self.needs.modelled
        why = why_not_flat(scene, settings)
        if why is not None:
            raise NotFlat(why)
        if self.needs.on(Physics.INTERREFLECTION) or not self.needs.reflects_once:
            raise NotFlat("light is to be followed beyond its first reflection")
        self.pixels, self.max_depth = film[0] * film[1], 2
        low, high = float(bands.lower.min()), float(bands.upper.max())
        frame = frame_of(scene)
        self.groups = light_groups(scene, low, high, frame.unit)
        self.nodes = self.needs.nodes_nm(bands)
        self.weights = [self.needs.weights(group, self.nodes, bands) for group in self.groups]
        self.faces = faces_of(scene, frame)
        sky = any(isinstance(scene.lights[i], SKIES) for group in self.groups for i in group.lights)
        why = why_ambiguous(self.faces, sky)
        if why is not None:
            raise NotFlat(why)
        self._level = LEVEL * max((float(np.ptp(f.corners, axis=0).max()) for f in self.faces), default=1.0)
        self._tables = [band_table(scene, self.nodes, weights) for weights in self.weights]
        self._lights = [
            (g, flat_light(scene.lights[i], i, strength, self.faces, frame))
            for g, group in enumerate(self.groups)
            for i, strength in zip(group.lights, group.strengths)
        ]
        self._view = FlatView(scene.viewpoint, frame, film, self.faces)
        self._pixel, self._inside = crossed_pixels(self._view.segments, *film)
        self._shadows: dict[tuple[int, int], list[Shadows]] = {}
        self._cast = 0
        self._mean = self._mean_level(bands.count)

    def strips(self) -> Iterator[Strip]:
        """Render strip by strip, from the top.

        Raises:
            NotFlat: when a quadrature does not reach the error asked for.
        """
        rows = max(1, min(PIXELS_A_STRIP, VALUES_A_STRIP // len(self._mean)) // self.film[1])
        for top in range(0, self.film[0], rows):
            first, last = top * self.film[1], min(top + rows, self.film[0]) * self.film[1]
            yield self._strip(first, last)

    @property
    def level(self) -> float:
        """Return about the largest mean radiance of a band."""
        return float(self._mean.max(initial=0.0))

    def _strip(self, first: int, last: int) -> Strip:
        cells = self._cells(first, last, np.arange(first, last), None)
        sent, error = self._emitted(cells, first, last), np.zeros((last - first, len(self._mean)))
        seen, shown = self._view.seen(cells), np.full(last - first, -1)
        shown[seen.cells.pixel - first] = seen.face
        shown[self._pixel[slice(*np.searchsorted(self._pixel, [first, last]))] - first] = -2
        for number, (group, light) in enumerate(self._lights):
            value, off = self._integral(light.unhidden, seen, self._limits[group])
            place = seen.cells.pixel - first
            sent += self._spread(place, seen.row, value, group, last - first)
            error += self._spread(place, seen.row, off, group, last - first)
            rows, lost, unsure = self._shadowed(number, first, shown)
            sent[rows] -= lost
            error[rows] += unsure
        sent = np.maximum(sent, 0)
        return Strip(first, sent, error + ROUNDING * sent)

    def _cells(self, first: int, last: int, pixels: np.ndarray, shadows: Shadows | None) -> Cells:
        """Cut some pixels of a strip, ascending, along all borders, those of shadows too."""
        parts = []
        for number, inside in [(self._pixel, self._inside)] + ([] if shadows is None else [(shadows.pixel, shadows.inside)]):
            own = slice(*np.searchsorted(number, [first, last]))
            parts.append((number[own], inside[own]))
        number, inside = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
        wanted = np.zeros(last - first, bool)
        wanted[pixels - first] = True
        keep = np.flatnonzero(wanted[number - first])
        keep = keep[np.argsort(number[keep], kind="stable")]
        number, inside = number[keep], inside[keep]
        wanted[number - first] = False
        return join([whole_pixels(first + np.flatnonzero(wanted), self.film[1]), *cut_pixels(number, inside, self.film[1])])

    def _emitted(self, cells: Cells, first: int, last: int) -> np.ndarray:
        """Return what lamps and sky that are seen send out themselves."""
        sent = np.zeros((last - first, len(self._mean)))
        own = {light.own: (g, light.strength) for g, light in self._lights if light.own >= 0}
        skies = [(g, light.strength) for g, light in self._lights if isinstance(light.light, SKIES)]
        if not (skies or any(f in self._view.face for f in own)):
            return sent
        face = self._view.nearest(*cells.middle())
        _, _, weight = cells.points(1)
        for shown, (group, strength) in [*own.items(), *[(-1, sky) for sky in skies]]:
            here = (face == shown) & (np.append(self._view.front, True)[face])
            share = np.bincount(cells.pixel[here] - first, weight[here, 0], last - first)
            sent += share[:, None] * (strength * self.weights[group].sum(1))
        return sent

    def _integral(self, irradiance: Irradiance, seen: Seen, limit: float, depth: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Integrate over cells to a share of the error asked for: two orders that differ send a cell on, at last to be divided."""

        def by(order: int, some: Seen) -> np.ndarray:
            x, y, weight = some.cells.points(order)
            return np.sum(weight * irradiance(self._view.places(x, y, some.face), some.face), axis=1)

        before, found = by(ORDERS[0], seen), by(ORDERS[1], seen)
        off = np.abs(found - before)
        for order in ORDERS[2:]:
            rough = np.flatnonzero(off > limit)
            if not len(rough):
                return found, off
            finer = by(order, seen.take(rough))
            off[rough], found[rough] = np.abs(finer - found[rough]), finer
        rough = np.flatnonzero(off > limit)
        if len(rough) and depth < MAX_DIVISIONS:
            quarters, owner = seen.cells.take(rough).quarters()
            parts = Seen(quarters, seen.face[rough][owner], seen.row[rough][owner])
            finer, unsure = self._integral(irradiance, parts, limit / 4, depth + 1)
            found[rough], off[rough] = np.bincount(owner, finer, len(rough)), np.bincount(owner, unsure, len(rough))
        return found, off

    def _spread(self, pixel: np.ndarray, row: np.ndarray, value: np.ndarray, group: int, count: int) -> np.ndarray:
        """Turn irradiance times area on cells, with their pixels and rows of the table, into radiance of ``count`` pixels."""
        table = self._tables[group]
        shape = (count, len(table))
        if shape[0] * shape[1] <= DENSE_VALUES:
            return np.bincount(pixel * shape[1] + row, value / np.pi, shape[0] * shape[1]).reshape(shape) @ table
        from scipy.sparse import csr_array

        return csr_array((value / np.pi, (pixel, row)), shape=shape) @ table

    def _shadowed(self, number: int, first: int, shown: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return which pixels of a strip lie in shadow (r,), what it takes from them (r, K), and how far that may be off (r, K)."""
        light = self._lights[number][1]
        limit = SHADOW_SHARE * self.settings.tolerance * self._mean
        before, touched = np.zeros((0, 0)), np.zeros(len(shown), bool)
        for order in SHADOW_ORDERS:
            lost, unsure = np.zeros((2, len(shown), len(self._mean)))
            for one in self._shadows_of(number, order):
                if not one.empty:
                    here, more, off = self._lost(one, number, first, shown)
                    lost[here] += more
                    unsure[here] += off
                    touched[here] = True
            rows = np.flatnonzero(touched)
            if light.own < 0 or all(one.empty for one in self._shadows_of(number, order)):
                return rows, lost[rows], unsure[rows]
            off = np.abs(lost[rows] - before[rows]) if order > 1 else lost[rows]
            size = np.sqrt(np.sum(off**2, 0) / len(shown))
            if order > 1 and np.all(size <= limit):
                return rows, lost[rows], off + unsure[rows]
            if order > 2 and np.any(size * (order / SHADOW_ORDERS[-1]) ** 2 > limit):
                break
            before = lost
        raise NotFlat("the edges of shadows are too soft")

    def _shadows_of(self, number: int, order: int) -> list[Shadows]:
        if (number, order) not in self._shadows:
            light, made = self._lights[number][1], []
            points = light.points(order)
            before = self._shadows.get((number, order - 1), [])
            if self._cast + sum(s.count for s in before) * len(points) // max(1, len(before)) > MAX_SHADOWS:
                raise NotFlat(f"there are more than {MAX_SHADOWS} shadows to cast: samples are quicker")
            for point in points:
                made.append(Shadows(self._view, light, point, self._level))
                self._cast += made[-1].count
            self._shadows[number, order] = made
        return self._shadows[number, order]

    def _lost(self, shadows: Shadows, number: int, first: int, shown: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the same of the shadows from one point."""
        last = first + len(shown)
        touched = shadows.touched(first, last, shown)
        if not len(touched):
            return touched, *np.zeros((2, 0, len(self._mean)))
        seen = self._view.seen(self._cells(first, last, touched, shadows))
        seen = seen.take(shadows.on(seen))
        group = self._lights[number][0]
        value, off = self._integral(
            lambda places, face: shadows.point.irradiance(places, self._view.normal[face][:, None, :]), seen, self._limits[group]
        )
        pixels, place = np.unique(seen.cells.pixel, return_inverse=True)
        lost, unsure = (self._spread(place, seen.row, x, group, len(pixels)) for x in (value, off))
        return pixels - first, lost, unsure

    def _mean_level(self, count: int) -> np.ndarray:
        """Return the mean radiance of each band, from a few points of the picture, no shadows: what errors are relative to."""
        n = LEVEL_POINTS
        corner = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2) * np.array(self.film) / n
        y, x = corner.T
        size = np.array(self.film) / n
        cells = Cells(np.arange(n * n), y, y + size[0], np.stack([x, x], 1), np.stack([x, x], 1) + size[1])
        seen, mean = self._view.seen(cells), np.zeros(count)
        irradiance = np.zeros(len(self.groups))
        for group, light in self._lights:
            x, y, _ = seen.cells.points(1)
            value = light.unhidden(self._view.places(x, y, seen.face), seen.face)[:, 0]
            mean += value @ self._tables[group][seen.row] / np.pi / n**2
            irradiance[group] += value.sum() / n**2
        self._limits = SHARE * self.settings.tolerance * irradiance
        return mean
