"""Weights of the band model over the field: boxes where nothing blurs, a table of blurred boxes elsewhere (theory.md (S.44), (S.45))."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from optsim.camera.blur import Otf, Window
from optsim.camera.field_paths import Displacements, Field
from optsim.camera.spread import PIECES_PER_BAND, Landing, Passed, pieces, share_below

TINY = 1e-9  # px; keeps rounding from opening a row or column


def field_taps(
    field: Field,
    lower_nm: np.ndarray,
    upper_nm: np.ndarray,
    error: float,
    passed: Passed | None = None,
    otf: Otf | None = None,
) -> Landing:
    """Return where every mirror's light of every band lands.

    Args:
        field: mirrors and paths.
        lower_nm, upper_nm: (K,) bands.
        error: share of the light that may end on a wrong pixel: variations over the field up to so many px, and tails of
            the blur that hold so much of the light, are left out.
        passed: weighs the wavelengths inside a band.
        otf: the blur that is alike all over the field; None: none.

    Returns:
        Taps (K, 1|M, 1|N, Tr, Tc), float64 for the whole field, float32 where they vary; (K, T) where that says all.
    """
    count = 8 if len(field.rays) > 1 else PIECES_PER_BAND
    edges, _ = pieces(lower_nm, upper_nm, count)
    found = Displacements(field, edges, error)
    if found.shape != (1, 1) and len(field.rays) == 1:
        count = 32 if 1 in found.shape else 16
    edges, weight = pieces(lower_nm, upper_nm, count, passed)
    found = Displacements(field, edges, error)
    paths = _Paths(field, found, edges, weight)
    landing = _boxes(paths) if otf is None else _blurred(paths, Window.fitting(paths.lines(otf), error))
    return landing.simplified()


class _Paths:
    """Hand out the pieces of a band and ray as boxes: ends, row, share of the band's light."""

    def __init__(self, field: Field, found: Displacements, edges: np.ndarray, weight: np.ndarray) -> None:
        self.field, self.found, self.weight = field, found, weight
        middle = edges[:, edges.shape[1] // 2]
        self.middle = middle
        self.sides = np.array([field.side_px(float(wavelength)) for wavelength in middle])
        if found.in_row:
            self.sides[:, 1] = np.minimum(self.sides[:, 1], 1.0)

    def of(self, band: int, ray: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return (a, b, y, weight), (P, 1|M, 1|N) each; a <= b."""
        x, y, valid = self.found.of(band, ray)
        weight = self.weight[band][:, None, None] * self.field.rays[ray].share * np.ones(x.shape[1:])
        if valid is not None:
            weight = weight * (valid[1:] & valid[:-1])
        return np.minimum(x[1:], x[:-1]), np.maximum(x[1:], x[:-1]), (y[1:] + y[:-1]) / 2, weight

    def each(self) -> list[tuple[int, int]]:
        """List (band, ray)."""
        return [(k, r) for k in range(self.weight.shape[0]) for r in range(len(self.field.rays))]

    def lines(self, otf: Otf) -> list[Callable[[np.ndarray, np.ndarray], np.ndarray]]:
        """Return for each band the spectrum of one mirror's light around its centroid: mirror, line, pixel and blur."""
        return [self._line(k, otf) for k in range(self.weight.shape[0])]

    def _line(self, band: int, otf: Otf) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        a, b, _, weight = (v[:, v.shape[1] // 2, v.shape[2] // 2] for v in self.of(band, 0))
        total = weight.sum()
        share = weight / total if total > 0 else np.full(weight.shape, 1 / weight.size)
        middle = (a + b) / 2
        offset, length = middle - (share * middle).sum(), b - a
        side_x, side_y = self.sides[band]
        wavelength = float(self.middle[band])

        def spectrum(fy: np.ndarray, fx: np.ndarray) -> np.ndarray:
            waves = np.exp(-2j * np.pi * fx * offset[:, None]) * np.sinc(fx * length[:, None])
            across = (share @ waves.reshape(offset.size, -1)).reshape(fx.shape) * np.sinc(fx * side_x) * np.sinc(fx)
            result: np.ndarray = np.sinc(fy * side_y) * np.sinc(fy) * across * otf(wavelength, fy, fx)
            return result

        return spectrum


def _boxes(paths: _Paths) -> Landing:
    """Lay pieces as boxes: exact in both directions."""
    first_row, first_column, counts = _corners(paths)
    single = paths.found.shape == (1, 1)
    taps = np.zeros((*first_row.shape, *counts), np.float64 if single else np.float32)
    for k, ray in paths.each():
        a, b, y, weight = paths.of(k, ray)
        side_x, side_y = paths.sides[k]
        column = first_column[k][..., None] + np.arange(counts[1] + 1) - 0.5
        row = first_row[k][..., None] + np.arange(counts[0] + 1) - 0.5
        for p in range(a.shape[0]):
            across = np.diff(share_below(column, a[p, ..., None], b[p, ..., None], side_x), axis=-1)
            down = np.diff(np.clip((row - y[p, ..., None]) / side_y + 0.5, 0, 1), axis=-1)
            taps[k] += (weight[p, ..., None] * down)[..., :, None] * across[..., None, :]
    taps[taps < 1e-15] = 0
    return Landing(first_column, taps, first_row)


def _corners(paths: _Paths) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Return the first row and column that each mirror's boxes touch, and how many of each hold all of them."""
    low = np.full((2, paths.weight.shape[0], *paths.found.shape), np.inf)
    high = -low
    for k, ray in paths.each():
        a, b, y, weight = paths.of(k, ray)
        lit = weight > 0
        side_x, side_y = paths.sides[k]
        for axis, start, end, side in ((0, y, y, side_y), (1, a, b, side_x)):
            low[axis, k] = np.minimum(low[axis, k], np.where(lit, start - side / 2, np.inf).min(0))
            high[axis, k] = np.maximum(high[axis, k], np.where(lit, end + side / 2, -np.inf).max(0))
    dark = ~np.isfinite(low)
    first = np.where(dark, 0, np.floor(np.where(dark, 0, low) + 0.5 + TINY)).astype(np.int64)
    last = np.where(dark, 0, np.ceil(np.where(dark, 0, high) - 0.5 - TINY)).astype(np.int64)
    rows, columns = (max(1, int((last[axis] - first[axis]).max()) + 1) for axis in (0, 1))
    return first[0], first[1], (rows, columns)


def _blurred(paths: _Paths, window: Window) -> Landing:
    """Lay each band's whole blurred line at its centroid, from a table over sub-pixel phases."""
    bands, rays = paths.weight.shape[0], len(paths.field.rays)
    place = np.zeros((3, bands, rays, *paths.found.shape))
    for k, ray in paths.each():
        a, b, y, weight = paths.of(k, ray)
        total = weight.sum(0)
        safe = np.where(total > 0, total, 1.0)
        place[:, k, ray] = (weight * y).sum(0) / safe, (weight * (a + b) / 2).sum(0) / safe, total
    first = np.floor(place[:2].min(2) + 0.5).astype(np.int64)
    span = np.floor(place[:2].max(2) + 0.5).astype(np.int64) - first
    more = [int(span[axis].max()) for axis in (0, 1)]
    shape = (window.reach[0] * 2 + 1 + more[0], window.reach[1] * 2 + 1 + more[1])
    single = paths.found.shape == (1, 1)
    taps = np.zeros((*first.shape[1:], *shape), np.float64 if single else np.float32)
    for k in range(bands):
        blur = window.exact(k) if single else window.table(k)
        for ray in range(rays):
            at = place[:2, k, ray]
            nearest = np.floor(at + 0.5)
            values = blur(at - nearest) * place[2, k, ray][..., None, None].astype(taps.dtype)
            move = (nearest - first[:, k]).astype(np.int64)
            for dy, dx in {(int(v), int(u)) for v, u in move.reshape(2, -1).T}:
                here = (move[0] == dy) & (move[1] == dx)
                taps[k, here, dy : dy + values.shape[-2], dx : dx + values.shape[-1]] += values[here]
    return Landing(first[1] - window.reach[1], taps, first[0] - window.reach[0])
