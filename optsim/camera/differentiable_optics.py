"""The optics as a function of its numbers: face tilts, indices, lenses, registration, on NumPy or Dr.Jit arrays (theory.md (C.71))."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from optsim.camera.arrays import NUMPY, Array, Kernels, Ops
from optsim.camera.camera import CameraConfig
from optsim.camera.glass import AIR, Glass
from optsim.camera.stack import Prism
from optsim.camera.trace import image_point, trace_faces, transmit_faces
from optsim.errors import InputError


class OpticsValues(NamedTuple):
    """Hold the optics' numbers; floats, or Dr.Jit arrays that carry gradients.

    Args:
        face_tilt_rad: F angles t of the faces' normals (sin t, 0, cos t), rad.
        index_shift: F - 1 numbers added to the refractive index behind each face but the last.
        collimator_mm, focal_mm: f1 and f2, mm.
        offset_x_px, offset_y_px: displacement of the mirrors' image on the sensor, px.
        rotation_rad: of the mirrors in their plane.
        scale: of the mirrors in their plane, beside f2 / f1.
    """

    face_tilt_rad: tuple[Array, ...]
    index_shift: tuple[Array, ...]
    collimator_mm: Array
    focal_mm: Array
    offset_x_px: Array = 0.0
    offset_y_px: Array = 0.0
    rotation_rad: Array = 0.0
    scale: Array = 1.0

    def leaves(self) -> list[Array]:
        """Return all numbers in one list."""
        return [*self.face_tilt_rad, *self.index_shift, *self[2:]]

    def with_leaves(self, leaves: Sequence[Array]) -> OpticsValues:
        """Return the same form with other numbers, in the order of ``leaves``."""
        faces, media = len(self.face_tilt_rad), len(self.index_shift)
        return OpticsValues(tuple(leaves[:faces]), tuple(leaves[faces : faces + media]), *leaves[faces + media :])

    def numbers(self) -> OpticsValues:
        """Return plain floats, without gradients."""
        return self.with_leaves([float(leaf) if isinstance(leaf, float | int) else float(leaf[0]) for leaf in self.leaves()])

    def names(self) -> list[str]:
        """Return a name with unit for every leaf."""
        tilts = [f"tilt of face {i + 1} [rad]" for i in range(len(self.face_tilt_rad))]
        media = [f"index behind face {i + 1}" for i in range(len(self.index_shift))]
        return [*tilts, *media, "f1 [mm]", "f2 [mm]", "offset x [px]", "offset y [px]", "rotation [rad]", "scale"]


@dataclass(frozen=True)
class DifferentiableOptics:
    """Trace field points to the sensor as a function of :class:`OpticsValues`.

    Args:
        media: the glass behind each face but the last.
        values: the numbers of the camera at hand.
        pixel_um: the sensor's pitch.
        origin_px: position of the optical axis on the sensor, held fixed while the numbers change.
        fresnel: whether faces reflect part of the light.
        field: False keeps the axial curve for the whole field.
    """

    media: tuple[Glass, ...]
    values: OpticsValues
    pixel_um: float
    origin_px: float
    fresnel: bool = False
    field: bool = True

    @classmethod
    def of(cls, camera: CameraConfig) -> DifferentiableOptics:
        """Take the numbers from a camera with a traced prism in collimated light.

        Raises:
            InputError: field ``camera.table`` for a camera that is a table; ``camera.relay.converging``; ``camera`` for tilted
                mirrors or distortion.
        """
        if camera.prism is None:
            raise InputError("camera.table", "a table of centres", "a traced prism, whose angles and glasses have derivatives")
        if camera.relay.converging:
            raise InputError("camera.relay.converging", True, "false: derivatives are of chief rays in collimated light")
        if camera.dmd.tilt_deg != 0 or camera.relay.distortion_per_mm2 != 0:
            raise InputError("camera", "tilted mirrors or distortion", "mirrors that face the relay, and lenses without distortion")
        prism = camera.dispersion
        assert isinstance(prism, Prism)
        stack, dmd = prism.stack, camera.dmd
        values = OpticsValues(
            stack.face_tilt_rad,
            (0.0,) * len(stack.glasses),
            camera.relay.collimator_mm,
            camera.relay.focal_mm,
            dmd.offset_x_px,
            dmd.offset_y_px,
            math.radians(dmd.rotation_deg),
            dmd.scale,
        )
        return cls(stack.glasses, values, camera.sensor.pitch_um, float(stack.origin_px), stack.fresnel, stack.field)

    def inputs(self, k: Kernels, values: OpticsValues | None = None) -> OpticsValues:
        """Return numbers as Dr.Jit inputs: a new value reuses the compiled kernel, gradients may be enabled."""
        values = self.values if values is None else values
        return values.with_leaves([k.opaque(k.backend.Float64, float(leaf)) for leaf in values.leaves()])

    def gathered(self, k: Kernels, values: OpticsValues, like: Array) -> OpticsValues:
        """Spread Dr.Jit scalars over as many lanes as ``like`` has, so that reverse mode adds their derivatives in one kernel."""
        zero = k.dr.zeros(k.backend.UInt32, k.dr.width(like))
        return values.with_leaves([k.dr.gather(k.backend.Float64, leaf, zero) for leaf in values.leaves()])

    def trace(self, ops: Ops, values: OpticsValues, wavelength_nm: Array, X_mm: Array, Y_mm: Array) -> tuple[Array, Array, Array]:
        """Return (x, y, valid): the position in px of the light of field points (theory.md (C.71)); wavelengths are not checked."""
        kx, ky = self._turned(ops, values, X_mm, Y_mm)
        rays = self._rays(ops, values, wavelength_nm, kx, ky) if self.field else self._rays(ops, values, wavelength_nm, 0.0, 0.0)
        traced = trace_faces(ops, *rays)
        x, y = image_point(ops, traced, ky if self.field else 0.0, values.focal_mm)
        if not self.field:
            m = values.focal_mm / values.collimator_mm
            x, y = x + m * kx, y + m * ky
        scale = 1000 / self.pixel_um
        px = ops.where(traced.valid, x * scale + (self.origin_px + values.offset_x_px), 0.0)
        return px, ops.where(traced.valid, y * scale + values.offset_y_px, 0.0), traced.valid

    def transmitted(self, ops: Ops, values: OpticsValues, wavelength_nm: Array, X_mm: Array, Y_mm: Array) -> Array:
        """Return the share of light that the faces pass (theory.md (C.19)); 1 without ``fresnel``, lost light is the trace's to say."""
        if not self.fresnel:
            return 1.0
        kx, ky = self._turned(ops, values, X_mm, Y_mm) if self.field else (0.0, 0.0)
        return transmit_faces(ops, *self._rays(ops, values, wavelength_nm, kx, ky))

    def _turned(self, ops: Ops, values: OpticsValues, X_mm: Array, Y_mm: Array) -> tuple[Array, Array]:
        """Turn and stretch field points in the mirrors' plane (theory.md (C.27))."""
        c, s = ops.cos(values.rotation_rad) * values.scale, ops.sin(values.rotation_rad) * values.scale
        return X_mm * c - Y_mm * s, X_mm * s + Y_mm * c

    def _rays(self, ops: Ops, values: OpticsValues, wavelength_nm: Array, kx: Array, ky: Array) -> tuple[Any, ...]:
        """Return what the trace of the faces takes."""
        squared_um = wavelength_nm * wavelength_nm * 1e-6
        excess = [self._excess(ops, medium, squared_um, shift) for medium, shift in zip(self.media, values.index_shift)]
        tilts = [(ops.sin(t), ops.cos(t)) for t in values.face_tilt_rad]
        kz = values.collimator_mm
        return kx, kz, kx * kx + ky * ky + kz * kz, tilts, (*excess, 0.0)

    def position_px(
        self, values: OpticsValues, wavelength_nm: np.ndarray, X_mm: np.ndarray | float = 0.0, Y_mm: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid), broadcast, by NumPy in float64 (or complex128, for complex steps)."""
        x, y, valid = self.trace(NUMPY, values, np.asarray(wavelength_nm), np.asarray(X_mm), np.asarray(Y_mm))
        x, y, valid = np.broadcast_arrays(x, y, valid)
        return x, y, valid

    @staticmethod
    def _excess(ops: Ops, medium: Glass, squared_um: Array, shift: Array) -> Array:
        """Return n^2 - 1 of a medium whose index is raised by ``shift``."""
        plain = squared_um * 0.0 if medium == AIR else medium.rational.excess(squared_um)
        return plain + shift * (2 * ops.sqrt(1 + plain) + shift)
