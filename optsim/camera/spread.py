"""How the light of one mirror and one band falls on a row of pixels (theory.md (C.15))."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from optsim.camera.prism import Dispersion

PIECES_PER_BAND = 64
"""A band's light is laid on the sensor in this many exact pieces; 64 and 128 agree to 1e-6 of the light."""

Passed = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Photons, in any unit, that filter and prism pass between two wavelengths in nm."""


@dataclass(frozen=True, eq=False)
class Landing:
    """Say where the light of mirror (m, n) lands: row ``m + first_row + s``, column ``n + first_column + t``, share ``taps``.

    Args:
        first_column: (K,) int64, or (K, 1|M, 1|N).
        taps: (K, T), or (K, 1|M, 1|N, Tr, Tc).
        first_row: (K, 1|M, 1|N) int64; None with (K, T) taps: light stays in its row.
    """

    first_column: np.ndarray
    taps: np.ndarray
    first_row: np.ndarray | None = None

    def simplified(self) -> Landing:
        """Return the form (K,), (K, T) where one row of taps in the mirror's row serves the whole field."""
        if self.first_row is None or self.first_row.any() or self.taps.shape[1:4] != (1, 1, 1):
            return self
        return Landing(self.first_column[:, 0, 0], self.taps[:, 0, 0, 0])


def pieces(lower_nm: np.ndarray, upper_nm: np.ndarray, count: int, passed: Passed | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Cut bands into pieces of equal width in nm and weigh them by their photons (lambda d lambda) that pass.

    Returns:
        (edges (K, count + 1) in nm, weights (K, count) that add to 1 for each band).
    """
    edges = lower_nm[:, None] + (upper_nm - lower_nm)[:, None] * np.linspace(0, 1, count + 1)
    photons = np.diff(edges**2, axis=1)
    if passed is not None:
        kept = passed(edges[:, :-1].ravel(), edges[:, 1:].ravel()).reshape(photons.shape)
        photons = np.where(kept.sum(1, keepdims=True) > 0, kept, photons)
    return edges, photons / photons.sum(1, keepdims=True)


def spread_taps(
    dispersion: Dispersion,
    mirror_px: float,
    lower_nm: np.ndarray,
    upper_nm: np.ndarray,
    passed: Passed | None = None,
    offset_px: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Lay each band's light of one mirror on sensor columns: mirror box * band * pixel box (theory.md (C.15)).

    A band is cut into pieces of equal width in nm; a piece is a box between the traced positions of its ends,
    weighted by its photons, so that the integrals are exact for each piece. Pieces that the prism loses weigh nothing.

    Returns:
        (first_column (K,) int64, taps (K, T) float64); a band's taps sum to 1, or to the share that the prism passes.
    """
    edges, weight = pieces(lower_nm, upper_nm, PIECES_PER_BAND, passed)
    x, _, valid = dispersion.position_px(edges)
    x = x + offset_px
    weight = weight * (valid[:, 1:] & valid[:, :-1])
    a, b = np.minimum(x[:, 1:], x[:, :-1]), np.maximum(x[:, 1:], x[:, :-1])
    low = np.floor(np.where(weight > 0, a, np.inf).min(1) - mirror_px / 2 + 0.5)
    high = np.ceil(np.where(weight > 0, b, -np.inf).max(1) + mirror_px / 2 - 0.5)
    dark = ~np.isfinite(low)
    low, high = np.where(dark, 0, low), np.where(dark, 0, high)
    count = int((high - low).max()) + 1
    column = low[:, None] + np.arange(count + 1) - 0.5
    below = (weight[..., None] * share_below(column[:, None, :], a[..., None], b[..., None], mirror_px)).sum(1)
    taps = np.diff(below, axis=1)
    taps[taps < 1e-15] = 0.0
    return low.astype(np.int64), taps


def share_below(t: np.ndarray, a: np.ndarray, b: np.ndarray, box: float) -> np.ndarray:
    """Return the share below t of (box of width ``box`` around 0) convolved with (box from a to b): a trapezoid's integral."""

    def mean_ramp(u: np.ndarray) -> np.ndarray:
        """Average max(u - p, 0) over p from a to b, without dividing small differences by b - a."""
        inside = (u > a) & (u < b)
        return np.where(u >= b, u - (a + b) / 2, np.where(inside, (u - a) ** 2 / (2 * np.where(inside, b - a, 1.0)), 0.0))

    return np.clip((mean_ramp(t + box / 2) - mean_ramp(t - box / 2)) / box, 0, 1)
