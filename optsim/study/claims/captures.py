"""How the data of a reading come about, and the H that goes with them."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from optsim.camera import (
    Bayer,
    CameraConfig,
    Distinct,
    Exposure,
    Noise,
    OwnShifts,
    Repeated,
    Sensor,
    UnitShift,
    masks_for,
    matched_model,
    photograph,
    physical_model,
    signal_of,
)
from optsim.camera.known_noise import variance_of
from optsim.camera.noise import expose
from optsim.report.data import Series
from optsim.study.assumptions import Calibrated
from optsim.study.claims.curves import PUBLISHED, Curves, without_mosaic
from optsim.study.claims.demosaic import bilinear
from optsim.study.claims.worlds import World

if TYPE_CHECKING:
    from optsim.camera import BandModel
    from optsim.camera.dmd import MaskRule
    from recon.operator import LinearOperator

READ_NOISE_E = 10.0
FULL_WELL_E = 200_000.0
BITS = 16
OFFSET_DN = 500.0
"""So that read noise is not cut off at the converter's zero."""
PHOTOGRAPH = threading.Lock()
"""One photograph at a time: Dr.Jit uses all cores for one anyway."""


@dataclass(frozen=True, eq=False)
class Taken:
    """One measurement and what is believed of it.

    Args:
        operator: H, float32.
        signal: (L, C, M, W) frames without their dark level.
        variance: of each measurement, where noise was made; None without noise.
    """

    operator: LinearOperator
    signal: np.ndarray
    variance: np.ndarray | None = None


class Capture(Protocol):
    """A way to come by data."""

    @property
    def name(self) -> str:
        """Return its name, unique among captures."""
        ...

    def take(self, world: World, series: Series, groups: int, seed: int) -> Taken:
        """Photograph a world with one series' sensor and mask rule; ``seed`` draws masks, noise and calibration."""
        ...


@dataclass(frozen=True)
class Matched:
    """Data made by the paper's discrete model: g = H f, without noise."""

    curves: Curves = PUBLISHED

    @property
    def name(self) -> str:
        """Return its name."""
        return f"matched-{self.curves.name}"

    def take(self, world: World, series: Series, groups: int, seed: int) -> Taken:
        """Apply H."""
        sensor = self.curves.of(series.sensor)
        masks = draw(sensor, series, groups * sensor.shots_per_group, world, seed)
        model = matched_model(sensor, world.bands, masks)
        return Taken(model.operator(np.float32), model.operator(np.float64).forward(world.truth))

    def believed(self, world: World, sensor: Sensor, masks: np.ndarray, seed: int) -> BandModel:
        """Return the model of a sensor."""
        return matched_model(sensor, world.bands, masks)


class Belief(Protocol):
    """What H knows of where the prism lays the bands."""

    @property
    def name(self) -> str:
        """Return its name."""
        ...

    def knowledge(self, camera: CameraConfig, world: World, seed: int) -> OwnShifts:
        """Return the camera's kind of knowledge."""
        ...


@dataclass(frozen=True)
class KnowsAll:
    """H has the camera's own columns and weights (its smile, at most 0.006 px, is left out)."""

    name = "exact"

    def knowledge(self, camera: CameraConfig, world: World, seed: int) -> OwnShifts:
        """Return the camera's shifts."""
        return OwnShifts()


@dataclass(frozen=True)
class KnowsSpots:
    """H has a curve fitted to spots of a monochromator, each centroid off by 0.1 px; every seed is a calibration of its own."""

    name = "calibrated"

    def knowledge(self, camera: CameraConfig, world: World, seed: int) -> OwnShifts:
        """Return the fitted curve."""
        return Calibrated().knowledge(camera, world.bands, seed)  # type: ignore[return-value]


@dataclass(frozen=True)
class KnowsNothing:
    """H believes that band k lands exactly k columns on, as the paper's model does."""

    name = "unit-shift"

    def knowledge(self, camera: CameraConfig, world: World, seed: int) -> OwnShifts:
        """Return unit shifts."""
        return UnitShift()


@dataclass(frozen=True)
class Physical:
    """Data of the fine camera model: ten wavelengths a band, the traced prism, no noise; mean electrons of one second."""

    curves: Curves = PUBLISHED
    belief: Belief = KnowsAll()

    @property
    def name(self) -> str:
        """Return its name."""
        return f"physical-{self.curves.name}-{self.belief.name}"

    def take(self, world: World, series: Series, groups: int, seed: int) -> Taken:
        """Photograph."""
        sensor = self.curves.of(series.sensor)
        masks = draw(sensor, series, groups * sensor.shots_per_group, world, seed)
        with PHOTOGRAPH:
            frames = photograph(world.fine, world.bands, CameraConfig().ideal(), sensor, masks, Exposure(time_s=1.0))
        return Taken(self.believed(world, sensor, masks, seed).operator(np.float32), signal_of(frames))

    def believed(self, world: World, sensor: Sensor, masks: np.ndarray, seed: int) -> BandModel:
        """Return the model of a sensor as H believes the camera to be."""
        camera = CameraConfig().ideal()
        return physical_model(camera, sensor, world.bands, masks, self.belief.knowledge(camera, world, seed))


@dataclass(frozen=True)
class Demosaiced:
    """Bayer frames whose colours are interpolated first, inverted as if every pixel had measured all three."""

    base: Matched | Physical

    @property
    def name(self) -> str:
        """Return its name."""
        return f"{self.base.name}-demosaiced"

    def take(self, world: World, series: Series, groups: int, seed: int) -> Taken:
        """Photograph through the mosaic and interpolate."""
        sensor = self.base.curves.of(series.sensor)
        assert isinstance(sensor, Bayer)
        taken = self.base.take(world, series, groups, seed)
        full = bilinear(taken.signal[:, 0], sensor.mosaic(*taken.signal.shape[-2:]))
        masks = draw(sensor, series, groups, world, seed)
        model = self.base.believed(world, without_mosaic(sensor), masks, seed)
        return Taken(model.operator(np.float32), full)


@dataclass(frozen=True)
class Lit:
    """Matched data with shot noise, read noise and a converter.

    Args:
        electrons: in the brightest pixel of one monochrome shot of unit exposure; with ``own`` of the sensor's own.
        shots: L.
        exposure: of a shot, relative to the colour sensors'.
        own: whether the sensor is exposed until its own brightest pixel holds ``electrons``.
        curves: the sensors.
    """

    electrons: float
    shots: int
    exposure: float = 1.0
    own: bool = False
    curves: Curves = PUBLISHED

    @property
    def name(self) -> str:
        """Return its name."""
        amount = "own" if self.own else f"x{self.exposure:.4g}"
        return f"lit-{self.curves.name}-{self.electrons:g}e-{self.shots}-{amount}"

    def take(self, world: World, series: Series, groups: int, seed: int) -> Taken:
        """Expose the frames of H."""
        sensor = self.curves.of(series.sensor)
        masks = draw(sensor, series, self.shots, world, seed)
        model = matched_model(sensor, world.bands, masks)
        mean = model.operator(np.float64).forward(world.truth)
        brightest = mean if self.own else self._mono(world, seed)
        scale = self.electrons * self.exposure / float(brightest.max())
        noise = Noise(read_noise_e=READ_NOISE_E, bits=BITS, offset_dn=OFFSET_DN)
        seen = expose(mean * scale, noise, full_well_e=FULL_WELL_E, exposure_s=0.0, seed=seed)
        signal = seen.dn - seen.dark_dn
        variance = variance_of(signal, seen.gain, READ_NOISE_E**2)
        return Taken(model.scaled(scale * seen.gain).operator(np.float32), signal, variance)

    def _mono(self, world: World, seed: int) -> np.ndarray:
        """Return the frame of one monochrome shot, by which all sensors are exposed."""
        sensor = self.curves.of("mono")
        masks = masks_for(sensor, 1, Distinct(), (world.size, world.size), seed)
        return matched_model(sensor, world.bands, masks).operator(np.float64).forward(world.truth)


def draw(sensor: Sensor, series: Series, shots: int, world: World, seed: int) -> np.ndarray:
    """Draw the masks of a series: the first one is shared by all sensors of a seed."""
    rules: dict[str, MaskRule] = {rule.name: rule for rule in (Distinct(), Repeated())}
    alone = shots % sensor.shots_per_group != 0  # less than a group of three: nothing to repeat
    return masks_for(sensor, shots, Distinct() if alone else rules[series.masks], (world.size, world.size), seed)
