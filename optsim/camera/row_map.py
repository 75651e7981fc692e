"""What the gather by rows must know of a layout: where a row of samples lands, and how far its light can be from there."""

from __future__ import annotations

import math

import numpy as np

from optsim.camera.layout import Layout

_SIDE = np.linspace(-1, 1, 9)


class RowMap:
    """Bound places along rows of samples.

    Args:
        layout: geometry.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout, self.valid = layout, layout.map.valid
        valid = np.flatnonzero(self.valid)
        self.middle = int(valid[valid.size // 2])

    @property
    def upright(self) -> bool:
        """Tell whether rows run along pixels rather than across, and downwards."""
        jacobian = self.layout.map.jacobian()[self.valid] * (2 / (np.array([self.layout.mirrors[1], self.layout.mirrors[0]])))
        bend = np.abs(np.diff(self._y(), axis=2))
        return bool((np.abs(jacobian[:, 0, 0]) > np.abs(jacobian[:, 0, 1])).all() and (np.diff(self._y(), axis=2) > 0.2 * bend.max()).all())

    def lines(self, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the coefficients in xi of x, y and the transmission on lines eta: (n, A, lines) each."""
        f = self.layout.map
        x, y, passed = (
            np.einsum("nap,pv->nav", table, np.stack([eta**p for p in powers])) for table, powers in zip((f.x, f.y, f.passed), f.powers)
        )
        return x, y, passed

    def reach(self, pixels: int) -> float:
        """Return how far from the place found a sample that touches a thread's pixels can be, in samples along the row.

        The place (a linear guess and one correction) is compared with the field map over the field and over a sample's
        whole distance; half again of the error found is added.
        """
        x, slope = self._x(), self._slopes()
        wide = self._wide(pixels)
        error = 1e-9
        for part in (0.0, 1.0, -1.0, 0.5, -0.5):
            line = _SIDE[:, None] + part * wide / slope
            error = max(error, float(np.abs(self._inverse(x + part * wide) - line)[self.valid].max()))
        extent = float((wide / np.abs(slope))[self.valid].max())
        return (extent + 1.5 * error) * self.layout.fine[1] / 2 * (1 + 1e-6)

    def spread(self, block: int) -> tuple[float, float]:
        """Return how far before and behind a block's first wavelength the others' samples for a pixel lie, in samples along the row."""
        x = self._x()
        first = np.arange(len(x)) // block * block
        apart = (x - x[first]) / self._slopes()[first]
        # light that lands farther right reaches a given pixel from mirrors farther left
        before, behind = -max(float(apart.max()), 0.0), -min(float(apart.min()), 0.0)
        return 1.1 * before * self.layout.fine[1] / 2, 1.1 * behind * self.layout.fine[1] / 2

    def heights(self, pixels: int) -> tuple[float, int]:
        """Return where a row's light begins, in px from the middle wavelength's place there, and how many rows of cells it meets."""
        x, y, wide = self._x(), self._y(), self._wide(pixels)
        low, high = math.inf, -math.inf
        one = slice(self.middle, self.middle + 1)
        along, across = (line[one, :, None] for line in self.lines(_SIDE)[:2])
        for part in (-1.0, -0.5, 0.0, 0.5, 1.0):
            place = np.clip(self._inverse(x + part * wide, along[:, :, 0]), -1.1, 1.1)
            apart = (y - _polynomial(across[:, :, 0], place))[self.valid]
            low, high = min(low, float(apart.min())), max(high, float(apart.max()))
        spare = 0.1 * (high - low) + float(self.layout.sides[self.valid, 1].max()) / 2 + 1e-6
        low, high = low - spare, high + spare
        return low, math.floor((high - low) * self.layout.grid.sub) + 2

    def rows_across(self, cells: int) -> float:
        """Return over how many rows of samples so many rows of cells extend."""
        step = float(np.diff(self._y(), axis=2)[self.valid].min()) / (_SIDE[1] - _SIDE[0]) * 2 / self.layout.fine[0]
        return (cells + 2) / self.layout.grid.sub / step + 2

    def _x(self) -> np.ndarray:
        return self.layout.map.at(_SIDE[:, None], _SIDE)[0]

    def _y(self) -> np.ndarray:
        return self.layout.map.at(_SIDE[:, None], _SIDE)[1]

    def _slopes(self) -> np.ndarray:
        """Return (n, 1, lines) derivatives of x by xi in the middle of each line."""
        return self.lines(_SIDE)[0][:, 1][:, None]

    def _wide(self, pixels: int) -> np.ndarray:
        return (pixels + self.layout.sides[:, 0, None, None]) / 2

    def _inverse(self, x: np.ndarray, line: np.ndarray | None = None) -> np.ndarray:
        """Return the xi found for (n, places, lines) positions on each line, as the kernel does."""
        line = self.lines(_SIDE)[0] if line is None else line
        slope = line[:, 1][:, None]
        guess = np.clip((x - line[:, 0][:, None]) / slope, -1.1, 1.1)
        found: np.ndarray = guess - (_polynomial(line, guess) - x) / slope
        return found


def _polynomial(line: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Return sums of line[:, a] xi^a for (n, places, lines)."""
    result = np.zeros(xi.shape)
    for a in reversed(range(line.shape[1])):
        result = result * xi + line[:, a][:, None]
    return result
