"""The fixed patterns of pixels: each one's own response (PRNU) and own dark signal (DSNU) (theory.md (C.50))."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.optics_config import SensorConfig

_STREAM = 0x70726E75


def fixed_pattern(shape: tuple[int, int, int], config: SensorConfig) -> tuple[np.ndarray, np.ndarray]:
    """Draw the fixed patterns of a sensor, the same for every shot.

    Args:
        shape: (C, M, W), C = 1 or the number of layers.
        config: its ``prnu``, ``dsnu_e`` and ``pattern_seed`` are read.

    Returns:
        (gain (M, W), offset_e (C, M, W)), float64: normal around 1 and 0 with the standard deviations ``prnu`` and
        ``dsnu_e``; a gain below 0 becomes 0. The layers of a pixel share its aperture, hence its gain; each layer is
        read by its own transistors, hence has its own offset. Exactly 1 and 0 where the deviation is 0.

    Raises:
        InputError: field ``shape``.
    """
    if len(shape) != 3 or min(shape) < 1:
        raise InputError("shape", shape, "(channels, rows, columns), each at least 1")
    gain, offset = np.ones(shape[1:]), np.zeros(shape)
    if config.prnu > 0:
        gain = np.maximum(1 + config.prnu * _stream(config.pattern_seed, 0).standard_normal(shape[1:]), 0.0)
    if config.dsnu_e > 0:
        offset = config.dsnu_e * _stream(config.pattern_seed, 1).standard_normal(shape)
    return gain, offset


def _stream(seed: int, which: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(_STREAM, which))))
