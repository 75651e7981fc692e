"""How the mirrors and the sensor stand: registration, tilt about a diagonal, Scheimpflug (theory.md (C.27) to (C.29))."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from optsim.camera.relay import Relay
from optsim.errors import InputError

_HALF = math.sqrt(0.5)


@dataclass(frozen=True)
class MirrorMount:
    """Place the mirrors before the relay.

    The tilt's axis is the diagonal from the first mirror (row 0, column 0) to the last. A positive tilt brings the
    corner of the last column and first row nearer to the relay.

    Args:
        collimator_mm: the relay's distance from their middle.
        tilt_deg, rotation_deg, scale: see ``DmdConfig``.
    """

    collimator_mm: float
    tilt_deg: float = 0.0
    rotation_deg: float = 0.0
    scale: float = 1.0

    @property
    def in_place(self) -> bool:
        """Tell whether the mirrors stand as they should, untilted, unturned and to scale."""
        return self.tilt_deg == 0 and self.rotation_deg == 0 and self.scale == 1

    def place(self, X_mm: np.ndarray, Y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, o) in mm: where a point of the mirrors is across the axis, and its distance from the lens (C.27).

        Raises:
            InputError: field ``dmd.tilt_deg`` when the mirrors would reach the lens.
        """
        turn, scale, tilt = math.radians(self.rotation_deg), self.scale, math.radians(self.tilt_deg)
        x = scale * (math.cos(turn) * X_mm - math.sin(turn) * Y_mm)
        y = scale * (math.sin(turn) * X_mm + math.cos(turn) * Y_mm)
        if tilt == 0:
            return x, y, np.full(np.broadcast(x, y).shape, self.collimator_mm)
        along, across = (x + y) * _HALF, (x - y) * _HALF
        distance = self.collimator_mm - across * math.sin(tilt)
        if np.any(distance < self.collimator_mm / 10):
            raise InputError(
                "dmd.tilt_deg", self.tilt_deg, f"an angle that keeps the field within 0.9 x {self.collimator_mm:g} mm of depth"
            )
        across = across * math.cos(tilt)
        return (along + across) * _HALF, (along - across) * _HALF, distance


@dataclass(frozen=True)
class SensorMount:
    """Place the sensor behind the relay.

    Args:
        distance_mm: from the lens to the sensor where ``pivot_mm`` is.
        slope: tangent of its tilt, about the same diagonal as the mirrors'.
        pivot_mm: position along x at which the tilt leaves the distance alone.
    """

    distance_mm: float
    slope: float
    pivot_mm: float = 0.0

    def hit(
        self, x: np.ndarray, y: np.ndarray, slope_x: np.ndarray, slope_y: np.ndarray, start_mm: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, meets): where rays meet the sensor, in mm along its own axes, and whether they do (theory.md (C.29)).

        Args:
            x, y: a point of the ray, across the axis.
            slope_x, slope_y: dx/dz and dy/dz.
            start_mm: the point's distance behind the lens.
        """
        length = self.distance_mm - start_mm
        if self.slope == 0:
            x, y = np.broadcast_arrays(x + length * slope_x, y + length * slope_y)
            return x, y, np.ones(x.shape, bool)
        across, rise = (x - y) * _HALF, (slope_x - slope_y) * _HALF
        towards = 1 - self.slope * rise
        meets = towards > 1e-6
        length = (length + self.slope * (across - self.pivot_mm * _HALF)) / np.where(meets, towards, 1.0)
        x, y = x + length * slope_x, y + length * slope_y
        along, across = (x + y) * _HALF, (x - y) * _HALF * math.hypot(1, self.slope)
        return (along + across) * _HALF, (along - across) * _HALF, meets


def sharp_slope(relay: Relay, tilt_deg: float) -> float:
    """Return the tangent of the sensor's tilt at which tilted mirrors are sharp: m tan(theta); 0 without Scheimpflug (theory.md (C.28))."""
    return relay.magnification * math.tan(math.radians(tilt_deg)) if relay.scheimpflug else 0.0
