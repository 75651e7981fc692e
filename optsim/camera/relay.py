"""The relay: two lenses with the prism in the collimated light between them, and the light that they pass."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from optsim.camera.model import Model, ranged


class Relay(Model):
    """Describe the lenses that image the mirrors onto the sensor.

    Distortion-free, without aberrations or diffraction: a point at (X, Y) becomes the wave vector (X, Y, f1), a wave
    vector k becomes the point f2 (kx, ky) / kz (theory.md (C.5)). X and Y count along their image, so that the image
    inversion is undone by numbering the mirrors from the opposite corner.

    Args:
        collimator_mm: f1, from the mirrors to the collimated light, in (0, 1e6] mm.
        focal_mm: f2, from the prism to the sensor, in (0, 1e6] mm.
        f_number: of the light cone at the mirrors, from 0.5 (a hemisphere) to 1e3.
        transmission: of all optics together, in (0, 1].
    """

    place: ClassVar[str] = "relay"
    collimator_mm: Annotated[float, ranged(0, 1e6, "mm", "(]")] = 138.2
    focal_mm: Annotated[float, ranged(0, 1e6, "mm", "(]")] = 100.0
    f_number: Annotated[float, ranged(0.5, 1e3, "")] = 8.0
    transmission: Annotated[float, ranged(0, 1, "", "(]")] = 1.0

    @property
    def magnification(self) -> float:
        """Return f2 / f1."""
        return self.focal_mm / self.collimator_mm

    @property
    def projected_solid_angle_sr(self) -> float:
        """Return pi sin^2(theta) of the cone at the mirrors, sin(theta) = 1 / (2 f_number), in sr (theory.md (C.8))."""
        return math.pi / (4 * self.f_number**2)
