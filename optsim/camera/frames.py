"""The measurement as one Dataset that a stranger can reconstruct from: frames, masks, responses, columns, scales."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.band_model import BandModel
from optsim.cube import Bands
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

FORMAT = "optsim-frames-1"
UNITS = ("relative", "electron", "DN")
CHANNEL_NAMES = {1: ("sensor",), 3: ("red", "green", "blue")}


def make_frames(values: np.ndarray, model: BandModel, attrs: Mapping[str, Any]) -> xr.Dataset:
    """Wrap a measurement and the band model that explains it.

    Args:
        values: (L, C, M, W) float64 frames.
        model: masks, response in frames-units per cube-unit, columns and taps.
        attrs: ``units`` (relative, electron, DN), ``model``, ``masks`` (distinct or repeated), ``offset`` and what
            else is known; values str, int or float.

    Raises:
        InputError: field ``frames`` when values are not finite or of the wrong shape.
    """
    import xarray as xr

    frames = np.ascontiguousarray(values, np.float64)
    rows = model.masks.shape[1]
    channels = 1 if model.mosaic is not None else model.response.shape[0]
    expected = (model.masks.shape[0], channels, rows, model.width)
    if frames.shape != expected or not np.isfinite(frames).all():
        raise InputError("frames", frames.shape if frames.shape != expected else "not finite", f"finite, of shape {expected}")
    bands = model.bands
    data: dict[str, Any] = {
        "frames": (("shot", "channel", "y", "x"), frames),
        "mask": (("shot", "mirror_y", "mirror_x"), model.masks),
        "response": (("curve", "wavelength"), model.response),
        "shift_px": ("wavelength", model.shift_px),
        "first_column": ("wavelength", model.first_column.astype(np.int64)),
        "tap": (("wavelength", "column"), model.taps),
    }
    if model.mosaic is not None:
        data["cfa"] = (("y", "x"), model.mosaic.astype(np.int8))
    coords = {
        "wavelength": ("wavelength", bands.center.copy(), {"units": "nm", "standard_name": "radiation_wavelength"}),
        "band_lower": ("wavelength", bands.lower.copy(), {"units": "nm"}),
        "band_upper": ("wavelength", bands.upper.copy(), {"units": "nm"}),
        "curve": ("curve", np.array(model.curve_names)),
        "channel": ("channel", np.array(CHANNEL_NAMES[channels])),
    }
    dataset = xr.Dataset(data, coords=coords, attrs={"format": FORMAT, "sensor": model.sensor, "offset": 0.0, **attrs})
    check_frames(dataset)
    return dataset


def check_frames(frames: xr.Dataset) -> None:
    """Refuse a Dataset that is not a measurement.

    Raises:
        InputError: naming the variable or attribute.
    """
    if frames.attrs.get("format") != FORMAT:
        raise InputError("format", frames.attrs.get("format"), repr(FORMAT))
    for name in ("frames", "mask", "response", "shift_px", "first_column", "tap"):
        if name not in frames:
            raise InputError(name, sorted(map(str, frames.data_vars)), "a variable of the file")
        if not np.isfinite(frames[name].values).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(frames[name].values))[0])
            raise InputError(name, "not finite", f"finite everywhere; first bad index is {where}")
    if frames.attrs.get("units") not in UNITS:
        raise InputError("units", frames.attrs.get("units"), f"one of {', '.join(UNITS)}")
    if frames["frames"].dims != ("shot", "channel", "y", "x"):
        raise InputError("frames.dims", frames["frames"].dims, "('shot', 'channel', 'y', 'x')")


def band_model_of(frames: xr.Dataset) -> BandModel:
    """Read the band model that travels in the file.

    Raises:
        InputError: see :func:`check_frames`.
    """
    check_frames(frames)
    return BandModel(
        masks=frames["mask"].values.astype(np.uint8),
        response=frames["response"].values.astype(np.float64),
        first_column=frames["first_column"].values.astype(np.int64),
        taps=frames["tap"].values.astype(np.float64),
        shift_px=frames["shift_px"].values.astype(np.float64),
        mosaic=frames["cfa"].values.astype(np.int8) if "cfa" in frames else None,
        width=int(frames.sizes["x"]),
        bands=Bands(frames["band_lower"].values, frames["band_upper"].values, frames["wavelength"].values),
        sensor=str(frames.attrs["sensor"]),
        curve_names=tuple(str(name) for name in frames["curve"].values),
    )


def signal_of(frames: xr.Dataset) -> np.ndarray:
    """Return (L, C, M, W) float64 frames minus their level without light: what H times the cube explains."""
    check_frames(frames)
    return frames["frames"].values.astype(np.float64) - float(frames.attrs.get("offset", 0.0))


def with_unit_shifts(frames: xr.Dataset) -> xr.Dataset:
    """Return the same data whose H believes that band k lands exactly k columns on: what a matched set-up hides."""
    import xarray as xr

    check_frames(frames)
    count = frames.sizes["wavelength"]
    changed = frames.drop_vars("tap").assign(
        first_column=("wavelength", np.arange(count, dtype=np.int64)),
        tap=xr.DataArray(np.ones((count, 1)), dims=("wavelength", "column")),
    )
    return changed.assign_attrs(operator="unit-shift")
