"""Three sensors: monochrome, Bayer mosaic, and Foveon's three layers in every pixel."""

from __future__ import annotations

import functools
import itertools
from abc import ABC, abstractmethod
from enum import Enum
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, field_validator

from optsim.camera.dmd import MONO_SHOTS_PER_GROUP
from optsim.camera.model import Model
from optsim.cube import Bands
from optsim.errors import InputError
from scenes.spectrum import Spectrum

COLOUR_NAMES = ("red", "green", "blue")


class BayerPhase(Enum):
    """Name the curve (0 red, 1 green, 2 blue) of the mosaic's top left 2 x 2 pixels, row by row."""

    RGGB = (0, 1, 1, 2)
    GRBG = (1, 0, 2, 1)
    GBRG = (1, 2, 0, 1)
    BGGR = (2, 1, 1, 0)


class Sensor(Model, ABC):
    """A sensor: its spectral curves and which of them each pixel has.

    Curves are quantum efficiencies relative to one common factor, in [0, 1]: as published, each with maximum 1,
    unless given otherwise.
    """

    place: ClassVar[str] = "sensor"
    name: ClassVar[str]
    curve_names: ClassVar[tuple[str, ...]]
    shots_per_group: ClassVar[int] = 1

    @property
    @abstractmethod
    def curves(self) -> tuple[Spectrum, ...]:
        """Return the C curves in the order of ``curve_names``."""

    @property
    def channels(self) -> int:
        """Return how many numbers one pixel yields: 1, or 3 for Foveon."""
        return len(self.curves)

    @property
    def layer_bins(self) -> tuple[int, ...]:
        """Return for each curve how many pixels along y and x share one pixel of its layer: 1 but for the Quattro."""
        return (1,) * len(self.curves)

    def mosaic(self, rows: int, columns: int) -> np.ndarray | None:
        """Return (rows, columns) int8, the index of each pixel's curve; None when every pixel has all curves."""
        return None

    def response(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the (C, ...) curves at wavelengths in nm.

        Raises:
            InputError: field ``sensor.curve`` naming the range that a curve lacks.
        """
        wavelength = np.asarray(wavelength_nm, np.float64)
        self.check_range(float(wavelength.min()), float(wavelength.max()))
        return np.stack([curve.at(wavelength) for curve in self.curves])

    def band_mean(self, bands: Bands) -> np.ndarray:
        """Return the (C, K) means of the curves over the bands (exact for piecewise linear curves)."""
        self.check_range(float(bands.lower.min()), float(bands.upper.max()))
        return np.stack([curve.band_mean(bands.lower, bands.upper) for curve in self.curves])

    def check_range(self, low_nm: float, high_nm: float) -> None:
        """Refuse wavelengths that a curve does not cover; nothing is assumed beyond published data.

        Raises:
            InputError: field ``sensor.curve`` naming the missing range in nm.
        """
        for name, curve in zip(self.curve_names, self.curves):
            first, last = curve.range_nm
            missing = [f"{low_nm:g}-{min(first, high_nm):g}"] if low_nm < first - 1e-6 else []
            missing += [f"{max(last, low_nm):g}-{high_nm:g}"] if high_nm > last + 1e-6 else []
            if missing:
                raise InputError(
                    "sensor.curve",
                    f"{low_nm:g}-{high_nm:g} nm",
                    f"within {first:g}-{last:g} nm, the data of the {self.name} sensor's {name} curve; missing: {' and '.join(missing)} nm",
                )


class Mono(Sensor):
    """A monochrome sensor; flat response 1 unless a curve is given."""

    name = "mono"
    curve_names = ("mono",)
    shots_per_group = MONO_SHOTS_PER_GROUP
    curve: Spectrum = Field(default_factory=lambda: Spectrum.constant(1.0, name="flat"))

    @property
    def curves(self) -> tuple[Spectrum, ...]:
        """Return the one curve."""
        return (self.curve,)

    @classmethod
    def silicon(cls, depth_um: float = 5.0) -> Mono:
        """Return a sensor that collects all electrons freed within a depth of silicon, behind a perfect coating (theory.md (C.11))."""
        wavelength, absorption = silicon_absorption()
        return cls(curve=Spectrum(wavelength, layer_absorption(absorption, [0.0, depth_um])[0], f"silicon, {depth_um:g} um"))

    @field_validator("curve")
    @classmethod
    def _in_range(cls, value: Spectrum) -> Spectrum:
        return _quantum_efficiency(value)


class _Colour(Sensor):
    curve_names = COLOUR_NAMES
    red: Spectrum
    green: Spectrum
    blue: Spectrum

    @property
    def curves(self) -> tuple[Spectrum, ...]:
        """Return the curves in the order red, green, blue."""
        return (self.red, self.green, self.blue)

    @field_validator(*COLOUR_NAMES)
    @classmethod
    def _in_range(cls, value: Spectrum) -> Spectrum:
        return _quantum_efficiency(value)


class Bayer(_Colour):
    """A sensor with one colour filter a pixel: half green, a quarter red, a quarter blue."""

    name = "bayer"
    phase: BayerPhase = BayerPhase.RGGB

    @classmethod
    def nikon(cls, phase: BayerPhase = BayerPhase.RGGB) -> Bayer:
        """Return the filters of a Nikon 5100, measured by NPL."""
        return cls(**_published("nikon-5100"), phase=phase)

    @property
    def channels(self) -> int:
        """Return 1: each pixel yields the number of its own colour."""
        return 1

    def mosaic(self, rows: int, columns: int) -> np.ndarray:
        """Return (rows, columns) int8 of 0 red, 1 green, 2 blue."""
        tile = np.array(self.phase.value, np.int8).reshape(2, 2)
        return tile[np.arange(rows)[:, None] % 2, np.arange(columns) % 2]


class Foveon(_Colour):
    """A sensor with three layers in every pixel, blue on top."""

    name = "foveon"

    @classmethod
    def sigma(cls) -> Foveon:
        """Return the layers of a Sigma SD Merrill (Foveon X3), measured by NPL."""
        return cls(**_published("sigma-sd-merrill"))


@functools.cache
def sensors() -> tuple[Sensor, ...]:
    """Return the sensors that are compared: monochrome, Bayer (Nikon 5100), Foveon (Sigma SD Merrill)."""
    return (Mono(), Bayer.nikon(), Foveon.sigma())


def layer_absorption(absorption_per_um: ArrayLike, borders_um: ArrayLike) -> np.ndarray:
    """Return the share of light absorbed between neighbouring borders, (layers, ...) (theory.md (C.11)).

    The share is exp(-a top) (1 - exp(-a thickness)), by expm1: right for 1e-20 as for 1e3.
    """
    absorption, borders = np.asarray(absorption_per_um, np.float64), np.asarray(borders_um, np.float64)
    if borders.ndim != 1 or borders.size < 2 or borders[0] < 0 or np.any(np.diff(borders) <= 0) or not np.all(np.isfinite(borders)):
        raise InputError("borders_um", borders.tolist(), "at least two increasing depths from 0 up, in um")
    if not np.all(np.isfinite(absorption)) or np.any(absorption < 0):
        raise InputError("absorption_per_um", absorption.tolist(), "finite and at least 0 per um")
    return np.stack([np.exp(-absorption * top) * -np.expm1(-absorption * (low - top)) for top, low in itertools.pairwise(borders)])


@functools.cache
def silicon_absorption() -> tuple[np.ndarray, np.ndarray]:
    """Return (wavelength_nm, absorption per um) of silicon at 300 K, 360-830 nm (Green 2008)."""
    from importlib import resources

    text = (resources.files("optsim") / "data" / "sensor" / "silicon_green2008.csv").read_text()
    wavelength, k = np.array([line.split(",") for line in text.splitlines()[1:]], np.float64).T
    return wavelength, 4 * np.pi * k / (wavelength / 1000)


def _published(name: str) -> dict[str, Spectrum]:
    from scenes.library import sensor_curves

    return sensor_curves(name)


def _quantum_efficiency(value: Spectrum) -> Spectrum:
    low, high = float(value.value.min()), float(value.value.max())
    if low < 0 or high > 1:
        raise InputError("", low if low < 0 else high, "a response in [0, 1] at every wavelength")
    return value
