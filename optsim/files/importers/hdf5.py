"""HDF5: MATLAB 7.3 (ICVL, ARAD), netCDF-4 and plain files, through h5py; links, outside storage and filters of others are not followed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import IO, Any

import numpy as np

from optsim.errors import InputError
from optsim.files.importers.found import MOST_ARRAYS, NUMERIC, Found, as_found, little

LIBRARIES = ("h5py", "h5netcdf")
"""Imported by the child before the clock runs."""
DEPTH = 2
"""Groups inside groups that are looked into."""
FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32"}
"""Built into HDF5: no other code is loaded for them."""
SLAB = 64 << 20
"""Bytes read at once where nothing is kept."""
MATLAB_BLOCK = 512
"""Bytes before the HDF5 part of a MATLAB file."""
MATLAB_NUMERIC = ("double", "single", "logical", *(f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)))


def survey(files: Sequence[IO[bytes]]) -> list[Found]:
    """List the numeric arrays; MATLAB's as MATLAB shows them, others as they are stored."""
    with _opened(files) as file:
        matlab = _is_matlab(file)
        return [_describe(name, dataset, matlab) for name, dataset in _datasets(file, matlab)]


def read(files: Sequence[IO[bytes]], name: str) -> np.ndarray:
    """Read one array.

    Raises:
        InputError: ``name`` when it is missing.
    """
    with _opened(files) as file:
        matlab = _is_matlab(file)
        for found, dataset in _datasets(file, matlab):
            if found == name:
                _check_chunks(name, dataset)
                values = dataset[()]
                return as_found(values.T if matlab else values)
    raise InputError(name, "missing", "a numeric array of the file itself, not behind a link")


def extent(files: Sequence[IO[bytes]]) -> int:
    """Return the bytes of all numeric arrays when unpacked."""
    return sum(found.size for found in survey(files))


def prove(files: Sequence[IO[bytes]]) -> None:
    """Read everything in a netCDF file, and forget it: what ends or stops this process would have ended or stopped the parent."""
    import h5netcdf

    (file,) = files
    with h5netcdf.File(f"/dev/fd/{file.fileno()}", "r", decode_vlen_strings=True, phony_dims="sort") as opened:
        dict(opened.attrs)
        for variable in opened.variables.values():
            dict(variable.attrs)
            _pass_through(variable)


def _pass_through(variable: Any) -> None:
    """Read a variable some rows at a time."""
    if variable.dimensions is None or variable.shape is None:
        return
    if len(variable.shape) < 2:
        variable[...]
        return
    row = max(1, int(np.prod(np.array(variable.shape[1:], object))) * np.dtype(variable.dtype).itemsize)
    chunk = variable.chunks[0] if variable.chunks else 1
    rows = max(1, SLAB // row // chunk) * chunk
    for top in range(0, variable.shape[0], rows):
        variable[top : top + rows]


def _opened(files: Sequence[IO[bytes]]) -> Any:
    import h5py

    (file,) = files
    return h5py.File(file, "r", locking=False)


def _is_matlab(file: Any) -> bool:
    block = int(file.userblock_size)
    if block not in (0, MATLAB_BLOCK):
        raise InputError("user block", block, f"0 or {MATLAB_BLOCK} bytes")
    return block == MATLAB_BLOCK


def _datasets(group: Any, matlab: bool, prefix: str = "", depth: int = DEPTH) -> Iterator[tuple[str, Any]]:
    """Walk over data sets behind hard links that hold real numbers."""
    import h5py

    count = 0
    for key in group:
        if count >= MOST_ARRAYS:
            return
        if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue
        item = group[key]
        if isinstance(item, h5py.Group) and depth > 1:
            yield from _datasets(item, matlab, f"{prefix}{key}/", depth - 1)
        elif isinstance(item, h5py.Dataset) and _readable(item, matlab):
            count += 1
            yield prefix + key, item


def _readable(dataset: Any, matlab: bool) -> bool:
    dtype = dataset.dtype
    if dtype.kind not in NUMERIC or dtype.itemsize > 8 or dtype.hasobject or not 0 <= len(dataset.shape or ()) <= 5:
        return False
    if dataset.shape is None or dataset.external or dataset.is_virtual:
        return False
    plist = dataset.id.get_create_plist()
    if any(plist.get_filter(i)[0] not in FILTERS for i in range(plist.get_nfilters())):
        return False
    return not matlab or (_text(dataset, "MATLAB_class") in MATLAB_NUMERIC and "MATLAB_empty" not in dataset.attrs)


def _check_chunks(name: str, dataset: Any) -> None:
    """Refuse chunks far larger than the array: each is unpacked whole."""
    chunks = dataset.chunks
    if chunks is not None and np.prod(np.array(chunks, object)) > 64 * max(int(np.prod(np.array(dataset.shape, object))), 1 << 20):
        raise InputError(name, chunks, f"in chunks not much larger than its shape {dataset.shape}")


def _describe(name: str, dataset: Any, matlab: bool) -> Found:
    shape = tuple(int(n) for n in dataset.shape) or (1,)
    dims = () if matlab else _dims(dataset)
    return Found(
        name=name,
        shape=shape[::-1] if matlab else shape,
        dtype=little(dataset.dtype),
        axes=dims if len(dims) == len(shape) else (),
        unit=_text(dataset, "units"),
        gain=_number(dataset, "scale_factor"),
        offset=_number(dataset, "add_offset"),
        ignore=next(iter(_number(dataset, "_FillValue")), None),
    )


def _dims(dataset: Any) -> tuple[str, ...]:
    """Return the names of netCDF dimensions, or nothing."""
    try:
        names = [dimension[0].name for dimension in dataset.dims]
        if len(names) == 1 and "CLASS" in dataset.attrs:
            return ()
        return tuple(str(name).rsplit("/", 1)[-1] for name in names)
    except Exception:  # no scales, or dead references: then the axes are to be stated
        return ()


def _text(dataset: Any, key: str) -> str:
    try:
        value = dataset.attrs.get(key, "")
    except Exception:  # an attribute of a damaged file
        return ""
    if isinstance(value, bytes | np.bytes_):
        value = value.decode("utf-8", "replace")
    return str(value)[:500] if isinstance(value, str) else ""


def _number(dataset: Any, key: str) -> tuple[float, ...]:
    try:
        value = np.ravel(dataset.attrs.get(key, ()))
    except Exception:  # an attribute of a damaged file
        return ()
    return (float(value[0]),) if value.size == 1 and value.dtype.kind in "fiu" and np.isfinite(value[0]) else ()
