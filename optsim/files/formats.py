"""One door to all formats: written by a path's suffix, recognised on reading by content."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from optsim.errors import InputError
from optsim.files import netcdf, spectral_exr
from optsim.files.guard import regular_file

if TYPE_CHECKING:
    import xarray as xr

_READERS = ((netcdf.MAGIC, "hdf5", "netCDF-4", netcdf.read_netcdf), (spectral_exr.MAGIC, "exr", "OpenEXR", spectral_exr.read_exr))
_WRITERS = {".nc": netcdf.write_netcdf, ".exr": spectral_exr.write_exr}


def read(path: Path | str, trusted: bool = False) -> xr.Dataset:
    """Read a netCDF or spectral EXR file, told apart by its first four bytes.

    Args:
        path: the file.
        trusted: whether it is known to be as optsim wrote it; any other is first read in a child process with limits (proof.py).

    Raises:
        InputError: when the file is missing, of neither format, or damaged.
    """
    path = Path(path)
    with regular_file(path).open("rb") as file:
        magic = file.read(4)
    for known, module, title, reader in _READERS:
        if magic == known:
            if not trusted and os.name == "posix":
                from optsim.files.proof import prove
                from optsim.files.reader import Source

                prove(Source(module, title, (path,)))
            return reader(path)
    raise InputError("file", str(path), "a netCDF-4 (.nc) or OpenEXR (.exr) file")


def read_cube(path: Path | str) -> xr.Dataset:
    """Read a file and insist that it holds a valid radiance cube.

    Raises:
        InputError: when it does not, naming the file and what is wrong.
    """
    from optsim.cube import check_cube

    cube = read(path)
    if "radiance" not in cube:
        kind = "frames" if "frames" in cube else f"a file of {', '.join(sorted(map(str, cube.data_vars))) or 'nothing'}"
        raise InputError(str(path), kind, "a cube or an estimate (with a variable radiance)")
    try:
        check_cube(cube)
    except InputError as error:
        raise InputError(f"{path}: {error.field}", error.value, error.allowed) from None
    return cube


def writable(path: Path | str, field: str = "-o", source: Path | None = None, suffixes: tuple[str, ...] = tuple(_WRITERS)) -> Path:
    """Check an output path before the work starts: a known suffix, in a folder that can be written, and not the input.

    Args:
        path: file to write; its folder is made.
        field: named in errors.
        source: the file that is read, which must not be overwritten.
        suffixes: endings that can hold what is to be written.

    Raises:
        InputError: naming ``field``.
    """
    path = Path(path)
    if path.suffix not in suffixes:
        raise InputError(field, str(path), f"a file path that ends in {' or '.join(suffixes)}")
    if path.is_dir():
        raise InputError(field, str(path), "a file, not an existing folder")
    if source is not None and source.exists() and path.exists() and path.samefile(source):
        raise InputError(field, str(path), "another file than the one that is read")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(field, str(path), f"in a folder that can be made ({error.strerror})") from None
    if not os.access(path.parent, os.W_OK):
        raise InputError(field, str(path), "in a folder that can be written")
    return path


def write(dataset: xr.Dataset, path: Path | str) -> None:
    """Write a Dataset in the format of the path's suffix: ``.nc`` anything, ``.exr`` cubes."""
    path = writable(path, suffixes=tuple(_WRITERS) if "radiance" in dataset else (".nc",))
    _WRITERS[path.suffix](dataset, path)
