"""Spectra as scene files write them: a number, a name, a formula, a table, or a CSV beside the scene file."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from scenes import library
from scenes.errors import InputError
from scenes.meshes import read_regular
from scenes.model import did_you_mean
from scenes.spectrum import Spectrum

MAX_BYTES = 2**20
BLACKBODY_NODES_NM = np.arange(250.0, 2501.0, 5.0)
FORMS: dict[str, tuple[str, ...]] = {
    "wavelength_nm": ("value", "name"),
    "csv": ("column",),
    "reflectance": (),
    "illuminant": (),
    "blackbody_K": (),
    "line_nm": ("width_nm",),
    "lines_nm": ("power", "width_nm"),
}
"""The keys that say what a spectrum table is, and what may stand beside each (``scale`` always may)."""


def inside(folder: Path, name: Any, field: str) -> Path:
    """Return the path of a file that a scene file names, if it lies in the scene file's own folder.

    Raises:
        InputError: for an absolute path, one that climbs out, or a link that leads out.
    """
    allowed = "a relative path of a file inside the scene file's own folder"
    if not isinstance(name, str) or not name or "\0" in name or Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(field, name, allowed)
    try:
        home = folder.resolve()
        path = (home / name).resolve()
    except (OSError, RuntimeError):
        raise InputError(field, name, allowed) from None
    if not path.is_relative_to(home):
        raise InputError(field, name, f"{allowed} (this one leads to {path.parent})")
    return path


def parse_spectrum(value: Any, field: str, folder: Path | None, names: Callable[[str], Spectrum] | None) -> Any:
    """Turn a file's value into a Spectrum; numbers are passed on for the model to spread over all wavelengths.

    Args:
        value: number, name, or table with exactly one of the keys of ``FORMS`` and an optional ``scale``.
        field: dotted name for messages.
        folder: where CSV files may lie; None allows none.
        names: what a bare name is looked up in; None allows none.

    Raises:
        InputError: naming the field and the form expected.
    """
    if isinstance(value, str) and names is not None:
        return under(field, names, value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    if not isinstance(value, dict):
        kinds = "a number, a name," if names else "a number"
        raise InputError(field, value, f"{kinds} or a table with one of {', '.join(FORMS)}")
    forms = [key for key in FORMS if key in value]
    if len(forms) != 1:
        raise InputError(field, sorted(value), f"a table with exactly one of {', '.join(FORMS)}")
    require_keys(value, (forms[0], *FORMS[forms[0]], "scale"), field)
    spectrum = under(field, _read, value, forms[0], field, folder)
    return under(field, spectrum.scaled, _number(value["scale"], f"{field}.scale")) if "scale" in value else spectrum


def _read(value: dict[str, Any], form: str, field: str, folder: Path | None) -> Spectrum:
    if form == "wavelength_nm":
        return Spectrum(value[form], value.get("value", []), str(value.get("name", "")))
    if form == "csv":
        if folder is None:
            raise InputError("csv", value[form], "left out: this scene has no folder of its own")
        return read_csv(inside(folder, value[form], f"{field}.csv"), value.get("column"))
    if form == "reflectance":
        return library.reflectance(_word(value[form], field))
    if form == "illuminant":
        return library.illuminant(_word(value[form], field))
    if form == "blackbody_K":
        return library.blackbody(_number(value[form], f"{field}.blackbody_K"), BLACKBODY_NODES_NM)
    if form == "lines_nm":
        centers = _numbers(value[form], f"{field}.lines_nm")
        power = _numbers(value.get("power", [1.0] * len(centers)), f"{field}.power")
        return library.lines(centers, power, _number(value.get("width_nm", 1.0), f"{field}.width_nm"))
    return library.line(_number(value[form], f"{field}.line_nm"), _number(value.get("width_nm", 1.0), f"{field}.width_nm"))


def read_csv(path: Path, column: str | None = None) -> Spectrum:
    """Read a spectrum from a CSV of at most 1 MiB: a header whose first word is wavelength_nm, then rows of numbers.

    Args:
        path: of the file.
        column: which curve; None takes the second column.

    Raises:
        InputError: ``csv`` naming the file and line.
    """
    try:
        rows = [row for row in csv.reader(read_regular(path, MAX_BYTES, "csv").decode("utf-8-sig").splitlines()) if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError("csv", path.name, f"a CSV file in UTF-8 ({error})") from None
    header = [cell.strip() for cell in rows[0]] if rows else []
    if len(header) < 2 or header[0] != "wavelength_nm":
        raise InputError("csv", header[:5], f"a header wavelength_nm,NAME,... in {path.name}")
    if column is not None and column not in header[1:]:
        raise InputError("csv.column", column, f"one of {', '.join(header[1:])}{did_you_mean(column, header[1:])}")
    at = 1 if column is None else header.index(column)
    grid, values = [], []
    for number, row in enumerate(rows[1:], 2):
        try:
            grid.append(float(row[0]))
            values.append(float(row[at]))
        except (ValueError, IndexError):
            raise InputError("csv", row[:5], f"numbers in row {number} of {path.name}") from None
    return Spectrum(np.array(grid), np.array(values), header[at])


def spectrum_data(spectrum: Spectrum) -> dict[str, Any]:
    """Return the table form of a spectrum, which reads back as an equal one."""
    name = {"name": spectrum.name} if spectrum.name else {}
    return name | {"wavelength_nm": spectrum.wavelength_nm.tolist(), "value": spectrum.value.tolist()}


def under(field: str, make: Callable[..., Any], *args: Any) -> Any:
    """Call make(*args) and put its InputError under the dotted field."""
    try:
        return make(*args)
    except InputError as error:
        if error.field.startswith(field):
            raise
        inner = error.field.partition(".")[2]
        raise InputError(f"{field}.{inner}" if inner else field, error.value, error.allowed) from None


def require_keys(table: dict[str, Any], allowed: Iterable[str], field: str) -> None:
    """Refuse the first key that is not allowed, with the nearest one that is."""
    known = list(allowed)
    for key in table:
        if key not in known:
            place = f"{field}.{key}" if field else str(key)
            raise InputError(place, key, f"one of the keys {', '.join(known)}{did_you_mean(key, known)}")


def _number(value: Any, field: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(field, value, "a number")
    return float(value)


def _numbers(value: Any, field: str) -> list[float]:
    if not isinstance(value, list) or not value:
        raise InputError(field, value, "a list of numbers")
    return [_number(item, field) for item in value]


def _word(value: Any, field: str) -> str:
    if not isinstance(value, str):
        raise InputError(field, value, "a name")
    return value
