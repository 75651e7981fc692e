"""NumPy arrays handed to Dr.Jit at one alignment, so that its kernels are compiled once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

_BOUNDARY = 64


def aligned(values: ArrayLike, dtype: Any = np.float64) -> np.ndarray:
    """Return a flat copy that starts on a 64-byte boundary.

    Dr.Jit works in NumPy's memory, and its alignment is part of a kernel's identity: memory that lies otherwise, as
    chance has it, compiles a kernel anew.
    """
    source = np.asarray(values, dtype).ravel()
    room = np.empty(source.nbytes + _BOUNDARY, np.uint8)
    start = -room.ctypes.data % _BOUNDARY
    copy = room[start : start + source.nbytes].view(source.dtype)
    copy[...] = source
    return copy
