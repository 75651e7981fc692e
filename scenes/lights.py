"""The lights. A light absorbs whatever falls on it: it reflects nothing."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from scenes.errors import InputError
from scenes.materials import Emission
from scenes.model import Direction, Model, Vector, ranged
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


class GradientSky(Light):
    """A sky that changes from the horizon to the zenith: radiance x (horizon + (zenith - horizon) max(0, sine of the elevation)).

    Below the horizon it is as at the horizon. Two of them with different spectra make a sky that changes colour.

    Args:
        radiance: W m^-2 sr^-1 nm^-1, 0 to 1e30.
        horizon: share of the radiance at the horizon, 0 to 1.
        zenith: share of it at the zenith, 0 to 1.
        up: towards the zenith.
    """

    radiance: Emission
    horizon: Annotated[float, ranged(0, 1, "")] = 1.0
    zenith: Annotated[float, ranged(0, 1, "")] = 0.0
    up: Direction = (0.0, 0.0, 1.0)

    @property
    def spectrum(self) -> Spectrum:
        """Return the radiance."""
        return self.radiance

    def share(self, direction: ArrayLike) -> np.ndarray:
        """Return the share of the radiance that comes from directions (..., 3) pointing into the sky."""
        d = np.asarray(direction, np.float64)
        up = np.asarray(self.up) / np.linalg.norm(self.up)
        sine = np.clip(d @ up / np.linalg.norm(d, axis=-1), 0, 1)
        return self.horizon + (self.zenith - self.horizon) * sine


SKIES = (ConstantSky, GradientSky)
LIGHTS: tuple[type[Light], ...] = (AreaLight, DirectionalLight, PointLight, ConstantSky, GradientSky)
"""Every light a scene may use."""
