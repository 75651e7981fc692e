"""What about a foreign measurement does not fit together, though each part of it is allowed: told before it is reconstructed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optsim.camera.frames import signal_of

if TYPE_CHECKING:
    import xarray as xr

LIT = 1e-3
"""A column carries light when its sum is above this share of the brightest column's; columns together when they have this share of all."""
BELOW = 0.01
"""Signal below zero, as a share of all, that read-out noise round a right offset does not reach in frames worth reconstructing."""


def doubts(frames: xr.Dataset) -> list[str]:
    """Say what wrong shifts, a wrong mask or a wrong offset would look like.

    Args:
        frames: a measurement whose bands fall on columns (:func:`optsim.camera.elsewhere.frames_from`).

    Returns:
        Sentences: bands that fall partly off the frame, lit columns that no band reaches, signal below the offset.
    """
    signal = signal_of(frames)
    return [*_bands_off(frames), *_columns_unreached(frames, signal), *_below_offset(frames, signal)]


def _bands_off(frames: xr.Dataset) -> list[str]:
    columns, width = frames.sizes["mirror_x"], frames.sizes["x"]
    first, taps = frames["first_column"].values, frames["tap"].values
    start = first[:, None] + np.arange(taps.shape[1])
    inside = np.clip(np.minimum(start + columns, width) - np.maximum(start, 0), 0, columns)
    lost = (taps * (columns - inside)).sum(1)
    off = np.flatnonzero(lost > 1e-9)
    if off.size == 0:
        return []
    worst = off[np.argmax(lost[off])]
    return [
        f"{off.size} of {len(first)} bands fall partly off the frame of {width} columns, that at {frames['wavelength'].values[worst]:g} nm "
        f"by {lost[worst]:g} of the mask's {columns} columns: their light is taken as lost; are --shifts and the mask's width right?"
    ]


def _columns_unreached(frames: xr.Dataset, signal: np.ndarray) -> list[str]:
    width, columns = frames.sizes["x"], frames.sizes["mirror_x"]
    is_open, first, taps = (frames["mask"].values > 0).any((0, 1)), frames["first_column"].values, frames["tap"].values
    seen = (frames["response"].values != 0).any(0)
    reached = np.zeros(width, bool)
    for k, t in np.argwhere((taps != 0) & seen[:, None]):
        places = np.arange(columns)[is_open] + first[k] + t
        reached[places[(places >= 0) & (places < width)]] = True
    light = signal.sum((0, 1, 2))
    missed = ~reached & (light > LIT * light.max())
    share = light[missed].sum() / light[light > 0].sum() if missed.any() else 0.0
    if share <= LIT:
        return []
    where = np.flatnonzero(missed)
    return [
        f"{missed.sum()} of {width} columns carry light that no band explains ({share:.2g} of all; {where[0]} to {where[-1]}, counted"
        " from 0): are --shifts, the mask and --offset right?"
    ]


def _below_offset(frames: xr.Dataset, signal: np.ndarray) -> list[str]:
    below, total = float(-signal[signal < 0].sum()), float(np.abs(signal).sum())
    if total == 0 or below <= BELOW * total:
        return []
    offset, pixels = float(frames.attrs.get("offset", 0.0)), np.mean(signal < 0)
    return [f"{pixels:.2g} of the pixels are below the offset {offset:g}, with {below / total:.2g} of the signal: is --offset right?"]
