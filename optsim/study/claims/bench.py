"""The paper's test bed: a monochrome camera of 8 bits, alone and behind red, green and blue glass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from optsim.camera import CameraConfig, Distinct, Exposure, Mono, Noise, band_model_of, masks_for, photograph, signal_of
from optsim.camera.emulate import GlassPlates, bayer_of, foveon_of, plate_exposures
from optsim.report.data import Series
from optsim.study.claims.captures import PHOTOGRAPH, READ_NOISE_E, Taken, draw
from optsim.study.claims.worlds import World

if TYPE_CHECKING:
    import xarray as xr

BENCH_BITS = 8


@dataclass(frozen=True)
class Bench:
    """The default camera with diffraction, leaking mirrors and read noise; every exposure fills 0.9 of the well.

    H knows where the prism lays each band and how it spreads along the row, as a calibration with a monochromator tells;
    blur and leak it does not know.
    """

    @property
    def name(self) -> str:
        """Return its name."""
        return "bench"

    def frames(self, world: World, series: Series, groups: int, seed: int) -> xr.Dataset:
        """Return what the test bed records for one sensor, as a frames file."""
        camera, mono = CameraConfig(), Mono.silicon()
        noise = Noise(bits=BENCH_BITS, read_noise_e=READ_NOISE_E)
        exposure = Exposure(noise=noise, seed=seed, masks_name=series.masks)
        with PHOTOGRAPH:
            if series.sensor == "mono":
                masks = draw(mono, series, groups * mono.shots_per_group, world, seed)
                return photograph(world.fine, world.bands, camera, mono, masks, exposure)
            masks = _color_masks(world, groups, seed)
            three = plate_exposures(world.fine, world.bands, camera, masks, exposure, GlassPlates().before(mono))
        return bayer_of(three) if series.sensor == "bayer" else foveon_of(three)

    def take(self, world: World, series: Series, groups: int, seed: int) -> Taken:
        """Photograph, alone or behind glass."""
        frames = self.frames(world, series, groups, seed)
        return Taken(band_model_of(frames).operator(np.float32), signal_of(frames))


def _color_masks(world: World, groups: int, seed: int) -> np.ndarray:
    """Return one mask a group, the one that the group's first monochrome shot has too."""
    shots = Mono().shots_per_group
    return masks_for(Mono(), groups * shots, Distinct(), (world.size, world.size), seed)[::shots]
