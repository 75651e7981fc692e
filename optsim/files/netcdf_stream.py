"""A netCDF-4 cube written some rows at a time, for cubes that do not fit into memory; an interrupted one is taken up again."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from optsim.cube import DIMS, UNITS, Bands
from optsim.errors import InputError
from optsim.files.guard import UMASK


class NetcdfSink:
    """Write a cube to ``path``; until it is whole its rows lie in ``.NAME.part`` beside it.

    Args:
        path: file to write; its folder is made.
        attrs: attributes to add to the render's own.

    Attributes:
        attrs: all attributes of the file, once it is finished.
    """

    def __init__(self, path: Path | str, attrs: Mapping[str, str | int | float] | None = None) -> None:
        self._path, self._more = Path(path), dict(attrs or {})
        self._part = self._path.with_name(f".{self._path.name}.part")
        self._file: Any = None
        self.attrs: dict[str, str | int | float] = {}

    def begin(
        self, shape: tuple[int, int, int], bands: Bands, dtype: type[np.floating], stderr: bool, digest: str
    ) -> tuple[int, np.ndarray]:
        """Create the file, or take up the rows of an interrupted render of the same digest: (rows, notes)."""
        import h5netcdf

        self._path.parent.mkdir(parents=True, exist_ok=True)
        if self._file is not None:
            self._file.close()
        kept = self._take_up(digest)
        if kept is not None:
            return kept
        self._file = file = h5netcdf.File(self._part, "w")
        file.dimensions = dict(zip(DIMS, shape))
        for name, values in (("wavelength", bands.center), ("band_lower", bands.lower), ("band_upper", bands.upper)):
            variable = file.create_variable(name, ("wavelength",), np.float64, data=np.asarray(values, np.float64))
            variable.attrs["units"] = "nm"
        file.variables["wavelength"].attrs["standard_name"] = "radiation_wavelength"
        for name in ("radiance", "stderr") if stderr else ("radiance",):
            variable = file.create_variable(name, DIMS, np.dtype(dtype))
            variable.attrs["units"], variable.attrs["coordinates"] = UNITS, "band_lower band_upper"
        file.attrs["unfinished_digest"] = digest
        file.attrs["unfinished_rows"] = 0
        file.flush()
        return 0, np.zeros(0)

    def _take_up(self, digest: str) -> tuple[int, np.ndarray] | None:
        import h5netcdf

        if not self._part.is_file():
            return None
        try:
            file = h5netcdf.File(self._part, "r+")
        except Exception:  # h5py raises OSError, KeyError, RuntimeError or ValueError for a file that a crash has left
            return None
        try:
            if file.attrs.get("unfinished_digest") == digest:
                rows = int(file.attrs["unfinished_rows"])
                notes = np.atleast_1d(np.asarray(file.attrs.get("unfinished_notes", np.zeros(0)), np.float64))
                self._file, file = file, None
                return rows, notes
            return None
        finally:
            if file is not None:
                file.close()

    def rows(self, top: int, radiance: np.ndarray, stderr: np.ndarray | None, notes: np.ndarray) -> None:
        """Write rows from ``top`` on.

        Raises:
            InputError: for a value that is not finite.
        """
        bottom = top + len(radiance)
        for name, values in (("radiance", radiance), ("stderr", stderr)):
            if values is None:
                continue
            variable = self._file.variables[name]
            kept = values.astype(variable.dtype)
            if not np.isfinite(kept).all():
                raise InputError(name, "non-finite", "finite before it is written")
            variable[top:bottom] = kept
        self._file.attrs["unfinished_rows"] = bottom
        self._file.attrs["unfinished_notes"] = np.asarray(notes, np.float64).ravel()
        self._file.flush()

    def finish(self, attrs: Mapping[str, str | int | float]) -> None:
        """Write the attributes and move the file into place."""
        for name in ("unfinished_digest", "unfinished_rows", "unfinished_notes"):
            if name in self._file.attrs:
                del self._file.attrs[name]
        self.attrs = {**attrs, **self._more}
        for name, value in self.attrs.items():
            self._file.attrs[name] = value
        self._file.close()
        self._file = None
        with self._part.open("rb+") as file:
            os.fsync(file.fileno())
        os.chmod(self._part, 0o666 & ~UMASK)
        os.replace(self._part, self._path)

    def close(self) -> None:
        """Leave an unfinished file as it is, to be taken up again."""
        if self._file is not None:
            self._file.close()
            self._file = None
