"""A folder of PNG pictures, one a band, as the CAVE set has them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from optsim.errors import InputError
from optsim.files.guard import declared_size
from optsim.files.reader import Reader
from optsim.files.recognise import recognise

CAVE_NM = tuple(400.0 + 10 * k for k in range(31))
CAVE = re.compile(r"_ms_(\d+)$")
NUMBER = re.compile(r"(\d+(?:[.,]\d+)?)\s*(nm)?$")
MOST = 1000
SHORTEST_NM = 200
"""Numbers at the end of names are wavelengths from here on, else they count."""


def pictures(folder: Path) -> tuple[list[Path], tuple[float, ...]]:
    """Return a folder's PNG files by increasing band, and the wavelengths in nm that their names tell; none when they only count.

    Names that end in ``_ms_01`` to ``_ms_31`` are the CAVE set's: 400 to 700 nm. A folder that holds one folder only stands for it.

    Raises:
        InputError: when there are fewer than two, a band is missing or named twice, or a name has no number.
    """
    found = _inside(folder)
    numbers = []
    for path in found:
        match = NUMBER.search(path.stem)
        if match is None:
            raise InputError("file", str(path), "named with its band's number or wavelength at the end")
        numbers.append(float(match[1].replace(",", ".")))
    order = np.argsort(numbers, kind="stable")
    found, numbers = [found[i] for i in order], [numbers[i] for i in order]
    if len(set(numbers)) != len(numbers):
        raise InputError("file", [path.name for path in found][:6], "one picture a band")
    if numbers[0] >= SHORTEST_NM:
        return found, tuple(numbers)
    missing = sorted(set(range(int(numbers[0]), int(numbers[-1]) + 1)) - {int(n) for n in numbers})
    if missing:
        raise InputError("file", f"{folder.name}: no picture {', '.join(map(str, missing[:5]))}", "every band's picture")
    if all(CAVE.search(path.stem) for path in found):
        if len(found) != len(CAVE_NM):
            raise InputError("file", f"{folder.name}: {len(found)} pictures", f"{len(CAVE_NM)} pictures, as the CAVE set has them")
        return found, CAVE_NM
    return found, ()


def stack(folder: Path, reader: Reader) -> tuple[np.ndarray, tuple[float, ...], str]:
    """Return (y, x, wavelength) float32 of full scale 1, the wavelengths that the names tell, and what the values are.

    Raises:
        InputError: naming the picture that is damaged, coloured, or of another size.
    """
    paths, wavelengths = pictures(folder)
    result, scales = np.zeros((0, 0, 0), np.float32), set()
    for k, path in enumerate(paths):
        source = recognise(path)
        if source.format != "png":
            raise InputError("file", str(path), f"a PNG picture (this is {source.title})")
        (found,) = reader.survey(source)
        if k == 0:
            shape = (*found.shape[:2], len(paths))
            declared_size(folder.name, shape, 4)
            result = np.empty(shape, np.float32)
        if found.shape[:2] != result.shape[:2]:
            raise InputError(f"{path.name}:shape", found.shape[:2], f"{result.shape[:2]}, as {paths[0].name}")
        full = float(np.iinfo(found.dtype).max)
        scales.add(full)
        result[:, :, k] = _gray(reader.read(source, found), path) / full
    return result, wavelengths, f"value / {' or '.join(f'{full:g}' for full in sorted(scales))}"


def _gray(values: np.ndarray, path: Path) -> np.ndarray:
    """Return one channel of a picture whose colours are all the same (one scene of CAVE is stored so)."""
    if values.ndim == 2:
        return values.astype(np.float64)
    if values.shape[2] > 2 and np.any(values[..., 1:3] != values[..., :1]):
        raise InputError(f"{path.name}:channels", "colours", "gray: red, green and blue the same")
    return values[..., 0].astype(np.float64)


def _inside(folder: Path) -> list[Path]:
    for _ in range(3):
        entries = sorted(folder.iterdir())[: 10 * MOST]
        found = [path for path in entries if path.suffix.lower() == ".png" and not path.name.startswith(".")]
        folders = [path for path in entries if path.is_dir()]
        if found or len(folders) != 1:
            break
        (folder,) = folders
    if not 2 <= len(found) <= MOST:
        raise InputError("file", f"{folder}: {len(found)} pictures", f"a folder of 2 to {MOST} PNG pictures, one a band")
    return found
