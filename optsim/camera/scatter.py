"""The same photograph in NumPy, one wavelength at a time, for machines without a usable libLLVM and for fields that no polynomial holds."""

from __future__ import annotations

import numpy as np

from optsim.camera.gather import Rows
from optsim.camera.layout import Account, Layout, Weights


class Scatter:
    """Lay every sample's footprint on the cells that it overlaps, by area (theory.md (C.17)); slow but plain.

    Args as :class:`optsim.camera.gather.Gather`.
    """

    def __init__(self, layout: Layout, weights: np.ndarray, states: np.ndarray, rows: Rows, wavelengths: slice) -> None:
        self.layout, self.weights, self.states, self.rows, self.wavelengths = layout, weights, states, rows, wavelengths

    def sums(self) -> np.ndarray:
        """Return (L, P, rows, columns) of cells."""
        layout, shots = self.layout, len(self.states)
        sums = np.zeros((shots, len(self.weights), *layout.grid.cells))
        for first in range(0, layout.fine[0], layout.samples):
            light, x, y = lines(layout, self.states, self.rows, first, self.wavelengths)
            for w in range(self.weights.shape[1]):
                spread = self._spread(x[w], y[w], light[..., w], layout.sides[w])
                sums += spread.reshape(shots, 1, *layout.grid.cells) * self.weights[:, w, None, None]
        return sums

    def _spread(self, x: np.ndarray, y: np.ndarray, light: np.ndarray, sides: np.ndarray) -> np.ndarray:
        """Return (L, cells) light on the cells."""
        grid = self.layout.grid
        (height, width), sub = grid.cells, grid.sub
        out = np.zeros((len(light), height * width))
        place = [
            ((p - first + 0.5) * sub - 0.5, side * sub) for p, first, side in ((x, grid.first[1], sides[0]), (y, grid.first[0], sides[1]))
        ]
        (x, wide), (y, high) = place  # in cells
        column, row = (np.floor(p - side / 2 + 0.5).astype(np.int64) for p, side in place)
        for dj in range(int(np.ceil(wide)) + 1):
            part_x = np.clip((1 + wide) / 2 - np.abs(x - (column + dj)), 0, min(wide, 1.0)) / wide
            for di in range(int(np.ceil(high)) + 1):
                part = part_x * np.clip((1 + high) / 2 - np.abs(y - (row + di)), 0, min(high, 1.0)) / high
                j, i = column + dj, row + di
                on = (part > 0) & (j >= 0) & (j < width) & (i >= 0) & (i < height)
                for l in range(len(light)):
                    out[l] += np.bincount((i * width + j)[on], (light[l] * part)[on], minlength=out.shape[1])
        return out


def scatter_account(layout: Layout, weights: Weights, states: np.ndarray, rows: Rows) -> Account:
    """Return the account of one photograph, sample by sample."""
    totals = np.zeros((6, len(states)))
    top, bottom, left, right = layout.grid.borders()
    wide, high = (layout.sides[:, i, None, None] for i in (0, 1))
    everything = slice(None)
    for first in range(0, layout.fine[0], layout.samples):
        sent, x, y = lines(layout, states, rows, first, everything, passed=False)
        light, _, _ = lines(layout, states, rows, first, everything)
        inside = _inside(x, wide, left, right) * _inside(y, high, top, bottom)
        every, passed = sent.sum((1, 2)), light.sum((1, 2))
        on = np.einsum("lvuw,wvu->lw", light, inside)
        rates = weights.arriving + weights.blocked + weights.absorbed
        totals += np.stack(
            [
                every @ rates,
                (passed - on) @ weights.arriving,
                every @ weights.blocked,
                every @ weights.absorbed,
                (every - passed) @ weights.arriving,
                on @ weights.outside,
            ]
        )
    return Account(*totals)


def lines(
    layout: Layout, states: np.ndarray, rows: Rows, first: int, wavelengths: slice, passed: bool = True
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return one row of mirrors: light (L, s, N s, n) that its samples send (and the prism passes), x and y (n, s, N s) on the sensor."""
    s, (height, columns) = layout.samples, layout.fine
    cube = rows(first, first + s, wavelengths).astype(np.float64) / s**2
    states = np.repeat(np.repeat(states[:, first // s], s, axis=1)[:, None, :, None], s, axis=1)
    eta = ((np.arange(first, first + s) + 0.5) / (height / 2) - 1)[:, None]
    xi = (np.arange(columns) + 0.5) / (columns / 2) - 1
    x, y = layout.field.at(xi, eta)
    light = states * cube
    if passed:
        light = light * np.moveaxis(layout.field.passes(xi, eta), 0, -1)
    return light, x + layout.middle[1], y + layout.middle[0]


def _inside(position: np.ndarray, side: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.maximum(np.minimum(position + side / 2, high) - np.maximum(position - side / 2, low), 0) / side
