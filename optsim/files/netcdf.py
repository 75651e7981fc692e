"""netCDF-4 through h5netcdf: the same Dataset always gives the same bytes."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.errors import InputError
from optsim.files.guard import atomic_path, declared_size, regular_file

if TYPE_CHECKING:
    import xarray as xr

MAGIC = b"\x89HDF"


def write_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Write a Dataset to a netCDF-4 file, atomically.

    Raises:
        InputError: naming the first variable that holds a non-finite value.
    """
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "f" and not np.isfinite(variable.values).all():
            raise InputError(str(name), "non-finite", "finite before it is written")
    encoding = {str(name): {"_FillValue": None} for name in dataset.variables}
    with atomic_path(path) as temporary:
        dataset.to_netcdf(temporary, engine="h5netcdf", format="NETCDF4", encoding=encoding)


def read_netcdf(path: Path) -> xr.Dataset:
    """Read a whole netCDF-4 file into memory.

    Raises:
        InputError: when the file is missing, cut off, damaged or larger than 8 GiB when unpacked.
    """
    import xarray as xr

    regular_file(path)
    try:
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as lazy:
            for name, variable in lazy.variables.items():
                declared_size(f"{path.name}:{name}", variable.shape, variable.dtype.itemsize)
            return lazy.load()
    except InputError:
        raise
    except Exception as error:  # h5py raises OSError, KeyError, RuntimeError or ValueError for a damaged file
        raise InputError("file", str(path), f"a readable netCDF-4 file ({type(error).__name__}: {error})") from None


def netcdf_bytes_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, as hex."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
