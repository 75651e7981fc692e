"""The l1 norm of a cube's coefficients in a basis, alone or by groups over wavelength (theory.md (S.51), (S.52))."""

from typing import Any

import numpy as np
from pydantic import field_validator

from recon.basis import Basis, Kronecker
from recon.coded_aperture import empty_cube
from recon.config import Config
from recon.errors import InputError


class L1(Config):
    """``R(f) = sum of weight |theta|``, ``theta = Psi^T f``: the paper's prior (theory.md (S.51)).

    Args:
        basis: Psi, orthonormal: an object with ``analysis`` and ``synthesis``; None: ``Kronecker.for_shape`` of the cube.
        weights: one positive factor a spectral coefficient (the last axis of theta); None: all 1.
    """

    basis: Any = None
    weights: tuple[float, ...] | None = None

    @field_validator("basis")
    @classmethod
    def _transforms(cls, basis: Any) -> Any:
        return checked_basis("L1.basis", basis)

    @field_validator("weights")
    @classmethod
    def _positive(cls, weights: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if weights is not None and (not weights or min(weights) <= 0):
            raise InputError("L1.weights", weights, "positive numbers, one for each spectral coefficient")
        return weights

    def bind(self, shape: tuple[int, ...], dtype: Any) -> "L1Penalty":
        """See ``Prior.bind``."""
        return L1Penalty(self.basis_for(shape), self.weights, shape, dtype)

    def basis_for(self, shape: tuple[int, ...]) -> Basis:
        """Return Psi for cubes of this shape."""
        return basis_for(self.basis, shape)


class GroupL1(Config):
    """``R(f) = sum of ||theta[m, n, :]||_2``: coefficients of one place vanish in all bands or in none (theory.md (S.52)).

    Args:
        basis: Psi, as for ``L1``.
    """

    basis: Any = None

    @field_validator("basis")
    @classmethod
    def _transforms(cls, basis: Any) -> Any:
        return checked_basis("GroupL1.basis", basis)

    def bind(self, shape: tuple[int, ...], dtype: Any) -> "GroupPenalty":
        """See ``Prior.bind``."""
        return GroupPenalty(basis_for(self.basis, shape), shape, dtype)


class L1Penalty:
    """The l1 norm bound to one solve."""

    def __init__(self, basis: Basis, weights: tuple[float, ...] | None, shape: tuple[int, ...], dtype: Any) -> None:
        if weights is not None and len(weights) != shape[2]:
            raise InputError("L1.weights", len(weights), f"as many numbers as bands, {shape[2]}")
        self.basis = basis
        self._weights = None if weights is None else np.array(weights, dtype)
        self._margin = Margin(basis, shape, dtype)

    @property
    def weights(self) -> np.ndarray | None:
        """Return the factor of each spectral coefficient, or None."""
        return self._weights

    @property
    def weighted(self) -> bool:
        """Tell whether the coefficients have weights."""
        return self._weights is not None

    def tau_max(self, correlation: np.ndarray) -> float:
        """Return ``2 max |Psi^T H^T g| / weight`` (theory.md (S.9))."""
        size = np.abs(self.basis.analysis(correlation))
        return 2 * float((size if self._weights is None else size / self._weights).max())

    def value(self, cube: np.ndarray) -> float:
        """See ``Penalty.value``."""
        size = np.abs(self.basis.analysis(self._margin.around(cube)))
        return float((size if self._weights is None else size * self._weights).sum(dtype=np.float64))

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """See ``Penalty.shrink``."""
        whole = self._margin.around(cube)
        value = self._shrink(whole, threshold)
        self._margin.cut(cube)
        return value

    def _shrink(self, whole: np.ndarray, threshold: float) -> float:
        if isinstance(self.basis, Kronecker):
            return self.basis.shrink(whole, threshold, self._weights)
        theta = self.basis.analysis(whole)
        weights = theta.dtype.type(1) if self._weights is None else self._weights
        limit = theta.dtype.type(threshold) * weights
        theta -= np.clip(theta, -limit, limit)
        whole[...] = self.basis.synthesis(theta)
        return float((np.abs(theta) * weights).sum(dtype=np.float64))


class GroupPenalty:
    """The group norm bound to one solve."""

    def __init__(self, basis: Basis, shape: tuple[int, ...], dtype: Any) -> None:
        self.basis = basis
        self._margin = Margin(basis, shape, dtype)

    def value(self, cube: np.ndarray) -> float:
        """See ``Penalty.value``."""
        return float(_lengths(self.basis.analysis(self._margin.around(cube))).sum(dtype=np.float64))

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """See ``Penalty.shrink``."""
        whole = self._margin.around(cube)
        theta = self.basis.analysis(whole)
        length = _lengths(theta)
        kept = np.maximum(length - theta.dtype.type(threshold), 0)
        theta *= np.divide(kept, length, out=np.zeros_like(length), where=length > 0)[:, :, None]
        self.basis.synthesis(theta, whole)
        self._margin.cut(cube)
        return float(kept.sum(dtype=np.float64))

    def tau_max(self, correlation: np.ndarray) -> float:
        """Return twice the largest length of a group of ``Psi^T H^T g``."""
        return 2 * float(_lengths(self.basis.analysis(correlation)).max())


class Margin:
    """What a padded basis has around the cube: unknowns of the prior alone, kept from one call to the next (theory.md (S.63)).

    Args:
        basis: Psi; one that pads has ``theta_shape``.
        shape: (M, N, K) of the cubes.
        dtype: float32 or float64.
    """

    def __init__(self, basis: Basis, shape: tuple[int, ...], dtype: Any) -> None:
        longer = basis.theta_shape(shape) if isinstance(basis, Kronecker) else tuple(shape)
        self._whole: np.ndarray | None = None
        if longer != tuple(shape):
            self._whole = empty_cube(longer, dtype)
            self._whole[...] = 0

    def around(self, cube: np.ndarray) -> np.ndarray:
        """Return the cube with its margin: itself where there is none."""
        if self._whole is None:
            return cube
        self._whole[: cube.shape[0], : cube.shape[1]] = cube
        return self._whole

    def cut(self, cube: np.ndarray) -> None:
        """Copy what ``around`` gave back to the cube."""
        if self._whole is not None:
            cube[...] = self._whole[: cube.shape[0], : cube.shape[1]]


def checked_basis(field: str, basis: Any) -> Any:
    """Refuse what has no ``analysis`` and ``synthesis``; None passes."""
    if basis is not None and not (callable(getattr(basis, "analysis", None)) and callable(getattr(basis, "synthesis", None))):
        raise InputError(field, basis, "an object with analysis(cube) and synthesis(theta), e.g. recon.Kronecker(), or None")
    return basis


def basis_for(basis: Basis | None, shape: tuple[int, ...]) -> Basis:
    """Return the basis, or the default one for this shape, after asking whether it fits."""
    chosen = Kronecker.for_shape(shape) if basis is None else basis
    if isinstance(chosen, Kronecker):
        chosen.require(shape)
    return chosen


def _lengths(theta: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("mnk,mnk->mn", theta, theta))
