"""MATLAB files of version 5 to 7.2, through SciPy, which is not hardened against damaged ones (wrong tags end it by a signal)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import IO

import numpy as np

from optsim.errors import InputError
from optsim.files.importers.found import MOST_ARRAYS, Found, as_found, little

LIBRARIES = ("scipy.io",)
"""Imported by the child before the clock runs."""
CLASSES: dict[str, type[np.generic]] = {
    "double": np.float64,
    "single": np.float32,
    "logical": np.bool_,
    **{f"{sign}int{bits}": np.dtype(f"{sign}int{bits}").type for sign in ("", "u") for bits in (8, 16, 32, 64)},
}


def survey(files: Sequence[IO[bytes]]) -> list[Found]:
    """List the numeric arrays from their headers; shapes as MATLAB shows them."""
    from scipy.io import whosmat

    (file,) = files
    return [
        Found(name=name, shape=shape, dtype=little(CLASSES[kind]))
        for name, shape, kind in whosmat(file)[:MOST_ARRAYS]
        if kind in CLASSES and 1 <= len(shape) <= 5
    ]


def read(files: Sequence[IO[bytes]], name: str) -> np.ndarray:
    """Read one array.

    Raises:
        InputError: ``name`` when it is missing or complex.
    """
    from scipy.io import loadmat

    (file,) = files
    values = loadmat(file, variable_names=[name], mat_dtype=True).get(name)
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiub":
        raise InputError(name, str(getattr(values, "dtype", "missing")), "an array of real numbers")
    return as_found(values)
