"""Mean and variance over independent passes, in float64, one pass at a time; saved and resumed."""

from __future__ import annotations

import os
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np


class Replicates:
    """Accumulate equally weighted replicates of an array (Welford 1962).

    Args:
        shape: shape of one replicate.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.count = 0
        self.mean = np.zeros(shape)
        self.scatter = np.zeros(shape)

    def add(self, sample: np.ndarray) -> None:
        """Take in one replicate; ``sample`` is used as scratch space."""
        self.count += 1
        for mean, scatter, x in zip(self.mean, self.scatter, sample):  # row by row: half the memory traffic of whole arrays
            x -= mean
            mean += x / self.count
            scatter += x * x * (1 - 1 / self.count)

    def squared_error(self) -> np.ndarray:
        """Return the estimated variance of the mean; needs at least two replicates."""
        return self.scatter / (self.count * (self.count - 1))


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
