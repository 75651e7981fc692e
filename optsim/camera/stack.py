"""A prism of any number of wedges, cemented or with air between, in the collimated light of a relay (theory.md (C.3) to (C.6), (C.19))."""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from optsim.camera.arrays import NUMPY, Array, Kernels, Ops
from optsim.camera.glass import AIR, Glass
from optsim.camera.inverse import wavelength_at
from optsim.camera.model import Model, ranged
from optsim.camera.relay import Relay
from optsim.camera.trace import Traced, image_point, trace_steps, transmit_steps
from optsim.errors import InputError

DESIGN_NM = 550.0
DEFAULT_PIXEL_UM = 9.9
FIRST_BAND_NM = 455.0
"""Position 0 is the centre of the pixel of this band (Rueda, Lau, Arce 2015, section 4)."""


class StackValues(NamedTuple):
    """Hold the numbers of a stack between two lenses; any of them may be an array that carries gradients.

    Args:
        tilt_rad: of each face's normal against the optical axis.
        squared_shift: added to n^2 of each medium: 2 n times a small change of its index.
        collimator_mm, focal_mm: f1 and f2.
    """

    tilt_rad: tuple[Array, ...]
    squared_shift: tuple[Array, ...]
    collimator_mm: Array
    focal_mm: Array


class Chief(NamedTuple):
    """Hold where axial light leaves: (n,) position in mm from the optical axis, 0 where lost, and (n,) transmitted."""

    position_mm: np.ndarray
    transmitted: np.ndarray


class Prism(Model, ABC):
    """Trace light through plane faces between the relay's lenses; red counts towards larger x.

    Args:
        relay: the lenses.
        pixel_um: the sensor's pitch, in (0, 1e4] um.
        design_nm: the wavelength whose position is ``design_position_px``.
        design_position_px: see there; None places 455 nm at position 0.
        fresnel: whether faces reflect part of the light (:meth:`transmission`).
        field: False keeps the axial curve for the whole field: no smile, no keystone.
    """

    place: ClassVar[str] = "prism"
    relay: Relay = Relay()
    pixel_um: Annotated[float, ranged(0, 1e4, "um", "(]")] = DEFAULT_PIXEL_UM
    design_nm: Annotated[float, ranged(100, 1e4, "nm")] = DESIGN_NM
    design_position_px: Annotated[float, ranged(-1e6, 1e6, "px")] | None = None
    fresnel: bool = True
    field: bool = True

    @property
    @abstractmethod
    def media(self) -> tuple[Glass, ...]:
        """Return what fills the spaces between faces, one fewer than faces."""

    @property
    @abstractmethod
    def values(self) -> Any:
        """Return the parameters as plain numbers, in a NamedTuple whose fields may be tuples."""

    @abstractmethod
    def unfold(self, values: Any) -> StackValues:
        """Return parameters of this prism's own kind (numbers or arrays) as those of the faces."""

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors."""
        return self.relay.magnification * 1000 / self.pixel_um

    @property
    def range_nm(self) -> tuple[float, float]:
        """Return the wavelengths that lie in all glasses' ranges."""
        low, high = zip(*(medium.range_nm for medium in self.media))
        return max(low), min(high)

    @property
    def stack(self) -> PrismStack:
        """Return the same prism by its faces."""
        faces = self.unfold(self.values).tilt_rad
        names = ("relay", "pixel_um", "design_nm", "design_position_px", "fresnel", "field")
        return PrismStack(glasses=self.media, face_tilt_rad=faces, **{name: getattr(self, name) for name in names})

    def opaque_values(self, kernels: Kernels, kind: Array) -> Any:
        """Return the parameters as Dr.Jit inputs of one type: new values reuse the compiled kernel, gradients may be enabled."""
        return _each(self.values, lambda value: kernels.opaque(kind, value))

    @functools.cached_property
    def origin_px(self) -> float:
        """Return the position of a ray that leaves along the optical axis.

        Raises:
            InputError: field ``prism`` when the wavelength that fixes the position does not pass.
        """
        anchor = FIRST_BAND_NM if self.design_position_px is None else self.design_nm
        position_mm, transmitted = self.chief(anchor)
        if not transmitted:
            raise InputError("prism", f"one that loses {anchor:g} nm", "a prism that passes the wavelength that fixes the position")
        return (self.design_position_px or 0.0) - float(position_mm) * 1000 / self.pixel_um

    def chief(self, wavelength_nm: ArrayLike) -> Chief:
        """Return where light along the axis lands, f2 kx / kz, unrounded, in mm from the optical axis.

        Raises:
            InputError: field ``wavelength_nm`` outside a glass's range.
        """
        x, _, valid = self.trace(NUMPY, self._checked(wavelength_nm), 0.0, 0.0, self.values)
        x, valid, _ = np.broadcast_arrays(x, valid, wavelength_nm)
        return Chief(x, valid)

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return where light of a field point lands, in sensor pixels, by the exact trace in float64.

        Args:
            wavelength_nm: in the glasses' ranges, any shape; broadcast with X and Y.
            X_mm, Y_mm: the point at the mirrors, counted along its image, in mm.

        Returns:
            (x, y, valid): x = 0 is the 455 nm pixel of X = 0, red positive; (0, 0, False) where no light leaves.

        Raises:
            InputError: field ``wavelength_nm`` or ``X_mm``.
        """
        X, Y = field_points(X_mm, "X_mm"), field_points(Y_mm, "Y_mm")
        scale = 1000 / self.pixel_um
        if self.field:
            x_mm, y_mm, valid = self.trace(NUMPY, self._checked(wavelength_nm), X, Y, self.values)
            x_mm, _ = np.broadcast_arrays(x_mm, wavelength_nm)  # air alone knows no wavelength
        else:
            x_mm, valid = self.chief(wavelength_nm)
            x_mm, y_mm = x_mm + self.relay.magnification * X, self.relay.magnification * Y
        x, y, valid = np.broadcast_arrays(x_mm, y_mm, valid)
        return np.where(valid, x * scale + self.origin_px, 0.0), np.where(valid, y * scale, 0.0), valid

    def transmission(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> np.ndarray:
        """Return the share of unpolarised light that the faces pass, in [0, 1], broadcast; 0 where lost, 1 without ``fresnel``.

        Raises:
            InputError: as :meth:`position_px`.
        """
        wavelength, X, Y = self._checked(wavelength_nm), field_points(X_mm, "X_mm"), field_points(Y_mm, "Y_mm")
        shape = np.broadcast_shapes(wavelength.shape, X.shape, Y.shape)
        if not self.field:
            X = Y = np.zeros(())
        if self.fresnel:
            share = np.asarray(self.transmittance(NUMPY, wavelength, X, Y, self.values))
        else:
            share = np.asarray(self.directions(NUMPY, wavelength, X, Y, self.values).valid, np.float64)
        return share if share.shape == shape else np.broadcast_to(share, shape).copy()

    def wavelength_at(self, position_px: ArrayLike) -> np.ndarray:
        """Return the wavelengths in nm that land at positions of the axis; see :func:`optsim.camera.inverse.wavelength_at`."""
        return wavelength_at(self, position_px, self.range_nm)

    def trace(self, ops: Ops, wavelength_nm: Array, X_mm: Array, Y_mm: Array, values: Any) -> tuple[Array, Array, Array]:
        """Return (x, y, valid) at the sensor in mm from the optical axis, on NumPy or Dr.Jit arrays; wavelengths are not checked."""
        faces = self.unfold(values)
        traced = self._directions(ops, wavelength_nm, X_mm, Y_mm, faces)
        x, y = image_point(ops, traced, Y_mm, faces.focal_mm)
        return x, y, traced.valid

    def transmittance(self, ops: Ops, wavelength_nm: Array, X_mm: Array, Y_mm: Array, values: Any) -> Array:
        """Return Fresnel's transmission, 0 where lost, on NumPy or Dr.Jit arrays; wavelengths are not checked (theory.md (C.19))."""
        faces = self.unfold(values)
        norm2, tilts, steps = self._steps(ops, wavelength_nm, X_mm, Y_mm, faces)
        return transmit_steps(ops, X_mm, faces.collimator_mm, norm2, tilts, steps)

    def directions(self, ops: Ops, wavelength_nm: Array, X_mm: Array, Y_mm: Array, values: Any) -> Traced:
        """Return the wave vectors behind the prism; k_y stays Y (theory.md (C.4))."""
        return self._directions(ops, wavelength_nm, X_mm, Y_mm, self.unfold(values))

    def why_lost(self, wavelength_nm: float, X_mm: float = 0.0, Y_mm: float = 0.0) -> str | None:
        """Say in a sentence why a ray does not reach the sensor; None when it does."""
        X, Y = field_points(X_mm, "X_mm"), field_points(Y_mm, "Y_mm")
        traced = self.directions(NUMPY, self._checked(wavelength_nm), X, Y, self.values)
        if traced.valid:
            return None
        if not traced.met:
            return "the ray runs along a face of the prism or meets it from behind"
        return "total reflection at a face of the prism"

    def _directions(self, ops: Ops, wavelength_nm: Array, X_mm: Array, Y_mm: Array, faces: StackValues) -> Traced:
        _, tilts, steps = self._steps(ops, wavelength_nm, X_mm, Y_mm, faces)
        return trace_steps(ops, X_mm, faces.collimator_mm, tilts, steps)

    def _steps(
        self, ops: Ops, wavelength_nm: Array, X_mm: Array, Y_mm: Array, faces: StackValues
    ) -> tuple[Array, list[tuple[Array, Array]], list[Array]]:
        """Return k_0^2 of the wave vector (X, Y, f1), each face's (sin, cos), and (n^2 - 1) k_0^2 behind each; one division a glass."""
        squared_nm = wavelength_nm * wavelength_nm
        norm2 = ops.fma(X_mm, X_mm, ops.fma(Y_mm, Y_mm, faces.collimator_mm * faces.collimator_mm))
        factor = squared_nm * norm2
        known: dict[Glass, Array] = {AIR: 0.0}
        steps = []
        for medium, shift in zip(self.media, faces.squared_shift, strict=True):
            if medium not in known:
                numerator, denominator = medium.rational_nm.parts(squared_nm, ops)
                known[medium] = factor * numerator / denominator
            unshifted = isinstance(shift, float) and shift == 0
            steps.append(known[medium] if unshifted else ops.fma(shift, norm2, known[medium]))
        return norm2, [ops.sincos(t) for t in faces.tilt_rad], [*steps, 0.0]

    def _checked(self, wavelength_nm: ArrayLike) -> np.ndarray:
        values = np.asarray(wavelength_nm, np.float64)
        for medium in self.media:
            values = medium.check(values)
        return values


class PrismStack(Prism):
    """A prism by its faces.

    Args:
        glasses: what fills the spaces between faces, in the order of the light; ``AIR`` for gaps; at least one.
        face_tilt_rad: of each face's normal, one more than glasses, in (-pi/2, pi/2) rad: the normal is (sin t, 0, cos t),
            x along the dispersion, z along the light.
    """

    glasses: tuple[Glass, ...]
    face_tilt_rad: tuple[Annotated[float, ranged(-math.pi / 2, math.pi / 2, "rad", "()")], ...]

    @model_validator(mode="after")
    def _counts(self) -> PrismStack:
        if not self.glasses or len(self.face_tilt_rad) != len(self.glasses) + 1:
            raise InputError("face_tilt_rad", self.face_tilt_rad, f"one more than glasses: {len(self.glasses) + 1} angles, at least 2")
        return self

    @property
    def media(self) -> tuple[Glass, ...]:
        """Return the glasses."""
        return self.glasses

    @property
    def values(self) -> StackValues:
        """Return the parameters as plain numbers."""
        return StackValues(self.face_tilt_rad, (0.0,) * len(self.glasses), self.relay.collimator_mm, self.relay.focal_mm)

    def unfold(self, values: StackValues) -> StackValues:
        """Return the values as they are."""
        return values


def field_points(value: ArrayLike, name: str) -> np.ndarray:
    """Return field coordinates as float64.

    Raises:
        InputError: field ``name`` when not finite or beyond 1e6 mm.
    """
    array = np.asarray(value, np.float64)
    if not np.all(np.isfinite(array)) or np.any(np.abs(array) > 1e6):
        raise InputError(name, value, "finite, within +-1e6 mm")
    return array


def _each(values: Any, change: Callable[[float], Array]) -> Any:
    """Apply a function to every number of a NamedTuple whose fields may be tuples of numbers."""
    return type(values)(*(tuple(change(v) for v in field) if isinstance(field, tuple) else change(field) for field in values))
