"""Orthonormal bases along wavelength: cosines, or learned from spectra of a library (theory.md (S.7), (S.60))."""

from functools import lru_cache
from itertools import pairwise
from typing import Any, Protocol, runtime_checkable

import numpy as np
from pydantic import field_validator

from recon.arrays import as_double, real_array, require
from recon.config import Config
from recon.errors import InputError

ORTHONORMAL = 1e-6  # allowed error of given rows; they are made exactly orthonormal afterwards
FAINTEST = 1e-3  # strengths below this part of the largest count as this part: a library doesn't know them


@runtime_checkable
class SpectralBasis(Protocol):
    """An orthonormal K x K matrix for spectra of K bands; row q is the q-th basis spectrum, and weights say how rare it is."""

    def matrix(self, bands: int, dtype: Any) -> np.ndarray:
        """Return the matrix (K, K).

        Raises:
            InputError: when the basis is for another number of bands.
        """
        ...

    def weights(self, bands: int, power: float = 0.5) -> tuple[float, ...]:
        """Return ``(strength[0] / strength[q])^power``, K numbers from 1 up: what spectra have less of costs more (theory.md (S.61))."""
        ...


class Cosine(Config):
    """The orthonormal DCT-II along wavelength, the paper's (theory.md (S.7))."""

    def matrix(self, bands: int, dtype: Any) -> np.ndarray:
        """Return the cosines (K, K), the slowest first."""
        return cosine_matrix(bands, np.dtype(dtype).name)

    def weights(self, bands: int, power: float = 0.5) -> tuple[float, ...]:
        """See ``SpectralBasis.weights``; strengths fall as ``(1 + q)^-2``, as those of natural reflectances do.

        Args:
            bands: K.
            power: 0 treats all alike, 1 scales every coefficient to the same strength; 0 to 2.
        """
        return _relative_weights((1.0 + np.arange(bands)) ** -2, power)


class Learned(Config):
    """The principal spectra of a library, strongest first; made by :func:`learned`.

    Args:
        rows: K orthonormal rows of K numbers.
        strengths: root mean square of the library's coefficients along each row, falling; at least one above 0.
    """

    rows: tuple[tuple[float, ...], ...]
    strengths: tuple[float, ...]

    @field_validator("rows")
    @classmethod
    def _orthonormal(cls, rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        if not rows or any(len(row) != len(rows) for row in rows):
            raise InputError("Learned.rows", [len(row) for row in rows], "as many numbers in each row as there are rows")
        matrix = np.array(rows)
        error = float(np.abs(matrix @ matrix.T - np.eye(len(rows))).max())
        if error > ORTHONORMAL:
            raise InputError("Learned.rows", error, f"orthonormal to {ORTHONORMAL:g}; recon.learned makes them so")
        return rows

    @field_validator("strengths")
    @classmethod
    def _falling(cls, strengths: tuple[float, ...]) -> tuple[float, ...]:
        if not strengths or strengths[0] <= 0 or strengths[-1] < 0 or any(b > a for a, b in pairwise(strengths)):
            raise InputError("Learned.strengths", strengths, "falling, at least 0, the first above 0")
        return strengths

    def matrix(self, bands: int, dtype: Any) -> np.ndarray:
        """Return the principal spectra (K, K), the strongest first."""
        if bands != len(self.rows):
            raise InputError("Learned", bands, f"used with the {len(self.rows)} bands that it was learned for")
        return _rows(self.rows, np.dtype(dtype).name)

    def weights(self, bands: int, power: float = 0.5) -> tuple[float, ...]:
        """See ``SpectralBasis.weights``; strengths below 1e-3 of the largest count as 1e-3: a library doesn't know them.

        Args:
            bands: K, that of the library.
            power: 0 treats all alike, 1 scales every coefficient to the same strength; 0 to 2.
        """
        self.matrix(bands, np.float64)
        return _relative_weights(np.array(self.strengths), power)


def learned(samples: np.ndarray) -> Learned:
    """Learn a spectral basis from spectra: the right singular vectors, the mean not removed (theory.md (S.60)).

    Args:
        samples: (n, K) spectra in the bands of the cubes to come, finite; fewer than K are completed to a basis. Their scale does
            not matter. To be believed they must not be those of the scenes that are reconstructed.

    Raises:
        InputError: field ``samples``.
    """
    spectra = as_double(real_array("samples", samples, axes=" (sample, band)"))
    if spectra.ndim != 2 or 0 in spectra.shape:
        raise InputError("samples", spectra.shape, "finite, of shape (samples, bands), different from 0 somewhere")
    require("samples", spectra, np.isfinite(spectra), "finite", " (sample, band)")
    if not spectra.any():
        raise InputError("samples", 0.0, "different from 0 somewhere")
    spectra = spectra / np.abs(spectra).max()
    _, s, vt = np.linalg.svd(spectra, full_matrices=True)
    strengths = np.zeros(spectra.shape[1])
    strengths[: s.size] = s / np.sqrt(spectra.shape[0])
    largest = vt[np.arange(len(vt)), np.abs(vt).argmax(1)]
    vt = vt * np.where(largest < 0, -1.0, 1.0)[:, None]  # the sign of a singular vector is arbitrary: fixed, so that bytes are too
    return Learned(rows=tuple(tuple(map(float, row)) for row in vt), strengths=tuple(map(float, strengths)))


def _relative_weights(strengths: np.ndarray, power: float) -> tuple[float, ...]:
    if not 0 <= power <= 2:
        raise InputError("power", power, "of [0, 2]")
    return tuple(float(w) for w in np.maximum(strengths / strengths[0], FAINTEST) ** -power)


@lru_cache(maxsize=64)
def cosine_matrix(bands: int, dtype: Any) -> np.ndarray:
    """Return the orthonormal DCT-II matrix (K, K): row q is the q-th cosine (theory.md (S.7))."""
    q, k = np.ogrid[:bands, :bands]
    matrix = np.sqrt(2 / bands) * np.cos(np.pi * (2 * k + 1) * q / (2 * bands))
    matrix[0] = np.sqrt(1 / bands)
    return np.asarray(matrix.astype(dtype))


@lru_cache(maxsize=64)
def _rows(rows: tuple[tuple[float, ...], ...], dtype: str) -> np.ndarray:
    u, _, vt = np.linalg.svd(np.array(rows))  # the nearest orthonormal matrix, whatever digits were lost on the way
    return np.asarray((u @ vt).astype(dtype))
