"""What is known of cubes before they are photographed: how large their coefficients are, group by group (theory.md (C.75))."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from optsim.errors import InputError

if TYPE_CHECKING:
    from recon.basis import Kronecker


@dataclass(frozen=True, eq=False)
class GaussianPrior:
    """Cubes are Psi theta with independent Gaussian theta: covariance C = Psi diag(variance) Psi^T.

    Args:
        basis: Psi, orthonormal.
        variance: (M, N, K), at least 0, in the cubes' unit squared.
    """

    basis: Kronecker
    variance: np.ndarray

    def __post_init__(self) -> None:
        if not np.all(np.isfinite(self.variance)) or self.variance.min() < 0 or self.variance.max() == 0:
            raise InputError("prior.variance", float(np.min(self.variance)), "finite, at least 0, not 0 everywhere")

    @classmethod
    def learned(cls, cubes: Sequence[np.ndarray], basis: Kronecker | None = None) -> GaussianPrior:
        """Average squared coefficients over training cubes (M, N, K) and over each subband x spectral frequency.

        Every cube is first divided by its root mean square: training scenes count alike, whatever their light.

        Args:
            cubes: at least one, none of them dark.
            basis: Psi, not padded; None: the default wavelet, as deep as the sides allow.
        """
        from recon.basis import DEFAULT_LEVEL, Kronecker, largest_level

        if not cubes or any(not np.any(c) for c in cubes) or len({c.shape for c in cubes}) > 1:
            raise InputError("cubes", len(cubes), "at least one training cube, all of one shape and none dark")
        basis = Kronecker(level=min(DEFAULT_LEVEL, largest_level(cubes[0].shape))) if basis is None else basis
        label = subbands(cubes[0].shape[:2], basis.level)
        variance = np.zeros(cubes[0].shape)
        for cube in cubes:
            squared = basis.analysis(np.asarray(cube, np.float64) / np.sqrt(np.mean(np.square(cube)))) ** 2
            for group in range(label.max() + 1):
                variance[label == group] += squared[label == group].mean(0) / len(cubes)
        return cls(basis, variance)

    def apply(self, cube: np.ndarray) -> np.ndarray:
        """Return C x of a cube (M, N, K), float64."""
        return self.basis.synthesis(self.variance * self.basis.analysis(cube))

    @property
    def trace(self) -> float:
        """Return the expected squared norm of a cube."""
        return float(self.variance.sum())


def subbands(shape: tuple[int, ...], level: int) -> np.ndarray:
    """Return (M, N) int, the wavelet subband of each packed coefficient; 0 is the coarse picture."""
    label = np.zeros(shape[:2], int)
    for i in range(level):
        m, n = shape[0] >> i, shape[1] >> i
        label[: m // 2, n // 2 : n], label[m // 2 : m, : n // 2], label[m // 2 : m, n // 2 : n] = 3 * i + 1, 3 * i + 2, 3 * i + 3
    return label
