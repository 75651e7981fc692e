"""The exact data step of a camera that spreads a band over several columns of its row (theory.md (S.15), (S.42))."""

import numpy as np

from recon import threads
from recon.coded_aperture import CodedAperture
from recon.field_aperture import FieldAperture
from recon.gram import LIMITED_BY, REGULAR
from recon.operator_step import Sums

FAITHFUL = 1e-9
LIMITED = LIMITED_BY + ": {:g} of H H^T's largest entry was added to project on bands; float64 adds 1e-11"
NEAR_SHARE = 0.9  # of a band's light that the columns kept there hold


class RowInverse:
    """``(H H^T + rho I)^-1`` of a camera whose rows don't couple: one banded Cholesky factor a sensor row, made in float64.

    Args:
        operator: H.
        rho: at least 0.
        regular: with rho = 0 a banded factor cannot leave out eigenvalues: this part of H H^T's largest diagonal entry is added.
        weights: d (L, C, M, W) where H is ``diag(d)`` times the operator; None: 1.
    """

    def __init__(
        self, operator: CodedAperture | FieldAperture, rho: float, regular: float = 0.0, weights: np.ndarray | None = None
    ) -> None:
        from recon import banded_kernels

        self._solve = banded_kernels.solve_groups
        self.factor = _factor(operator, rho if rho > 0 else regular * _largest(operator), weights)
        self._none = np.zeros(operator.out_shape, operator.dtype)

    @classmethod
    def near(cls, operator: FieldAperture, rho: float, weights: np.ndarray | None = None) -> "RowInverse":
        """Return the inverse of the nearest camera whose rows don't couple (theory.md (S.43))."""
        return cls(operator.rows_only(NEAR_SHARE), rho, weights=weights)

    def __call__(self, frames: np.ndarray, seen: np.ndarray | None = None, out: np.ndarray | None = None) -> np.ndarray:
        """Return the inverse times (frames - seen)."""
        result = np.empty_like(frames) if out is None else out
        threads.run(self._solve, self.factor.shape[0], self.factor, frames, self._none if seen is None else seen, result)
        return result


class BandedStep:
    """The exact step by a ``RowInverse``, applied in the operator's type.

    With rho = 0 it adds 1e-6 (float64: 1e-11) of the largest diagonal entry: basis pursuit becomes Eq. 4 with a tau that small,
    and what it leaves of g - H f is in ``Solution.residual``. Blocks leave eigenvalues below 1e-6 out; a fit closer than that
    amplifies without bound what H does not know of the optics, so float64 is not chosen by itself here.
    """

    def __init__(
        self,
        operator: CodedAperture | FieldAperture,
        frames: np.ndarray,
        rho: float,
        notes: tuple[str, ...] = (),
        weights: np.ndarray | None = None,
    ) -> None:
        from recon import banded_kernels, step_kernels

        self._advance = banded_kernels.advance_groups
        self._relax, self._finish = step_kernels.relax_rows, step_kernels.finish_rows
        regular = REGULAR[operator.dtype.name]
        said = () if rho > 0 or regular < FAITHFUL else (LIMITED.format(regular),)
        self.notes, self.condition = (*notes, *said), 1.0
        self._operator = operator
        self._inverse = RowInverse(operator, rho, regular, weights)
        self._weights = None if weights is None else weights.astype(operator.dtype)
        self._frames = np.ascontiguousarray(frames if weights is None else frames * weights, operator.dtype)
        self._none = np.zeros((0, 0, 0, 0), operator.dtype)
        self._optics = operator.optics() if isinstance(operator, CodedAperture) else None
        if self._optics is None:
            self._seen, self._y = np.empty_like(self._frames), np.empty_like(self._frames)
            self._step = np.empty((operator.in_shape[2], *operator.in_shape[:2]), operator.dtype)
        self._sums = np.zeros((operator.in_shape[0], 4))

    def advance(self, z: np.ndarray, w: np.ndarray, x: np.ndarray, relax: float, ratio: float = 1.0) -> Sums:
        """See ``DataStep.advance``."""
        real, rows = z.dtype.type, z.shape[1]
        if self._optics is not None:
            fused = (self._frames, self._none if self._weights is None else self._weights, self._optics, self._inverse.factor)
            threads.run(self._advance, self._inverse.factor.shape[0], z, w, x, real(relax), *fused, real(ratio), self._sums)
            return Sums(*(float(v) for v in self._sums.sum(0)))
        threads.run(self._relax, rows, z, w, x, real(relax), self._sums)
        self._operator.forward(z.transpose(1, 2, 0), self._seen)
        if self._weights is not None:
            self._seen *= self._weights
        self._inverse(self._frames, self._seen, self._y)
        if self._weights is not None:
            self._y *= self._weights
        self._operator.adjoint(self._y, self._step.transpose(1, 2, 0))
        threads.run(self._finish, rows, z, self._step, x, w, real(ratio), self._sums)
        return Sums(*(float(v) for v in self._sums.sum(0)))


def row_strength(operator: FieldAperture) -> float:
    """Return the largest diagonal entry of H H^T of the nearest camera whose rows don't couple."""
    return _largest(operator.rows_only())


def _largest(operator: CodedAperture | FieldAperture) -> float:
    """Return the largest diagonal entry of H H^T."""
    rows, lanes = operator.out_shape[2], 16
    every = (operator.gram(0, slice(first, first + lanes)) for first in range(0, rows, lanes))
    return max(float(np.einsum("mssj->msj", gram).max()) for gram in every)


def _factor(operator: CodedAperture | FieldAperture, rho: float, weights: np.ndarray | None) -> np.ndarray:
    from recon import banded_kernels

    rows, width = operator.out_shape[2:]
    size, lanes, reach = operator.measurements, banded_kernels.LANES, operator.reach
    half = size * reach - 1
    groups = -(-rows // lanes)
    factor = np.empty((groups, width * size, half + 1, lanes), operator.dtype)
    for group in range(groups):
        band = _band(operator, slice(group * lanes, (group + 1) * lanes), half, lanes, weights)
        band[:, :, 0] += rho
        banded_kernels.factor_groups(0, 1, band, half, factor[group : group + 1])
    return factor


def _band(operator: CodedAperture | FieldAperture, rows: slice, half: int, lanes: int, weights: np.ndarray | None = None) -> np.ndarray:
    """Return the band matrices of a group of rows: ``[0, i, d, lane] = A[i, i - d]`` with ``i = j S + s``."""
    size, width = operator.measurements, operator.width
    band = np.zeros((1, width * size, half + 1, lanes))
    for offset in range(operator.reach):
        gram = operator.gram(offset, rows)
        if weights is not None:
            root = weights.reshape(size, -1, width)[:, rows].transpose(1, 0, 2)
            gram = gram * root[:, :, None]
            gram[..., : width - offset] *= root[:, None, :, offset:]
        for p in range(size):
            for q in range(size):
                d = offset * size + q - p
                if d >= 0:
                    band[0, offset * size + q :: size, d, : gram.shape[0]] = gram[:, p, q, : width - offset].T
    return band
