"""What a decoder says of an array in a file, before anything of it is read."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

Length = Annotated[int, Field(ge=0, le=2**40)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Short = Annotated[str, Field(max_length=500)]
NUMERIC = "fiub"
MOST_ARRAYS = 1000
"""A file's list of arrays ends here."""


class Found(BaseModel):
    """Describe one numeric array of a file.

    Args:
        name: as the file has it, or as its format calls the picture.
        shape: of 1 to 5 axes.
        dtype: little-endian NumPy type, such as ``<f4``.
        axes: names of the axes where the format or the file knows them, else empty.
        wavelengths: of the bands as the file gives them, in ``unit``; empty when it doesn't.
        unit: of the wavelengths, as the file says it; of a one-dimensional array: of its values.
        gain: what the values are to be multiplied by, one number or one a band; empty: 1.
        offset: what is then to be added, likewise; empty: 0.
        divisor: what the result is then to be divided by.
        ignore: the value that stands for no data.
        compressed: whether the file may be smaller than the array.
        quantity: what the format says that the values are.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Short
    shape: Annotated[tuple[Length, ...], Field(min_length=1, max_length=5)]
    dtype: Annotated[str, Field(pattern=r"^[<|][fiub](1|2|4|8)$")]
    axes: Annotated[tuple[Short, ...], Field(max_length=5)] = ()
    wavelengths: Annotated[tuple[Number, ...], Field(max_length=10_000)] = ()
    unit: Short = ""
    gain: Annotated[tuple[Number, ...], Field(max_length=10_000)] = ()
    offset: Annotated[tuple[Number, ...], Field(max_length=10_000)] = ()
    divisor: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    ignore: Number | None = None
    compressed: bool = True
    quantity: Short = ""

    @property
    def size(self) -> int:
        """Return the number of bytes when unpacked."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize


def little(dtype: np.dtype | type) -> str:
    """Return the name of a type in little-endian order."""
    return np.dtype(dtype).newbyteorder("<").str


def as_found(values: np.ndarray) -> np.ndarray:
    """Return values as :class:`Found` announces them: C-contiguous and little-endian."""
    return np.ascontiguousarray(values, np.dtype(little(values.dtype)))
