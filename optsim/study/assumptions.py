"""What a reconstruction may believe about where the prism lays the bands, from the crudest to the exact (theory.md C.i)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np

from optsim.camera.camera import CameraConfig
from optsim.camera.center_table import CenterTable
from optsim.camera.knowledge import Assumed, Exact, OwnShifts, Scope, Shifts
from optsim.camera.mappings import LinearMap, PolynomialMap, shared
from optsim.camera.model import Model, ranged
from optsim.camera.spread import Landing
from optsim.cube import Bands


class Assumption(Protocol):
    """A belief about the dispersion."""

    @property
    def name(self) -> str:
        """Return its name, for files and tables."""
        ...

    def positions(self, camera: CameraConfig, bands: Bands, wavelength_nm: np.ndarray, seed: int) -> np.ndarray:
        """Return where it believes that wavelengths inside the bands land on the axis, in px."""
        ...

    def knowledge(self, camera: CameraConfig, bands: Bands, seed: int) -> Shifts:
        """Return what H then knows; ``seed`` is that of the run's masks."""
        ...


class Linear(Model):
    """Dispersion is linear in wavelength, as most codes assume: the line that fits the camera's curve best."""

    @property
    def name(self) -> str:
        """Return its name, for files and tables."""
        return "linear"

    def positions(self, camera: CameraConfig, bands: Bands, wavelength_nm: np.ndarray, seed: int) -> np.ndarray:
        """Return the line at wavelengths."""
        return self._line(camera, bands).position_px(wavelength_nm)[0]

    def knowledge(self, camera: CameraConfig, bands: Bands, seed: int) -> Shifts:
        """Let H spread its bands along the line."""
        return Assumed(dispersion=self._line(camera, bands))

    def _line(self, camera: CameraConfig, bands: Bands) -> LinearMap:
        return LinearMap.fit(camera.dispersion, _range(bands))


@dataclass(frozen=True)
class OneColumn(OwnShifts):
    """Let H believe that a band lands on one column, the nearest to its middle."""

    name = "one column"

    def land(self, scope: Scope) -> Landing:
        """Return one tap of 1 a band."""
        middle, _, _ = scope.camera.dispersion.position_px((scope.lower_nm + scope.upper_nm) / 2)
        return Landing(np.rint(middle).astype(np.int64), np.ones((middle.size, 1)))


class WholePixels(Model):
    """Every band lands on one column, the nearest to its middle: no spread, no fractions."""

    @property
    def name(self) -> str:
        """Return its name, for files and tables."""
        return "whole pixels"

    def positions(self, camera: CameraConfig, bands: Bands, wavelength_nm: np.ndarray, seed: int) -> np.ndarray:
        """Return the rounded position of the band that holds each wavelength."""
        steps = np.rint(camera.dispersion.position_px((bands.lower + bands.upper) / 2)[0])
        return np.asarray(steps[np.clip(np.searchsorted(bands.upper, wavelength_nm), 0, bands.count - 1)])

    def knowledge(self, camera: CameraConfig, bands: Bands, seed: int) -> Shifts:
        """Let H have one tap a band."""
        return OneColumn()


class PaperTable(Model):
    """The dispersion is the paper's table: its k-th centre lands on pixel k."""

    @property
    def name(self) -> str:
        """Return its name, for files and tables."""
        return "paper's table"

    def positions(self, camera: CameraConfig, bands: Bands, wavelength_nm: np.ndarray, seed: int) -> np.ndarray:
        """Return the table's curve at wavelengths."""
        return self._table(camera).position_px(wavelength_nm)[0]

    def knowledge(self, camera: CameraConfig, bands: Bands, seed: int) -> Shifts:
        """Let H spread its bands along the table's curve."""
        return Assumed(dispersion=self._table(camera))

    def _table(self, camera: CameraConfig) -> CenterTable:
        return CenterTable(relay=camera.relay, pixel_um=camera.sensor.pitch_um)


class Calibrated(Model):
    """A curve fitted to measured spots: a monochromator at the bands' middles, noisy centroids, a polynomial.

    Args:
        noise_px: standard deviation of a centroid, in [0, 10] px.
        spots: at different places of the field for each wavelength, 1 to 1000.
        degree: of the polynomial, 1 to 12.
    """

    noise_px: Annotated[float, ranged(0, 10, "px")] = 0.1
    spots: Annotated[int, ranged(1, 1000, "spots")] = 9
    degree: Annotated[int, ranged(1, 12, "")] = 5

    @property
    def name(self) -> str:
        """Return its name, for files and tables."""
        return "calibrated curve"

    def positions(self, camera: CameraConfig, bands: Bands, wavelength_nm: np.ndarray, seed: int) -> np.ndarray:
        """Return the fitted curve at wavelengths."""
        return self._curve(camera, bands, seed).position_px(wavelength_nm)[0]

    def knowledge(self, camera: CameraConfig, bands: Bands, seed: int) -> Shifts:
        """Let H spread its bands along the fitted curve; each seed is a calibration of its own."""
        return Assumed(dispersion=self._curve(camera, bands, seed))

    def _curve(self, camera: CameraConfig, bands: Bands, seed: int) -> PolynomialMap:
        random = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(0x73706F74,))))
        middle = (bands.lower + bands.upper) / 2
        spots = camera.dispersion.position_px(middle)[0] + self.noise_px * random.standard_normal((self.spots, bands.count))
        fitted = np.polynomial.Polynomial.fit(middle, spots.mean(0), min(self.degree, bands.count - 1), domain=_range(bands))
        return PolynomialMap(coefficients=tuple(fitted.coef.tolist()), **shared(camera.dispersion, _range(bands)))


class ExactWeights(Model):
    """The camera's own weights: every band spreads over columns, and over the field, as the traced prism lays it.

    Args:
        error: share of light that the weights may misplace, in [1e-5, 0.2].
    """

    error: Annotated[float, ranged(1e-5, 0.2, "")] = 5e-3

    @property
    def name(self) -> str:
        """Return its name, for files and tables."""
        return "exact weights"

    def positions(self, camera: CameraConfig, bands: Bands, wavelength_nm: np.ndarray, seed: int) -> np.ndarray:
        """Return the traced positions."""
        return camera.dispersion.position_px(wavelength_nm)[0]

    def knowledge(self, camera: CameraConfig, bands: Bands, seed: int) -> Shifts:
        """Let H know every fact."""
        return Exact(error=self.error)


ASSUMPTIONS: tuple[Assumption, ...] = (Linear(), WholePixels(), PaperTable(), Calibrated(), ExactWeights())
"""From (a) to (e); the last is what the others are compared with."""


def _range(bands: Bands) -> tuple[float, float]:
    return float(bands.lower[0]), float(bands.upper[-1])
