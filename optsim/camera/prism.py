"""The double Amici prism: three cemented wedges that disperse light and leave the design wavelength undeviated."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.arrays import Array
from optsim.camera.glass import Glass, glass
from optsim.camera.model import ranged
from optsim.camera.stack import DESIGN_NM, Prism, StackValues
from optsim.errors import InputError

DEFAULT_APEX_INNER_DEG = 13.1019
DEFAULT_DESIGN_POSITION_PX = 14.5451


@runtime_checkable
class Dispersion(Protocol):
    """Say where the light of a mirror lands on the sensor, and how much of it."""

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors."""

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid), broadcast: the position in sensor pixels of the light of field point (X, Y)."""

    def transmission(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> np.ndarray:
        """Return the share of light that is passed, in [0, 1], broadcast: 1 where not modelled, 0 where lost."""

    def wavelength_at(self, position_px: ArrayLike) -> np.ndarray:
        """Return the wavelengths in nm that land at positions of the axis (X = Y = 0)."""


class PrismValues(NamedTuple):
    """Hold the numbers of a double Amici prism between two lenses; any of them may be an array that carries gradients."""

    apex_outer_rad: Array
    apex_inner_rad: Array
    collimator_mm: Array
    focal_mm: Array


class DoubleAmici(Prism):
    """A symmetric double Amici prism in the collimated light of a relay (theory.md (C.3) to (C.6)).

    Face normals are tilted by (A1 - A2/2, -A2/2, A2/2, A2/2 - A1) against the optical axis. Red lands at larger x.

    Args:
        outer, inner: glasses of the two outer wedges and of the middle one.
        apex_outer_rad, apex_inner_rad: A1 and A2, in (-pi/2, pi/2) rad.
    """

    outer: Glass
    inner: Glass
    apex_outer_rad: Annotated[float, ranged(-math.pi / 2, math.pi / 2, "rad", "()")]
    apex_inner_rad: Annotated[float, ranged(-math.pi / 2, math.pi / 2, "rad", "()")]

    @classmethod
    def default(cls) -> DoubleAmici:
        """Return N-FK5/F5 with f2 = 100 mm: the design that fits the paper's 24 centres (theory.md, table C.1)."""
        outer, inner = glass("N-FK5"), glass("F5")
        a2 = math.radians(DEFAULT_APEX_INNER_DEG)
        a1 = direct_view_apex(outer, inner, a2, DESIGN_NM)
        return cls(outer=outer, inner=inner, apex_outer_rad=a1, apex_inner_rad=a2, design_position_px=DEFAULT_DESIGN_POSITION_PX)

    @property
    def media(self) -> tuple[Glass, ...]:
        """Return outer, inner, outer."""
        return self.outer, self.inner, self.outer

    @property
    def values(self) -> PrismValues:
        """Return the parameters as plain numbers."""
        return PrismValues(self.apex_outer_rad, self.apex_inner_rad, self.relay.collimator_mm, self.relay.focal_mm)

    def unfold(self, values: PrismValues) -> StackValues:
        """Return the tilts of the four faces."""
        first, half = values.apex_outer_rad, values.apex_inner_rad / 2
        return StackValues((first - half, -half, half, half - first), (0.0, 0.0, 0.0), values.collimator_mm, values.focal_mm)


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
