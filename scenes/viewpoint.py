"""Where the scene is looked at from. Pictures have row 0 at the top; x grows to the right."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from scenes.errors import InputError
from scenes.model import LENGTH_LIMIT_M, Direction, Model, Vector, ranged


class Viewpoint(Model):
    """A view of the scene; abstract, see ``VIEWPOINTS`` for the final ones.

    Args:
        origin: where the rays start.
        target: the point in the middle of the picture.
        up: what points up in the picture; need not be perpendicular to the view, must not be parallel to it.

    Raises:
        InputError: ``viewpoint.look_at`` when origin and target coincide or up is parallel to the view.
    """

    place: ClassVar[str] = "viewpoint"
    origin: Vector
    target: Vector
    up: Direction = (0.0, 1.0, 0.0)

    @model_validator(mode="after")
    def _look_at(self) -> Viewpoint:
        origin, target = np.asarray(self.origin), np.asarray(self.target)
        view = target - origin
        if np.linalg.norm(view) <= 1e-12 * max(1e-12, np.abs([origin, target]).max()):
            raise InputError("look_at", self.target, "a target that is not the origin")
        sine = np.linalg.norm(np.cross(view, self.up)) / np.linalg.norm(view) / np.linalg.norm(self.up)
        if sine < 1e-6:
            raise InputError("look_at", self.up, "an up vector that is not parallel to the view")
        return self

    def axes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the unit vectors right, up and forward of the picture."""
        forward = np.subtract(self.target, self.origin)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def rays(self, across: ArrayLike, down: ArrayLike, aspect: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays through picture points.

        Args:
            across: picture fractions from 0 (left edge) to 1 (right edge), any shape.
            down: picture fractions from 0 (top edge) to 1 (bottom edge), same shape.
            aspect: width / height of the picture.

        Returns:
            origins and unit directions, each of that shape + (3,).
        """
        raise NotImplementedError

    def _plane(self, across: ArrayLike, down: ArrayLike, aspect: float, half_height: float) -> np.ndarray:
        right, up, _ = self.axes()
        x = (2 * np.asarray(across, np.float64) - 1) * aspect * half_height
        y = (1 - 2 * np.asarray(down, np.float64)) * half_height
        return x[..., None] * right + y[..., None] * up


class Orthographic(Viewpoint):
    """Look along parallel rays.

    Args:
        half_height: from the middle of the picture to its top edge, in metres.
    """

    half_height: Annotated[float, ranged(0, LENGTH_LIMIT_M, "m", "(]")]

    def rays(self, across: ArrayLike, down: ArrayLike, aspect: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Return the parallel rays through picture points, see ``Viewpoint.rays``."""
        origins = np.asarray(self.origin) + self._plane(across, down, aspect, self.half_height)
        return origins, np.broadcast_to(self.axes()[2], origins.shape)


class Perspective(Viewpoint):
    """Look through a pinhole.

    Args:
        fov_deg: angle between the top and the bottom edge of the picture, in degrees, inside (0, 180).
    """

    fov_deg: Annotated[float, ranged(0, 180, "degrees", "()")]

    def rays(self, across: ArrayLike, down: ArrayLike, aspect: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays through the pinhole and picture points, see ``Viewpoint.rays``."""
        d = self.axes()[2] + self._plane(across, down, aspect, float(np.tan(np.deg2rad(self.fov_deg) / 2)))
        return np.broadcast_to(np.asarray(self.origin), d.shape), d / np.linalg.norm(d, axis=-1, keepdims=True)


class ThinLens(Viewpoint):
    """Look through a round thin lens: what lies in one plane is sharp, what lies before and behind it is blurred.

    Args:
        fov_deg: angle between the top and the bottom edge of the picture through the lens's middle, in degrees, inside (0, 180).
        aperture_m: radius of the lens, in (0, 1e9] m.
        focus_m: distance of the sharp plane along the view, in (0, 1e9] m; None: the target's.
    """

    fov_deg: Annotated[float, ranged(0, 180, "degrees", "()")]
    aperture_m: Annotated[float, ranged(0, LENGTH_LIMIT_M, "m", "(]")]
    focus_m: Annotated[float, ranged(0, LENGTH_LIMIT_M, "m", "(]")] | None = None

    @property
    def distance_m(self) -> float:
        """Return the distance of the sharp plane."""
        return float(np.linalg.norm(np.subtract(self.target, self.origin))) if self.focus_m is None else self.focus_m

    def rays(self, across: ArrayLike, down: ArrayLike, aspect: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays through the lens's middle and picture points, see ``Viewpoint.rays``."""
        return self.lens_rays(across, down, np.zeros(np.shape(across)), np.zeros(np.shape(across)), aspect)

    def lens_rays(
        self, across: ArrayLike, down: ArrayLike, lens_x: ArrayLike, lens_y: ArrayLike, aspect: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays through picture points and points of the lens.

        Args:
            across, down: as for ``rays``.
            lens_x, lens_y: places on the lens in units of its radius, along the picture's right and up.
            aspect: width / height of the picture.
        """
        right, up, forward = self.axes()
        ahead = forward + self._plane(across, down, aspect, float(np.tan(np.deg2rad(self.fov_deg) / 2)))
        x, y = (np.asarray(c, np.float64)[..., None] * self.aperture_m for c in (lens_x, lens_y))
        start = np.asarray(self.origin) + x * right + y * up
        d = np.asarray(self.origin) + self.distance_m * ahead - start
        return start, d / np.linalg.norm(d, axis=-1, keepdims=True)


VIEWPOINTS: tuple[type[Viewpoint], ...] = (Orthographic, Perspective, ThinLens)
"""Every viewpoint a scene may use."""
