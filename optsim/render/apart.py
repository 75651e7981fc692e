"""What a render with glass tells apart: pixels that show dispersing glass, and light that came by way of glass (theory.md (R.48))."""

from __future__ import annotations

import numpy as np

from optsim.render.passes import Renderable, State


class Apart:
    """Gather over the parts of a picture.

    Args:
        count: K.
    """

    def __init__(self, count: int) -> None:
        self._squares, self._dispersed = np.zeros(count), np.zeros(count)
        self._pixels, self._shown, self._caustic, self._light = np.zeros(4)

    def add(self, task: Renderable, state: State, stderr: np.ndarray | None) -> None:
        """Take in a part, with its standard errors (pixels, K), if there are any."""
        if state.told is None or not len(state.told):
            return
        seen, caustic = state.told / state.groups[0].counts
        shown = seen > 0
        self._pixels += len(seen)
        self._shown += np.count_nonzero(shown)
        self._caustic += caustic.sum()
        self._light += sum(level(weights) * group.mean.mean(0).sum() for group, weights in zip(state.groups, task.weights))
        if stderr is not None:
            self._squares += np.square(stderr, dtype=np.float64).sum(0)
            self._dispersed += np.square(stderr[shown], dtype=np.float64).sum(0)

    def notes(self) -> np.ndarray:
        """Return all that is gathered, as (2 K + 4,) numbers."""
        return np.concatenate([self._squares, self._dispersed, [self._pixels, self._shown, self._caustic, self._light]])

    @classmethod
    def from_notes(cls, notes: np.ndarray, count: int) -> Apart:
        """Go on from :meth:`notes`."""
        found = cls(count)
        found._squares, found._dispersed = notes[:-4].reshape(2, count).copy()
        found._pixels, found._shown, found._caustic, found._light = notes[-4:]
        return found

    def attrs(self, bounds: np.ndarray | None, dispersion: bool) -> dict[str, str | int | float]:
        """Return the attributes of the cube.

        Args:
            bounds: (3, K) of :meth:`optsim.render.estimate.ErrorBars.bounds`, None without standard errors.
            dispersion: whether glass disperses.
        """
        if self._pixels == 0:
            return {}
        told: dict[str, str | int | float] = {"caustic_share": float(self._caustic / self._light) if self._light > 0 else 0.0}
        if not dispersion:
            return told
        share = self._shown / self._pixels
        told["dispersed_share"] = float(share)
        if bounds is None:
            return told
        worst = int(np.argmax(bounds[0]))
        error, total = float(bounds[0, worst]), self._squares[worst]
        part = float(self._dispersed[worst] / total) if total > 0 else 0.0
        for name, squares, pixels in (("dispersed", part, share), ("elsewhere", 1 - part, 1 - share)):
            told[f"error_{name}"] = error * float(np.sqrt(squares / pixels)) if pixels > 0 else 0.0
        return told


def level(weights: np.ndarray) -> float:
    """Return the mean radiance of the bands for a transport of 1, from the (K, n) weights of a light group."""
    return float(weights.sum(1).mean())
