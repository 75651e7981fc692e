"""How noisy is each measurement? What a frames file says of its camera is enough to tell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.frames import signal_of
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr


NEEDED = ("gain", "read_noise_e", "dark_e_per_s")
"""Attributes that tell how frames in DN were read out."""


def noise_unknown(frames: xr.Dataset) -> str:
    """Return what a frames file lacks to tell its noise, as text; empty when it lacks nothing."""
    units = frames.attrs.get("units")
    lacking = [name for name in NEEDED if name not in frames.attrs]
    return ", ".join(([f"units {units!r}"] if units != "DN" else []) + ([f"no {' and '.join(lacking)}"] if lacking else []))


def noise_variance(frames: xr.Dataset) -> np.ndarray | None:
    """Return the variance of each measurement, in squared units of the frames (theory.md (C.12)).

    It is that of photons, dark current, read-out and rounding. The number of photons is known by the measurement alone: a pixel's own
    value stands for its mean, and none counts as less noisy than half of what a dark one is.

    Args:
        frames: as ``measure`` makes them.

    Returns:
        (L, C, M, W), or None for frames without noise or that don't say how they were read out.

    Raises:
        InputError: an attribute that is no number.
    """
    attrs = frames.attrs
    if noise_unknown(frames):
        return None
    gain, read_noise, dark, time = (_number(attrs, name) for name in (*NEEDED, "exposure_s"))
    return variance_of(signal_of(frames), gain, read_noise**2 + dark * time)


def _number(attrs: Mapping[Any, Any], name: str) -> float:
    value = attrs.get(name, 0.0)
    if isinstance(value, str | bytes) or not math.isfinite(float(value)) or value < 0:
        raise InputError(name, value, "a finite number, at least 0")
    return float(value)


def variance_of(signal_dn: np.ndarray, gain: float, dark_e2: float) -> np.ndarray:
    """Return the variance in DN^2 of measurements without their dark level.

    Unbiased but for the floor, half of a dark pixel's variance.

    Args:
        signal_dn: any shape.
        gain: DN per electron.
        dark_e2: variance of a pixel without light before rounding, in squared electrons.
    """
    dark = gain**2 * dark_e2 + 1 / 12
    return np.asarray(np.maximum(gain * signal_dn + dark, dark / 2))
