"""Operators that know their H H^T: in blocks, a pixel each, or in bands along a row; both give the exact data step (theory.md (S.55))."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from recon.errors import InputError
from recon.operator import LinearOperator

CUTOFF = 1e-6  # of a block's largest eigenvalue: below it an eigenvalue counts as 0 when rho = 0
FAINT = 1e-12  # and below this part of the largest of all blocks
REGULAR = {"float32": 1e-6, "float64": 1e-11}  # of a band's largest diagonal entry: what is added when rho = 0
LIMITED_BY = "limited by float32"  # how the note on it begins


@dataclass(frozen=True)
class GramBlocks:
    """H H^T as B independent blocks of S measurements.

    Args:
        index: (B, S) places in the flattened frames; every measurement stands in one block.
        matrix: (B, S, S) symmetric; the entries of H H^T between the measurements of a block, all others are 0.
    """

    index: np.ndarray
    matrix: np.ndarray

    def check(self, size: int) -> None:
        """Refuse shapes that don't fit each other or ``size`` measurements."""
        _check_index(self.index, size)
        if self.matrix.shape != (*self.index.shape, self.index.shape[1]) or not np.isfinite(self.matrix).all():
            raise InputError("gram_blocks.matrix", self.matrix.shape, f"finite, of shape {(*self.index.shape, self.index.shape[1])}")

    def scaled(self, weights: np.ndarray) -> "GramBlocks":
        """Return the blocks of ``diag(d) H H^T diag(d)`` for flat d."""
        d = weights[self.index]
        return GramBlocks(self.index, self.matrix * d[:, :, None] * d[:, None, :])

    def inverse(self, rho: float) -> "BlockInverse":
        """Return ``(H H^T + rho I)^-1``, at rho = 0 the pseudo-inverse."""
        return BlockInverse(self, rho)


@dataclass(frozen=True)
class GramBands:
    """H H^T as B independent rows of n measurements, banded.

    Args:
        index: (B, n) places in the flattened frames; every measurement stands in one row.
        bands: (B, n, U) with ``bands[b, i, d]`` the entry of H H^T between measurements i and i - d of row b.
    """

    index: np.ndarray
    bands: np.ndarray

    def check(self, size: int) -> None:
        """Refuse shapes that don't fit each other or ``size`` measurements."""
        _check_index(self.index, size)
        if self.bands.ndim != 3 or self.bands.shape[:2] != self.index.shape or not np.isfinite(self.bands).all():
            raise InputError("gram_blocks.bands", self.bands.shape, f"finite, of shape {self.index.shape} and a half band")

    def scaled(self, weights: np.ndarray) -> "GramBands":
        """Return the bands of ``diag(d) H H^T diag(d)`` for flat d."""
        d = weights[self.index]
        bands = self.bands * d[:, :, None]
        for offset in range(bands.shape[2]):
            bands[:, offset:, offset] *= d[:, : max(0, d.shape[1] - offset)]
        return GramBands(self.index, bands)

    def inverse(self, rho: float) -> "BandInverse":
        """Return ``(H H^T + rho I)^-1``; at rho = 0 with 1e-11 of the largest diagonal entry for rho."""
        return BandInverse(self, rho)


@runtime_checkable
class KnowsGram(Protocol):
    """An operator that can give its H H^T."""

    def gram_blocks(self) -> GramBlocks | GramBands:
        """Return H H^T in float64."""
        ...


class BlockInverse:
    """Small dense inverses, applied together."""

    def __init__(self, gram: GramBlocks, rho: float) -> None:
        value, vector = np.linalg.eigh(gram.matrix)
        top = value[:, -1:]
        kept = value + rho > (0 if rho > 0 else np.maximum(CUTOFF * top, FAINT * top.max(initial=0)))
        weight = np.divide(1.0, value + rho, out=np.zeros_like(value), where=kept)
        dropped = int((~kept & (value > 1e-12 * top)).sum()) if rho == 0 else 0
        least = np.where(kept, value + rho, np.inf).min(1)
        self.condition = float(np.sqrt(np.mean(np.where(kept.any(1), (top[:, 0] + rho) / least, 1.0) ** 2)))
        self.notes = (f"H H^T is ill-conditioned: {dropped} directions below {CUTOFF:g} of their block's largest were left out",) * bool(
            dropped
        )
        self._index = gram.index
        self._blocks = np.einsum("bsi,bi,bqi->bsq", vector, weight, vector)

    def __call__(self, right: np.ndarray) -> np.ndarray:
        """Return the inverse times ``right``."""
        out = np.empty(right.size, right.dtype)
        out[self._index] = np.matmul(self._blocks, right.reshape(-1)[self._index][:, :, None].astype(np.float64))[:, :, 0]
        return out.reshape(right.shape)


class BandInverse:
    """Banded Cholesky factors, one a row (scipy.linalg)."""

    def __init__(self, gram: GramBands, rho: float) -> None:
        from scipy.linalg import cholesky_banded

        self.notes: tuple[str, ...] = ()
        self._index = gram.index
        add = rho if rho > 0 else REGULAR["float64"] * float(gram.bands[:, :, 0].max())
        self._factors = []
        for band in gram.bands:
            lower = np.zeros((band.shape[1], band.shape[0]))
            for d in range(min(band.shape[1], band.shape[0])):
                lower[d, : band.shape[0] - d] = band[d:, d]
            lower[0] += add
            self._factors.append(cholesky_banded(lower, lower=True))

    def __call__(self, right: np.ndarray) -> np.ndarray:
        """Return the inverse times ``right``."""
        from scipy.linalg import cho_solve_banded

        out = np.empty(right.size, right.dtype)
        flat = right.reshape(-1)
        for index, factor in zip(self._index, self._factors):
            out[index] = cho_solve_banded((factor, True), flat[index].astype(np.float64))
        return out.reshape(right.shape)


def known_gram(operator: LinearOperator) -> GramBlocks | GramBands | None:
    """Return what the operator knows of H H^T, checked; None when it knows nothing."""
    from recon.operator import RowWeighted

    if isinstance(operator, RowWeighted):
        inner = known_gram(operator.operator)
        return None if inner is None else inner.scaled(operator.weights.reshape(-1).astype(np.float64))
    return checked_gram(operator.gram_blocks(), operator.out_shape) if isinstance(operator, KnowsGram) else None


def checked_gram(gram: Any, out_shape: tuple[int, ...]) -> GramBlocks | GramBands | None:
    """Refuse what is no H H^T of frames of this shape; None passes."""
    if gram is None:
        return None
    if not isinstance(gram, GramBlocks | GramBands):
        raise InputError("gram_blocks", type(gram).__name__, "GramBlocks, GramBands or None")
    gram.check(int(np.prod(out_shape)))
    return gram


def _check_index(index: np.ndarray, size: int) -> None:
    flat = np.asarray(index)
    if flat.ndim != 2 or not np.issubdtype(flat.dtype, np.integer) or not np.array_equal(np.sort(flat.ravel()), np.arange(size)):
        raise InputError("gram_blocks.index", flat.shape, f"(blocks, members) in which each of 0..{size - 1} stands once")
