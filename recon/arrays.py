"""Numbers from outside: taken as arrays of real numbers, or refused with the count and the place of what is wrong."""

from typing import Any

import numpy as np

from recon.errors import InputError

REAL = "iuf"
"""Kinds of NumPy types that are real numbers."""


def real_array(field: str, value: Any, *, axes: str = "", kinds: str = REAL, instead: str = "") -> np.ndarray:
    """Return ``value`` as an array of its own type.

    Args:
        field: what errors call it.
        value: an array or what NumPy makes one of.
        axes: names of the axes for errors, e.g. `` (row, column, band)``.
        kinds: of NumPy types that are allowed.
        instead: what to do with masked values in place of masking them.

    Raises:
        InputError: for masked values, which NumPy would forget to be masked, ragged lists, complex numbers, text and objects.
    """
    if np.ma.is_masked(value):
        masked = np.ma.getmaskarray(value)
        what = f"without masked values, first{axes} is {_place(masked)}: a solve can't see the mask{instead}"
        raise InputError(field, f"{int(masked.sum())} of {masked.size} masked", what)
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(field, type(value).__name__, f"an array of real numbers, not ragged ({error})") from None
    if array.dtype.kind not in kinds:
        raise InputError(field, value if array.ndim == 0 else f"an array of {array.dtype}", "real numbers")
    return array


def as_double(array: np.ndarray) -> np.ndarray:
    """Return a copy in float64; what float64 can't hold becomes infinite, which ``require`` then finds."""
    with np.errstate(over="ignore"):
        return array.astype(np.float64)


def require(field: str, values: np.ndarray, good: np.ndarray, allowed: str, axes: str = "") -> None:
    """Raise ``InputError`` for the first value that is not ``good``, with the count of such values and its place.

    Args:
        field: what the error calls the array.
        values: the array.
        good: bool of the same shape; comparisons are False for NaN, as wanted.
        allowed: the allowed range with its unit.
        axes: as for ``real_array``.
    """
    count = int(good.size - np.count_nonzero(good))
    if count == 0:
        return
    where = _place(~good)
    found = f"{allowed}; {count} value{' is' if count == 1 else 's are'} not"
    raise InputError(field, float(values[where]), found + (f", first{axes} is {where}" if where else ""))


def _place(bad: np.ndarray) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), bad.shape))
