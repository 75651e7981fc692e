"""Where the samples of a photograph lie and what they weigh: the geometry and the spectral weights of one photograph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optsim.camera.field import FieldMap, TracedField


@dataclass(frozen=True, eq=False)
class Layout:
    """Hold the geometry of one photograph.

    Args:
        field: positions for each of the n fine wavelengths.
        mirrors: (M, N).
        samples: s, samples along a mirror's side.
        frame: (rows, columns) of the sensor.
        mirror_px: side of a mirror's image in px.
    """

    field: FieldMap | TracedField
    mirrors: tuple[int, int]
    samples: int
    frame: tuple[int, int]
    mirror_px: float

    @property
    def fine(self) -> tuple[int, int]:
        """Return (M s, N s)."""
        return self.mirrors[0] * self.samples, self.mirrors[1] * self.samples

    @property
    def side_px(self) -> float:
        """Return the side of one sample's square footprint in px."""
        return self.mirror_px / self.samples

    @property
    def middle(self) -> tuple[float, float]:
        """Return the (row, column) on the sensor that belongs to the middle of the mirrors and position 0."""
        return (self.mirrors[0] - 1) / 2, (self.mirrors[1] - 1) / 2

    @property
    def map(self) -> FieldMap:
        """Return the field as polynomials, which the kernel needs."""
        assert isinstance(self.field, FieldMap)
        return self.field

    def reach(self) -> tuple[float, float]:
        """Return how far from its estimated place a sample that touches a pixel can be, in samples along (rows, columns).

        The estimate (a linear guess and one correction) is compared with the field map over the field and over a
        sample's whole distance from a pixel; half again of the error found is added.
        """
        f = self.map
        xi, eta = np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7), indexing="ij")
        x, y = f.at(xi, eta)
        half = (1 + self.side_px) / 2
        error_x = error_y = 1e-9
        for dx, dy in ((0, 0), (half, half), (-half, half), (half, -half), (-half, -half)):
            found_xi, found_eta = f.inverse(x + dx, y + dy)
            miss_x = (found_xi - xi) * f.x[:, 1, 0][:, None, None] - dx
            miss_y = (found_eta - eta) * f.y[:, 0, 0][:, None, None] - dy
            error_x = max(error_x, float(np.abs(miss_x)[f.valid].max(initial=0)))
            error_y = max(error_y, float(np.abs(miss_y)[f.valid].max(initial=0)))
        pitch_x = 2 * np.abs(f.x[f.valid, 1, 0]).min() / self.fine[1]
        pitch_y = 2 * np.abs(f.y[f.valid, 0, 0]).min() / self.fine[0]
        return float((half + 1.5 * error_y) / pitch_y * (1 + 1e-6)), float((half + 1.5 * error_x) / pitch_x * (1 + 1e-6))

    def fine_rows(self, first: int, last: int, reach: float) -> tuple[int, int]:
        """Return the range of fine rows that holds all that can touch sensor rows first..last-1."""
        f, fine = self.map, self.fine[0]
        slope = f.y[f.valid, 0, 0]
        xi, eta = np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7), indexing="ij")
        bend = np.abs(f.at(xi, eta)[1] - f.y[:, 0, 0][:, None, None] * eta)[f.valid].max()
        spare = reach + 2 + 1.5 * bend * fine / (2 * np.abs(slope).min())
        ends = [((i - self.middle[0]) / s + 1) / 2 * fine for i in (first, last - 1) for s in (slope.min(), slope.max())]
        start, stop = int(np.floor(min(ends) - spare)), int(np.ceil(max(ends) + spare))
        start = min(max(0, start), fine - 1)
        return start, max(start + 1, min(fine, stop))

    def edge_samples(self, margin_px: float = 0.01) -> np.ndarray:
        """Return the flat indices of samples that some wavelength may lay, in part, beside the frame.

        A column (row) of samples is safe when its footprint stays inside by a margin at seven places along it.
        """
        f, (height, width) = self.field, self.fine
        if not f.valid.any():
            return np.arange(0)
        xi, eta = ((np.arange(n) + 0.5) / (n / 2) - 1 for n in (width, height))
        lines = np.linspace(-1, 1, 7)
        spare = self.side_px / 2 + margin_px
        x = f.at(xi[:, None], lines)[0][f.valid] + self.middle[1]
        y = f.at(lines, eta[:, None])[1][f.valid] + self.middle[0]
        safe_x = ((x - spare > -0.5) & (x + spare < self.frame[1] - 0.5)).all((0, 2))
        safe_y = ((y - spare > -0.5) & (y + spare < self.frame[0] - 0.5)).all((0, 2))
        return np.flatnonzero(~(safe_y[:, None] & safe_x))


@dataclass(frozen=True, eq=False)
class Weights:
    """Hold what unit radiance of each fine wavelength on one whole mirror sends out, (n,) each.

    Args:
        curves: (C, n) contribution to a pixel of each spectral curve; 0 where the prism loses the light.
        arriving: photons that leave the optics towards the sensor's plane; 0 where the prism loses the light.
        outside: the part of ``arriving`` at wavelengths outside the discrete model's bands.
        blocked: photons stopped by the band-pass.
        reflected: photons that pass the filter and are lost in the prism.
    """

    curves: np.ndarray
    arriving: np.ndarray
    outside: np.ndarray
    blocked: np.ndarray
    reflected: np.ndarray


@dataclass(frozen=True)
class Budget:
    """Count photons of one shot: sent = detected + missed + blocked + reflected.

    Args:
        sent: leave the open mirrors, at all wavelengths of the cube.
        missed: fall beside the sensor.
        blocked: stopped by the band-pass.
        reflected: lost in the prism (total reflection).
        outside: detected, but at wavelengths outside the discrete model's bands.
    """

    sent: float
    missed: float
    blocked: float
    reflected: float
    outside: float
