"""Input files of verbs, and errors in the words that the user typed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

FRAMES_ONLY = (".nc",)
"""Endings of files of frames: OpenEXR holds cubes."""


def read_frames(path: Path) -> xr.Dataset:
    """Read a file and insist that it holds frames.

    Raises:
        InputError: naming the file, and what is wrong with it.
    """
    from optsim.camera import check_frames
    from optsim.files import read

    data = read(path)
    if "radiance" in data and "frames" not in data:
        kind = "an estimate" if data.attrs.get("kind") == "estimate" else "a cube"
        raise InputError(str(path), kind, "frames, as measure or import-measurement writes them")
    with named_by({}, before=f"{path}: "):
        check_frames(data)
    return data


@contextmanager
def named_by(names: Mapping[str, str], before: str = "") -> Iterator[None]:
    """Rename the fields of errors: to what the user typed, or with a file's name before them.

    Args:
        names: field -> what it is called; others stay.
        before: put before a field that is not renamed.
    """
    try:
        yield
    except InputError as error:
        raise InputError(names.get(error.field, before + error.field), error.value, error.allowed) from None
