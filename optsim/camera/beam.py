"""Rays between the mirrors and the prism (theory.md (C.27), (C.28))."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.mount import MirrorMount
from optsim.camera.stack import field_points
from optsim.errors import InputError


class Beam(NamedTuple):
    """Hold rays behind the first lens, where the prism stands; shapes broadcast together.

    Args:
        wavelength_nm: of each ray.
        x, y: where it crosses the lens, in mm.
        slope_x, slope_y: dx/dz and dy/dz behind it.
    """

    wavelength_nm: np.ndarray
    x: np.ndarray
    y: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray


def cast(
    mirrors: MirrorMount,
    radius_mm: float,
    power_per_mm: float,
    point: tuple[ArrayLike, ArrayLike, ArrayLike],
    pupil: ArrayLike | None = None,
) -> Beam:
    """Return the rays from points of the mirrors through points of the stop, behind a thin lens (theory.md (C.28)).

    Args:
        mirrors: how the mirrors stand.
        radius_mm: of the stop.
        power_per_mm: of the lens.
        point: (wavelength in nm, X, Y in mm in the mirrors' plane), broadcast.
        pupil: (..., 2) points of the unit disc, broadcast with the others; None: the middle.

    Raises:
        InputError: field ``X_mm``, ``pupil`` or ``dmd.tilt_deg``.
    """
    x, y, distance = mirrors.place(field_points(point[1], "X_mm"), field_points(point[2], "Y_mm"))
    u, v = (np.zeros(()), np.zeros(())) if pupil is None else _disc(pupil)
    across, up, bend = radius_mm * u, radius_mm * v, 1 / distance - power_per_mm
    return Beam(np.asarray(point[0], np.float64), across, up, x / distance + across * bend, y / distance + up * bend)


def _disc(pupil: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    points = np.asarray(pupil, np.float64)
    if points.shape[-1:] != (2,) or not np.all((points * points).sum(-1) <= 1 + 1e-12):
        raise InputError("pupil", points.shape, "(..., 2) points (u, v) of the unit disc")
    return points[..., 0], points[..., 1]
