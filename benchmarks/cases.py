"""Measurements to judge reconstructions by: rendered scenes through the matched model of each sensor, with and without noise.

Shared by the benchmarks of tau, of uncertainty and of solvers. Nothing is stored: a scene of 64 x 64 renders in about a second.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from optsim.camera import Distinct, Noise, Repeated, band_model_of, masks_for, measure_matched, sensors, signal_of
from optsim.cube import Bands, block_mean
from optsim.render import RenderSettings, render
from recon import CodedAperture, FieldAperture
from scenes import scene_by_name
from scenes.procedural import Procedural

SENSORS = ("mono", "mono-repeated", "bayer", "foveon")
"""Three mono shots with a mask each or with one mask, or one colour shot: R = 1/8 at 24 bands."""
READ_NOISE_E = 10.0
BITS = 12


@dataclass(frozen=True)
class Case:
    """Name one measurement.

    Args:
        scene: of ``scenes.SCENES``, or procedural-SEED.
        sensor: of ``SENSORS``.
        well: full well in electrons, 90 % of which the brightest pixel fills; None: no noise.
        seed: of masks and noise.
        size: mirrors along each side.
    """

    scene: str
    sensor: str
    well: int | None = None
    seed: int = 1
    size: int = 64

    @property
    def light(self) -> str:
        """Say how much light there is."""
        return "no noise" if self.well is None else f"{self.well} e"


@dataclass(frozen=True)
class Measured:
    """Hold H, the frames without their dark level, the variance of each (None: no noise), and the true cube (M, N, K), peak 1."""

    operator: CodedAperture | FieldAperture
    frames: np.ndarray
    variance: np.ndarray | None
    truth: np.ndarray


@lru_cache(maxsize=16)
def rendered(scene: str, size: int) -> Any:
    """Return the cube of a scene in the paper's 24 bands, scaled to peak 1."""
    number = scene.removeprefix("procedural-")
    recipe = Procedural(seed=int(number)).build() if number.isdigit() else scene_by_name(scene).build()
    cube = block_mean(render(recipe, Bands.paper(), (size, size), RenderSettings(oversample=2, error=0.01, seed=1)), 2)
    return cube.assign(radiance=cube["radiance"] / float(cube["radiance"].max()))


def measured(case: Case, dtype: Any = np.float32) -> Measured:
    """Photograph a case by the matched model."""
    mono, bayer, foveon = sensors()
    sensor, shots = {"bayer": (bayer, 1), "foveon": (foveon, 1)}.get(case.sensor, (mono, 3))
    cube = rendered(case.scene, case.size)
    truth = cube["radiance"].values.astype(np.float64)
    masks = masks_for(sensor, shots, Repeated() if case.sensor == "mono-repeated" else Distinct(), truth.shape[:2], case.seed)
    noise = None if case.well is None else Noise(read_noise_e=READ_NOISE_E, bits=BITS)
    frames = measure_matched(cube, sensor, masks, seed=case.seed, noise=noise, full_well_e=float(case.well or 1))
    signal = signal_of(frames)
    variance = None if noise is None else variance_of(signal, float(frames.attrs["gain"]))
    return Measured(band_model_of(frames).operator(dtype), signal, variance, truth)


def variance_of(signal: np.ndarray, gain: float) -> np.ndarray:
    """Return the variance in DN^2 that frames of ``signal`` (DN, without the dark level) say they have: photons, read-out, rounding."""
    return gain**2 * (np.maximum(signal / gain, 0.0) + READ_NOISE_E**2) + 1 / 12
