"""What a frames file must look like, variable by variable: a file may come from anywhere."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

FIELD = ("wavelength", "field_y", "field_x")
MASK = ("shot", "mirror_y", "mirror_x")
DIMS: dict[str, tuple[tuple[str, ...], ...]] = {
    "frames": (("shot", "channel", "y", "x"),),
    "mask": (MASK,),
    "response": (("curve", "wavelength"),),
    "shift_px": (("wavelength",),),
    "first_column": (("wavelength",), FIELD),
    "tap": (("wavelength", "column"), (*FIELD, "row", "column")),
    "first_row": (FIELD,),
    "mirror": (MASK,),
    "pixel_gain": (("y", "x"),),
    "layer_bin": (("channel",),),
    "cfa": (("y", "x"),),
    "band_lower": (("wavelength",),),
    "band_upper": (("wavelength",),),
}
"""Dims that a variable may have."""
WHOLE = ("first_column", "first_row", "layer_bin", "cfa")
NEEDED = ("wavelength", "band_lower", "band_upper")
NUMBERS = ("offset", "crosstalk")


def check_form(frames: xr.Dataset) -> None:
    """Refuse variables with other dims, types or sizes than the document says (docs/files.md).

    Raises:
        InputError: naming the variable or attribute.
    """
    for name in NEEDED:
        if name not in frames.coords:
            raise InputError(name, sorted(map(str, frames.coords)), "a coordinate on the dimension wavelength, in nm")
    for name, allowed in DIMS.items():
        if name not in frames.variables:
            continue
        variable = frames[name]
        if variable.dims not in allowed:
            raise InputError(f"{name}.dims", variable.dims, " or ".join(map(str, allowed)))
        if variable.dtype.kind not in ("iu" if name in WHOLE else "fiub"):
            raise InputError(f"{name}.dtype", str(variable.dtype), "whole numbers" if name in WHOLE else "real numbers")
    rows, full = frames.sizes["y"], frames["tap"].ndim == 5
    if frames.sizes["mirror_y"] != rows:
        raise InputError("mask", f"{frames.sizes['mirror_y']} rows", f"{rows} rows, as the frames have")
    if (frames["first_column"].ndim == 3) != full or ("first_row" in frames) != full:
        raise InputError("first_column.dims", frames["first_column"].dims, "those of tap without row and column, with first_row beside it")
    curves, channels = frames.sizes["curve"], frames.sizes["channel"]
    if channels != (1 if "cfa" in frames else curves):
        raise InputError("frames", f"{channels} channels, {curves} curves", "one channel a curve, or one channel and a cfa")
    for name in NUMBERS:
        value = frames.attrs.get(name, 0.0)
        if isinstance(value, str | bytes) or not math.isfinite(float(value)):
            raise InputError(name, value, "a finite number")
    if not isinstance(frames.attrs.get("sensor"), str):
        raise InputError("sensor", frames.attrs.get("sensor"), "an attribute: mono, bayer, foveon, or another name")
