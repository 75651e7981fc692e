"""Curves that stand for a dispersion on the axis: linear, polynomial, spline (theory.md (C.21) to (C.23)).

Each is made by ``.fit(dispersion, range_nm)``, places wavelengths by its curve and the field by the magnification alone
(no smile, no keystone), refuses wavelengths outside its range, and takes over the axial transmission of what it was
fitted to. ``benchmarks/mappings.py`` measures their errors and speeds.
"""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.inverse import wavelength_at
from optsim.camera.model import Model, ranged
from optsim.camera.prism import Dispersion
from optsim.camera.stack import field_points
from optsim.errors import InputError

SAMPLES = 441
"""Wavelengths, evenly spaced, to which a curve is fitted."""
TRANSMISSION_SAMPLES = 65


class AxialTransmission(Model):
    """Hold the share of light that passes on the axis, linear between samples.

    Args:
        wavelength_nm: (n,) increasing.
        share: (n,) in [0, 1].
    """

    place: ClassVar[str] = "transmission"
    wavelength_nm: tuple[float, ...]
    share: tuple[Annotated[float, ranged(0, 1, "")], ...]

    @classmethod
    def of(cls, dispersion: Dispersion, range_nm: tuple[float, float]) -> AxialTransmission:
        """Sample a dispersion."""
        wavelength = np.linspace(*range_nm, TRANSMISSION_SAMPLES)
        share = np.clip(dispersion.transmission(wavelength), 0, 1)
        return cls(wavelength_nm=tuple(wavelength.tolist()), share=tuple(share.tolist()))

    def at(self, wavelength_nm: ArrayLike, X_mm: ArrayLike, Y_mm: ArrayLike) -> np.ndarray:
        """Return the share, broadcast over the field; beyond the samples that of the last one."""
        shape = np.broadcast_shapes(*(np.shape(v) for v in (wavelength_nm, X_mm, Y_mm)))
        return np.broadcast_to(np.interp(np.asarray(wavelength_nm, np.float64), self.wavelength_nm, self.share), shape)


class AxialMap(Model, ABC):
    """Place wavelengths by a curve of the axis, x = curve + m X, y = m Y.

    Args:
        range_nm: (low, high), where the curve holds; others are refused.
        magnification_px: m, sensor pixels per mm at the mirrors, in (0, 1e6].
        passes: transmission on the axis.
    """

    place: ClassVar[str] = "mapping"
    range_nm: tuple[float, float]
    magnification_px: Annotated[float, ranged(0, 1e6, "px per mm", "(]")]
    passes: AxialTransmission

    @abstractmethod
    def along(self, wavelength_nm: Any) -> Any:
        """Return positions in px from the 455 nm pixel; wavelengths are not checked."""

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) in sensor pixels; see :meth:`optsim.camera.stack.Prism.position_px`.

        Raises:
            InputError: field ``wavelength_nm`` outside ``range_nm``, or ``X_mm``, ``Y_mm``.
        """
        wavelength = check_range(wavelength_nm, self.range_nm)
        scale = self.magnification_px
        x, y = np.broadcast_arrays(self.along(wavelength) + scale * field_points(X_mm, "X_mm"), scale * field_points(Y_mm, "Y_mm"))
        return x, y, np.ones(x.shape, bool)

    def transmission(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> np.ndarray:
        """Return the share of light that passes on the axis, broadcast."""
        return self.passes.at(wavelength_nm, X_mm, Y_mm)

    def wavelength_at(self, position_px: ArrayLike) -> np.ndarray:
        """Return the wavelengths in nm that land at positions of the axis; see :func:`optsim.camera.inverse.wavelength_at`."""
        return wavelength_at(self, position_px, self.range_nm)


class PolynomialMap(AxialMap):
    """A polynomial in the wavelength: x = sum of c_i u^i, u from -1 to 1 over the range (theory.md (C.21)).

    Args:
        coefficients: c, lowest power first, in px.
    """

    coefficients: tuple[float, ...]

    @classmethod
    def fit(cls, dispersion: Dispersion, range_nm: tuple[float, float], degree: int = 5) -> PolynomialMap:
        """Fit by least squares over evenly spaced wavelengths.

        Args:
            dispersion: what is fitted.
            range_nm: (low, high) nm.
            degree: from 1 to 12.

        Raises:
            InputError: ``degree``, ``range_nm``, or ``prism`` where the dispersion loses light.
        """
        wavelength, x = axial_samples(dispersion, range_nm)
        return cls(coefficients=_power_fit(_unit(wavelength, range_nm), x, degree), **shared(dispersion, range_nm))

    def along(self, wavelength_nm: Any) -> Any:
        """Return positions in px; any arrays."""
        return powers(self.coefficients, _unit(wavelength_nm, self.range_nm))


class CauchyMap(AxialMap):
    """A polynomial in 1 / wavelength^2, the variable of Cauchy's formula, scaled to -1 to 1 over the range (theory.md (C.21)).

    Args:
        coefficients: c, lowest power first, in px.
    """

    coefficients: tuple[float, ...]

    @classmethod
    def fit(cls, dispersion: Dispersion, range_nm: tuple[float, float], degree: int = 3) -> CauchyMap:
        """Fit by least squares over evenly spaced wavelengths; see :meth:`PolynomialMap.fit`."""
        wavelength, x = axial_samples(dispersion, range_nm)
        unit = _unit(1 / (wavelength * wavelength), _inverse_squares(range_nm))
        return cls(coefficients=_power_fit(unit, x, degree), **shared(dispersion, range_nm))

    def along(self, wavelength_nm: Any) -> Any:
        """Return positions in px; any arrays."""
        return powers(self.coefficients, _unit(1 / (wavelength_nm * wavelength_nm), _inverse_squares(self.range_nm)))


class LinearMap(AxialMap):
    """A straight line, as most CASSI codes assume: x = offset + slope (wavelength - middle of the range) (theory.md (C.22)).

    Args:
        offset_px: position of the middle of the range.
        slope_px: px per nm.
    """

    offset_px: float
    slope_px: float

    @classmethod
    def fit(cls, dispersion: Dispersion, range_nm: tuple[float, float]) -> LinearMap:
        """Fit by least squares over evenly spaced wavelengths; see :meth:`PolynomialMap.fit`."""
        line = PolynomialMap.fit(dispersion, range_nm, 1).coefficients
        return cls(offset_px=line[0], slope_px=2 * line[1] / (range_nm[1] - range_nm[0]), **shared(dispersion, range_nm))

    def along(self, wavelength_nm: Any) -> Any:
        """Return positions in px; any arrays."""
        return self.offset_px + self.slope_px * (wavelength_nm - (self.range_nm[0] + self.range_nm[1]) / 2)


class SplineMap(AxialMap):
    """A cubic spline through evenly spaced knots, its third derivative continuous at the knots next to the ends (theory.md (C.23)).

    Args:
        knots_px: positions at evenly spaced wavelengths from end to end of the range, at least 4.
    """

    knots_px: tuple[float, ...]

    @classmethod
    def fit(cls, dispersion: Dispersion, range_nm: tuple[float, float], knots: int = 24) -> SplineMap:
        """Interpolate a dispersion.

        Args:
            dispersion: what is interpolated.
            range_nm: (low, high) nm.
            knots: from 4 to 100000.

        Raises:
            InputError: ``knots``, ``range_nm``, or ``prism`` where the dispersion loses light.
        """
        if not isinstance(knots, int | np.integer) or not 4 <= knots <= 100_000:
            raise InputError("knots", knots, "a whole number from 4 to 100000")
        _, x = axial_samples(dispersion, range_nm, knots)
        return cls(knots_px=tuple(x.tolist()), **shared(dispersion, range_nm))

    @functools.cached_property
    def _pieces(self) -> np.ndarray:
        """Return (4, knots - 1) coefficients of each piece, highest power first, in knot distances."""
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(np.arange(len(self.knots_px)), self.knots_px, bc_type="not-a-knot").c)

    def along(self, wavelength_nm: Any) -> Any:
        """Return positions in px; NumPy arrays."""
        pieces = self._pieces
        low, high = self.range_nm
        place = (wavelength_nm - low) * (pieces.shape[1] / (high - low))
        piece = np.clip(place.astype(np.int64), 0, pieces.shape[1] - 1)
        u = place - piece
        a, b, c, d = pieces[:, piece]
        return ((a * u + b) * u + c) * u + d


def axial_samples(dispersion: Dispersion, range_nm: tuple[float, float], count: int = SAMPLES) -> tuple[np.ndarray, np.ndarray]:
    """Return evenly spaced wavelengths in nm and their positions in px.

    Raises:
        InputError: ``range_nm``, or ``prism`` where the dispersion loses light.
    """
    low, high = range_nm
    if not 0 < low < high < np.inf:
        raise InputError("range_nm", range_nm, "(low, high) with 0 < low < high, in nm")
    wavelength = np.linspace(low, high, count)
    x, _, valid = dispersion.position_px(wavelength)
    if not np.all(valid):
        raise InputError("prism", f"one that loses {wavelength[~valid][0]:g} nm", f"a dispersion that passes all of {low:g}-{high:g} nm")
    return wavelength, x


def shared(dispersion: Dispersion, range_nm: tuple[float, float]) -> dict[str, Any]:
    """Return the fields that every map takes from what it is fitted to."""
    return {
        "range_nm": range_nm,
        "magnification_px": dispersion.magnification_px,
        "passes": AxialTransmission.of(dispersion, range_nm),
    }


def check_range(wavelength_nm: ArrayLike, range_nm: tuple[float, float]) -> np.ndarray:
    """Return wavelengths as float64 if all lie in a map's range (to 1e-9 nm).

    Raises:
        InputError: field ``wavelength_nm``.
    """
    values, (low, high) = np.asarray(wavelength_nm, np.float64), range_nm
    bad = ~((values >= low - 1e-9) & (values <= high + 1e-9))
    if np.any(bad):
        raise InputError(
            "wavelength_nm", float(values[bad].flat[0]), f"from {low:g} to {high:g} nm, the range that the mapping was fitted in"
        )
    return values


def _power_fit(unit: np.ndarray, x: np.ndarray, degree: int) -> tuple[float, ...]:
    if not isinstance(degree, int | np.integer) or not 1 <= degree <= 12:
        raise InputError("degree", degree, "a whole number from 1 to 12")
    chebyshev = np.polynomial.chebyshev.chebfit(unit, x, degree)
    return tuple(np.polynomial.chebyshev.cheb2poly(chebyshev).tolist())


def powers(coefficients: tuple[float, ...], u: Any) -> Any:
    """Evaluate a polynomial, lowest power first, on any arrays."""
    result: Any = coefficients[-1]
    for c in coefficients[-2::-1]:
        result = result * u + c
    return result


def _unit(value: Any, ends: tuple[float, float]) -> Any:
    """Return a variable scaled to -1 at the first end and 1 at the second."""
    low, high = ends
    return (value - (low + high) / 2) * (2 / (high - low))


def _inverse_squares(range_nm: tuple[float, float]) -> tuple[float, float]:
    return 1 / range_nm[0] ** 2, 1 / range_nm[1] ** 2
