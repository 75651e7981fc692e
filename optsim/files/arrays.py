"""Single arrays (frames, masks) out of foreign files, through the limited child process."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from optsim.errors import InputError
from optsim.files.reader import Reader
from optsim.files.recognise import recognise

STACKS = {"mat5": ("y", "x", "shot"), "hdf5": ("y", "x", "shot"), "npy": ("shot", "y", "x"), "png": ("y", "x", "channel")}
"""Axes of a stack of pictures that nobody has stated; of MATLAB files as MATLAB shows them."""


def read_pictures(
    path: Path | str,
    known: Sequence[str],
    *,
    variable: str | None = None,
    axes: Sequence[str] | None = None,
    reader: Reader | None = None,
    options: tuple[str, str] = ("--variable", "--axes"),
) -> np.ndarray:
    """Read a picture or a stack of pictures as (shot, channel, y, x).

    Args:
        path: MATLAB, NumPy, HDF5 or PNG file.
        known: names to look for, in this order, where the file holds several arrays.
        variable: name of the array; None: the only one of two to four axes, or the first known one.
        axes: of the stored array in its order, out of shot, channel, y, x; None: y, x for a picture, for a stack as its format has it.
        reader: decodes the file; None: a child process of its own.
        options: what ``variable`` and ``axes`` are called in errors.

    Raises:
        InputError: naming file or array.
    """
    path = Path(path)
    source = recognise(path)
    with ExitStack() as closing:
        reader = closing.enter_context(Reader()) if reader is None else reader
        arrays = {a.name: a for a in reader.survey(source) if 2 <= len(a.shape) <= 4 and min(a.shape[:2]) > 1}
        listed = ", ".join(f"{a.name} {a.shape}" for a in list(arrays.values())[:10]) or "no picture"
        names = [variable] if variable is not None else [name for name in known if name in arrays] or list(arrays)
        if variable is None and len(arrays) > 1 and names[0] not in known:
            raise InputError(options[0], listed, f"the name of one of the arrays of {path.name}")
        if not names or names[0] not in arrays:
            raise InputError(options[0], variable, f"a picture in {path.name}: {listed}")
        found = arrays[names[0]]
        order: tuple[str, ...] = ("y", "x") if len(found.shape) == 2 else STACKS.get(source.format, ())
        if axes is not None:
            order = tuple(axes)
        if len(order) != len(found.shape) or len(set(order)) != len(order) or not {"y", "x"} <= set(order) <= {"shot", "channel", "y", "x"}:
            raise InputError(
                options[1],
                found.shape if axes is None else ",".join(axes),
                f"out of shot, channel, y, x, one for each axis of {path.name}:{found.name} {found.shape}",
            )
        values = reader.read(source, found)
    stack = _as_stack(values, order)
    return _opaque(stack, path) if source.format == "png" else stack


def _opaque(stack: np.ndarray, path: Path) -> np.ndarray:
    """Leave out a picture's transparent layer, which must be the same everywhere.

    Raises:
        InputError: naming the file.
    """
    if stack.shape[1] not in (2, 4):
        return stack
    if np.ptp(stack[:, -1]) > 0:
        raise InputError(path.name, "a transparency that varies", "opaque, or transparent alike everywhere")
    return stack[:, :-1]


def _as_stack(values: np.ndarray, order: Sequence[str]) -> np.ndarray:
    """Return (shot, channel, y, x)."""
    names = list(order)
    for name in ("shot", "channel"):
        if name not in names:
            values, names = values[None], [name, *names]
    return np.transpose(values, [names.index(name) for name in ("shot", "channel", "y", "x")])
