"""Optical glasses: refractive index from the Sellmeier formula, inside the range it was fitted in (theory.md (C.1))."""

from __future__ import annotations

import functools
import tomllib
from importlib import resources
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import field_validator

from optsim.camera.arrays import Array
from optsim.camera.model import Model, did_you_mean
from optsim.errors import InputError

D_LINE_NM, F_LINE_NM, C_LINE_NM = 587.5618, 486.1327, 656.2725


class Rational(NamedTuple):
    """Hold n^2 - 1 = l2 P(l2) / Q(l2), l2 the squared wavelength in um^2: one division a ray (theory.md (C.2))."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def excess(self, squared_um: Array) -> Array:
        """Evaluate n^2 - 1 at squared wavelengths in um^2; the range is the caller's to check."""
        return squared_um * _horner(self.numerator, squared_um) / _horner(self.denominator, squared_um)


class Glass(Model):
    """Describe a glass by its three-term Sellmeier formula against air.

    Args:
        name: catalogue name.
        sellmeier_b: B, dimensionless.
        sellmeier_c_um2: C, um^2.
        range_nm: (low, high), the wavelengths in nm that the formula was fitted in.
        source: where the coefficients come from.
    """

    name: str
    sellmeier_b: tuple[float, float, float]
    sellmeier_c_um2: tuple[float, float, float]
    range_nm: tuple[float, float]
    source: str = ""

    @field_validator("range_nm")
    @classmethod
    def _ordered(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not 0 < value[0] < value[1]:
            raise InputError("", value, "(low, high) with 0 < low < high, in nm")
        return value

    def check(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return wavelengths as float64 if all lie in the fitted range.

        Raises:
            InputError: field ``wavelength_nm`` (a formula outside its range gives plausible wrong numbers).
        """
        values = np.asarray(wavelength_nm, np.float64)
        low, high = self.range_nm
        bad = ~((values >= low) & (values <= high))
        if np.any(bad):
            raise InputError("wavelength_nm", float(values[bad].flat[0]), f"from {low:g} to {high:g} nm, the range of {self.name}")
        return values

    def index(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the refractive index against air at wavelengths in nm (theory.md (C.1)).

        Raises:
            InputError: field ``wavelength_nm`` outside the fitted range.
        """
        squared = (self.check(wavelength_nm) / 1000) ** 2
        excess = sum(b * squared / (squared - c) for b, c in zip(self.sellmeier_b, self.sellmeier_c_um2))
        return np.sqrt(1 + excess)

    @property
    def abbe(self) -> float:
        """Return the Abbe number (n_d - 1) / (n_F - n_C)."""
        d, f, c = self.index([D_LINE_NM, F_LINE_NM, C_LINE_NM])
        return float((d - 1) / (f - c))

    @functools.cached_property
    def rational(self) -> Rational:
        """Return the formula as one ratio of polynomials."""
        denominator, numerator = np.poly1d([1.0]), np.poly1d([0.0])
        for k, (b, c) in enumerate(zip(self.sellmeier_b, self.sellmeier_c_um2)):
            denominator = denominator * np.poly1d([1.0, -c])
            others = [np.poly1d([1.0, -other]) for j, other in enumerate(self.sellmeier_c_um2) if j != k]
            numerator = numerator + b * others[0] * others[1]
        return Rational(tuple(map(float, numerator.c)), tuple(map(float, denominator.c)))


@functools.cache
def glass_names() -> tuple[str, ...]:
    """List the glasses that are built in."""
    folder = resources.files("optsim") / "data" / "glass"
    return tuple(sorted(item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml")))


@functools.cache
def glass(name: str) -> Glass:
    """Load a built-in glass by its catalogue name.

    Raises:
        InputError: field ``glass`` with the names there are.
    """
    if name not in glass_names():
        raise InputError("glass", name, f"one of {', '.join(glass_names())}{did_you_mean(name, glass_names())}")
    text = (resources.files("optsim") / "data" / "glass" / f"{name}.toml").read_text()
    return Glass(**tomllib.loads(text))


def _horner(coefficients: tuple[float, ...], x: Array) -> Array:
    result = coefficients[0] * x + coefficients[1]
    for c in coefficients[2:]:
        result = result * x + c
    return result
