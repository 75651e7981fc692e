"""Silicon: how deep light goes, and the layers that divide it by depth (theory.md (C.11), (C.48), (C.49))."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from optsim.camera.model import Model, ranged
from optsim.errors import InputError
from scenes.spectrum import Spectrum

STEP_NM = 1.0
"""Grid of the layers' curves: the filter's edges are a few nm wide."""


@dataclass(frozen=True, eq=False)
class Silicon:
    """Hold tabulated silicon at 300 K: wavelength in nm, index n, absorption per um."""

    wavelength_nm: np.ndarray
    index: np.ndarray
    absorption_per_um: np.ndarray

    def at(self, wavelength_nm: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return (index, absorption per um), linear and log-linear between the table's rows.

        Raises:
            InputError: field ``wavelength_nm`` outside the table.
        """
        wavelength = np.asarray(wavelength_nm, np.float64)
        low, high = self.wavelength_nm[0], self.wavelength_nm[-1]
        if not np.all((wavelength >= low) & (wavelength <= high)):
            raise InputError("wavelength_nm", wavelength.tolist(), f"in [{low:g}, {high:g}] nm, the data of silicon")
        absorption = np.exp(np.interp(wavelength, self.wavelength_nm, np.log(self.absorption_per_um)))
        return np.interp(wavelength, self.wavelength_nm, self.index), absorption


@functools.cache
def silicon() -> Silicon:
    """Return silicon, 360-830 nm (M. A. Green, Sol. Energ. Mat. Sol. Cells 92, 1305 (2008))."""
    from importlib import resources

    text = (resources.files("optsim") / "data" / "sensor" / "silicon_green2008.csv").read_text()
    wavelength, index, k = np.array([line.split(",") for line in text.splitlines()[1:]], np.float64).T
    return Silicon(wavelength, index, 4 * np.pi * k / (wavelength / 1000))


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


class FrontFilter(Model):
    """Describe the glass before a sensor: a blue and a red edge, each a logistic curve of wavelength.

    Args:
        blue_nm, red_nm: where the transmission is one half, in [200, 1000] nm.
        blue_width_nm, red_width_nm: of the logistic curves, in [0.1, 100] nm.
    """

    place: ClassVar[str] = "front_filter"
    blue_nm: Annotated[float, ranged(200, 1000, "nm")] = 479.2
    blue_width_nm: Annotated[float, ranged(0.1, 100, "nm")] = 30.5
    red_nm: Annotated[float, ranged(200, 1000, "nm")] = 656.4
    red_width_nm: Annotated[float, ranged(0.1, 100, "nm")] = 2.35

    def transmission(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the share of light that passes, in [0, 1]."""
        wavelength = np.asarray(wavelength_nm, np.float64)
        blue, red = (wavelength - self.blue_nm) / self.blue_width_nm, (self.red_nm - wavelength) / self.red_width_nm
        return (1 + np.tanh(blue / 2)) / 2 * (1 + np.tanh(red / 2)) / 2


class SiliconLayers(Model):
    """Describe three layers of silicon one below the other, behind a filter.

    Args:
        borders_um: lower borders of the blue, green and red layer, increasing, in (0, 100] um.
        crosstalk: share of a layer's charge that diffuses into each neighbouring layer, in [0, 0.3].
        coated: whether a perfect coating lets all light in; else the bare surface reflects.
        front: filter before the sensor; None: no filter.
    """

    place: ClassVar[str] = "layers"
    borders_um: tuple[float, float, float] = (0.393, 3.352, 5.0)
    crosstalk: Annotated[float, ranged(0, 0.3, "")] = 0.0
    coated: bool = True
    front: FrontFilter | None = FrontFilter()

    @model_validator(mode="after")
    def _increasing(self) -> SiliconLayers:
        if not 0 < self.borders_um[0] < self.borders_um[1] < self.borders_um[2] <= 100:
            raise InputError("borders_um", self.borders_um, "increasing, in (0, 100] um")
        return self

    def efficiencies(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the (3, ...) quantum efficiencies of the blue, green and red layer (theory.md (C.48), (C.49))."""
        entering, absorption = self._entering(wavelength_nm)
        x = self.crosstalk
        exchange = np.array([[1 - x, x, 0], [x, 1 - 2 * x, x], [0, x, 1 - x]])
        return np.tensordot(exchange, layer_absorption(absorption, [0.0, *self.borders_um]), 1) * entering

    def account(self, wavelength_nm: ArrayLike) -> dict[str, np.ndarray]:
        """Return where light goes: ``filtered``, ``reflected``, ``layers`` (their sum) and ``transmitted`` add to 1."""
        wavelength = np.asarray(wavelength_nm, np.float64)
        passed = np.ones_like(wavelength) if self.front is None else self.front.transmission(wavelength)
        entering, absorption = self._entering(wavelength)
        return {
            "filtered": 1 - passed,
            "reflected": passed - entering,
            "layers": self.efficiencies(wavelength).sum(0),
            "transmitted": entering * np.exp(-absorption * self.borders_um[2]),
        }

    def curves(self) -> tuple[Spectrum, Spectrum, Spectrum]:
        """Return the efficiencies as spectra, blue (top) first, over all wavelengths of the silicon data in steps of 1 nm."""
        low, high = silicon().wavelength_nm[[0, -1]]
        grid = np.linspace(low, high, round((high - low) / STEP_NM) + 1)
        blue, green, red = self.efficiencies(grid)
        return (
            Spectrum(grid, blue, "silicon, top layer"),
            Spectrum(grid, green, "silicon, middle layer"),
            Spectrum(grid, red, "silicon, bottom layer"),
        )

    def _entering(self, wavelength_nm: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the share of light that enters the silicon, and its absorption per um."""
        wavelength = np.asarray(wavelength_nm, np.float64)
        index, absorption = silicon().at(wavelength)
        entering = np.ones_like(wavelength) if self.coated else 4 * index / (index + 1) ** 2
        return (entering if self.front is None else entering * self.front.transmission(wavelength)), absorption
