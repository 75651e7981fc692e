"""Where every mirror's light of every band lands: traced at a few nodes of the field, polynomials between (theory.md (S.44))."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

NODES = 9
Place = Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]
"""``place(wavelength_nm, X, Y)`` or ``place(..., pupil)`` -> (x, y, valid) in px from the field's middle."""


@dataclass(frozen=True, eq=False)
class Ray:
    """Hold one ray of the light cone: a point of the pupil (None: the chief ray) and its share of the light."""

    pupil: np.ndarray | None
    share: float


@dataclass(frozen=True, eq=False)
class Field:
    """Hold the mirrors and where their light goes.

    Args:
        place: see ``Place``.
        size: (M, N) mirrors.
        pitch: distance of neighbouring mirrors in the unit of X and Y.
        rays: of the light cone.
    """

    place: Place
    size: tuple[int, int]
    pitch: float
    rays: tuple[Ray, ...] = (Ray(None, 1.0),)

    def side_px(self, wavelength_nm: float) -> tuple[float, float]:
        """Return the sides (x, y) in px of the upright rectangle that stands for the middle mirror's image (theory.md (C.39))."""
        half = np.array([-0.5, 0.5, 0.0, 0.0]) * self.pitch
        x, y, _ = self.place(wavelength_nm, half, half[::-1])
        return math.hypot(x[1] - x[0], x[3] - x[2]), math.hypot(y[1] - y[0], y[3] - y[2])

    def trace(self, edges_nm: np.ndarray, across: np.ndarray, down: np.ndarray, ray: Ray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return displacements (dx, dy, valid), (..., down, across), against a grid of one pixel a mirror.

        ``across`` and ``down`` are field coordinates of -1..1 between the outer mirrors' centres.
        """
        n, m = across * ((self.size[1] - 1) / 2), down[:, None] * ((self.size[0] - 1) / 2)
        wavelength = edges_nm[..., None, None]
        extra: dict[str, Any] = {} if ray.pupil is None else {"pupil": ray.pupil}
        x, y, valid = self.place(wavelength, n * self.pitch, m * self.pitch, **extra)
        return x - n, y - m, valid


class Displacements:
    """Hold the displacements of all bands, reduced to one row or column of the field where they hardly vary.

    Args:
        field: mirrors and paths.
        edges_nm: (K, P + 1) borders of the pieces of each band.
        error_px: a variation up to this much from its middle value is left out.

    Attributes:
        shape: (1 or M, 1 or N).
        in_row: whether no light moves by more than ``error_px`` out of its row.
    """

    def __init__(self, field: Field, edges_nm: np.ndarray, error_px: float) -> None:
        self._field, self._edges = field, edges_nm
        node = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
        traced = [field.trace(edges_nm, node, node, ray) for ray in field.rays]
        self._smooth = all(valid.all() for _, _, valid in traced)
        self._nodes = [np.stack([x, y]) for x, y, _ in traced]
        rows, columns = field.size
        self._weights = tuple(_barycentric(node, _coordinates(count)) for count in (rows, columns))
        if self._smooth:
            full = [weights[[0, -1, count // 2]] for weights, count in zip(self._weights, field.size)]
            ends = [np.concatenate([np.eye(NODES), f]) for f in full]
            ranges = [np.einsum("ay,...yx,bx->...ab", ends[0], d, ends[1]) for d in self._nodes]
            self.shape = next(
                shape
                for shape in ((1, 1), (rows, 1), (1, columns), (rows, columns))
                if all(_varies(r, shape, field.size) <= 2 * error_px for r in ranges)
            )
            tallest = max(field.side_px(float(w))[1] for w in (edges_nm.min(), edges_nm.max()))
            away = max(float(np.abs(r[1]).max()) for r in ranges) + max(0.0, (tallest - 1) / 2)
            self.in_row = away <= error_px
        else:
            self.shape, self.in_row = field.size, False

    def of(self, band: int, ray: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return (dx, dy, valid) of the band's piece borders, (P + 1, 1|M, 1|N); valid None where all light arrives."""
        if not self._smooth:
            across, down = (_coordinates(count) for count in self._field.size[::-1])
            return self._field.trace(self._edges[band], across, down, self._field.rays[ray])
        weights = [w if s > 1 else _middle(w) for w, s in zip(self._weights, self.shape)]
        dx, dy = np.einsum("ay,cpyx,bx->cpab", weights[0], self._nodes[ray][:, band], weights[1], optimize=True)
        return dx, np.zeros_like(dy) if self.in_row else dy, None


def _coordinates(count: int) -> np.ndarray:
    return np.linspace(-1, 1, count) if count > 1 else np.zeros(1)


def _middle(weights: np.ndarray) -> np.ndarray:
    """Return the weights of the mean over the field."""
    return weights.mean(0, keepdims=True)


def _varies(displacement: np.ndarray, shape: tuple[int, int], size: tuple[int, int]) -> float:
    """Return the largest variation in px along the axes that ``shape`` gives up."""
    axes = tuple(axis for axis, kept, full in ((-2, shape[0], size[0]), (-1, shape[1], size[1])) if kept == 1 and full > 1)
    return float(np.ptp(displacement, axis=axes).max()) if axes else 0.0


def _barycentric(node: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the matrix (at, nodes) of polynomial interpolation between Chebyshev nodes."""
    count = node.size
    sign = (-1.0) ** np.arange(count) * np.sin(np.pi * (np.arange(count) + 0.5) / count)
    gap = at[:, None] - node
    exact = np.abs(gap) < 1e-14
    weights = sign / np.where(exact, 1.0, gap)
    weights = np.where(exact.any(1, keepdims=True), exact.astype(float), weights)
    result: np.ndarray = weights / weights.sum(1, keepdims=True)
    return result
