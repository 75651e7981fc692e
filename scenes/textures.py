"""Reflectances that vary over a surface: maps of weights on a basis of measured spectra."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, model_validator

from scenes.errors import InputError
from scenes.materials import Lambertian, Reflectance
from scenes.spectrum import Spectrum

MAX_BASIS = 32
MAX_TEXELS = 2**24
SUM_SLACK = 1e-6
"""By how much a texel's weights may exceed 1 in sum: the rounding of float32."""


def _weights(value: Any) -> np.ndarray:
    try:
        array = np.array(value, np.float32)
    except (TypeError, ValueError):
        raise InputError("", type(value).__name__, "a (rows, columns, basis) table of weights") from None
    if array.ndim != 3 or 0 in array.shape or array.shape[0] * array.shape[1] > MAX_TEXELS:
        raise InputError("", array.shape, f"a (rows, columns, basis) table of weights of 1 to {MAX_TEXELS} texels")
    bad = ~(np.isfinite(array) & (array >= 0))
    if bad.any():
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError("", float(array[where]), f"at least 0 and finite; the first bad (row, column, basis) is {where}")
    array.setflags(write=False)
    return array


class Textured(Lambertian):
    """A Lambertian picture on a rectangle: in each texel a mixture of a few reflectances (theory.md (R.32)).

    Texels are squares of constant reflectance; row 0 is at the far end of half_v, column 0 at the near end of half_u, as a
    picture on the front of a rectangle is seen with half_u to the right and half_v up. Weights are not negative and add
    to at most 1, so that every mixture of reflectances is a reflectance.

    Args:
        basis: the B spectra that are mixed, each within [0, 1]; 1 to 32.
        weights: (rows, columns, B) float32.

    Raises:
        InputError: ``material.weights`` with the first bad texel, ``material.basis``.
    """

    basis: Annotated[tuple[Reflectance, ...], Field(min_length=1, max_length=MAX_BASIS)]
    weights: Annotated[np.ndarray, BeforeValidator(_weights)]

    @model_validator(mode="after")
    def _consistent(self) -> Textured:
        if self.weights.shape[2] != len(self.basis):
            raise InputError("weights", self.weights.shape, f"one weight a texel for each of the {len(self.basis)} spectra of the basis")
        sums = self.weights.sum(2, dtype=np.float64)
        bad = sums > 1 + SUM_SLACK
        if bad.any():
            where = tuple(int(i) for i in np.argwhere(bad)[0])
            raise InputError("weights", float(sums[where]), f"weights that add to at most 1; the first bad (row, column) is {where}")
        return self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Textured) and self.basis == other.basis and np.array_equal(self.weights, other.weights)

    def __hash__(self) -> int:
        return hash((self.basis, self.weights.tobytes()))

    @property
    def size(self) -> tuple[int, int]:
        """Return (rows, columns)."""
        return int(self.weights.shape[0]), int(self.weights.shape[1])

    @property
    def curves(self) -> tuple[Spectrum, ...]:
        """Return the basis."""
        return self.basis

    @property
    def largest(self) -> float:
        """Return a bound of the reflectance over all texels and wavelengths."""
        return float(np.max(self.weights.astype(np.float64) @ np.array([s.maximum for s in self.basis])))

    def at(self, u: ArrayLike, v: ArrayLike, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return reflectances.

        Args:
            u, v: places from 0 to 1 along half_u and half_v, of one shape.
            wavelength_nm: (n,) in nm.

        Returns:
            that shape + (n,).
        """
        rows, columns = self.size
        i = np.clip(np.floor((1 - np.asarray(v, np.float64)) * rows).astype(int), 0, rows - 1)
        j = np.clip(np.floor(np.asarray(u, np.float64) * columns).astype(int), 0, columns - 1)
        return self.weights[i, j].astype(np.float64) @ self.table(wavelength_nm)

    def table(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the (B, n) basis at wavelengths in nm."""
        return np.stack([np.asarray(s.at(np.asarray(wavelength_nm, np.float64))) for s in self.basis])

    def mean(self) -> Spectrum:
        """Return the mean reflectance over all texels."""
        share = self.weights.mean((0, 1), dtype=np.float64)
        grid = np.unique(np.concatenate([s.wavelength_nm for s in self.basis]))
        low, high = max(s.range_nm[0] for s in self.basis), min(s.range_nm[1] for s in self.basis)
        grid = grid[(grid >= low) & (grid <= high)]
        return Spectrum(grid, share @ self.table(grid), "mean of a texture")
