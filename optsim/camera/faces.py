"""The faces of a traced prism as a converging beam meets them: tilted planes one behind the other (theory.md (C.30))."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from optsim.camera.stack import Prism

EDGE_MM = 1.0
"""Thickness of a wedge at its thin edge."""


@dataclass(frozen=True)
class Faces:
    """Hold plane faces with normals (sin t, 0, cos t), the first through z = 0 on the axis.

    Args:
        prism: whose faces these are.
        aperture_mm: full width of every face; wedges are as thin as it allows.
    """

    prism: Prism
    aperture_mm: float

    @property
    def tilts_rad(self) -> tuple[float, ...]:
        """Return t of each face."""
        return tuple(map(float, self.prism.unfold(self.prism.values).tilt_rad))

    def excesses(self, wavelength_nm: np.ndarray) -> tuple[np.ndarray | float, ...]:
        """Return n^2 - 1 behind each face."""
        return (*(medium.index(wavelength_nm) ** 2 - 1 for medium in self.prism.media), 0.0)

    @property
    def depth_mm(self) -> tuple[float, ...]:
        """Return where each face crosses the axis, in mm behind the first."""
        slopes = [math.tan(t) for t in self.tilts_rad]
        depth = [0.0]
        for before, after in itertools.pairwise(slopes):
            depth.append(depth[-1] + EDGE_MM + abs(after - before) * self.aperture_mm / 2)
        return tuple(depth)

    def trace(
        self, wavelength_nm: np.ndarray, position: tuple[np.ndarray, np.ndarray, np.ndarray], slope: tuple[np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Follow rays through all faces, place and direction (theory.md (C.3), (C.30)).

        Args:
            wavelength_nm: inside the glasses' ranges.
            position: (x, y, z) of a point of each ray in mm, z from the first face.
            slope: (dx/dz, dy/dz) in air before the first face.

        Returns:
            (x, y, z, dx/dz, dy/dz, valid) on the last face and behind it; finite where a ray is lost.
        """
        x, y, z = position
        kx, ky, kz = slope[0], slope[1], np.ones_like(slope[0])
        norm2 = kx * kx + ky * ky + 1
        valid = np.ones(np.broadcast(x, kx).shape, bool)
        before: np.ndarray | float = 0.0
        for tilt, depth, after in zip(self.tilts_rad, self.depth_mm, self.excesses(wavelength_nm), strict=True):
            s, c = math.sin(tilt), math.cos(tilt)
            along = kx * s + kz * c
            valid = valid & (along > 0)
            path = (c * (depth - z) - s * x) / np.where(valid, along, 1.0)
            x, y, z = x + path * kx, y + path * ky, z + path * kz
            radicand = (after - before) * norm2 + along * along
            valid = valid & (radicand > 0)
            gain = np.where(valid, np.sqrt(np.where(valid, radicand, 1.0)) - along, 0.0)
            kx, kz, before = kx + gain * s, kz + gain * c, after
        valid = valid & (kz > 0)
        forward = np.where(valid, kz, 1.0)
        return x, y, z, kx / forward, ky / forward, valid
