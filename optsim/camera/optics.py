"""The whole path from a mirror to the sensor: registration, tilt, lenses, prism, distortion, and the blur (theory.md C.e)."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.faces import Faces
from optsim.camera.mount import MirrorMount, SensorMount, sharp_slope
from optsim.camera.prism import Dispersion
from optsim.camera.psf import airy_otf, disc_otf
from optsim.camera.pupil import Pupil, rings
from optsim.camera.stack import DESIGN_NM, FIRST_BAND_NM, Prism, field_points
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig

_HALF = math.sqrt(0.5)


class _Beam(NamedTuple):
    """Hold rays between the mirrors and the prism: where they cross the lens and their slopes before and behind its power."""

    wavelength_nm: np.ndarray
    pupil_x: np.ndarray
    pupil_y: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray


@dataclass(frozen=True)
class Optics:
    """Say where a camera's light lands and how it blurs, with everything that its relay, mirrors and mounting do.

    The lenses are thin and ideal, both at the prism, where the light cone's stop is too: a chief ray goes through
    their centre. Tilt, registration, defocus, distortion and the converging geometry enter exactly in this model.

    Args:
        camera: whose relay, mirrors, prism or table.

    Raises:
        InputError: field ``relay.converging`` with a table of centres (a table has no faces to trace), or
            ``relay.prism_to_sensor_mm`` when the prism does not stand between the lens and the sensor.
    """

    camera: CameraConfig

    def __post_init__(self) -> None:
        relay = self.camera.relay
        if not relay.converging:
            return
        if not isinstance(self.dispersion, Prism):
            raise InputError("relay.converging", True, "false with [table]: a table of centres has no faces to trace")
        if self._prism_start_mm < 0 or self._prism_start_mm + self._faces.depth_mm[-1] >= relay.focal_mm:
            allowed = f"above {self._faces.depth_mm[-1]:.4g} (the prism's thickness), up to focal_mm = {relay.focal_mm:g} mm"
            raise InputError("relay.prism_to_sensor_mm", relay.prism_to_sensor_mm, allowed)

    @functools.cached_property
    def dispersion(self) -> Dispersion:
        """Return the prism or table in the collimated light."""
        return self.camera.dispersion

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors, on the axis and without tilt."""
        return self.dispersion.magnification_px * self.camera.dmd.scale

    @property
    def f_number(self) -> float:
        """Return the f-number of the cone at the sensor: that at the mirrors x f2 / f1."""
        return self.camera.relay.f_number * self.camera.relay.magnification

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0, pupil: ArrayLike | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return where light of a point of the mirrors lands, in sensor pixels, float64 (theory.md (C.27) to (C.31)).

        Args:
            wavelength_nm: broadcast with X and Y, as for the prism.
            X_mm, Y_mm: the point in the mirrors' own plane, counted along its image, in mm.
            pupil: (..., 2) point of the unit disc that the ray goes through, broadcast with the others; None: the chief ray.

        Returns:
            (x, y, valid): x = 0 is the 455 nm pixel of X = 0, red positive; (0, 0, False) where no light arrives.

        Raises:
            InputError: fields ``wavelength_nm``, ``X_mm``, ``pupil``, ``dmd.tilt_deg``, ``relay.distortion_per_mm2``.
        """
        dmd = self.camera.dmd
        if self._straight and pupil is None:
            x, y, valid = self.dispersion.position_px(wavelength_nm, X_mm, Y_mm)
        else:
            x_mm, y_mm, valid = self._land(self._beam(wavelength_nm, X_mm, Y_mm, pupil))
            x_mm, y_mm = self._distorted(x_mm, y_mm, valid)
            scale = 1000 / self.camera.sensor.pitch_um
            x, y = x_mm * scale + self._origin_px, y_mm * scale
        return np.where(valid, x + dmd.offset_x_px, 0.0), np.where(valid, y + dmd.offset_y_px, 0.0), valid

    def transmission(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> np.ndarray:
        """Return the share of the chief ray's light that the prism lets through, in [0, 1]; 0 where it is lost."""
        beam = self._beam(wavelength_nm, X_mm, Y_mm, None)
        f1 = self.camera.relay.collimator_mm
        return self.dispersion.transmission(beam.wavelength_nm, beam.slope_x * f1, beam.slope_y * f1)

    def pupil(self) -> Pupil | None:
        """Return the rays that stand for the light cone; None when a chief ray and ``otf`` say all.

        Rays are needed in a converging beam, and with tilted mirrors before an upright sensor.
        """
        relay, tilt = self.camera.relay, self.camera.dmd.tilt_deg
        return rings(relay.pupil_rays) if relay.converging or (tilt != 0 and not relay.scheimpflug) else None

    @property
    def has_blur(self) -> bool:
        """Tell whether ``otf`` differs from 1."""
        relay, sharp = self.camera.relay, sharp_slope(self.camera.relay, self.camera.dmd.tilt_deg)
        return relay.diffraction or (self.pupil() is None and (relay.defocus_mm != 0 or sharp != 0))

    def otf(self, wavelength_nm: float, fy: ArrayLike, fx: ArrayLike) -> np.ndarray:
        """Return the part of the blur that is alike all over the field, as a real OTF (theory.md (C.32) to (C.35)).

        Diffraction and defocus of a circular pupil together, exactly; without diffraction the defocus disc alone. With
        pupil rays the rays carry the defocus and only diffraction is left here. The image is not moved.

        Args:
            wavelength_nm: one wavelength.
            fy, fx: frequencies in cycles per px along rows' and columns' index, broadcast.
        """
        relay, pitch_mm = self.camera.relay, self.camera.sensor.pitch_um / 1000
        fy, fx = np.broadcast_arrays(np.asarray(fy, np.float64), np.asarray(fx, np.float64))
        stretch = math.hypot(1, sharp_slope(relay, self.camera.dmd.tilt_deg))
        along, across = (fx + fy) * _HALF, (fx - fy) * _HALF * stretch
        radial = np.hypot(along, across) / pitch_mm
        defocus = 0.0 if self.pupil() is not None else self.defocus_mm(wavelength_nm)
        if not relay.diffraction:
            return disc_otf(radial, abs(defocus) / self.f_number)
        return airy_otf(radial, wavelength_nm, self.f_number, defocus)

    def defocus_mm(self, wavelength_nm: float) -> float:
        """Return how far behind the focus the sensor is at this wavelength's place, in mm (theory.md (C.35)).

        A Scheimpflug sensor is sharp for the design wavelength; the others land beside their own tilted image.
        """
        slope = sharp_slope(self.camera.relay, self.camera.dmd.tilt_deg)
        return self.camera.relay.defocus_mm + slope * _HALF * (self._axial_mm(wavelength_nm) - self._pivot_mm if slope else 0.0)

    @property
    def _straight(self) -> bool:
        """Tell whether positions are the dispersion's own, plus the offset."""
        relay = self.camera.relay
        return self._mirrors.in_place and not relay.converging and relay.defocus_mm == 0 and relay.distortion_per_mm2 == 0

    @property
    def _mirrors(self) -> MirrorMount:
        return MirrorMount(self.camera.dmd, self.camera.relay.collimator_mm)

    @functools.cached_property
    def _sensor(self) -> SensorMount:
        relay = self.camera.relay
        slope = sharp_slope(relay, self.camera.dmd.tilt_deg)
        focus = self._focus_mm if relay.converging else relay.focal_mm
        return SensorMount(focus + relay.defocus_mm, slope, self._pivot_mm if slope else 0.0)

    @functools.cached_property
    def _faces(self) -> Faces:
        assert isinstance(self.dispersion, Prism)
        return Faces(self.dispersion, self.camera.relay.prism_aperture_mm)

    @property
    def _prism_start_mm(self) -> float:
        relay = self.camera.relay
        return 0.0 if relay.prism_to_sensor_mm is None else relay.focal_mm - relay.prism_to_sensor_mm

    @functools.cached_property
    def _axis_px(self) -> float:
        """Return the position in px of light along the optical axis, with the prism in collimated light."""
        if isinstance(self.dispersion, Prism):
            return self.dispersion.origin_px
        return float(self.dispersion.position_px(DESIGN_NM)[0])

    @property
    def _design_nm(self) -> float:
        return self.dispersion.design_nm if isinstance(self.dispersion, Prism) else DESIGN_NM

    @functools.cached_property
    def _pivot_mm(self) -> float:
        return self._axial_mm(self._design_nm)

    @functools.cached_property
    def _origin_px(self) -> float:
        """Return the position in px of the sensor's point on the optical axis."""
        prism = self.dispersion
        if not self.camera.relay.converging or not isinstance(prism, Prism):
            return self._axis_px
        anchor = (FIRST_BAND_NM, 0.0) if prism.design_position_px is None else (prism.design_nm, prism.design_position_px)
        x, _, valid = self._through_faces(self._beam(anchor[0], 0.0, 0.0, None), self._sensor)
        if not valid:
            raise InputError("relay.converging", True, f"false, or angles at which {anchor[0]:g} nm passes the prism")
        return anchor[1] - float(x) * 1000 / self.camera.sensor.pitch_um

    def _axial_mm(self, wavelength_nm: float) -> float:
        """Return where the chief ray of the field's middle lands, in mm from the axis, on an upright sensor."""
        if self.camera.relay.converging:
            upright = SensorMount(self._focus_mm, 0.0)
            return float(self._through_faces(self._beam(wavelength_nm, 0.0, 0.0, None), upright)[0])
        x, _, _ = self.dispersion.position_px(wavelength_nm)
        return (float(x) - self._axis_px) * self.camera.sensor.pitch_um / 1000

    @functools.cached_property
    def _focus_mm(self) -> float:
        """Return the distance behind the lens at which the design wavelength's spot on the axis is smallest (theory.md (C.30))."""
        beam = self._beam(self._design_nm, 0.0, 0.0, rings(self.camera.relay.pupil_rays).points)
        x, y, z, slope_x, slope_y, valid = self._behind_faces(beam)
        if valid.sum() < 4:
            raise InputError("relay.converging", True, f"false, or angles at which {self._design_nm:g} nm passes the prism")
        places = np.stack([x - z * slope_x, y - z * slope_y])[:, valid]
        slopes = np.stack([slope_x, slope_y])[:, valid]
        places, slopes = (a - a.mean(1, keepdims=True) for a in (places, slopes))
        return -float((places * slopes).sum() / (slopes * slopes).sum())

    def _beam(self, wavelength_nm: ArrayLike, X_mm: ArrayLike, Y_mm: ArrayLike, pupil: ArrayLike | None) -> _Beam:
        """Return rays as they reach the prism: behind the collimator, or behind the one lens (theory.md (C.27), (C.28))."""
        relay = self.camera.relay
        x, y, distance = self._mirrors.place(field_points(X_mm, "X_mm"), field_points(Y_mm, "Y_mm"))
        radius = relay.collimator_mm / (2 * relay.f_number)
        u, v = (np.zeros(()), np.zeros(())) if pupil is None else _disc(pupil)
        power = 1 / relay.collimator_mm + (1 / relay.focal_mm if relay.converging else 0.0)
        bend = 1 / distance - power
        arrays = (
            np.asarray(wavelength_nm, np.float64),
            radius * u,
            radius * v,
            x / distance + radius * u * bend,
            y / distance + radius * v * bend,
        )
        return _Beam(*np.broadcast_arrays(*arrays))

    def _land(self, beam: _Beam) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) on the sensor in mm from the axis."""
        relay = self.camera.relay
        if relay.converging:
            return self._through_faces(beam, self._sensor)
        f1, f2 = relay.collimator_mm, relay.focal_mm
        x, y, valid = self.dispersion.position_px(beam.wavelength_nm, beam.slope_x * f1, beam.slope_y * f1)
        scale = self.camera.sensor.pitch_um / (1000 * f2)
        slope_x, slope_y = (x - self._axis_px) * scale - beam.pupil_x / f2, y * scale - beam.pupil_y / f2
        landed_x, landed_y = self._sensor.hit(beam.pupil_x, beam.pupil_y, slope_x, slope_y)
        return np.where(valid, landed_x, 0.0), np.where(valid, landed_y, 0.0), valid

    def _behind_faces(self, beam: _Beam) -> tuple[np.ndarray, ...]:
        start = self._prism_start_mm
        position = beam.pupil_x, beam.pupil_y, np.full(beam.pupil_x.shape, -start)
        x, y, z, slope_x, slope_y, valid = self._faces.trace(beam.wavelength_nm, position, (beam.slope_x, beam.slope_y))
        return x, y, z + start, slope_x, slope_y, valid

    def _through_faces(self, beam: _Beam, sensor: SensorMount) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x, y, z, slope_x, slope_y, valid = self._behind_faces(beam)
        x, y = sensor.hit(x, y, slope_x, slope_y, z)
        return np.where(valid, x, 0.0), np.where(valid, y, 0.0), valid

    def _distorted(self, x: np.ndarray, y: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = self.camera.relay.distortion_per_mm2
        if k == 0:
            return x, y
        grow = k * (x * x + y * y)
        if np.any(valid & (3 * grow <= -1)):
            limit = -1 / (3 * float((x * x + y * y)[valid].max()))
            raise InputError("relay.distortion_per_mm2", k, f"above {limit:.3g} per mm^2, where this field's image folds over")
        return x * (1 + grow), y * (1 + grow)


def _disc(pupil: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    points = np.asarray(pupil, np.float64)
    if points.shape[-1:] != (2,) or not np.all((points * points).sum(-1) <= 1 + 1e-12):
        raise InputError("pupil", points.shape, "(..., 2) points (u, v) of the unit disc")
    return points[..., 0], points[..., 1]
