"""Single arrays (frames, masks) out of foreign files, through the limited child process."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from optsim.errors import InputError
from optsim.files.importers.found import Found
from optsim.files.reader import Reader, Source
from optsim.files.recognise import recognise

STACKS = {"mat5": ("y", "x", "shot"), "hdf5": ("y", "x", "shot"), "npy": ("shot", "y", "x"), "png": ("y", "x", "channel")}
"""Axes of a stack of pictures that nobody has stated; of MATLAB files as MATLAB shows them."""
NAMED_STACKS = {"simulation_test": ("scene", "y", "x")}
"""Axes of arrays that the benchmark's programs know by name: its test set holds scenes, each photographed once."""
AXES = ("scene", "shot", "channel", "y", "x")


def read_pictures(
    path: Path | str,
    known: Sequence[str],
    *,
    variable: str | None = None,
    axes: Sequence[str] | None = None,
    scene: int | None = None,
    reader: Reader | None = None,
    options: tuple[str, str] = ("--variable", "--axes"),
) -> np.ndarray:
    """Read a picture or a stack of pictures as (shot, channel, y, x).

    Args:
        path: MATLAB, NumPy, HDF5 or PNG file.
        known: names to look for, in this order, where the file holds several arrays.
        variable: name of the array; None: the only one of two to four axes, or the first known one.
        axes: of the stored array in its order, out of scene, shot, channel, y, x; None: y, x for a picture, for a stack as its name or
            its format has it.
        scene: which one of an array of scenes, from 1; None: the only one.
        reader: decodes the file; None: a child process of its own.
        options: what ``variable`` and ``axes`` are called in errors.

    Raises:
        InputError: naming file, array or option.
    """
    path = Path(path)
    source = recognise(path)
    with ExitStack() as closing:
        reader = closing.enter_context(Reader()) if reader is None else reader
        found = _chosen(path, reader.survey(source), known, variable, options[0])
        order = tuple(axes) if axes is not None else _usual_axes(source, found)
        if len(order) != len(found.shape) or len(set(order)) != len(order) or not {"y", "x"} <= set(order) <= set(AXES):
            form = f"out of {', '.join(AXES)}, one for each axis of {path.name}:{found.name} {found.shape}"
            raise InputError(options[1], found.shape if axes is None else ",".join(axes), form)
        values = reader.read(source, found)
    values, order = _one_scene(values, order, scene, f"{path.name}:{found.name}")
    stack = _as_stack(values, order)
    return _opaque(stack, path) if source.format == "png" else stack


def _chosen(path: Path, arrays: Sequence[Found], known: Sequence[str], variable: str | None, option: str) -> Found:
    pictures = {a.name: a for a in arrays if 2 <= len(a.shape) <= 4 and sum(n > 1 for n in a.shape) >= 2}
    listed = ", ".join(f"{a.name} {a.shape}" for a in list(pictures.values())[:10]) or "no picture"
    names = [variable] if variable is not None else [name for name in known if name in pictures] or list(pictures)
    if variable is None and len(pictures) > 1 and names[0] not in known:
        raise InputError(option, listed, f"the name of one of the arrays of {path.name}")
    if not names or names[0] not in pictures:
        raise InputError(option, variable, f"a picture in {path.name}: {listed}")
    return pictures[names[0]]


def _usual_axes(source: Source, found: Found) -> tuple[str, ...]:
    """Return what the axes of an array are when nobody has stated them; a first axis of 1 is no picture's row."""
    if len(found.shape) == 2:
        return "y", "x"
    if found.name in NAMED_STACKS:
        return NAMED_STACKS[found.name]
    return ("shot", "y", "x") if len(found.shape) == 3 and found.shape[0] == 1 else STACKS.get(source.format, ())


def _one_scene(values: np.ndarray, order: tuple[str, ...], scene: int | None, name: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return one scene of the array, and the axes that are left.

    Raises:
        InputError: ``--scene``.
    """
    if "scene" not in order:
        if scene is not None:
            raise InputError("--scene", scene, f"absent, as {name} {values.shape} has the axes {', '.join(order)} (--axes states others)")
        return values, order
    axis = order.index("scene")
    count = values.shape[axis]
    if not (count == 1 if scene is None else 1 <= scene <= count):
        raise InputError("--scene", scene, f"from 1 to {count}, one of the scenes in {name} {values.shape}")
    return np.take(values, 0 if scene is None else scene - 1, axis), tuple(word for word in order if word != "scene")


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
