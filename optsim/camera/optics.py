"""The whole path from a mirror to the sensor: registration, tilt, lenses, prism, distortion, and the blur (theory.md C.e)."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.arms import Arm, CollimatedArm, ConvergingArm
from optsim.camera.beam import Beam, cast
from optsim.camera.inverse import wavelength_at
from optsim.camera.mount import MirrorMount, SensorMount, sharp_slope
from optsim.camera.prism import Dispersion
from optsim.camera.psf import airy_otf, disc_otf
from optsim.camera.pupil import Pupil, rings
from optsim.camera.stack import DESIGN_NM, Chief, Prism
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig

_HALF = math.sqrt(0.5)


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
        _ = self._arm

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
            InputError: fields ``wavelength_nm``, ``X_mm``, ``pupil``, ``dmd.tilt_deg``, ``relay.defocus_mm``, ``relay.distortion_per_mm2``.
        """
        dmd = self.camera.dmd
        if self._straight and pupil is None:
            x, y, valid = self.dispersion.position_px(wavelength_nm, X_mm, Y_mm)
        else:
            x_mm, y_mm, valid = self._arm.land(self._beam(wavelength_nm, X_mm, Y_mm, pupil), self._sensor)
            x_mm, y_mm = self._distorted(x_mm, y_mm, valid)
            scale = 1000 / self.camera.sensor.pitch_um
            x, y = x_mm * scale + self._origin_px, y_mm * scale
        return np.where(valid, x + dmd.offset_x_px, 0.0), np.where(valid, y + dmd.offset_y_px, 0.0), valid

    def chief(self, wavelength_nm: ArrayLike) -> Chief:
        """Return where chief rays of the mirrors' middle land, in mm from the optical axis, without the registration's offset.

        Raises:
            InputError: ``wavelength_nm`` outside a glass's range; ``table`` for a table, which knows no optical axis.
        """
        if not isinstance(self.dispersion, Prism):
            raise InputError("table", "a table of centres", "a prism: a table knows no optical axis")
        if self._straight:
            return self.dispersion.chief(wavelength_nm)
        x, y, valid = self._arm.land(self._beam(wavelength_nm, 0.0, 0.0, None), self._sensor)
        return Chief(self._distorted(x, y, valid)[0], valid)

    def transmission(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0, pupil: ArrayLike | None = None
    ) -> np.ndarray:
        """Return the share of a ray's light that the prism passes, in [0, 1]; 0 where it is lost. Arguments as for ``position_px``."""
        beam = self._beam(wavelength_nm, X_mm, Y_mm, pupil)
        f1 = self.camera.relay.collimator_mm
        return self.dispersion.transmission(beam.wavelength_nm, beam.slope_x * f1, beam.slope_y * f1)

    def wavelength_at(self, position_px: ArrayLike) -> np.ndarray:
        """Return the wavelengths in nm whose chief ray from the mirrors' middle lands at positions along x, in px."""
        return wavelength_at(self, position_px, self.dispersion.range_nm if isinstance(self.dispersion, Prism) else None)

    def pupil(self) -> Pupil | None:
        """Return the rays that stand for the light cone; None when a chief ray and ``otf`` say all (theory.md (C.31)).

        Rays are needed in a converging beam, and with tilted mirrors before an upright sensor.
        """
        relay, tilt = self.camera.relay, self.camera.dmd.tilt_deg
        return rings(relay.pupil_rays) if relay.converging or (tilt != 0 and not relay.scheimpflug) else None

    @property
    def has_blur(self) -> bool:
        """Tell whether ``otf`` differs from 1."""
        relay = self.camera.relay
        return relay.diffraction or (self.pupil() is None and (relay.defocus_mm != 0 or self._slope != 0))

    def otf(self, wavelength_nm: float, fy: ArrayLike, fx: ArrayLike) -> np.ndarray:
        """Return the part of the blur that is alike all over the field, as a real OTF (theory.md (C.32) to (C.35)).

        Diffraction and defocus of a circular pupil together, exactly; without diffraction the defocus disc alone. With
        pupil rays the rays carry the defocus and only diffraction is left here. The image is not moved.

        Args:
            wavelength_nm: one wavelength.
            fy, fx: frequencies in cycles per px along rows' and columns' index, broadcast.
        """
        pitch_mm = self.camera.sensor.pitch_um / 1000
        fy, fx = np.broadcast_arrays(np.asarray(fy, np.float64), np.asarray(fx, np.float64))
        along, across = (fx + fy) * _HALF, (fx - fy) * _HALF * math.hypot(1, self._slope)
        radial = np.hypot(along, across) / pitch_mm
        defocus = 0.0 if self.pupil() is not None else self.defocus_mm(wavelength_nm)
        if not self.camera.relay.diffraction:
            return disc_otf(radial, abs(defocus) / self.f_number)
        return airy_otf(radial, wavelength_nm, self.f_number, defocus)

    def defocus_mm(self, wavelength_nm: float) -> float:
        """Return how far behind the focus the sensor is at this wavelength's place, in mm (theory.md (C.35)).

        A Scheimpflug sensor is sharp for the design wavelength; the others land beside their own tilted image.
        """
        aside = self._axial_mm(wavelength_nm) - self._pivot_mm if self._slope else 0.0
        return self.camera.relay.defocus_mm + self._slope * _HALF * aside

    @functools.cached_property
    def _arm(self) -> Arm:
        relay, pixel_mm = self.camera.relay, self.camera.sensor.pitch_um / 1000
        if not relay.converging:
            return CollimatedArm(self.dispersion, relay, pixel_mm)
        if not isinstance(self.dispersion, Prism):
            raise InputError("relay.converging", True, "false with [table]: a table of centres has no faces to trace")
        return ConvergingArm(self.dispersion, relay, pixel_mm)

    @property
    def _mirrors(self) -> MirrorMount:
        dmd = self.camera.dmd
        return MirrorMount(self.camera.relay.collimator_mm, dmd.tilt_deg, dmd.rotation_deg, dmd.scale)

    @property
    def _straight(self) -> bool:
        """Tell whether positions are the dispersion's own, plus the offset."""
        relay = self.camera.relay
        return self._mirrors.in_place and not relay.converging and relay.defocus_mm == 0 and relay.distortion_per_mm2 == 0

    @property
    def _slope(self) -> float:
        return sharp_slope(self.camera.relay, self.camera.dmd.tilt_deg)

    @functools.cached_property
    def _sensor(self) -> SensorMount:
        arm, defocus_mm = self._arm, self.camera.relay.defocus_mm
        if arm.focus_mm + defocus_mm <= arm.back_mm:
            raise InputError("relay.defocus_mm", defocus_mm, f"above {arm.back_mm - arm.focus_mm:.6g} mm, where lens and prism are")
        return SensorMount(arm.focus_mm + defocus_mm, self._slope, self._pivot_mm if self._slope else 0.0)

    @functools.cached_property
    def _origin_px(self) -> float:
        return self._arm.origin_px(self._sensor)

    @functools.cached_property
    def _pivot_mm(self) -> float:
        """Return where the design wavelength of the field's middle lands on an upright sensor."""
        return self._axial_mm(self.dispersion.design_nm if isinstance(self.dispersion, Prism) else DESIGN_NM)

    def _axial_mm(self, wavelength_nm: float) -> float:
        upright = SensorMount(self._arm.focus_mm, 0.0)
        return float(self._arm.land(self._beam(wavelength_nm, 0.0, 0.0, None), upright)[0])

    def _beam(self, wavelength_nm: ArrayLike, X_mm: ArrayLike, Y_mm: ArrayLike, pupil: ArrayLike | None) -> Beam:
        point = wavelength_nm, X_mm, Y_mm
        return cast(self._mirrors, self.camera.relay.stop_radius_mm, self._arm.power_per_mm, point, pupil)

    def _distorted(self, x: np.ndarray, y: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Apply r' = r (1 + k r^2) (theory.md (C.29))."""
        k = self.camera.relay.distortion_per_mm2
        if k == 0:
            return x, y
        grow = k * (x * x + y * y)
        if np.any(valid & (3 * grow <= -1)):
            limit = -1 / (3 * float((x * x + y * y)[valid].max()))
            raise InputError("relay.distortion_per_mm2", k, f"above {limit:.3g} per mm^2, where this field's image folds over")
        return x * (1 + grow), y * (1 + grow)
