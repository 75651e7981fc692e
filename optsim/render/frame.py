"""Rescale and recentre a scene for the renderer, and aim the camera in those coordinates.

Radiance does not change with the scale of a scene, but the renderer's float32 ray offsets do not shrink with it: a chart
of 0.1 mm would lose its shadows. So everything is rendered about one unit large, near the origin (theory.md (R.21)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.lights import AreaLight
from scenes.scene import Scene
from scenes.viewpoint import Orthographic, Perspective, ThinLens

SMALLEST_VIEW = 1e-3
"""The unit is never below this share of the scene's half diagonal: float32 then still resolves the far end."""


@dataclass(frozen=True)
class Frame:
    """Map scene points p in metres to renderer points (p - origin) / unit."""

    origin: np.ndarray
    unit: float

    def to_units(self, points: np.ndarray) -> np.ndarray:
        """Return (..., 3) points in renderer coordinates."""
        return (np.asarray(points, np.float64) - self.origin) / self.unit


def _solid_bounds(scene: Scene) -> np.ndarray | None:
    boxes = [b for b in [scene.bounds()] if b is not None]
    boxes += [np.array([c.min(0), c.max(0)]) for c in (light.corners() for light in scene.lights if isinstance(light, AreaLight))]
    return np.array([np.min([b[0] for b in boxes], 0), np.max([b[1] for b in boxes], 0)]) if boxes else None


def frame_of(scene: Scene) -> Frame:
    """Choose the origin at what the camera looks at and the unit as what it sees of it, bounded by the shapes' own size."""
    box = scene.bounds()
    if box is None:
        box = _solid_bounds(scene)
    view = scene.viewpoint
    eye, (_, _, forward) = np.asarray(view.origin), view.axes()
    if box is None:
        return Frame(np.asarray(view.target, np.float64), float(np.linalg.norm(np.subtract(view.target, eye))))
    middle, half = box.mean(0), float(np.linalg.norm(box[1] - box[0])) / 2
    distance = max(float(forward @ (middle - eye)), 0.0)
    origin = np.clip(eye + distance * forward, box[0], box[1])
    if isinstance(view, Orthographic):
        seen = view.half_height
    else:
        assert isinstance(view, Perspective | ThinLens)
        seen = distance * float(np.tan(np.deg2rad(view.fov_deg) / 2))
    return Frame(origin, max(min(seen, half), SMALLEST_VIEW * half))


@dataclass(frozen=True)
class CameraRays:
    """Linear ray generation: the ray through (a, b) in [-1, 1]^2 starts at start + a start_a + b start_b and runs along
    forward + a turn_a + b turn_b; a grows to the right, b downwards. Renderer coordinates.

    Through the place (x, y) on a lens, in its radii, it starts start_lens (x right + y up) further on and turns by turn_lens times that
    (theory.md (R.33)); both are None for a pinhole."""

    start: np.ndarray
    start_a: np.ndarray
    start_b: np.ndarray
    forward: np.ndarray
    turn_a: np.ndarray
    turn_b: np.ndarray
    right: np.ndarray
    up: np.ndarray
    start_lens: float | None = None
    turn_lens: float | None = None

    @property
    def has_lens(self) -> bool:
        """Tell whether rays start all over a lens."""
        return self.start_lens is not None


def camera_rays(scene: Scene, frame: Frame, height: int, width: int) -> CameraRays:
    """Aim the camera of a height x width picture.

    Rays of a distant camera start just before the scene, on a plane computed in float64: float32 coordinates a thousand
    scene sizes away would not hit where they should.
    """
    view = scene.viewpoint
    right, up, forward = view.axes()
    aspect = width / height
    eye = frame.to_units(np.asarray(view.origin))
    box = _solid_bounds(scene)
    skip = 0.0
    if box is not None:
        corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        nearest = float(((frame.to_units(corners) - eye) @ forward).min())
        skip = max(0.0, nearest - 1.0)
    zero = np.zeros(3)
    if isinstance(view, Orthographic):
        half = view.half_height / frame.unit
        return CameraRays(eye + skip * forward, right * half * aspect, -up * half, forward, zero, zero, right, up)
    assert isinstance(view, Perspective | ThinLens)
    tangent = float(np.tan(np.deg2rad(view.fov_deg) / 2))
    turn_a, turn_b = right * tangent * aspect, -up * tangent
    lens: tuple[float, ...] = ()
    if isinstance(view, ThinLens):
        radius, focus = view.aperture_m / frame.unit, view.distance_m / frame.unit
        lens = (radius * (1 - skip / focus), -radius / focus)
    return CameraRays(eye + skip * forward, skip * turn_a, skip * turn_b, forward, turn_a, turn_b, right, up, *lens)
