"""Lay fine samples on the sensor by area, as a gather: every cell adds up the samples that touch it (theory.md (C.17), (C.40)).

Two Dr.Jit kernels a slab. In the first a thread is a row of samples and a few neighbouring columns of cells; it holds
the sums of the rows of cells that its samples can touch. The second adds up, for every cell, the rows of samples that
touch it, in their order. No two threads write to one place, so that the result has the same bits every time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from optsim.camera.aligned import aligned
from optsim.camera.arrays import Kernels
from optsim.camera.layout import Layout
from optsim.camera.row_kernels import Slab
from optsim.camera.row_map import RowMap
from optsim.errors import InputError

SLAB_BYTES = 2**27
MAX_SPREAD = 1.5
"""Neighbouring wavelengths are handled together while their places lie within this many samples."""
MAX_WINDOW = 400
_CELLS, _CANDIDATES = 4, 20
_WIDE = 4

Rows = Callable[[int, int, slice], np.ndarray]
"""``rows(start, stop, wavelengths)`` gives fine rows of the cube, (stop - start, N s, n) float32."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Say how a layout is laid row by row, the same for all parts of its wavelengths, so that one kernel serves them.

    Args:
        k: Dr.Jit and its types.
        pixels: whose columns a thread holds.
        block: wavelengths handled together.
        early: samples between the place found for a thread's middle and its first candidate (negative).
        window: candidates along the row.
    """

    k: Kernels
    pixels: int
    block: int
    early: float
    window: int

    @classmethod
    def of(cls, k: Kernels, layout: Layout) -> Plan | None:
        """Find the window; None where rows of mirrors are turned too far against rows of pixels.

        Raises:
            InputError: field ``camera`` when a sample's image is too small for a kernel of bounded size.
        """
        rows = RowMap(layout)
        if not rows.upright:
            return None
        block = next(b for b in (4, 2, 1) if b == 1 or np.ptp(rows.spread(b)) <= MAX_SPREAD)
        before, behind = rows.spread(block)
        for pixels in sorted({max(1, _CELLS // layout.grid.sub), 1}, reverse=True):
            reach = rows.reach(pixels)
            window = math.floor(2 * reach + behind - before) + 1
            if window <= _CANDIDATES:
                break
        if window * rows.heights(pixels)[1] > MAX_WINDOW:
            side = float(layout.sides.min())
            raise InputError("camera", f"{side:g} px", "a sample's image of at least 0.1 px (fewer samples a mirror, or larger mirrors)")
        return cls(k, pixels, block, before - reach, window)


class Gather:
    """Lay light with Dr.Jit, row by row.

    Args:
        plan: how.
        layout: geometry, of the wavelengths that are laid.
        weights: (P, n) of each plane that is summed.
        states: (L, M, N) float64, what each mirror sends on, from 0 to 1.
        rows: the fine cube.
        wavelengths: which of the cube's wavelengths are laid.
    """

    def __init__(self, plan: Plan, layout: Layout, weights: np.ndarray, states: np.ndarray, rows: Rows, wavelengths: slice) -> None:
        self.plan, self.layout, self.states, self.rows, self.wavelengths = plan, layout, states, rows, wavelengths
        self.planes, self.cells = len(weights), plan.pixels * layout.grid.sub
        self.strips = -(-layout.grid.pixels[1] // plan.pixels)
        self.map = RowMap(layout)
        self.low, self.high = self.map.heights(plan.pixels)
        self.table = _Table(self.map, weights, plan.block)

    def sums(self) -> np.ndarray:
        """Return (L, P, rows, columns) of cells."""
        (height, width), shots, sub = self.layout.grid.cells, len(self.states), self.layout.grid.sub
        sums = np.empty((shots, self.planes, height, width))
        together = 2 ** int(np.clip(math.log2(128 / (self.cells * self.high * self.planes)), 0, 4))
        fine = self.layout.fine[1] * self.table.blocks * self.plan.block * 4
        held = self.strips * self.cells * self.high * self.planes * min(together, shots) * 8
        step = max(1, int(SLAB_BYTES // ((fine + held) * self.layout.samples))) * sub
        reach = self.map.rows_across(self.high)
        for first in range(0, height, step):
            last = min(height, first + step)
            start, stop = self.layout.fine_rows(first, last, reach)
            cube = self._padded(self.rows(start, stop, self.wavelengths))
            lines = aligned(self.table.lines(start, stop))
            for l in range(0, shots, together):
                chosen = slice(l, min(shots, l + together))
                slab = Slab(self, (start, stop), chosen)
                sums[chosen, :, first:last] = slab.added(slab.laid(cube, lines), first, last)[..., :width]
        return sums

    def _padded(self, cube: np.ndarray) -> np.ndarray:
        missing = self.table.blocks * self.plan.block - cube.shape[-1]
        return np.ascontiguousarray(cube if missing == 0 else np.pad(cube, ((0, 0), (0, 0), (0, missing))), np.float32).ravel()


class _Table:
    """Arrange what a kernel reads: for each row and wavelength polynomials along the row, for each wavelength sides and weights."""

    def __init__(self, rows: RowMap, weights: np.ndarray, block: int) -> None:
        layout, f, n = rows.layout, rows.layout.map, weights.shape[1]
        self.rows, self.blocks, self.count = rows, -(-n // block), -(-n // block) * block
        self.varies = f.passed[0].size > 1
        norm = f.valid / layout.samples**2
        constant = norm if self.varies else norm * f.passed[:, 0, 0]
        numbers = np.concatenate([1 / layout.sides, (weights * constant).T], axis=1)
        self.fixed = self._padded(numbers, 0)
        self.fixed[n:, 2:] = 0  # the last block repeats the last wavelength with weight 0
        self.packets = self.fixed.shape[1] // _WIDE
        self.lengths = (f.x.shape[1], f.y.shape[1], f.passed.shape[1] * self.varies)
        self.line_packets = -(-sum(self.lengths) // _WIDE)
        self.middle = rows.middle

    def lines(self, start: int, stop: int) -> np.ndarray:
        """Return (rows, wavelengths, numbers): x and y in sides of a sample, and the transmission."""
        eta = (np.arange(start, stop) + 0.5) / (self.rows.layout.fine[0] / 2) - 1
        sides = self.rows.layout.sides
        x, y, passed = (np.moveaxis(line, 2, 0) for line in self.rows.lines(eta))
        parts = [x / sides[:, :1], y / sides[:, 1:], passed[..., : self.lengths[2]]]
        return self._padded(np.concatenate(parts, axis=2), 1)

    def _padded(self, numbers: np.ndarray, axis: int) -> np.ndarray:
        widths = [(0, 0)] * numbers.ndim
        widths[axis] = (0, self.count - numbers.shape[axis])
        numbers = np.pad(numbers, widths, mode="edge")
        return np.pad(numbers, [(0, 0)] * (numbers.ndim - 1) + [(0, -numbers.shape[-1] % _WIDE)])
