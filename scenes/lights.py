"""The lights. A light absorbs whatever falls on it: it reflects nothing."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import model_validator

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
