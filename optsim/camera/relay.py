"""The relay: two lenses with the prism in the collimated light between them, and the light that they pass."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from optsim.camera.model import Model, ranged


class Relay(Model):
    """Describe the lenses that image the mirrors onto the sensor.

    Ideal thin lenses, with the stop where they and the prism are: a point at (X, Y) becomes the wave vector (X, Y, f1), a
    wave vector k becomes the point f2 (kx, ky) / kz (theory.md (C.5)). X and Y count along their image, so that the image
    inversion is undone by numbering the mirrors from the opposite corner.

    Args:
        collimator_mm: f1, from the mirrors to the collimated light, in (0, 1e6] mm.
        focal_mm: f2, from the prism to the sensor, in (0, 1e6] mm.
        f_number: of the light cone at the mirrors, from 0.5 (a hemisphere) to 1e3.
        transmission: of all optics together, in (0, 1].
        diffraction: whether the lenses' aperture blurs (an Airy pattern at the f-number on the sensor's side).
        defocus_mm: of the sensor, in [-100, 100] mm.
        distortion_per_mm2: k in r' = r (1 + k r^2) at the sensor, in [-1e-2, 1e-2] per mm^2.
        scheimpflug: whether the sensor is tilted so that tilted mirrors are sharp all over.
        converging: whether the prism stands in the converging beam of one lens, not in collimated light.
        prism_to_sensor_mm: with ``converging``, in (0, 1e6] mm; None: ``focal_mm``.
        prism_aperture_mm: full width of the prism's faces; with ``converging`` it sets how thick the wedges are, in (0, 1e4] mm.
        pupil_rays: traced through the pupil where chief rays are not enough, from 32 to 4096.
    """

    place: ClassVar[str] = "relay"
    collimator_mm: Annotated[float, ranged(0, 1e6, "mm", "(]")] = 138.2
    focal_mm: Annotated[float, ranged(0, 1e6, "mm", "(]")] = 100.0
    f_number: Annotated[float, ranged(0.5, 1e3, "")] = 8.0
    transmission: Annotated[float, ranged(0, 1, "", "(]")] = 1.0

    diffraction: bool = True
    defocus_mm: Annotated[float, ranged(-100, 100, "mm")] = 0.0
    distortion_per_mm2: Annotated[float, ranged(-1e-2, 1e-2, "per mm^2")] = 0.0
    scheimpflug: bool = True
    converging: bool = False
    prism_to_sensor_mm: Annotated[float, ranged(0, 1e6, "mm", "(]")] | None = None
    prism_aperture_mm: Annotated[float, ranged(0, 1e4, "mm", "(]")] = 25.0
    pupil_rays: Annotated[int, ranged(32, 4096, "rays")] = 32

    @property
    def magnification(self) -> float:
        """Return f2 / f1."""
        return self.focal_mm / self.collimator_mm

    @property
    def stop_radius_mm(self) -> float:
        """Return the radius of the light cone's stop at the lenses: f1 / (2 f_number)."""
        return self.collimator_mm / (2 * self.f_number)

    @property
    def projected_solid_angle_sr(self) -> float:
        """Return pi sin^2(theta) of the cone at the mirrors, sin(theta) = 1 / (2 f_number), in sr (theory.md (C.8))."""
        return math.pi / (4 * self.f_number**2)
