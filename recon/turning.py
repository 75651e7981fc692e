"""Change spectral coordinates: a small matrix times the spectrum of every pixel, on all threads (theory.md (S.7))."""

from functools import lru_cache
from typing import Any

import numpy as np

from recon import threads

SYMMETRIC = 1e-6  # mirrored entries of a row may differ by this much of the largest entry


def turn(matrix: np.ndarray, source: np.ndarray, target: np.ndarray) -> None:
    """Set ``target[i] = sum_k matrix[i, k] source[k]`` for band-major cubes (bands, M, N).

    A matrix whose rows are mirror-symmetric in turn, as the DCT's are, or the transpose of one costs half of another.

    Args:
        matrix: (R, K), of the cubes' type.
        source: (K, M, N), pixels contiguous.
        target: (R, M, N); may be ``source``.
    """
    from recon import spectral_kernels as kernels

    x, out = source.reshape(source.shape[0], -1), target.reshape(target.shape[0], -1)
    tiles = -(-x.shape[1] // kernels.TILE)
    if halves(matrix)[1].size == 0 and halves(matrix.T)[1].size:
        threads.run(kernels.turn_back_tiles, tiles, x, *packed_halves(matrix.T)[2:], out)
    else:
        threads.run(kernels.turn_tiles, tiles, x, *packed_halves(matrix)[:2], out)


def packed_halves(matrix: np.ndarray | None, dtype: Any = None) -> tuple[np.ndarray, ...]:
    """Return what the kernels need of a matrix (R, K): its even and odd half, packed, and those of its transpose.

    None, for no matrix at all, gives empty arrays.
    """
    if matrix is None:
        return (np.zeros((0, 0, 4), dtype),) * 4
    values = np.ascontiguousarray(matrix, dtype)
    return _packed_halves(values.tobytes(), values.shape, values.dtype.name)


def halves(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the even and odd rows on half of the bands when they are mirror-symmetric and antisymmetric; else all, and nothing."""
    rows, bands = matrix.shape
    even, odd = matrix[0::2], matrix[1::2]
    close = SYMMETRIC * float(np.abs(matrix).max(initial=0))
    if rows != bands or rows < 2 or np.abs(even - even[:, ::-1]).max() > close or np.abs(odd + odd[:, ::-1]).max() > close:
        return matrix, np.zeros((0, 0), matrix.dtype)
    return even[:, : bands - bands // 2], odd[:, : bands // 2]


@lru_cache(maxsize=64)
def _packed_halves(data: bytes, shape: tuple[int, int], dtype: str) -> tuple[np.ndarray, ...]:
    even, odd = halves(np.frombuffer(data, dtype).reshape(shape))
    return _packed(even), _packed(odd), _packed(even.T), _packed(odd.T)


def _packed(matrix: np.ndarray) -> np.ndarray:
    """Return ``out[b, k, r] = matrix[4 b + r, k]``, with rows of zeros to fill the last block of four."""
    rows, columns = matrix.shape
    whole = np.zeros((-(-rows // 4) * 4, columns), matrix.dtype)
    whole[:rows] = matrix
    return np.ascontiguousarray(whole.reshape(whole.shape[0] // 4, 4, columns).transpose(0, 2, 1))
