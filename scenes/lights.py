"""The lights. A light absorbs whatever falls on it: it reflects nothing."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from scenes.errors import InputError
from scenes.materials import Emission
from scenes.model import Direction, Model, Vector
from scenes.shapes import require_perpendicular
from scenes.spectrum import Spectrum


class Light(Model):
    """A light; abstract, see ``LIGHTS`` for the final ones."""

    place: ClassVar[str] = "light"

    @property
    def spectrum(self) -> Spectrum:
        """Return the light's spectrum in its own unit."""
        raise NotImplementedError


class AreaLight(Light):
    """A glowing rectangle, the same in all directions, on the side of half_u x half_v; the back is black.

    Args:
        center: the middle.
        half_u: from the middle to the middle of one side.
        half_v: from the middle to the middle of a neighbouring side, perpendicular to half_u.
        radiance: W m^-2 sr^-1 nm^-1, 0 to 1e30.
    """

    center: Vector
    half_u: Direction
    half_v: Direction
    radiance: Emission

    @model_validator(mode="after")
    def _sides(self) -> AreaLight:
        require_perpendicular(half_u=self.half_u, half_v=self.half_v)
        return self

    @property
    def spectrum(self) -> Spectrum:
        """Return the radiance."""
        return self.radiance

    @property
    def normal(self) -> np.ndarray:
        """Return the unit normal of the glowing side."""
        n = np.cross(self.half_u, self.half_v)
        return n / np.linalg.norm(n)

    def corners(self) -> np.ndarray:
        """Return the (4, 3) corners, anticlockwise seen from the glowing side."""
        c, u, v = (np.asarray(x) for x in (self.center, self.half_u, self.half_v))
        return np.array([c - u - v, c + u - v, c + u + v, c - u + v])

    def irradiance_per_radiance(self, point: ArrayLike, normal: ArrayLike) -> float:
        """Return irradiance / radiance in sr at a surface point, nothing in between (Lambert's polygon formula, theory.md (R.8)).

        Args:
            point: three coordinates in metres.
            normal: of the surface there, any length.

        Raises:
            InputError: ``light`` when a part of the light lies behind the surface, or the point behind the light.
        """
        n = np.asarray(normal, np.float64) / np.linalg.norm(normal)
        r = self.corners() - np.asarray(point, np.float64)
        if np.any(r @ n < 0) or np.any(r @ self.normal > 0):
            raise InputError("light", self.center, "wholly above the surface and facing the point")
        r = r / np.linalg.norm(r, axis=1, keepdims=True)
        after = np.roll(r, -1, axis=0)
        across = np.cross(r, after)
        sine = np.linalg.norm(across, axis=1)
        angle = np.arctan2(sine, np.sum(r * after, axis=1))
        return float(abs(np.sum(angle / sine * (across @ n))) / 2)


class DirectionalLight(Light):
    """Parallel light from infinitely far away.

    Args:
        direction: the way the light travels.
        irradiance: on a plane across the light, W m^-2 nm^-1, 0 to 1e30.
    """

    direction: Direction
    irradiance: Emission

    @property
    def spectrum(self) -> Spectrum:
        """Return the irradiance."""
        return self.irradiance


class PointLight(Light):
    """Light from one point, the same in all directions.

    Args:
        position: where it is.
        intensity: W sr^-1 nm^-1, 0 to 1e30.
    """

    position: Vector
    intensity: Emission

    @property
    def spectrum(self) -> Spectrum:
        """Return the intensity."""
        return self.intensity


class ConstantSky(Light):
    """Light from all directions alike; it is what a ray sees that hits nothing.

    Args:
        radiance: W m^-2 sr^-1 nm^-1, 0 to 1e30.
    """

    radiance: Emission

    @property
    def spectrum(self) -> Spectrum:
        """Return the radiance."""
        return self.radiance


LIGHTS: tuple[type[Light], ...] = (AreaLight, DirectionalLight, PointLight, ConstantSky)
"""Every light a scene may use."""
