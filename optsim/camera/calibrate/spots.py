"""Spots of known wavelength and place, as measured on the sensor; read from and written to CSV."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from optsim.errors import InputError

COLUMNS = ("wavelength_nm", "X_mm", "Y_mm", "x_px", "y_px")
SIGMA = ("sigma_x_px", "sigma_y_px")
MAX_BYTES = 64 * 2**20
LIMIT_PX = 1e6


@dataclass(frozen=True, eq=False)
class Spots:
    """Hold n spots.

    Args:
        wavelength_nm: (n,) of the light.
        X_mm, Y_mm: (n,) lit place at the mirrors, from the field's centre, counted along its image.
        x_px, y_px: (n,) centroids on the sensor, from the 455 nm pixel as drawn.
        sigma_x_px, sigma_y_px: (n,) standard errors of the centroids, above 0; None: unknown, taken from the misfit.
    """

    wavelength_nm: np.ndarray
    X_mm: np.ndarray
    Y_mm: np.ndarray
    x_px: np.ndarray
    y_px: np.ndarray
    sigma_x_px: np.ndarray | None = None
    sigma_y_px: np.ndarray | None = None

    def __post_init__(self) -> None:
        if (self.sigma_x_px is None) != (self.sigma_y_px is None):
            raise InputError("spots.sigma_y_px", None, "given together with sigma_x_px")
        for name in (*COLUMNS, *(SIGMA if self.sigma_x_px is not None else ())):
            values = np.atleast_1d(np.asarray(getattr(self, name), np.float64))
            if values.ndim != 1 or values.size == 0 or values.size != np.size(self.wavelength_nm):
                raise InputError(f"spots.{name}", values.shape, f"one value a spot, {np.size(self.wavelength_nm)} in all")
            low = 0.0 if name == "wavelength_nm" or name in SIGMA else -LIMIT_PX
            bad = ~(np.isfinite(values) & (values > low) & (values < LIMIT_PX))
            if bad.any():
                where = int(np.argmax(bad))
                raise InputError(f"spots.{name}", float(values[where]), f"finite, in ({low:g}, {LIMIT_PX:g}) {_unit(name)}; spot {where}")
            object.__setattr__(self, name, values)

    @property
    def count(self) -> int:
        """Return n."""
        return int(self.wavelength_nm.size)

    @property
    def errors_known(self) -> bool:
        """Tell whether the centroids come with standard errors."""
        return self.sigma_x_px is not None

    def sigmas(self, otherwise_px: float) -> np.ndarray:
        """Return (2n,) standard errors, of all x and then of all y; one value for all where they are unknown."""
        if self.sigma_x_px is None or self.sigma_y_px is None:
            return np.full(2 * self.count, otherwise_px)
        return np.concatenate([self.sigma_x_px, self.sigma_y_px])

    def write(self, path: str | PathLike[str]) -> None:
        """Write a CSV file that :func:`read_spots` reads back bit for bit."""
        names = (*COLUMNS, *(SIGMA if self.errors_known else ()))
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(names)
            writer.writerows(zip(*([repr(float(v)) for v in getattr(self, name)] for name in names)))


def read_spots(path: str | PathLike[str]) -> Spots:
    """Read spots from a CSV file with a header line.

    Columns: wavelength_nm, X_mm, Y_mm, x_px, y_px, and either none, sigma_px (for both axes) or sigma_x_px and
    sigma_y_px; any order.

    Raises:
        InputError: field ``SPOTS`` (unreadable, over 64 MiB), or the column, with the line.
    """
    rows = _rows(Path(path))
    header = [name.strip() for name in rows[0]]
    missing = [name for name in COLUMNS if name not in header]
    extra = [name for name in header if name not in (*COLUMNS, *SIGMA, "sigma_px")]
    if missing or extra or len(set(header)) != len(header):
        raise InputError("SPOTS", header, f"a CSV header of {', '.join(COLUMNS)} and, if known, sigma_px or {' and '.join(SIGMA)}")
    columns: dict[str, list[float]] = {name: [] for name in header}
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise InputError("SPOTS", row, f"{len(header)} values in line {number}")
        for name, text in zip(header, row):
            try:
                columns[name].append(float(text))
            except ValueError:
                raise InputError(f"SPOTS.{name}", text, f"a number in line {number}") from None
    data = {name: np.array(values) for name, values in columns.items()}
    if "sigma_px" in data:
        both = data.pop("sigma_px")
        data = {SIGMA[0]: both, SIGMA[1]: both, **data}
    return Spots(**data)


def _rows(path: Path) -> list[list[str]]:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError("SPOTS", str(path), f"a CSV file of at most {MAX_BYTES // 2**20} MiB")
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError("SPOTS", str(path), f"a readable CSV file ({error.__class__.__name__})") from None
    if len(rows) < 2:
        raise InputError("SPOTS", str(path), "a CSV file with a header line and at least one spot")
    return rows


def _unit(name: str) -> str:
    return name.rsplit("_", 1)[1]
