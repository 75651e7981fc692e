"""Where the samples of a photograph lie and what they weigh: the geometry and the spectral weights of one photograph."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from optsim.camera.field import Field, FieldMap


@dataclass(frozen=True, eq=False)
class Grid:
    """Hold the cells that light is laid on: the frame, or a finer and larger grid that is blurred and binned later.

    Args:
        first: (row, column) of the pixel in whose corner the grid begins.
        pixels: (rows, columns) that it spans.
        sub: cells along a pixel's side.
    """

    first: tuple[int, int]
    pixels: tuple[int, int]
    sub: int = 1

    @property
    def cells(self) -> tuple[int, int]:
        """Return (rows, columns) of cells."""
        return self.pixels[0] * self.sub, self.pixels[1] * self.sub

    def borders(self) -> tuple[float, float, float, float]:
        """Return the first and last row, first and last column border in px, pixel centres being whole numbers."""
        (y, x), (height, width) = self.first, self.pixels
        return y - 0.5, y + height - 0.5, x - 0.5, x + width - 0.5


@dataclass(frozen=True, eq=False)
class Layout:
    """Hold the geometry of one photograph.

    Args:
        field: positions for each of the n fine wavelengths.
        mirrors: (M, N).
        samples: s, samples along a mirror's side.
        grid: the cells.
        sides: (n, 2) of a sample's footprint along x and y, in px.
    """

    field: Field
    mirrors: tuple[int, int]
    samples: int
    grid: Grid
    sides: np.ndarray

    @classmethod
    def of(cls, field: Field, mirrors: tuple[int, int], samples: int, grid: Grid) -> Layout:
        """Give every sample the rectangle that has its image's second moments along x and y (theory.md (C.39))."""
        jacobian = field.jacobian() * (2 / (np.array([mirrors[1], mirrors[0]]) * samples))
        sides = np.hypot(jacobian[..., 0], jacobian[..., 1])
        return cls(field, mirrors, samples, grid, sides)

    @property
    def fine(self) -> tuple[int, int]:
        """Return (M s, N s)."""
        return self.mirrors[0] * self.samples, self.mirrors[1] * self.samples

    @property
    def middle(self) -> tuple[float, float]:
        """Return the (row, column) on the sensor that belongs to the middle of the mirrors and position 0."""
        return (self.mirrors[0] - 1) / 2, (self.mirrors[1] - 1) / 2

    @property
    def map(self) -> FieldMap:
        """Return the field as polynomials, which the kernel needs."""
        assert isinstance(self.field, FieldMap)
        return self.field

    def part(self, wavelengths: slice | np.ndarray) -> Layout:
        """Return the same for some of the wavelengths."""
        return replace(self, field=self.field.part(wavelengths), sides=self.sides[wavelengths])

    def fine_rows(self, first: int, last: int, reach: float) -> tuple[int, int]:
        """Return the range of fine rows that holds all that can touch rows of cells first..last-1."""
        fine, f, grid = self.fine[0], self.map, self.grid
        xi, eta = np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7), indexing="ij")
        y = f.at(xi, eta)[1][f.valid] + self.middle[0]
        slope = np.abs(f.y[f.valid, 0, f.powers[1].index(1)])
        if slope.min() < np.abs(y - y.mean()).max() * 0.05:
            return 0, fine  # the image is turned so far that rows of mirrors are no rows of cells
        middle = y[:, 3, 3]
        bend = np.abs(y - middle[:, None, None] - f.y[f.valid, 0, f.powers[1].index(1)][:, None, None] * eta).max()
        ends = [grid.first[0] - 0.5 + i / grid.sub for i in (first, last)]
        sign = np.sign(f.y[f.valid, 0, f.powers[1].index(1)])
        places = [(sign * (end + side * bend * 1.5 - middle) / slope + 1) / 2 * fine for end in ends for side in (-1, 1)]
        spare = reach + 2
        start, stop = int(np.floor(min(p.min() for p in places) - spare)), int(np.ceil(max(p.max() for p in places) + spare))
        start = min(max(0, start), fine - 1)
        return start, max(start + 1, min(fine, stop))

    def edge_samples(self, margin_px: float = 0.01) -> np.ndarray:
        """Return the flat indices of samples that some wavelength may lay, in part, beside the grid.

        A line of samples is safe when its footprints stay inside by a margin at seven places along it, at the wavelengths that
        land outermost.
        """
        if not self.field.valid.any():
            return np.arange(0)
        (height, width), chosen = self.fine, self._outermost()
        f, sides = self.field.part(chosen), self.sides[chosen]
        xi, eta = ((np.arange(n) + 0.5) / (n / 2) - 1 for n in (width, height))
        top, bottom, left, right = self.grid.borders()
        lines = np.linspace(-1, 1, 7)
        wide, high = (sides[:, i, None, None] / 2 + margin_px for i in (0, 1))
        x = f.at(xi[:, None], lines)[0] + self.middle[1]
        y = f.at(lines, eta[:, None])[1] + self.middle[0]
        safe_x = ((x - wide > left) & (x + wide < right)).all((0, 2))
        safe_y = ((y - high > top) & (y + high < bottom)).all((0, 2))
        return np.flatnonzero(~(safe_y[:, None] & safe_x))

    def _outermost(self) -> np.ndarray:
        """Return the wavelengths that land farthest out to some side, somewhere in the field."""
        valid = np.flatnonzero(self.field.valid)
        line = np.linspace(-1, 1, 9)
        places = [p[valid].reshape(valid.size, -1) for p in self.field.at(line[:, None], line)]
        return np.asarray(valid[np.unique([f(p, axis=0) for p in places for f in (np.argmin, np.argmax)])])


@dataclass(frozen=True, eq=False)
class Weights:
    """Hold what unit radiance of each fine wavelength on one whole mirror sends out, (n,) each, before the prism's own losses.

    Args:
        curves: (C, n) contribution to a pixel of each spectral curve.
        arriving: photons that reach the prism.
        outside: the part of ``arriving`` at wavelengths outside the discrete model's bands.
        blocked: photons stopped by the band-pass.
        absorbed: photons lost in the lenses.
    """

    curves: np.ndarray
    arriving: np.ndarray
    outside: np.ndarray
    blocked: np.ndarray
    absorbed: np.ndarray


@dataclass(frozen=True, eq=False)
class Account:
    """Count photons of the L shots, (L,) each: sent = detected + missed + blocked + absorbed + reflected.

    Args:
        sent: leave the mirrors within the light cone, at all wavelengths of the cube.
        missed: fall beside the grid; light that the blur takes off the frame is added later.
        blocked: stopped by the band-pass.
        absorbed: lost in the lenses.
        reflected: lost in the prism (at its faces, by total reflection).
        outside: on the grid, but at wavelengths outside the discrete model's bands.
    """

    sent: np.ndarray
    missed: np.ndarray
    blocked: np.ndarray
    absorbed: np.ndarray
    reflected: np.ndarray
    outside: np.ndarray
