"""ENVI: a text header beside raw numbers. Read here and not through Spectral Python, which allocates what a header claims unseen."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from typing import IO

import numpy as np

from optsim.errors import InputError
from optsim.files.importers.found import Found, as_found, little

LIBRARIES: tuple[str, ...] = ()
"""Imported by the child before the clock runs."""
NAME = "cube"
LONGEST_HEADER = 4 << 20
TYPES = {1: "u1", 2: "i2", 3: "i4", 4: "f4", 5: "f8", 12: "u2", 13: "u4", 14: "i8", 15: "u8"}
ORDER = {0: "<", 1: ">"}
AXES = {"bsq": ("wavelength", "y", "x"), "bil": ("y", "wavelength", "x"), "bip": ("y", "x", "wavelength")}
ENTRY = re.compile(r"^[ \t]*([^=\n{}]+?)[ \t]*=[ \t]*(\{[^}]*\}|[^\n]*)", re.MULTILINE)


def survey(files: Sequence[IO[bytes]]) -> list[Found]:
    """Describe the cube from its header, and see that the data file is long enough."""
    header_file, data_file = files
    header = parse(header_file.read(LONGEST_HEADER + 1))
    shape, dtype, start = _layout(header)
    found = math.prod(shape) * dtype.itemsize
    held = os.fstat(data_file.fileno()).st_size - start
    if found > held:
        size = " x ".join(str(_whole(header, key)) for key in ("lines", "samples", "bands"))
        raise InputError("lines x samples x bands", f"{size}, {found} bytes", f"at most the {max(held, 0)} bytes of data")
    return [
        Found(
            name=NAME,
            shape=shape,
            dtype=little(dtype),
            axes=AXES[_interleave(header)],
            wavelengths=_numbers(header, "wavelength"),
            unit=header.get("wavelength units", ""),
            gain=_numbers(header, "data gain values"),
            divisor=_divisor(header),
            offset=_numbers(header, "data offset values"),
            ignore=_ignored(header),
            compressed=False,
            quantity="reflectance" if "reflectance scale factor" in header else "as in the file",
        )
    ]


def read(files: Sequence[IO[bytes]], name: str) -> np.ndarray:
    """Read the numbers in the order of the file."""
    header_file, data_file = files
    shape, dtype, start = _layout(parse(header_file.read(LONGEST_HEADER + 1)))
    data_file.seek(start)
    values = np.fromfile(data_file, dtype, math.prod(shape))
    return as_found(values.reshape(shape))


def parse(data: bytes) -> dict[str, str]:
    """Return the header's entries, keys in lower case, lists without their braces.

    Raises:
        InputError: ``header`` when it does not start with ENVI or is over 4 MiB.
    """
    if len(data) > LONGEST_HEADER:
        raise InputError("header", f"{len(data)} bytes", f"at most {LONGEST_HEADER} bytes")
    text = data.decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n").lstrip("\ufeff")
    first, _, rest = text.partition("\n")
    if first.strip() != "ENVI":
        raise InputError("header", first[:40], "text whose first line is ENVI")
    return {" ".join(match[1].lower().split()): match[2].strip().strip("{}").strip() for match in ENTRY.finditer(rest)}


def _layout(header: dict[str, str]) -> tuple[tuple[int, ...], np.dtype, int]:
    """Return shape in the order of the file, type, and where the numbers start."""
    if _whole(header, "file compression", 0) != 0:
        raise InputError("file compression", header["file compression"], "0: not compressed")
    size = {"y": _whole(header, "lines"), "x": _whole(header, "samples"), "wavelength": _whole(header, "bands")}
    kind, order = _whole(header, "data type"), _whole(header, "byte order", 0)
    if kind not in TYPES:
        raise InputError("data type", kind, f"one of {', '.join(map(str, TYPES))} (real numbers)")
    if order not in ORDER:
        raise InputError("byte order", order, "0 or 1")
    for key, count in zip(("lines", "samples", "bands"), size.values()):
        if not 1 <= count <= 2**31:
            raise InputError(key, count, "from 1 to 2^31")
    start = _whole(header, "header offset", 0)
    if not 0 <= start <= 2**40:
        raise InputError("header offset", start, "from 0 to 2^40 bytes")
    return tuple(size[axis] for axis in AXES[_interleave(header)]), np.dtype(ORDER[order] + TYPES[kind]), start


def _interleave(header: dict[str, str]) -> str:
    word = header.get("interleave", "bsq").lower()
    if word not in AXES:
        raise InputError("interleave", word, f"one of {', '.join(AXES)}")
    return word


def _whole(header: dict[str, str], key: str, default: int | None = None) -> int:
    text = header.get(key)
    if text is None and default is not None:
        return default
    if text is None or not re.fullmatch(r"[+-]?\d{1,18}", text):
        raise InputError(key, "nothing" if text is None else text, "a whole number")
    return int(text)


def _numbers(header: dict[str, str], key: str) -> tuple[float, ...]:
    if key not in header:
        return ()
    parts = [part.strip() for part in header[key].split(",") if part.strip()]
    try:
        values = [float(part) for part in parts]
    except ValueError:
        raise InputError(key, header[key][:80], "a list of numbers") from None
    if not np.isfinite(values).all() or len(values) != _whole(header, "bands"):
        raise InputError(key, len(values), f"{_whole(header, 'bands')} finite numbers, one a band")
    return tuple(values)


def _divisor(header: dict[str, str]) -> float:
    factor = _float(header, "reflectance scale factor") if "reflectance scale factor" in header else 1.0
    if not factor > 0:
        raise InputError("reflectance scale factor", factor, "above 0")
    return factor


def _ignored(header: dict[str, str]) -> float | None:
    return _float(header, "data ignore value") if "data ignore value" in header else None


def _float(header: dict[str, str], key: str) -> float:
    try:
        value = float(header[key])
    except ValueError:
        raise InputError(key, header[key][:80], "a number") from None
    if not math.isfinite(value):
        raise InputError(key, header[key][:80], "a finite number")
    return value
