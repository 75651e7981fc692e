"""What the discrete H knows about the camera: nothing, its shifts, another mapping, or everything (theory.md (C.14), (C.15))."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from optsim.camera.dmd import mirror_states
from optsim.camera.field_paths import Field, Ray
from optsim.camera.field_spread import field_taps
from optsim.camera.fixed_pattern import fixed_pattern
from optsim.camera.prism import Dispersion
from optsim.camera.spread import Landing, Passed, spread_taps
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig


@dataclass(frozen=True, eq=False)
class Scope:
    """Hold what a discrete model is asked for.

    Args:
        camera: the true one.
        lower_nm, upper_nm: (K,) bands inside the band-pass filter.
        size: (M, N) mirrors.
        passed: what the sensor collects behind filter and prism.
    """

    camera: CameraConfig
    lower_nm: np.ndarray
    upper_nm: np.ndarray
    size: tuple[int, int]
    passed: Passed


@dataclass(frozen=True)
class OwnShifts:
    """Let H know where the prism lays each band of the middle mirror: its position and how it spreads over columns."""

    name = "camera"

    def land(self, scope: Scope) -> Landing:
        """Return columns and taps of the field's middle for all mirrors."""
        camera = scope.camera
        return _columns(camera.dispersion, camera.mirror_px, scope)

    def mirrors(self, scope: Scope, masks: np.ndarray) -> np.ndarray:
        """Return the masks: H believes in perfect mirrors."""
        return masks

    def pixels(self, scope: Scope, width: int) -> tuple[np.ndarray | None, float]:
        """Return (gain, crosstalk) of perfect pixels."""
        return None, 0.0


@dataclass(frozen=True)
class UnitShift(OwnShifts):
    """Let H believe that band k lands exactly k columns on, as in the paper's discrete model."""

    name = "unit-shift"

    def land(self, scope: Scope) -> Landing:
        """Return first columns 0..K-1 and one tap of 1."""
        count = scope.lower_nm.size
        return Landing(np.arange(count), np.ones((count, 1)))


@dataclass(frozen=True)
class Assumed(OwnShifts):
    """Let H believe in another mapping of wavelengths, or in another registration of the mirrors, than the camera has.

    Mirrors lie one pixel apart, as in ``OwnShifts``, times ``scale``; they are turned about the field's middle in their own plane,
    while the dispersion stays along rows.

    Args:
        dispersion: where wavelengths land, e.g. a linear or a calibrated curve; None: the camera's own.
        offset_x_px, offset_y_px: of the mirrors' image, in [-1e3, 1e3] px.
        rotation_deg: in [-10, 10] deg.
        scale: in [0.5, 2].
    """

    name = "assumed"
    dispersion: Dispersion | None = None
    offset_x_px: float = 0.0
    offset_y_px: float = 0.0
    rotation_deg: float = 0.0
    scale: float = 1.0

    def __post_init__(self) -> None:
        for field, low, high, unit in (
            ("offset_x_px", -1e3, 1e3, " px"),
            ("offset_y_px", -1e3, 1e3, " px"),
            ("rotation_deg", -10, 10, " deg"),
            ("scale", 0.5, 2, ""),
        ):
            value = getattr(self, field)
            if not low <= value <= high:
                raise InputError(field, value, f"in [{low:g}, {high:g}]{unit}")

    def land(self, scope: Scope) -> Landing:
        """Return the taps of the mapping and registration that H believes in."""
        dispersion = scope.camera.dispersion if self.dispersion is None else self.dispersion
        if self.offset_y_px == 0 and self.rotation_deg == 0 and self.scale == 1:
            return _columns(dispersion, scope.camera.mirror_px, scope, self.offset_x_px)
        turn, scale = math.radians(self.rotation_deg), self.scale
        cos, sin = scale * math.cos(turn), scale * math.sin(turn)

        def place(wavelength_nm: np.ndarray, X: np.ndarray, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            x, _, valid = dispersion.position_px(wavelength_nm)
            found = np.broadcast_arrays(x + cos * X - sin * Y + self.offset_x_px, sin * X + cos * Y + self.offset_y_px, valid)
            return found[0], found[1], found[2]

        return field_taps(Field(place, scope.size, 1.0), scope.lower_nm, scope.upper_nm, 1e-6, scope.passed)


@dataclass(frozen=True)
class Exact:
    """Let H know every fact of the camera: paths over the field, blur, leak and defects of mirrors, patterns of pixels.

    Args:
        error: share of a band's light that H may lay on a wrong pixel, in [1e-5, 0.2]: variations over the field up to so many
            px, and tails of the blur that hold so much of the light, are left out. A smaller error takes more taps.
    """

    name = "exact"
    error: float = 0.02

    def __post_init__(self) -> None:
        if not 1e-5 <= self.error <= 0.2:
            raise InputError("error", self.error, "in [1e-5, 0.2]")

    def land(self, scope: Scope) -> Landing:
        """Return the taps of the camera's optics over the field."""
        camera, optics = scope.camera, scope.camera.optics
        pupil = optics.pupil()
        rays = (Ray(None, 1.0),) if pupil is None else tuple(Ray(p, float(w)) for p, w in zip(pupil.points, pupil.weights))
        field = Field(optics.position_px, scope.size, camera.dmd.pitch_um / 1000, rays)
        otf = optics.otf if optics.has_blur else None
        return field_taps(field, scope.lower_nm, scope.upper_nm, self.error, scope.passed, otf)

    def mirrors(self, scope: Scope, masks: np.ndarray) -> np.ndarray:
        """Return what each mirror sends out, with leak and defects."""
        return mirror_states(masks, scope.camera.dmd)

    def pixels(self, scope: Scope, width: int) -> tuple[np.ndarray | None, float]:
        """Return the pixels' own gains (M, W), or None when all are 1, and their crosstalk."""
        sensor = scope.camera.sensor
        gain, _ = fixed_pattern((1, scope.size[0], width), sensor)
        return None if (gain == 1).all() else gain, sensor.crosstalk


Knowledge = OwnShifts | Exact
"""Any of the four."""

Shifts = Knowledge


def _columns(dispersion: Dispersion, mirror_px: float, scope: Scope, offset_px: float = 0.0) -> Landing:
    """Return columns and taps on the axis, each band's taps adding to 1 (or 0): the response counts what is lost."""
    first, taps = spread_taps(dispersion, mirror_px, scope.lower_nm, scope.upper_nm, scope.passed, offset_px)
    total = taps.sum(1, keepdims=True)
    return Landing(first, np.where(total > 0, taps / np.where(total > 0, total, 1.0), 0.0))
