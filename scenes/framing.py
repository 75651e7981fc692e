"""Views aligned to a rectangle: each mirror then looks at a tile of it, row by row and column by column."""

from __future__ import annotations

from typing import Any

import numpy as np

from scenes.errors import InputError
from scenes.model import LENGTH_LIMIT_M
from scenes.shapes import Rectangle
from scenes.viewpoint import Orthographic, Perspective, ThinLens


def square_on(rectangle: Rectangle, distance_m: float) -> dict[str, Any]:
    """Return where to look from to see a rectangle's front square on: half_u to the right, half_v up.

    Args:
        rectangle: what is looked at.
        distance_m: from the rectangle's middle, in (0, 1e9] m.

    Returns:
        the fields origin, target and up of a viewpoint.

    Raises:
        InputError: ``viewpoint.distance``.
    """
    if isinstance(distance_m, bool) or not isinstance(distance_m, int | float) or not 0 < distance_m <= LENGTH_LIMIT_M:
        raise InputError("viewpoint.distance", distance_m, f"in (0, {LENGTH_LIMIT_M:g}] m")
    center, up = np.asarray(rectangle.center), np.asarray(rectangle.half_v)
    origin = center + distance_m * rectangle.normal
    return {"origin": tuple(origin), "target": tuple(center), "up": tuple(up / np.linalg.norm(up))}


def orthographic_on(rectangle: Rectangle, distance_m: float) -> Orthographic:
    """Return the parallel view whose picture's height a rectangle fills exactly (and its width, in a picture of its aspect)."""
    return Orthographic(**square_on(rectangle, distance_m), half_height=float(np.linalg.norm(rectangle.half_v)))


def perspective_on(rectangle: Rectangle, distance_m: float) -> Perspective:
    """Return the pinhole view whose picture's height a rectangle fills exactly."""
    return Perspective(**square_on(rectangle, distance_m), fov_deg=_angle(rectangle, distance_m))


def lens_on(rectangle: Rectangle, distance_m: float, aperture_m: float) -> ThinLens:
    """Return the view through a lens, sharp on the rectangle, whose picture's height the rectangle fills exactly."""
    return ThinLens(**square_on(rectangle, distance_m), fov_deg=_angle(rectangle, distance_m), aperture_m=aperture_m)


def _angle(rectangle: Rectangle, distance_m: float) -> float:
    return float(2 * np.rad2deg(np.arctan(np.linalg.norm(rectangle.half_v) / distance_m)))
