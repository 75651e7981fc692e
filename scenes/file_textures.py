"""Textures as scene files write them: names of spectra, and weights in a picture or table beside the scene file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from scenes import library
from scenes.errors import InputError
from scenes.file_spectra import inside, parse_spectrum, require_keys
from scenes.materials import as_spectrum
from scenes.meshes import read_regular
from scenes.textures import MAX_BASIS, MAX_TEXELS

MAX_PICTURE_BYTES = 2**26


def texture_fields(fields: dict[str, Any], place: str, folder: Path | None) -> dict[str, Any]:
    """Turn a texture's table into the fields of :class:`scenes.textures.Textured`.

    ``basis`` is a list of spectra. ``weights`` is an inline (rows, columns, basis) table, or the name of a PNG (its channels
    divided by the largest number of their type; 1 to 4 of them) or NPY file in the scene file's own folder.

    Raises:
        InputError: naming the offending place.
    """
    require_keys(fields, ("basis", "weights"), place)
    basis = fields.get("basis")
    if not isinstance(basis, list) or not 1 <= len(basis) <= MAX_BASIS:
        raise InputError(f"{place}.basis", basis, f"a list of 1 to {MAX_BASIS} spectra")
    spectra = [as_spectrum(parse_spectrum(item, f"{place}.basis[{i}]", folder, library.reflectance)) for i, item in enumerate(basis)]
    weights = fields.get("weights")
    if isinstance(weights, str):
        if folder is None:
            raise InputError(f"{place}.weights", weights, "given as numbers: this scene has no folder of its own")
        weights = read_weights(inside(folder, weights, f"{place}.weights"), f"{place}.weights")
    return {"basis": tuple(spectra), "weights": weights}


def read_weights(path: Path, field: str = "weights") -> np.ndarray:
    """Read a (rows, columns, channels) table of weights from a PNG or NPY file of at most 64 MiB.

    Raises:
        InputError: the field, for other files, too many texels, or what is not a picture.
    """
    readers = {".png": _png, ".npy": _npy}
    if path.suffix.lower() not in readers:
        raise InputError(field, path.name, "a file of type .png or .npy")
    table = readers[path.suffix.lower()](read_regular(path, MAX_PICTURE_BYTES, field), path.name, field)
    return table[..., None] if table.ndim == 2 else table


def _png(data: bytes, name: str, field: str) -> np.ndarray:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
            if picture.width * picture.height > MAX_TEXELS:
                raise InputError(field, picture.size, f"a picture of at most {MAX_TEXELS} texels")
            table = np.asarray(picture.convert("RGB") if picture.mode == "P" else picture)
    except InputError:
        raise
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(field, name, f"a readable PNG file ({error})") from None
    if table.dtype == bool:
        return table.astype(np.float32)
    if not np.issubdtype(table.dtype, np.integer) or table.min(initial=0) < 0:
        raise InputError(field, name, "a PNG of 8 or 16 bits a channel")
    top = 255 if table.dtype == np.uint8 else 65535
    return (table / top).astype(np.float32)


def _npy(data: bytes, name: str, field: str) -> np.ndarray:
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
        shape, _, kind = read(stream)
        if kind.hasobject or not (np.issubdtype(kind, np.floating) or np.issubdtype(kind, np.integer)):
            raise InputError(field, str(kind), "numbers")
        if len(shape) not in (2, 3) or any(n <= 0 for n in shape) or int(np.prod(shape, dtype=object)) > MAX_TEXELS * MAX_BASIS:
            raise InputError(field, shape, f"(rows, columns) or (rows, columns, basis) of at most {MAX_TEXELS} texels")
        if int(np.prod(shape, dtype=object)) * kind.itemsize != len(data) - stream.tell():
            raise InputError(field, name, "a whole NPY file: its length does not fit its header")
        return np.load(io.BytesIO(data), allow_pickle=False)
    except InputError:
        raise
    except (ValueError, KeyError, EOFError, OSError, TypeError, SyntaxError) as error:
        raise InputError(field, name, f"a readable NPY file ({error})") from None
