"""Spectral curves of a user's sensor, read from a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np

from optsim.errors import InputError
from scenes.errors import InputError as SpectrumError
from scenes.spectrum import Spectrum

MAX_ROWS = 100_000


def curves_from_csv(path: str | PathLike[str], names: Sequence[str]) -> dict[str, Spectrum]:
    """Read quantum efficiencies by wavelength; nothing is rescaled or assumed beyond the rows.

    Args:
        path: of a CSV file whose first row names the columns: ``wavelength_nm`` and one for each curve, in any order;
            lines that begin with # are skipped. Wavelengths increase; efficiencies are in [0, 1].
        names: the curves that are wanted.

    Raises:
        InputError: field ``sensor.csv`` when the file can't be read, a column is missing or unknown, or a cell is no
            number (with its line); ``sensor.csv.NAME`` for a value out of range.
    """
    columns, cells = _table(Path(path))
    wanted = {"wavelength_nm", *names}
    if set(columns) != wanted or len(columns) != len(wanted):
        raise InputError("sensor.csv", ", ".join(columns), f"a first row with the columns wavelength_nm, {', '.join(names)}")
    table = np.array(cells)
    grid = table[:, columns.index("wavelength_nm")]
    curves = {}
    for name in names:
        values = table[:, columns.index(name)]
        try:
            curve = Spectrum(grid, values, f"{Path(path).name} {name}")
        except SpectrumError as error:
            raise InputError(f"sensor.csv.{name}", error.value, error.allowed) from None
        if curve.minimum < 0 or curve.maximum > 1:
            bad = curve.minimum if curve.minimum < 0 else curve.maximum
            raise InputError(f"sensor.csv.{name}", bad, "in [0, 1] at every wavelength (not in percent)")
        curves[name] = curve
    return curves


def _table(path: Path) -> tuple[list[str], list[list[float]]]:
    """Return the column names and the rows of numbers."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("sensor.csv", str(path), f"a readable CSV file ({error.__class__.__name__})") from None
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not 3 <= len(lines) <= MAX_ROWS:
        raise InputError("sensor.csv", f"{len(lines)} rows", f"a row of names and 2 to {MAX_ROWS - 1} rows of numbers")
    columns = [name.strip() for name in next(csv.reader([lines[0][1]]))]
    rows = []
    for number, line in lines[1:]:
        try:
            row = [float(cell) for cell in next(csv.reader([line]))]
        except ValueError:
            row = []
        if len(row) != len(columns):
            raise InputError("sensor.csv", line[:60], f"{len(columns)} numbers in line {number}")
        rows.append(row)
    return columns, rows
