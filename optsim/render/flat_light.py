"""Light on flat faces in closed form, and the shadows that faces cast on each other (theory.md (R.40), (R.42))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optsim.render.flat_faces import LEVEL, Face
from optsim.render.frame import Frame
from optsim.render.polygons import clip
from scenes.lights import AreaLight, ConstantSky, DirectionalLight, Light, PointLight

SMALL_LIGHT = 1e-3
"""Area lights of less than this share of their distance are summed over points: the closed form would cancel."""
SMALL_LIGHT_ORDER = 3
NEAR_LIGHT = 1e-7
"""Shadows of what lies closer than this share below a light's own height are cut off there: they would reach to infinity."""


@dataclass(frozen=True)
class LightPoint:
    """Hold one point of a light, or all of a light that is one point: it casts sharp shadows.

    Args:
        place: in renderer coordinates, or the way the light travels.
        distant: whether ``place`` is a direction.
        strength: intensity across ``normal`` x its area's share; of a distant light the irradiance across it.
        normal: of the glowing side, None when all directions are alike.
    """

    place: np.ndarray
    distant: bool
    strength: float
    normal: np.ndarray | None = None

    def irradiance(self, points: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Return the irradiance at points (..., 3) of surfaces of these normals, nothing between."""
        if self.distant:
            return self.strength * np.maximum(-(normal @ self.place), 0) * np.ones(points.shape[:-1])
        away = self.place - points
        square = np.sum(away * away, -1)
        cosine = np.maximum(np.sum(away * normal, -1), 0)
        found = np.divide(self.strength * cosine, square * np.sqrt(square), out=np.zeros_like(square), where=square > 0)
        if self.normal is not None:
            found *= np.divide(np.maximum(-(away @ self.normal), 0), np.sqrt(square), out=np.zeros_like(square), where=square > 0)
        return found

    def may_reach(self, corners: np.ndarray, receiver: Face, level: float) -> np.ndarray:
        """Tell of which polygons (H, m, 3) the shadows may fall on a receiver; quick, and True when in doubt."""
        heights = receiver.heights(corners)
        top = np.inf if self.distant else float(receiver.heights(self.place))
        plain = np.all((heights > level) & (heights < top * (1 - NEAR_LIGHT)), axis=1)
        if (self.distant and self.place @ receiver.normal >= 0) or top <= level:
            return np.zeros(len(corners), bool)
        chosen = corners[plain]
        travel = np.broadcast_to(self.place, chosen.shape) if self.distant else chosen - self.place
        cast = chosen - travel * (heights[plain] / (travel @ receiver.normal))[..., None]
        found = np.ones(len(corners), bool)
        for start, stop in zip(receiver.corners, np.roll(receiver.corners, -1, 0)):
            found[plain] &= np.any((cast - start) @ np.cross(receiver.normal, stop - start) > 0, axis=1)
        return found

    def shadow(self, face: Face, receiver: Face, level: float) -> np.ndarray:
        """Return the corners of the shadow of a face on the plane of another, cut to the receiver; (0, 3) when there is none."""
        corners = clip(face.corners, receiver.heights(face.corners) - level)
        if self.distant:
            travel = np.broadcast_to(self.place, corners.shape)
            if self.place @ receiver.normal >= 0:
                return corners[:0]
        else:
            top = float(receiver.heights(self.place))
            if top <= level:
                return corners[:0]
            corners = clip(corners, top * (1 - NEAR_LIGHT) - receiver.heights(corners)) if len(corners) else corners
            travel = corners - self.place
        if len(corners) == 0:
            return corners
        along = travel @ receiver.normal
        cast = corners - travel * (receiver.heights(corners) / along)[:, None]
        for start, stop in zip(receiver.corners, np.roll(receiver.corners, -1, 0)):
            if len(cast):
                cast = clip(cast, (cast - start) @ np.cross(receiver.normal, stop - start))
        return cast


@dataclass(frozen=True)
class FlatLight:
    """Hold one light of the scene over a set of faces.

    Args:
        light: the light.
        strength: in renderer units, for unit spectrum.
        own: number of the light's own face, or -1.
        corners: (F, m, 3) what of an area light lies above each face's plane; None for the other lights.
        faces: the faces.
        frame: renderer coordinates.
    """

    light: Light
    strength: float
    own: int
    corners: np.ndarray | None
    faces: list[Face]
    frame: Frame

    def unhidden(self, points: np.ndarray, face: np.ndarray) -> np.ndarray:
        """Return irradiances on the fronts of faces, nothing between.

        Args:
            points: (C, m, 3) in renderer coordinates.
            face: (C,) number of the face that a row of points lies on.
        """
        normal = np.stack([f.normal for f in self.faces])[face][:, None, :]
        if isinstance(self.light, ConstantSky):
            return np.full(points.shape[:-1], np.pi * self.strength)
        if self.corners is None:
            return np.sum([p.irradiance(points, normal) for p in self.points(SMALL_LIGHT_ORDER)], axis=0)
        return self.strength * lambert(self.corners[face][:, None], points, normal)

    def points(self, order: int) -> list[LightPoint]:
        """Return the points that stand for the light: order x order of an area light's, the one of others; none for the sky."""
        light = self.light
        if isinstance(light, DirectionalLight):
            return [LightPoint(np.asarray(light.direction) / np.linalg.norm(light.direction), True, self.strength)]
        if isinstance(light, PointLight):
            return [LightPoint(self.frame.to_units(np.asarray(light.position)), False, self.strength)]
        if not isinstance(light, AreaLight):
            return []
        place, share = np.polynomial.legendre.leggauss(order)
        center, u, v = (
            self.frame.to_units(np.asarray(light.center)),
            *(np.asarray(s) / self.frame.unit for s in (light.half_u, light.half_v)),
        )
        size = self.strength * float(np.linalg.norm(np.cross(u, v)))
        return [
            LightPoint(center + a * u + b * v, False, size * s * t, light.normal)
            for a, s in zip(place, share)
            for b, t in zip(place, share)
        ]

    def hiders(self, receiver: int, level: float) -> np.ndarray:
        """Return the faces that may keep this light from a receiver: what reaches above the receiver's plane and before the light."""
        if isinstance(self.light, ConstantSky):
            return np.zeros(0, np.int64)
        above = self._highest(self.faces[receiver]) > level
        if self.own >= 0:
            above &= self._highest(self.faces[self.own]) > level
            above[self.own] = False
        above[receiver] = False
        return np.flatnonzero(above)

    def _highest(self, face: Face) -> np.ndarray:
        """Return how far each face reaches above the plane of one."""
        corners = np.concatenate([f.corners for f in self.faces])
        starts = np.cumsum([0, *(len(f.corners) for f in self.faces[:-1])])
        return np.maximum.reduceat(face.heights(corners), starts)


def flat_light(light: Light, number: int, strength: float, faces: list[Face], frame: Frame) -> FlatLight:
    """Prepare a light for a set of faces."""
    if not isinstance(light, AreaLight):
        return FlatLight(light, strength, -1, None, faces, frame)
    own = next(i for i, face in enumerate(faces) if face.light == number)
    lamp = faces[own]
    parts = []
    for face in faces:
        heights = face.heights(lamp.corners)
        level = LEVEL * float(np.abs(heights).max(initial=0.0))
        facing = face is not lamp and lamp.heights(face.corners).max() > 0
        parts.append(clip(lamp.corners, np.where(np.abs(heights) < level, 0, heights)) if facing else lamp.corners[:0])
    gap = _least_distance(lamp, faces)
    if float(np.abs(lamp.corners - lamp.corners.mean(0)).max()) < SMALL_LIGHT * gap:
        return FlatLight(light, strength, own, None, faces, frame)
    most = max(1, *(len(p) for p in parts))
    padded = np.zeros((len(faces), most, 3))
    for row, part in zip(padded, parts):
        if len(part):
            row[: len(part)], row[len(part) :] = part, part[-1]
    return FlatLight(light, strength, own, padded, faces, frame)


def _least_distance(lamp: Face, faces: list[Face]) -> float:
    """Return a bound of the distance from a lamp to all other faces: between the boxes round them."""
    low, high = lamp.corners.min(0), lamp.corners.max(0)
    gaps = [
        float(np.linalg.norm(np.maximum(np.maximum(low - f.corners.max(0), f.corners.min(0) - high), 0))) for f in faces if f is not lamp
    ]
    return min(gaps, default=np.inf)


def lambert(corners: np.ndarray, points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return irradiance / radiance of polygons at points, nothing between (theory.md (R.8)); shapes broadcast.

    Args:
        corners: (..., m, 3); repeated corners count once, and a polygon of one point is dark.
        points, normal: (..., 3).
    """
    place, (nx, ny, nz) = np.moveaxis(points, -1, 0), np.moveaxis(normal, -1, 0)
    unit = []
    for i in range(corners.shape[-2]):
        x, y, z = (corners[..., i, k] - place[k] for k in range(3))
        length = np.sqrt(x * x + y * y + z * z)
        scale = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
        unit.append((x * scale, y * scale, z * scale))
    total: np.ndarray | float = 0.0
    for (ax, ay, az), (bx, by, bz) in zip(unit, unit[1:] + unit[:1]):
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        sine = np.sqrt(x * x + y * y + z * z)
        angle = np.arctan2(sine, ax * bx + ay * by + az * bz)
        total = total + np.divide(angle, sine, out=np.zeros_like(sine), where=sine > 0) * (x * nx + y * ny + z * nz)
    return np.abs(total) / 2
