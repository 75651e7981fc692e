"""Three sensors: monochrome, Bayer mosaic, and Foveon's three layers in every pixel."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from enum import Enum
from os import PathLike
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, field_validator

from optsim.camera.dmd import MONO_SHOTS_PER_GROUP
from optsim.camera.model import Model
from optsim.camera.sensor_files import curves_from_csv
from optsim.camera.silicon import SiliconLayers, layer_absorption, silicon
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

    def mosaic(self, rows: int, columns: int) -> np.ndarray:
        """Return (rows, columns) int8 of 0 red, 1 green, 2 blue."""
        tile = np.array(self.value, np.int8).reshape(2, 2)
        return tile[np.arange(rows)[:, None] % 2, np.arange(columns) % 2]


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

    @abstractmethod
    def with_peak_qe(self, peak: float) -> Self:
        """Return the same sensor with an absolute quantum efficiency: published curves are relative.

        Args:
            peak: largest value of any of its curves, in (0, 1].

        Raises:
            InputError: field ``sensor.peak_qe``.
        """

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
        if wavelength.size == 0:
            return np.zeros((len(self.curves), *wavelength.shape))
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
        data = silicon()
        share = layer_absorption(data.absorption_per_um, [0.0, depth_um])[0]
        return cls(curve=Spectrum(data.wavelength_nm, share, f"silicon, {depth_um:g} um"))

    @classmethod
    def from_csv(cls, path: str | PathLike[str]) -> Self:
        """Return a sensor with the curve of a CSV file with the columns wavelength_nm and mono."""
        return cls(**{"curve": curves_from_csv(path, ("mono",))["mono"]})

    def with_peak_qe(self, peak: float) -> Self:
        """Return the sensor whose curve's maximum is ``peak``."""
        return self.model_copy(update={"curve": _scaled(self.curves, peak)[0]})

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

    @classmethod
    def from_csv(cls, path: str | PathLike[str], **more: Any) -> Self:
        """Return a sensor with the curves of a CSV file with the columns wavelength_nm, red, green and blue."""
        return cls(**curves_from_csv(path, COLOUR_NAMES), **more)

    def with_peak_qe(self, peak: float) -> Self:
        """Return the sensor whose largest maximum is ``peak``; the ratios of its curves stay."""
        return self.model_copy(update=dict(zip(COLOUR_NAMES, _scaled(self.curves, peak))))

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
        return self.phase.mosaic(rows, columns)


class Foveon(_Colour):
    """A sensor with three layers in every pixel, blue on top."""

    name = "foveon"

    @classmethod
    def sigma(cls) -> Foveon:
        """Return the layers of a Sigma SD Merrill (Foveon X3), measured by NPL."""
        return cls(**_published("sigma-sd-merrill"))

    @classmethod
    def physical(cls, layers: SiliconLayers | None = None) -> Self:
        """Return three layers of silicon that divide the light by depth (theory.md (C.48), (C.49)).

        Curves are absolute quantum efficiencies. The default's depths and filter are those that fit a Sigma SD Merrill best
        (:func:`optsim.camera.foveon_fit.fit_layers`).
        """
        return cls(**dict(zip(("blue", "green", "red"), (SiliconLayers() if layers is None else layers).curves())))


@functools.cache
def sensors() -> tuple[Sensor, ...]:
    """Return the sensors that are compared: monochrome, Bayer (Nikon 5100), Foveon (Sigma SD Merrill)."""
    return (Mono(), Bayer.nikon(), Foveon.sigma())


def _published(name: str) -> dict[str, Spectrum]:
    from scenes.library import sensor_curves

    return sensor_curves(name)


def _scaled(curves: tuple[Spectrum, ...], peak: float) -> tuple[Spectrum, ...]:
    largest = max(curve.maximum for curve in curves)
    if not 0 < peak <= 1 or largest == 0:
        raise InputError("sensor.peak_qe", peak, "in (0, 1], of curves that are not 0 everywhere")
    return tuple(curve.scaled(peak / largest) for curve in curves)


def _quantum_efficiency(value: Spectrum) -> Spectrum:
    low, high = float(value.value.min()), float(value.value.max())
    if low < 0 or high > 1:
        raise InputError("", low if low < 0 else high, "a response in [0, 1] at every wavelength")
    return value
