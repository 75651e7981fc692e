"""From the light on each pixel to the mean charge that it reports: mosaic, crosstalk, binned layers, response (theory.md (C.44))."""

from __future__ import annotations

import numpy as np

from optsim.camera.fixed_pattern import fixed_pattern
from optsim.camera.layer_bins import bin_layers
from optsim.camera.optics_config import SensorConfig
from optsim.camera.sensor import Sensor


def charges(light: np.ndarray, mosaic: np.ndarray | None, sensor: Sensor, config: SensorConfig) -> np.ndarray:
    """Return (L, C', M, W) mean electrons: each pixel's own curve, charge shared with neighbours, layers binned, PRNU.

    Args:
        light: (L, C, M, W) electrons that each curve would give.
        mosaic: (M, W) curve of each pixel, or None: every pixel has all curves.
        sensor: its binned layers.
        config: crosstalk and PRNU.
    """
    if mosaic is not None:
        light = np.take_along_axis(light, mosaic.astype(np.intp)[None, None], axis=1)
    light = shared(light, config.crosstalk)
    if max(sensor.layer_bins) > 1:
        light = bin_layers(light, sensor.layer_bins)
    if config.prnu > 0:
        rows, columns = light.shape[-2:]
        light = light * fixed_pattern((light.shape[1], rows, columns), config)[0]
    return light


def shared(charge: np.ndarray, crosstalk: float) -> np.ndarray:
    """Return charge (..., M, W) of which each pixel gives a share to each of its four neighbours; beyond the border it is lost."""
    if crosstalk == 0:
        return charge
    result = charge * (1 - 4 * crosstalk)
    result[..., 1:, :] += crosstalk * charge[..., :-1, :]
    result[..., :-1, :] += crosstalk * charge[..., 1:, :]
    result[..., :, 1:] += crosstalk * charge[..., :, :-1]
    result[..., :, :-1] += crosstalk * charge[..., :, 1:]
    return result
