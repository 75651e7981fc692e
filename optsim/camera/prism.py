"""The double Amici prism: three cemented wedges that disperse light and leave the design wavelength undeviated."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.arrays import NUMPY, Array, Kernels, Ops
from optsim.camera.glass import Glass, glass
from optsim.camera.model import Model, ranged
from optsim.camera.relay import Relay
from optsim.camera.trace import Traced, image_point, trace_faces
from optsim.errors import InputError

DESIGN_NM = 550.0
DEFAULT_APEX_INNER_DEG = 13.1019
DEFAULT_DESIGN_POSITION_PX = 14.5451
DEFAULT_PIXEL_UM = 9.9
FIRST_BAND_NM = 455.0
"""Position 0 is the centre of the pixel of this band (Rueda, Lau, Arce 2015, section 4)."""


@runtime_checkable
class Dispersion(Protocol):
    """Say where the light of a mirror lands on the sensor."""

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors."""

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid), broadcast: the position in sensor pixels of the light of field point (X, Y)."""


class PrismValues(NamedTuple):
    """Hold the numbers of a prism between two lenses; any of them may be an array that carries gradients."""

    apex_outer_rad: Array
    apex_inner_rad: Array
    collimator_mm: Array
    focal_mm: Array


class DoubleAmici(Model):
    """A symmetric double Amici prism in the collimated light of a relay (theory.md (C.3) to (C.6)).

    Face normals are tilted by (A1 - A2/2, -A2/2, A2/2, A2/2 - A1) against the optical axis. Red lands at larger x.

    Args:
        outer, inner: glasses of the two outer wedges and of the middle one.
        apex_outer_rad, apex_inner_rad: A1 and A2, in (-pi/2, pi/2) rad.
        relay: the lenses.
        pixel_um: the sensor's pitch, in (0, 1e4] um.
        design_nm: the wavelength whose position is ``design_position_px``.
        design_position_px: see there; None places 455 nm at position 0.
    """

    place: ClassVar[str] = "prism"
    outer: Glass
    inner: Glass
    apex_outer_rad: Annotated[float, ranged(-math.pi / 2, math.pi / 2, "rad", "()")]
    apex_inner_rad: Annotated[float, ranged(-math.pi / 2, math.pi / 2, "rad", "()")]
    relay: Relay = Relay()
    pixel_um: Annotated[float, ranged(0, 1e4, "um", "(]")] = DEFAULT_PIXEL_UM
    design_nm: Annotated[float, ranged(100, 1e4, "nm")] = DESIGN_NM
    design_position_px: Annotated[float, ranged(-1e6, 1e6, "px")] | None = None

    @classmethod
    def default(cls) -> DoubleAmici:
        """Return N-FK5/F5 with f2 = 100 mm: the design that fits the paper's 24 centres (theory.md, table C.1)."""
        outer, inner = glass("N-FK5"), glass("F5")
        a2 = math.radians(DEFAULT_APEX_INNER_DEG)
        a1 = direct_view_apex(outer, inner, a2, DESIGN_NM)
        return cls(outer=outer, inner=inner, apex_outer_rad=a1, apex_inner_rad=a2, design_position_px=DEFAULT_DESIGN_POSITION_PX)

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors."""
        return self.relay.magnification * 1000 / self.pixel_um

    @property
    def values(self) -> PrismValues:
        """Return the parameters as plain numbers."""
        return PrismValues(self.apex_outer_rad, self.apex_inner_rad, self.relay.collimator_mm, self.relay.focal_mm)

    def opaque_values(self, kernels: Kernels, kind: Array) -> PrismValues:
        """Return the parameters as Dr.Jit inputs of one type: new values reuse the compiled kernel, gradients may be enabled."""
        return PrismValues(*(kernels.opaque(kind, value) for value in self.values))

    @property
    def origin_px(self) -> float:
        """Return the position of a ray that leaves along the optical axis."""
        if self.design_position_px is not None:
            return self.design_position_px - self._raw_px(self.design_nm)
        return -self._raw_px(FIRST_BAND_NM)

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return where light of a field point lands, in sensor pixels, by the exact trace in float64.

        Args:
            wavelength_nm: in both glasses' ranges, any shape; broadcast with X and Y.
            X_mm, Y_mm: the point at the mirrors, counted along its image, in mm.

        Returns:
            (x, y, valid): x = 0 is the 455 nm pixel of X = 0, red positive; (0, 0, False) where no light leaves.

        Raises:
            InputError: field ``wavelength_nm`` or ``X_mm``.
        """
        X, Y = _field(X_mm, "X_mm"), _field(Y_mm, "Y_mm")
        x_mm, y_mm, valid = self.trace(NUMPY, self._checked(wavelength_nm), X, Y, self.values)
        x, y, valid = np.broadcast_arrays(x_mm, y_mm, valid)
        scale = 1000 / self.pixel_um
        return np.where(valid, x * scale + self.origin_px, 0.0), y * scale, valid

    def trace(self, ops: Ops, wavelength_nm: Array, X_mm: Array, Y_mm: Array, values: PrismValues) -> tuple[Array, Array, Array]:
        """Return (x, y, valid) at the sensor in mm from the optical axis, on NumPy or Dr.Jit arrays; wavelengths are not checked."""
        traced = self.directions(ops, wavelength_nm, X_mm, Y_mm, values)
        x, y = image_point(ops, traced, Y_mm, values.focal_mm)
        return x, y, traced.valid

    def directions(self, ops: Ops, wavelength_nm: Array, X_mm: Array, Y_mm: Array, values: PrismValues) -> Traced:
        """Return the wave vectors behind the prism; k_y stays Y (theory.md (C.4))."""
        squared_um = wavelength_nm * wavelength_nm * 1e-6
        outer, inner = self.outer.rational.excess(squared_um), self.inner.rational.excess(squared_um)
        first, half = values.apex_outer_rad, values.apex_inner_rad / 2
        tilts = [(ops.sin(t), ops.cos(t)) for t in (first - half, -half, half, half - first)]
        norm2 = X_mm * X_mm + Y_mm * Y_mm + values.collimator_mm * values.collimator_mm
        return trace_faces(ops, X_mm, values.collimator_mm, norm2, tilts, (outer, inner, outer, 0.0))

    def why_lost(self, wavelength_nm: float, X_mm: float = 0.0, Y_mm: float = 0.0) -> str | None:
        """Say in a sentence why a ray does not reach the sensor; None when it does."""
        traced = self.directions(NUMPY, self._checked(wavelength_nm), _field(X_mm, "X_mm"), _field(Y_mm, "Y_mm"), self.values)
        if traced.valid:
            return None
        if not traced.met:
            return "the ray runs along a face of the prism or meets it from behind"
        return "total reflection at a face of the prism"

    def _checked(self, wavelength_nm: ArrayLike) -> np.ndarray:
        return self.inner.check(self.outer.check(wavelength_nm))

    def _raw_px(self, wavelength_nm: float) -> float:
        x, _, valid = self.trace(NUMPY, self._checked(wavelength_nm), 0.0, 0.0, self.values)
        if not valid:
            raise InputError(
                "prism.apex", (self.apex_outer_rad, self.apex_inner_rad), f"angles in rad at which {wavelength_nm:g} nm passes the prism"
            )
        return float(x) * 1000 / self.pixel_um


def direct_view_apex(outer: Glass, inner: Glass, apex_inner_rad: float, design_nm: float) -> float:
    """Return A1 for which the design wavelength leaves along the axis, in closed form (theory.md (C.6)).

    In the middle wedge the ray then runs along the axis; h = A2/2 gives the ray's angle in the outer wedge, and the
    entrance face must turn a ray along the axis by it.

    Raises:
        InputError: field ``prism.apex_inner_rad`` when the middle wedge is too steep for any A1.
    """
    n1, n2 = float(outer.index(design_nm)), float(inner.index(design_nm))
    half = apex_inner_rad / 2
    sine = n2 / n1 * math.sin(half)
    if not abs(sine) < 1 or not abs(half) < math.pi / 2:
        raise InputError("prism.apex_inner_rad", apex_inner_rad, f"within +-{2 * math.asin(min(1, n1 / n2)):.6g} rad for these glasses")
    turn = math.asin(sine) - half
    if turn == 0:
        return half
    tilt = math.atan2(math.sin(turn), math.cos(turn) - 1 / n1)
    return tilt + half


def _field(value: ArrayLike, name: str) -> np.ndarray:
    array = np.asarray(value, np.float64)
    if not np.all(np.isfinite(array)) or np.any(np.abs(array) > 1e6):
        raise InputError(name, value, "finite, within +-1e6 mm")
    return array
