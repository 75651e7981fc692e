"""Cubes as people have them, brought into optsim's form: which array, which axis is which, at which wavelengths, on what scale."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.cube import DIMS
from optsim.errors import InputError
from optsim.files import picture_folder
from optsim.files.cube_meaning import as_cube
from optsim.files.import_config import CubeImport
from optsim.files.importers.found import Found
from optsim.files.reader import Reader, Source
from optsim.files.recognise import recognise

if TYPE_CHECKING:
    import xarray as xr

KNOWN_CUBES = ("rad", "cube", "img", "HSI", "hsi", "img_expand", "ref", "radiance", "reflectance", "data")
"""Names under which ICVL, ARAD, KAIST / TSA, Harvard and others keep their cubes; the first that is there."""
KNOWN_WAVELENGTHS = ("wavelength", "wavelengths", "bands", "wl", "lambda", "lam", "wavelengths_nm", "wavelength_nm", "Wavelengths")
KNOWN_AXES = {
    "y": ("y", "row", "rows", "line", "lines", "height"),
    "x": ("x", "column", "columns", "sample", "samples", "width"),
    "wavelength": ("wavelength", "wavelengths", "band", "bands", "lambda", "channel"),
}


def import_cube(path: Path | str, how: CubeImport | None = None, reader: Reader | None = None) -> xr.Dataset:
    """Read a cube from ENVI, MATLAB (v5 to v7.3), spectral OpenEXR, NumPy, HDF5, netCDF or a folder of PNG pictures.

    Args:
        path: the file (of ENVI either half), or the folder.
        how: what the file leaves open.
        reader: decodes it; None: a child process of its own.

    Returns:
        A cube (:mod:`optsim.cube`), float32 where the file's numbers fit, else float64; bands sorted, edges midway between centres.

    Raises:
        InputError: naming the file and what is wrong with it or missing: damage, axes, wavelengths, values that are not finite.
    """
    path, how = Path(path), CubeImport() if how is None else how
    with ExitStack() as closing:
        reader = closing.enter_context(Reader()) if reader is None else reader
        if path.is_dir():
            values, told, quantity = picture_folder.stack(path, reader)
            source = Source("png", "a folder of PNG pictures", (path,))
            found = Found(name=path.name, shape=values.shape, dtype="<f4", axes=DIMS, wavelengths=told, unit="nm", quantity=quantity)
        else:
            source = recognise(path)
            found = _described(reader, source, how)
            values = reader.read(source, found)
    return as_cube(source, found, values, how)


def _described(reader: Reader, source: Source, how: CubeImport) -> Found:
    """Choose the array, and add axes and wavelengths that stand beside it in the file."""
    arrays = reader.survey(source)
    found = _chosen(source, arrays, how)
    axes = tuple(_known_axis(name) for name in found.axes)
    if sorted(axes) == sorted(DIMS):
        told = next((a for a in arrays if len(a.shape) == 1 and a.name == found.axes[axes.index("wavelength")]), None)
        found = found.model_copy(update={"axes": axes})
    else:
        found, told = found.model_copy(update={"axes": ()}), None
    if found.wavelengths or how.wavelengths_nm is not None:
        return found
    beside = {array.name: array for array in arrays if max(array.shape) == np.prod(array.shape) and max(array.shape) in found.shape}
    told = told or next((beside[name] for name in KNOWN_WAVELENGTHS if name in beside), None)
    if told is None or told.size > 80_000:
        return found
    numbers = np.ravel(reader.read(source, told)).astype(np.float64)
    return found.model_copy(update={"wavelengths": tuple(numbers.tolist()), "unit": told.unit})


def _chosen(source: Source, arrays: tuple[Found, ...], how: CubeImport) -> Found:
    by_name = {array.name: array for array in arrays}
    if how.variable is not None:
        if how.variable not in by_name:
            raise InputError("--variable", how.variable, f"an array of {source.name}: {_listed(arrays)}")
        chosen = by_name[how.variable]
        if len(chosen.shape) != 3:
            raise InputError("--variable", f"{how.variable} {chosen.shape}", "an array of three axes")
        return chosen
    cubes = [array for array in arrays if len(array.shape) == 3]
    if len(cubes) == 1:
        return cubes[0]
    known = [by_name[name] for name in KNOWN_CUBES if name in by_name and len(by_name[name].shape) == 3]
    if not known:
        allowed = "a file with an array of three axes" if not cubes else "stated by --variable, as the file holds several arrays"
        raise InputError(f"{source.name}", _listed(arrays), allowed)
    return known[0]


def _listed(arrays: tuple[Found, ...]) -> str:
    return ", ".join(f"{array.name} {' x '.join(map(str, array.shape))}" for array in arrays[:10]) or "no numeric array"


def _known_axis(name: str) -> str:
    return next((axis for axis, names in KNOWN_AXES.items() if name.lower() in names), "")
