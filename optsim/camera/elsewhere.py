"""Measurements that another camera or program made, as the same Dataset that ours gives: from frames, masks and shifts alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.band_model import BandModel
from optsim.camera.dmd import check_masks
from optsim.camera.frames import make_frames
from optsim.cube import FOREIGN, Bands
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

CURVES = {1: ("mono",), 3: ("red", "green", "blue")}
SENSORS = {1: "mono", 3: "three-channel"}


def frames_from(
    frames: ArrayLike,
    masks: ArrayLike,
    shift_px: ArrayLike,
    bands: Bands,
    *,
    response: ArrayLike | None = None,
    mosaic: np.ndarray | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Describe a measurement by what made it, so that it can be reconstructed (theory.md (S.1)).

    Band k of mirror column n falls on sensor column ``n + shift_px[k]``; a shift between two columns divides its light linearly.

    Args:
        frames: (y, x), (shot, y, x) or (shot, channel, y, x); finite.
        masks: (y, x) or (shot, y, x), one a frame, from 0 to 1.
        shift_px: (K,) finite; whole, broken, of either sign. Redder bands to larger x: increasing.
        bands: the K bands.
        response: (K,) or (curves, K) frames-units per cube-unit; None: 1, for one curve only.
        mosaic: (y, x) of the sensor, the curve of each pixel; None: every pixel has every channel.
        attrs: ``offset`` (the level without light), ``units`` (relative, electron or DN) and what else is known.

    Raises:
        InputError: naming ``frames``, ``masks``, ``shift_px``, ``response`` or ``mosaic``.
    """
    from recon.coded_aperture import shift_taps

    values, patterns = np.asarray(frames, np.float64), np.asarray(masks)
    values = values[(None,) * max(0, 3 - values.ndim)]
    values = values[:, None] if values.ndim == 3 else values
    patterns = check_masks(patterns[None] if patterns.ndim == 2 else patterns, gray=True)
    _check_shapes(values, patterns)
    _check_light(values, patterns)
    shifts = _checked_shifts(shift_px, bands.count, patterns.shape[2], values.shape[3])
    first, taps = shift_taps(shifts)
    if mosaic is not None and values.shape[1] != 1:
        raise InputError("frames", values.shape, "of one channel, as the mosaic tells each pixel's curve")
    chi = _response(response, bands.count, values.shape[1] if mosaic is None else None)
    sensor = SENSORS[values.shape[1]] if mosaic is None else "bayer"
    if mosaic is not None:
        _check_mosaic(mosaic, values.shape[2:], chi.shape[0])
    model = BandModel(
        masks=patterns,
        response=chi,
        first_column=first,
        taps=taps,
        shift_px=shifts,
        mosaic=mosaic,
        width=values.shape[3],
        bands=bands,
        sensor=sensor,
        curve_names=CURVES.get(chi.shape[0], tuple(f"curve {c}" for c in range(chi.shape[0]))),
    )
    return make_frames(values, model, {"units": "relative", "model": FOREIGN, "masks": "distinct", "operator": "stated", **(attrs or {})})


def _check_shapes(values: np.ndarray, masks: np.ndarray) -> None:
    if values.ndim != 4 or 0 in values.shape:
        raise InputError("frames", values.shape, "of shape (y, x), (shot, y, x) or (shot, channel, y, x)")
    if values.shape[1] not in SENSORS:
        raise InputError("frames", values.shape, f"of {' or '.join(map(str, SENSORS))} channels")
    if values.shape[0] != masks.shape[0]:
        raise InputError("masks", f"{masks.shape[0]} masks", f"one a frame: {values.shape[0]}")
    if values.shape[2] != masks.shape[1]:
        raise InputError("masks", f"{masks.shape[1]} rows", f"{values.shape[2]} rows, as the frames have")


def _check_light(values: np.ndarray, masks: np.ndarray) -> None:
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        where = tuple(int(i) for i in bad[0])
        form = f"finite everywhere; first bad (shot, channel, y, x) is {where} (a pixel of infinite noise is left out by recon.reconstruct)"
        raise InputError("frames", float(values[where]), form)
    closed = np.flatnonzero(~(masks > 0).any((1, 2)))
    if len(closed):
        raise InputError("masks", f"shot {closed[0] + 1} closed everywhere", "open somewhere in every shot")


def _checked_shifts(shift_px: ArrayLike, count: int, columns: int, width: int) -> np.ndarray:
    shifts = np.asarray(shift_px, np.float64)
    if shifts.shape != (count,) or not np.isfinite(shifts).all():
        raise InputError("shift_px", shifts.shape, f"{count} finite numbers, one a band, in px")
    outside = (shifts <= -columns) | (shifts >= width)
    if outside.any():
        k = int(np.argmax(outside))
        raise InputError("shift_px", float(shifts[k]), f"such that band {k} falls on the frame: above {-columns} and below {width} px")
    return shifts


def _response(response: ArrayLike | None, count: int, channels: int | None) -> np.ndarray:
    if response is None and channels is not None and channels > 1:
        raise InputError(
            "response", None, f"stated for {channels} channels, of shape ({channels}, {count}): channels that see alike are one"
        )
    chi = np.ones((1, count)) if response is None else np.atleast_2d(np.asarray(response, np.float64))
    if chi.ndim != 2 or chi.shape[1] != count or not np.isfinite(chi).all() or (channels is not None and chi.shape[0] != channels):
        raise InputError("response", chi.shape, f"finite, of shape ({channels or 'curves'}, {count})")
    return chi


def _check_mosaic(mosaic: np.ndarray, shape: tuple[int, ...], curves: int) -> None:
    if mosaic.shape != shape or mosaic.dtype.kind not in "iu" or mosaic.min() < 0 or mosaic.max() >= curves:
        raise InputError("mosaic", (mosaic.shape, str(mosaic.dtype)), f"integers from 0 to {curves - 1}, of the frames' shape {shape}")
