"""NumPy's own format, without pickled objects."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import IO

import numpy as np
from numpy.lib import format as npy

from optsim.errors import InputError
from optsim.files.importers.found import NUMERIC, Found, as_found, little

LIBRARIES: tuple[str, ...] = ()
"""Imported by the child before the clock runs."""
NAME = "array"


def survey(files: Sequence[IO[bytes]]) -> list[Found]:
    """Describe the file's array, and see that the file is as long as its header says."""
    (file,) = files
    shape, _, dtype = _header(file)
    missing = int(np.prod([int(n) for n in shape], dtype=object)) * dtype.itemsize - (os.fstat(file.fileno()).st_size - file.tell())
    if missing > 0:
        raise InputError("shape", shape, f"of no more numbers than the file holds ({missing} bytes are missing)")
    return [Found(name=NAME, shape=shape or (1,), dtype=little(dtype), compressed=False)]


def read(files: Sequence[IO[bytes]], name: str) -> np.ndarray:
    """Read the array."""
    (file,) = files
    return as_found(np.atleast_1d(npy.read_array(file, allow_pickle=False)))


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    version = npy.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise InputError("version", version, "1.0 or 2.0")
    header = npy.read_array_header_1_0(file) if version == (1, 0) else npy.read_array_header_2_0(file)
    dtype = header[2]
    if dtype.kind not in NUMERIC or dtype.itemsize > 8 or dtype.hasobject:
        raise InputError("dtype", str(dtype), "real numbers of at most 8 bytes")
    return header
