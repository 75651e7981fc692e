"""Mean and variance over independent passes, in float64, one pass at a time; saved and resumed."""

from __future__ import annotations

import os
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from optsim.render.tiles import Tiles


class Replicates:
    """Accumulate equally weighted replicates of an array (Welford 1962); pixels may sit out.

    Args:
        shape: (nodes, pixels) of one replicate.
        weights: (K, nodes) from nodes to bands, when the scatter of bands is wanted too.
        tiles: over which the scatter of bands is summed.

    Attributes:
        counts: (pixels,) replicates so far.
        mean, scatter: of that shape; sum of squares about the mean.
        band_scatter: (tiles, K) sums over tiles of the bands' scatter, or None.
    """

    def __init__(self, shape: tuple[int, int] | tuple[int, ...], weights: np.ndarray | None = None, tiles: Tiles | None = None) -> None:
        self.counts = np.zeros(shape[-1], np.int64)
        self.mean = np.zeros(shape)
        self.scatter = np.zeros(shape)
        self._weights, self._tiles = weights, tiles
        self.band_scatter = np.zeros((tiles.count, len(weights))) if weights is not None and tiles is not None else None

    @property
    def count(self) -> int:
        """Return the least number of replicates of any pixel."""
        return int(self.counts.min(initial=np.iinfo(np.int64).max)) if self.counts.size else 0

    def add(self, sample: np.ndarray, active: np.ndarray | None = None) -> None:
        """Take in one replicate; ``sample`` is used as scratch space. Where ``active`` is False it is ignored."""
        self.counts += 1 if active is None else active
        share = 1 / np.maximum(self.counts, 1)
        rest = 1 - share if active is None else np.where(active, 1 - share, 0)
        for mean, scatter, x in zip(self.mean, self.scatter, sample):  # row by row: half the memory traffic of whole arrays
            x -= mean
            if active is not None:
                x[~active] = 0
            mean += x * share
            scatter += x * x * rest
        if self.band_scatter is None or self._weights is None or self._tiles is None:
            return
        with threadpool_limits(1):  # one BLAS thread: the same bytes whatever the number of cores
            for block in self._tiles.blocks():
                bands = self._weights @ sample[:, block]
                self.band_scatter += self._tiles.sums(bands * bands * rest[block], block)

    def squared_error(self) -> np.ndarray:
        """Return the estimated variance of the mean; needs at least two replicates."""
        return self.scatter / (self.counts * (self.counts - 1))


def save(path: Path, digest: str, state: dict[str, np.ndarray | float | int]) -> None:
    """Write a checkpoint under a temporary name, then rename it into place."""
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.name, suffix=".tmp", delete=False) as file:
        try:
            arrays: dict[str, Any] = {key: np.asarray(value) for key, value in state.items()}
            np.savez(file, digest=np.array(digest), **arrays)
            file.flush()
            os.fsync(file.fileno())
        except BaseException:
            os.unlink(file.name)
            raise
    os.replace(file.name, path)


def load(path: Path, digest: str) -> dict[str, np.ndarray] | None:
    """Read a checkpoint of the same configuration; None when there is none, it is another's, or it cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as file:
            if str(file["digest"]) != digest:
                return None
            return {key: file[key] for key in file.files if key != "digest"}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
