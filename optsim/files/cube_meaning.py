"""What the numbers of a foreign cube mean: axes, wavelengths, scale."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optsim.cube import DIMS, Bands, make_cube
from optsim.errors import InputError
from optsim.files.grids import LOWEST_NM, require_nanometres
from optsim.files.import_config import Axis, Crop, CubeImport
from optsim.files.importers.found import Found
from optsim.files.reader import Source

if TYPE_CHECKING:
    import xarray as xr

UNITS_NM = {
    **dict.fromkeys(("nm", "nanometer", "nanometre"), 1.0),
    **dict.fromkeys(("um", "µm", "μm", "micrometer", "micrometre", "micron"), 1e3),
    **dict.fromkeys(("m", "meter", "metre"), 1e9),
    "angstrom": 0.1,
}
UNSAID = ("", "unknown", "1")
UM_TO = 20.0
"""Without a unit, wavelengths from 100 on are nanometres, and up to 20 micrometres."""


def as_cube(source: Source, found: Found, values: np.ndarray, how: CubeImport) -> xr.Dataset:
    """Return a cube from a stored array, by what the file and the user say of it.

    Args:
        source: the file, for messages and attributes.
        found: axes (empty when unknown), wavelengths, scale.
        values: the array as it is stored.
        how: what the user says; it overrules the file.

    Raises:
        InputError: for axes, wavelengths or a crop that are missing or wrong, and for values that are not finite.
    """
    axes = how.axes or _axes_of(source, found)
    if sorted(axis.name for axis in axes) != sorted(DIMS):
        raise InputError("--axes", [axis.name for axis in axes], "y, x and wavelength, each once")
    values = np.transpose(values, [[axis.name for axis in axes].index(name) for name in DIMS])
    values = values[tuple(slice(None, None, -1 if axis.reverse else 1) for name in DIMS for axis in axes if axis.name == name)]
    centers, reverse = _centers(source, found, values.shape, how), next(axis.reverse for axis in axes if axis.name == "wavelength")
    centers = centers[::-1] if reverse else centers
    values = _cropped(values, how.crop)
    values = _scaled(source, found, values, how.scale, reverse)
    order = np.argsort(centers, kind="stable")
    if how.range_nm is not None:
        order = order[(centers[order] >= how.range_nm[0]) & (centers[order] <= how.range_nm[1])]
        if order.size < 2:
            kept = f"around at least two of the file's bands, {centers.min():g} to {centers.max():g} nm"
            raise InputError("--range", how.range_nm, kept)
    if order.size < 2 or np.any(np.diff(centers[order]) <= 0):
        raise InputError("--wavelengths", np.sort(centers).tolist()[:8], "at least two, all different, in nm")
    attrs = {
        "kind": "imported",
        "source_format": source.title,
        "source_file": source.name,
        "source_variable": found.name,
        "source_values": found.quantity or "as in the file",
        "source_axes": ",".join(f"{'-' if axis.reverse else ''}{axis.name}" for axis in axes),
        "scale": how.scale,
    }
    values = values if np.array_equal(order, np.arange(centers.size)) else values[:, :, order]
    try:
        return make_cube(values, Bands.from_centers(centers[order]), attrs=attrs)
    except InputError as error:
        form = f"{error.allowed}; --crop and --range leave such places out"
        raise InputError(f"{source.name}:{found.name}", error.value, form) from None


def _axes_of(source: Source, found: Found) -> tuple[Axis, ...]:
    names = found.axes or (DIMS if source.title.startswith("MATLAB") else ())
    if not names:
        raise InputError("--axes", None, f"stated, such as y,x,wavelength: {source.name} does not say which of its {found.shape} is which")
    return tuple(Axis(name=name) for name in names)


def _centers(source: Source, found: Found, shape: tuple[int, ...], how: CubeImport) -> np.ndarray:
    """Return the K band centres in nm, in the order of the file."""
    if how.wavelengths_nm is not None:
        centers = np.array(how.wavelengths_nm, np.float64)
    elif found.wavelengths:
        centers = np.array(found.wavelengths) * _unit_nm(source, found)
    else:
        form = "stated, as the file has none: such as 400:700:31, or tsa-453.5 or tsa-453.3 for the 28 bands of KAIST / TSA"
        raise InputError("--wavelengths", None, form)
    if centers.size != shape[2]:
        form = f"{shape[2]}, as the wavelength axis of shape (y, x, wavelength) = {shape} has; or state --axes"
        raise InputError("--wavelengths", f"{centers.size} numbers", form)
    require_nanometres(f"{source.name}:wavelength" if how.wavelengths_nm is None else "--wavelengths", centers)
    return centers


def _unit_nm(source: Source, found: Found) -> float:
    word = found.unit.strip().lower()
    for unit in (word, word.rstrip("s")):
        if unit in UNITS_NM:
            return UNITS_NM[unit]
    low, high = min(found.wavelengths), max(found.wavelengths)
    if word in UNSAID and low >= LOWEST_NM:
        return 1.0
    if word in UNSAID and low > 0 and high <= UM_TO:
        return 1e3
    form = "in nm or um (--wavelengths states them in nm)"
    raise InputError(f"{source.name}:wavelength units", f"{found.unit!r} for {low:g} to {high:g}", form)


def _cropped(values: np.ndarray, crop: Crop | None) -> np.ndarray:
    if crop is None:
        return values
    bottom, right = crop.top + crop.height, crop.left + crop.width
    if bottom > values.shape[0] or right > values.shape[1]:
        raise InputError(
            "--crop", (crop.top, crop.left, crop.height, crop.width), f"inside the {values.shape[0]} x {values.shape[1]} picture"
        )
    return values[crop.top : bottom, crop.left : right]


def _scaled(source: Source, found: Found, values: np.ndarray, scale: float, reverse: bool) -> np.ndarray:
    """Apply the file's own scale and the user's, in float64, rounded once."""
    if found.ignore is not None and (values == found.ignore).any():
        where = tuple(int(i) for i in np.argwhere(values == found.ignore)[0])
        form = f"data everywhere; first without data (y, x, band) is {where} (crop around it with --crop)"
        raise InputError(f"{source.name}:{found.name}", found.ignore, form)
    narrow = (values.dtype.kind in "fb" and values.dtype.itemsize <= 4) or values.dtype.itemsize <= 2
    wanted = np.float32 if narrow else np.float64
    gain, offset = (np.array(numbers or (plain,)) for numbers, plain in ((found.gain, 1.0), (found.offset, 0.0)))
    for name, numbers in (("gain", gain), ("offset", offset)):
        if numbers.size not in (1, values.shape[2]):
            raise InputError(f"{source.name}:{name}", numbers.size, f"1 number, or {values.shape[2]}")
    if np.all(gain == 1) and np.all(offset == 0) and found.divisor == 1 and scale == 1:
        return np.ascontiguousarray(values, wanted)
    gain, offset = (numbers[::-1] if reverse else numbers for numbers in (gain, offset))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.ascontiguousarray((values * gain + offset) / found.divisor * scale, wanted)
