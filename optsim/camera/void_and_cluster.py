"""Blue noise: binary patterns without clusters and voids (R. Ulichney, Proc. SPIE 1913, 332 (1993))."""

from __future__ import annotations

import numpy as np

REACH = 4.0
"""The Gaussian is cut this many standard deviations out."""


def void_and_cluster(stream: np.random.Generator, size: tuple[int, int], count: int, sigma: float) -> np.ndarray:
    """Move the members of a random pattern from the tightest cluster to the largest void until that changes nothing (theory.md (C.46)).

    Crowding is a Gaussian sum over the members of the minority, cyclic in both directions, so that patterns tile.

    Args:
        stream: draws the pattern that is started from.
        size: (M, N).
        count: how many are open, from 0 to M N.
        sigma: of the Gaussian, in mirrors.

    Returns:
        (M, N) uint8 with exactly ``count`` ones.
    """
    total = size[0] * size[1]
    minority = min(count, total - count)
    chosen = np.zeros(total, bool)
    chosen[stream.permutation(total)[:minority]] = True
    if minority > 0:
        chosen = _Crowd(chosen.reshape(size), sigma).spread()
    open_ones = chosen if count == minority else ~chosen
    return open_ones.reshape(size).astype(np.uint8)


class _Crowd:
    """A pattern with its crowding, and each row's most crowded member and emptiest place."""

    def __init__(self, chosen: np.ndarray, sigma: float) -> None:
        self.chosen = chosen
        rows, columns = chosen.shape
        reach_y, reach_x = (min(int(np.ceil(REACH * sigma)), (side - 1) // 2) for side in (rows, columns))
        dy, dx = np.arange(-reach_y, reach_y + 1), np.arange(-reach_x, reach_x + 1)
        self.kernel = np.exp(-(dy[:, None] ** 2 + dx**2) / (2 * sigma**2))
        self.dy, self.dx = dy, dx
        self.crowding = np.zeros(chosen.shape)
        for row, column in np.argwhere(chosen):
            self._add(row, column, 1.0)
        self.fullest, self.emptiest = np.empty(rows), np.empty(rows)
        self._refresh(np.arange(rows))

    def spread(self) -> np.ndarray:
        """Swap until the tightest cluster's member is itself the largest void."""
        for _ in range(4 * self.chosen.size):
            row = int(self.fullest.argmax())
            column = int(np.where(self.chosen[row], self.crowding[row], -np.inf).argmax())
            self._put(row, column, False)
            new_row = int(self.emptiest.argmin())
            new_column = int(np.where(self.chosen[new_row], np.inf, self.crowding[new_row]).argmin())
            self._put(new_row, new_column, True)
            if (row, column) == (new_row, new_column):
                break
        return self.chosen

    def _put(self, row: int, column: int, here: bool) -> None:
        self.chosen[row, column] = here
        self._refresh(self._add(row, column, 1.0 if here else -1.0))

    def _add(self, row: int, column: int, sign: float) -> np.ndarray:
        rows = (row + self.dy) % self.chosen.shape[0]
        self.crowding[rows[:, None], (column + self.dx) % self.chosen.shape[1]] += sign * self.kernel
        return rows

    def _refresh(self, rows: np.ndarray) -> None:
        chosen, crowding = self.chosen[rows], self.crowding[rows]
        self.fullest[rows] = np.where(chosen, crowding, -np.inf).max(1)
        self.emptiest[rows] = np.where(chosen, np.inf, crowding).min(1)
