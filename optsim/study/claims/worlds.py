"""Scenes in front of the camera, each with masks of its own: what the readings of the paper look at."""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from optsim.camera import CameraConfig
from optsim.cube import Bands, band_mean, bands_of, block_mean

if TYPE_CHECKING:
    import xarray as xr

TARGET_1, TARGET_2, BENCH = "color-checker", "color-checker-bars", "bricks"
SUBDIVIDE = 10
"""Wavelengths inside every band of the fine cube."""
SAMPLES = 2
"""Along each side of a mirror."""


@dataclass(frozen=True)
class Cell:
    """One trial: a scene behind one random mask series.

    Args:
        scene: name in the catalogue.
        mask: number of the trial.
        size: mirrors along each side.
    """

    scene: str
    mask: int
    size: int

    @property
    def random(self) -> bool:
        """Tell whether the scene stands for scenes at large."""
        return self.scene not in (TARGET_1, TARGET_2, BENCH)

    @property
    def name(self) -> str:
        """Return a name fit for files."""
        return f"{self.scene}-{self.size}-m{self.mask}"

    def seed(self, root: int) -> int:
        """Return the seed of masks, noise and calibration: its own for every scene, one for both targets."""
        family = zlib.crc32(self.scene.encode()) if self.random or self.scene == BENCH else 1
        state = np.random.SeedSequence(root, spawn_key=(0x63656C6C, family, self.mask)).generate_state(2, np.uint32)
        return int(state[0]) << 20 | int(state[1]) >> 12


class World:
    """One scene at one size: rendered finely when first needed.

    Args:
        scene: name in the catalogue.
        size: mirrors along each side.
        error: of the render.
        seed: of the render.
    """

    def __init__(self, scene: str, size: int, error: float, seed: int) -> None:
        self.scene, self.size, self._error, self._seed = scene, size, error, seed
        self.bands = Bands.paper()

    @cached_property
    def fine(self) -> xr.Dataset:
        """Return the cube at ten wavelengths a band and two samples along a mirror."""
        from optsim.render import RenderSettings, render
        from scenes import scene_by_name

        passes = CameraConfig().bandpass
        bands = self.bands.subdivide(SUBDIVIDE, (passes.lower_nm, passes.upper_nm))
        settings = RenderSettings(oversample=SAMPLES, error=self._error, seed=self._seed)
        return render(scene_by_name(self.scene).build(), bands, (self.size, self.size), settings)

    @cached_property
    def cube(self) -> xr.Dataset:
        """Return the true cube: the fine one's means over mirrors and bands, with the scene's light in the same bands."""
        cube = band_mean(block_mean(self.fine, SAMPLES), self.bands)
        return cube.assign_attrs(scene=self.scene, bands="paper", illuminant=self._light())

    def _light(self) -> str:
        """Return the fine cube's note of its light, averaged over the bands."""
        fine = bands_of(self.fine)
        inside = np.minimum(fine.upper, self.bands.upper[:, None]) - np.maximum(fine.lower, self.bands.lower[:, None])
        shares = np.maximum(inside, 0.0) / np.maximum(inside, 0.0).sum(1, keepdims=True)
        noted = json.loads(self.fine.attrs["illuminant"])
        white, lamps = (np.asarray(noted[name], np.float64).reshape(-1, fine.count) @ shares.T for name in ("white", "lamps"))
        return json.dumps({"white": white[0].tolist(), "lamps": lamps.tolist()})

    @cached_property
    def truth(self) -> np.ndarray:
        """Return the true radiance (M, N, K) in float64."""
        return np.asarray(self.cube["radiance"].values, np.float64)
