"""One PNG picture of 8 or 16 bits, through Pillow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import IO, TYPE_CHECKING

import numpy as np

from optsim.errors import InputError
from optsim.files.importers.found import Found, as_found

if TYPE_CHECKING:
    from PIL.Image import Image

LIBRARIES = ("PIL.Image", "PIL.PngImagePlugin")
"""Imported by the child before the clock runs."""
NAME = "picture"
MODES: dict[str, tuple[str, int]] = {
    "1": ("|u1", 1),
    "L": ("|u1", 1),
    "I;16": ("<u2", 1),
    "I": ("<u2", 1),
    "LA": ("|u1", 2),
    "RGB": ("|u1", 3),
    "RGBA": ("|u1", 4),
}
"""Type and channels of Pillow's modes."""


def survey(files: Sequence[IO[bytes]]) -> list[Found]:
    """Describe the picture from its header."""
    picture = _opened(files)
    dtype, channels = MODES[picture.mode]
    many = 1 if channels > 1 else 0
    shape = (picture.height, picture.width, channels)[: 2 + many]
    return [Found(name=NAME, shape=shape, dtype=dtype, axes=("y", "x", "channel")[: 2 + many])]


def read(files: Sequence[IO[bytes]], name: str) -> np.ndarray:
    """Decode the picture; a truncated one is refused by Pillow."""
    picture = _opened(files)
    dtype, _ = MODES[picture.mode]
    values = np.asarray(picture.convert("L") if picture.mode == "1" else picture)
    return as_found(values.astype(dtype))


def _opened(files: Sequence[IO[bytes]]) -> Image:
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None  # the declared size is judged by the parent, against the file's
    (file,) = files
    picture = Image.open(file, formats=["PNG"])
    if picture.mode not in MODES:
        raise InputError("mode", picture.mode, f"one of {', '.join(MODES)}")
    raw = str(picture.tile[0][3]) if picture.tile else ""
    if MODES[picture.mode][1] > 1 and "16" in raw:
        raise InputError("mode", raw, "gray, or colour of 8 bits: Pillow keeps 8 of the 16 bits of a colour")
    if getattr(picture, "n_frames", 1) != 1:
        raise InputError("frames", picture.n_frames, "1: one picture, not an animation")  # type: ignore[attr-defined]
    return picture
