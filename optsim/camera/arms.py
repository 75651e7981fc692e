"""The relay's arm behind the first lens: prism and second lens in collimated light, or the prism in one lens's converging beam."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from optsim.camera.beam import Beam, cast
from optsim.camera.faces import Faces
from optsim.camera.mount import MirrorMount, SensorMount
from optsim.camera.prism import Dispersion
from optsim.camera.pupil import rings
from optsim.camera.relay import Relay
from optsim.camera.stack import DESIGN_NM, FIRST_BAND_NM, Prism
from optsim.errors import InputError


class Arm(Protocol):
    """Take rays from the first lens to the sensor."""

    @property
    def power_per_mm(self) -> float:
        """Return the power of the lens before the prism."""

    @property
    def focus_mm(self) -> float:
        """Return where the sensor belongs, in mm behind the lens."""

    @property
    def back_mm(self) -> float:
        """Return where the arm ends, in mm behind the lens: the sensor cannot stand nearer."""

    def land(self, beam: Beam, sensor: SensorMount) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) on the sensor in mm from the axis; 0 where lost."""

    def origin_px(self, sensor: SensorMount) -> float:
        """Return the position in px of the sensor's point on the axis."""


@dataclass(frozen=True)
class CollimatedArm:
    """Take light through a dispersion in collimated light, then through a lens (theory.md (C.5), (C.29)).

    Args:
        dispersion: prism or table.
        relay: the lenses.
        pixel_mm: the sensor's pitch.
    """

    dispersion: Dispersion
    relay: Relay
    pixel_mm: float

    @property
    def power_per_mm(self) -> float:
        """Return that of the collimator."""
        return 1 / self.relay.collimator_mm

    @property
    def focus_mm(self) -> float:
        """Return the second lens's focal length."""
        return self.relay.focal_mm

    @property
    def back_mm(self) -> float:
        """Return 0: the lens itself."""
        return 0.0

    def land(self, beam: Beam, sensor: SensorMount) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) on the sensor in mm from the axis; 0 where lost."""
        f1, f2 = self.relay.collimator_mm, self.relay.focal_mm
        x, y, valid = self.dispersion.position_px(beam.wavelength_nm, beam.slope_x * f1, beam.slope_y * f1)
        scale = self.pixel_mm / f2
        slope_x, slope_y = (x - self._axis_px) * scale - beam.x / f2, y * scale - beam.y / f2
        x, y, meets = sensor.hit(beam.x, beam.y, slope_x, slope_y)
        valid = valid & meets
        return np.where(valid, x, 0.0), np.where(valid, y, 0.0), valid

    def origin_px(self, sensor: SensorMount) -> float:
        """Return the position in px of light along the axis, wherever the sensor is."""
        return self._axis_px

    @functools.cached_property
    def _axis_px(self) -> float:
        if isinstance(self.dispersion, Prism):
            return self.dispersion.origin_px
        return float(self.dispersion.position_px(DESIGN_NM)[0])


@dataclass(frozen=True)
class ConvergingArm:
    """Take light through the faces of a prism in the beam of one lens of power 1/f1 + 1/f2 (theory.md (C.30)).

    Args:
        prism: whose faces.
        relay: the lens.
        pixel_mm: the sensor's pitch.

    Raises:
        InputError: field ``relay.prism_to_sensor_mm`` when the prism does not stand between the lens and the sensor.
    """

    prism: Prism
    relay: Relay
    pixel_mm: float

    def __post_init__(self) -> None:
        thick, relay = self._faces.depth_mm[-1], self.relay
        if self._start_mm < 0 or self.back_mm >= relay.focal_mm:
            allowed = f"above {thick:.4g} (the prism's thickness), up to focal_mm = {relay.focal_mm:g} mm"
            raise InputError("relay.prism_to_sensor_mm", relay.prism_to_sensor_mm, allowed)

    @property
    def power_per_mm(self) -> float:
        """Return that of the one lens."""
        return 1 / self.relay.collimator_mm + 1 / self.relay.focal_mm

    @property
    def back_mm(self) -> float:
        """Return where the last face crosses the axis."""
        return self._start_mm + self._faces.depth_mm[-1]

    @functools.cached_property
    def focus_mm(self) -> float:
        """Return the distance behind the lens at which the design wavelength's spot on the axis is smallest (theory.md (C.30))."""
        points = rings(self.relay.pupil_rays).points
        x, y, z, slope_x, slope_y, valid = self._behind_faces(self._axial(self.prism.design_nm, points))
        if valid.sum() < 4:
            raise self._lost(self.prism.design_nm)
        places = np.stack([x - z * slope_x, y - z * slope_y])[:, valid]
        slopes = np.stack([slope_x, slope_y])[:, valid]
        places, slopes = (a - a.mean(1, keepdims=True) for a in (places, slopes))
        return -float((places * slopes).sum() / (slopes * slopes).sum())

    def land(self, beam: Beam, sensor: SensorMount) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) on the sensor in mm from the axis; 0 where lost."""
        x, y, z, slope_x, slope_y, valid = self._behind_faces(beam)
        x, y, meets = sensor.hit(x, y, slope_x, slope_y, z)
        valid = valid & meets
        return np.where(valid, x, 0.0), np.where(valid, y, 0.0), valid

    def origin_px(self, sensor: SensorMount) -> float:
        """Return the position in px of the axis, such that the wavelength that fixes the prism's positions lands where it says."""
        at, fixed = self.prism.design_position_px, self.prism.design_nm
        anchor, position = (FIRST_BAND_NM, 0.0) if at is None else (fixed, at)
        x, _, valid = self.land(self._axial(anchor, None), sensor)
        if not valid:
            raise self._lost(anchor)
        return position - float(x) / self.pixel_mm

    @property
    def _faces(self) -> Faces:
        return Faces(self.prism, self.relay.prism_aperture_mm)

    @property
    def _start_mm(self) -> float:
        return 0.0 if self.relay.prism_to_sensor_mm is None else self.relay.focal_mm - self.relay.prism_to_sensor_mm

    def _axial(self, wavelength_nm: float, pupil: np.ndarray | None) -> Beam:
        upright = MirrorMount(collimator_mm=self.relay.collimator_mm)
        return cast(upright, self.relay.stop_radius_mm, self.power_per_mm, (wavelength_nm, 0.0, 0.0), pupil)

    def _behind_faces(self, beam: Beam) -> tuple[np.ndarray, ...]:
        position = beam.x, beam.y, np.asarray(-self._start_mm)
        x, y, z, slope_x, slope_y, valid = self._faces.trace(beam.wavelength_nm, position, (beam.slope_x, beam.slope_y))
        return x, y, z + self._start_mm, slope_x, slope_y, valid

    def _lost(self, wavelength_nm: float) -> InputError:
        return InputError("relay.converging", True, f"false, or angles at which {wavelength_nm:g} nm passes the prism")
