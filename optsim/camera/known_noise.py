"""How noisy is each measurement? What a frames file says of its camera is enough to tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optsim.camera.frames import signal_of

if TYPE_CHECKING:
    import xarray as xr


def noise_variance(frames: xr.Dataset) -> np.ndarray | None:
    """Return the variance of each measurement, in squared units of the frames (theory.md (C.12)).

    It is that of photons, dark current, read-out and rounding. The number of photons is known by the measurement alone: a pixel's own
    value stands for its mean, and none counts as less noisy than half of what a dark one is.

    Args:
        frames: as ``measure`` makes them.

    Returns:
        (L, C, M, W), or None for frames without noise or that don't say how they were read out.
    """
    attrs = frames.attrs
    if attrs.get("units") != "DN" or not {"gain", "read_noise_e", "dark_e_per_s"} <= set(attrs):
        return None
    gain = float(attrs["gain"])
    dark_e = float(attrs["dark_e_per_s"]) * float(attrs.get("exposure_s", 0.0))
    return variance_of(signal_of(frames), gain, float(attrs["read_noise_e"]) ** 2 + dark_e)


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
