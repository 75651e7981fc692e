"""The exact data step of a camera that spreads a band over several columns (theory.md (S.15))."""

import numpy as np

from recon import aperture_kernels, threads
from recon.coded_aperture import CodedAperture, mosaic_tile
from recon.data_step import Sums, merge_repeats, whiten

REGULAR = {"float32": 1e-6, "float64": 1e-11}  # of the largest diagonal entry: what is added when rho = 0


class BandedStep:
    """One banded Cholesky factor a sensor row, made once in float64, applied in the operator's type.

    With rho = 0 a banded factor cannot leave out eigenvalues, so 1e-6 (float64: 1e-11) of the largest diagonal entry of H H^T
    is added instead: basis pursuit becomes Eq. 4 with a tau that small, and what it leaves of g - H f is in ``Solution.residual``.
    """

    def __init__(self, operator: CodedAperture, frames: np.ndarray, rho: float, mixed: bool) -> None:
        from recon import banded_kernels, step_kernels

        self._relax, self._finish, self._solve = step_kernels.relax_rows, step_kernels.finish_rows, banded_kernels.solve_groups
        notes: list[str] = []
        masks, merged = merge_repeats(operator.masks, frames)
        response = operator.response
        if mixed:
            response, merged = whiten(response, operator.mosaic, merged, notes)
        self.notes = tuple(notes)
        tile, tile_of = mosaic_tile(response, operator.mosaic, operator.in_shape[0])
        exact = (masks, response, tile, tile_of, operator.first_column, operator.taps)
        self._factor = _factor(exact, merged.shape, rho, operator.dtype)
        arrays = [np.ascontiguousarray(a, operator.dtype) for a in (masks, response, tile, operator.taps)]
        self._arguments = (*arrays[:3], tile_of, operator.first_column, arrays[3])
        self._frames = np.ascontiguousarray(merged, operator.dtype)
        self._seen, self._y = np.empty_like(self._frames), np.empty_like(self._frames)
        self._step = np.empty((operator.in_shape[2], *operator.in_shape[:2]), operator.dtype)
        self._sums = np.zeros((operator.in_shape[0], 4))

    def advance(self, z: np.ndarray, w: np.ndarray, x: np.ndarray, relax: float, ratio: float = 1.0) -> Sums:
        """See ``DataStep.advance``."""
        real, rows = z.dtype.type, z.shape[1]
        threads.run(self._relax, rows, z, w, x, real(relax), self._sums)
        threads.run(aperture_kernels.forward_rows, rows, z, *self._arguments, self._seen)
        threads.run(self._solve, self._factor.shape[0], self._factor, self._frames, self._seen, self._y)
        threads.run(aperture_kernels.adjoint_rows, rows, self._y, *self._arguments, self._step)
        threads.run(self._finish, rows, z, self._step, x, w, real(ratio), self._sums)
        return Sums(*(float(v) for v in self._sums.sum(0)))


def _factor(exact: tuple[np.ndarray, ...], shape: tuple[int, ...], rho: float, dtype: np.dtype) -> np.ndarray:
    from recon import banded_kernels

    shots, channels, rows, width = shape
    size, lanes = shots * channels, banded_kernels.LANES
    half = size * exact[5].shape[1] - 1
    groups = -(-rows // lanes)
    factor = np.empty((groups, width * size, half + 1, lanes), dtype)
    if rho == 0:
        every = (_gram(exact, slice(g * lanes, (g + 1) * lanes), 0, size, width) for g in range(groups))
        rho = REGULAR[dtype.name] * max(float(np.einsum("mssj->msj", gram).max()) for gram in every)
    for group in range(groups):
        band = _band(exact, slice(group * lanes, (group + 1) * lanes), size, width, half, lanes)
        band[:, :, 0] += rho
        banded_kernels.factor_groups(0, 1, band, half, factor[group : group + 1])
    return factor


def _band(exact: tuple[np.ndarray, ...], rows: slice, size: int, width: int, half: int, lanes: int) -> np.ndarray:
    """Return the band matrices of a group of rows: ``[0, i, d, lane] = A[i, i - d]`` with ``i = j S + s``."""
    band = np.zeros((1, width * size, half + 1, lanes))
    for offset in range(exact[5].shape[1]):
        gram = _gram(exact, rows, offset, size, width)
        for p in range(size):
            for q in range(size):
                d = offset * size + q - p
                if d >= 0:
                    band[0, offset * size + q :: size, d, : gram.shape[0]] = gram[:, p, q, : width - offset].T
    return band


def _gram(exact: tuple[np.ndarray, ...], rows: slice, offset: int, size: int, width: int) -> np.ndarray:
    masks, response, tile, tile_of, start, taps = exact
    some = np.ascontiguousarray(masks[:, rows])
    gram = np.empty((some.shape[1], size, size, width))
    threads.run(aperture_kernels.gram_rows, some.shape[1], offset, some, response, tile, tile_of[rows], start, taps, gram)
    return gram
