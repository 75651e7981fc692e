"""The measurement as one Dataset that a stranger can reconstruct from: frames, masks, responses, columns, scales."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.band_model import BandModel
from optsim.camera.frames_form import FIELD, check_form
from optsim.cube import CUBE_UNITS, FOREIGN, FRAME_UNITS, OVER_RESPONSE, UNITS, Bands
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

FORMAT = "optsim-frames-2"
READABLE = ("optsim-frames-1", FORMAT)
"""Format 1 has only the simple form of H."""

REQUIRED = ("frames", "mask", "response", "shift_px", "first_column", "tap")
OPTIONAL = ("first_row", "mirror", "pixel_gain", "layer_bin")
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
        **_columns(model),
    }
    if model.mosaic is not None:
        data["cfa"] = (("y", "x"), model.mosaic.astype(np.int8))
    if model.mirrors is not None:
        data["mirror"] = (("shot", "mirror_y", "mirror_x"), model.mirrors)
    if model.gain is not None:
        data["pixel_gain"] = (("y", "x"), model.gain)
    if model.bins is not None:
        data["layer_bin"] = ("channel", np.array(model.bins, np.int64))
    coords = {
        "wavelength": ("wavelength", bands.center.copy(), {"units": "nm", "standard_name": "radiation_wavelength"}),
        "band_lower": ("wavelength", bands.lower.copy(), {"units": "nm"}),
        "band_upper": ("wavelength", bands.upper.copy(), {"units": "nm"}),
        "curve": ("curve", np.array(model.curve_names)),
        "channel": ("channel", np.array(CHANNEL_NAMES[channels])),
    }
    notes = {"format": FORMAT, "sensor": model.sensor, "offset": 0.0, "crosstalk": model.crosstalk, **attrs}
    dataset = xr.Dataset(data, coords=coords, attrs=notes)
    check_frames(dataset)
    return dataset


def _columns(model: BandModel) -> dict[str, Any]:
    """Return the variables that say where light lands."""
    first = model.first_column.astype(np.int64)
    if model.taps.ndim == 2:
        return {"first_column": ("wavelength", first), "tap": (("wavelength", "column"), model.taps)}
    assert model.first_row is not None
    return {
        "first_row": (FIELD, model.first_row.astype(np.int64)),
        "first_column": (FIELD, first),
        "tap": ((*FIELD, "row", "column"), model.taps),
    }


def check_frames(frames: xr.Dataset) -> None:
    """Refuse a Dataset that is not a measurement.

    Raises:
        InputError: naming the variable or attribute.
    """
    if frames.attrs.get("format") not in READABLE:
        raise InputError("format", frames.attrs.get("format"), " or ".join(repr(name) for name in READABLE))
    for name in REQUIRED:
        if name not in frames:
            raise InputError(name, sorted(map(str, frames.data_vars)), "a variable of the file")
    check_form(frames)
    for name in (*REQUIRED, *OPTIONAL):
        if name not in frames:
            continue
        if not np.isfinite(frames[name].values).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(frames[name].values))[0])
            raise InputError(name, "not finite", f"finite everywhere; first bad index is {where}")
    if frames.attrs.get("units") not in FRAME_UNITS:
        raise InputError("units", frames.attrs.get("units"), f"one of {', '.join(FRAME_UNITS)}")
    if frames.attrs.get("cube_units", UNITS) not in CUBE_UNITS:
        raise InputError("cube_units", frames.attrs["cube_units"], f"one of {', '.join(map(repr, CUBE_UNITS))}, or absent")


def band_model_of(frames: xr.Dataset) -> BandModel:
    """Read the band model that travels in the file.

    Raises:
        InputError: see :func:`check_frames`.
    """
    check_frames(frames)

    def optional(name: str) -> np.ndarray | None:
        return frames[name].values if name in frames else None

    taps, bins = frames["tap"].values, optional("layer_bin")
    masks = frames["mask"].values
    return BandModel(
        masks=masks.astype(np.float64 if masks.dtype.kind == "f" else np.uint8),
        response=frames["response"].values.astype(np.float64),
        first_column=frames["first_column"].values.astype(np.int64),
        taps=taps if taps.ndim == 5 else taps.astype(np.float64),
        shift_px=frames["shift_px"].values.astype(np.float64),
        mosaic=frames["cfa"].values.astype(np.int8) if "cfa" in frames else None,
        width=int(frames.sizes["x"]),
        bands=Bands(frames["band_lower"].values, frames["band_upper"].values, frames["wavelength"].values),
        sensor=str(frames.attrs["sensor"]),
        curve_names=tuple(str(name) for name in frames["curve"].values),
        first_row=optional("first_row"),
        mirrors=optional("mirror"),
        gain=optional("pixel_gain"),
        bins=None if bins is None else tuple(int(side) for side in bins),
        crosstalk=float(frames.attrs.get("crosstalk", 0.0)),
    )


def signal_of(frames: xr.Dataset) -> np.ndarray:
    """Return (L, C, M, W) float64 frames minus their level without light: what H times the cube explains."""
    check_frames(frames)
    return frames["frames"].values.astype(np.float64) - float(frames.attrs.get("offset", 0.0))


def cube_units_of(frames: xr.Dataset) -> str:
    """Return the unit of a cube that is reconstructed from these frames: frames-units over response.

    That is W m^-2 sr^-1 nm^-1 for our own cameras, whose responses refer to it. Foreign frames have their own unit over that of
    their responses, which nobody knows, unless they say in ``cube_units`` what it comes to.
    """
    check_frames(frames)
    if "cube_units" in frames.attrs:
        return str(frames.attrs["cube_units"])
    if frames.attrs.get("model") != FOREIGN:
        return UNITS
    units = str(frames.attrs["units"])
    return units if (frames["response"].values == 1).all() else units + OVER_RESPONSE


def with_unit_shifts(frames: xr.Dataset) -> xr.Dataset:
    """Return the same data whose H believes in perfect mirrors and pixels, and that band k lands exactly k columns on.

    That is what a matched set-up hides. Layers that are binned stay so.
    """
    import xarray as xr

    check_frames(frames)
    count = frames.sizes["wavelength"]
    changed = frames.drop_vars(["tap", "first_row", "first_column", "mirror", "pixel_gain"], errors="ignore").assign(
        first_column=("wavelength", np.arange(count, dtype=np.int64)),
        tap=xr.DataArray(np.ones((count, 1)), dims=("wavelength", "column")),
    )
    return changed.assign_attrs(operator="unit-shift", crosstalk=0.0)
