"""Files of every stage: netCDF for cubes, frames and estimates; spectral EXR for cubes."""

from optsim.files.formats import read, read_cube, writable, write
from optsim.files.netcdf import netcdf_bytes_digest
from optsim.files.netcdf_stream import NetcdfSink

__all__ = ["NetcdfSink", "netcdf_bytes_digest", "read", "read_cube", "writable", "write"]
