"""Files of every stage: netCDF for cubes, frames and estimates; spectral EXR for cubes; and what people bring in other formats."""

from typing import Any

from optsim.files.formats import read, read_cube, writable, write
from optsim.files.netcdf import netcdf_bytes_digest
from optsim.files.netcdf_stream import NetcdfSink

__all__ = ["Axis", "Crop", "CubeImport", "NetcdfSink", "import_cube", "netcdf_bytes_digest", "read", "read_cube", "writable", "write"]

_LATER = {"import_cube": "cube_import", "Axis": "import_config", "Crop": "import_config", "CubeImport": "import_config"}


def __getattr__(name: str) -> Any:
    if name in _LATER:
        from importlib import import_module

        return getattr(import_module(f"optsim.files.{_LATER[name]}"), name)
    raise AttributeError(f"module 'optsim.files' has no attribute {name!r}")
