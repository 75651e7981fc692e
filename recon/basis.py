"""Orthonormal bases in which a cube is sparse: a 2-D wavelet along the picture times a DCT along wavelength."""

from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from pydantic import Field, field_validator

from recon import threads
from recon.coded_aperture import empty_cube
from recon.config import Config
from recon.errors import InputError

DEFAULT_WAVELET = "db2"
DEFAULT_LEVEL = 5
ORTHONORMAL = 1e-9  # allowed error of the filters' autocorrelation


class Basis(Protocol):
    """An orthonormal change of coordinates of cubes (M, N, K): ``synthesis`` is the inverse and the transpose of ``analysis``."""

    def analysis(self, cube: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return theta = Psi^T f, of the cube's shape."""
        ...

    def synthesis(self, theta: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return f = Psi theta."""
        ...


class Kronecker(Config):
    """Psi = (orthogonal 2-D wavelet, periodised) Kronecker (orthonormal DCT-II along wavelength); theory.md (S.6).

    Coefficients have the cube's logical shape (M, N, K): wavelet coefficients packed as ``pywt.coeffs_to_array`` packs
    them, DCT order along the last axis. Arrays keep band-major memory; float32 stays float32.

    Args:
        wavelet: an orthogonal family of PyWavelets: haar, dbN, symN, coifN.
        level: how often the picture is halved; both sides must be divisible by 2^level. 0: no wavelet.

    Raises:
        InputError: ``basis.wavelet`` for an unknown or not orthogonal wavelet; ``basis.level`` with the largest valid level
            when a cube's sides don't allow it.
    """

    wavelet: str = DEFAULT_WAVELET
    level: int = Field(default=DEFAULT_LEVEL, ge=0, le=30)

    @field_validator("wavelet")
    @classmethod
    def _orthogonal(cls, name: str) -> str:
        _filters(name)
        return name

    @classmethod
    def for_shape(cls, shape: tuple[int, ...], wavelet: str = DEFAULT_WAVELET, level: int = DEFAULT_LEVEL) -> "Kronecker":
        """Return the basis with ``level`` or the deepest level that the sides of ``shape`` (M, N, K) allow."""
        return cls(wavelet=wavelet, level=min(level, largest_level(shape)))

    def require(self, shape: tuple[int, ...]) -> None:
        """Refuse a cube shape (M, N, K) that cannot be halved ``level`` times."""
        deepest = largest_level(shape)
        if self.level > deepest:
            raise InputError(
                "basis.level", self.level, f"at most {deepest} for a {shape[0]} x {shape[1]} picture (sides divisible by 2^level)"
            )

    def analysis(self, cube: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return theta = Psi^T f for a cube (M, N, K)."""
        source, target = self._arrays(cube, out)
        self._wavelet(source, target, forward=True)
        _cosine(target, analyse=True, synthesise=False)
        return target.transpose(1, 2, 0)

    def synthesis(self, theta: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return f = Psi theta for coefficients (M, N, K)."""
        source, target = self._arrays(theta, out)
        if target is not source:
            target[...] = source
        _cosine(target, analyse=False, synthesise=True)
        self._wavelet(target, target, forward=False)
        return target.transpose(1, 2, 0)

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """Replace a band-major cube by ``Psi soft(Psi^T f, threshold)`` in place and return ``||soft(...)||_1``.

        The coefficients never go to memory between the two spectral transforms.
        """
        _, target = self._arrays(cube, cube)
        self._wavelet(target, target, forward=True)
        total = _cosine(target, analyse=True, synthesise=True, threshold=threshold)
        self._wavelet(target, target, forward=False)
        return total

    def _wavelet(self, source: np.ndarray, target: np.ndarray, *, forward: bool) -> None:
        from recon import wavelet_kernels as kernels

        if self.level == 0 and source is target:
            return
        kernel = kernels.analysis_bands if forward else kernels.synthesis_bands
        filters = (filter_pair if forward else interleaved_pair)(self.wavelet, target.dtype)
        threads.run(kernel, source.shape[0], source, *filters, self.level, target)

    def _arrays(self, value: np.ndarray, out: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        array = np.asarray(value)
        if array.ndim != 3 or 0 in array.shape:
            raise InputError("cube", array.shape, "of shape (rows, columns, bands), each at least 1")
        self.require(array.shape)
        if array.dtype not in (np.float32, np.float64):
            array = array.astype(np.float64)
        if out is None:
            out = empty_cube(array.shape, array.dtype)
        source, target = array.transpose(2, 0, 1), out.transpose(2, 0, 1)
        if out.shape != array.shape or out.dtype != array.dtype or not target.flags.c_contiguous:
            raise InputError(
                "out", (out.shape, str(out.dtype)), f"of shape {array.shape}, type {array.dtype}, band-major (recon.basis.empty_cube)"
            )
        return np.ascontiguousarray(source), target


def largest_level(shape: tuple[int, ...]) -> int:
    """Return how often both sides of a picture (M, N, ...) can be halved."""
    side = int(np.gcd(shape[0], shape[1]))
    return (side & -side).bit_length() - 1


@lru_cache(maxsize=32)
def _filters(name: str) -> tuple[np.ndarray, np.ndarray]:
    import pywt

    if name not in pywt.wavelist(kind="discrete"):
        raise InputError("basis.wavelet", name, "an orthogonal wavelet of PyWavelets: haar, dbN, symN or coifN")
    wavelet = pywt.Wavelet(name)
    if not wavelet.orthogonal:
        raise InputError("basis.wavelet", name, "an orthogonal wavelet (haar, dbN, symN, coifN): Psi must be orthonormal")
    low, high = np.array(wavelet.rec_lo), np.array(wavelet.rec_hi)
    shifts = [low[2 * s :] @ low[: low.size - 2 * s] - (s == 0) for s in range(low.size // 2)]
    if np.abs(shifts).max() > ORTHONORMAL:
        raise InputError("basis.wavelet", name, f"orthonormal to {ORTHONORMAL:g} (PyWavelets truncates this one's filter)")
    return low, high


@lru_cache(maxsize=64)
def filter_pair(name: str, dtype: Any) -> tuple[np.ndarray, int]:
    """Return low and high pass (2, taps), padded with zeros to a multiple of four taps, and the true length."""
    low, high = _filters(name)
    pair = np.pad(np.stack([low, high]), ((0, 0), (0, -low.size % 4)))
    return pair.astype(dtype), low.size


@lru_cache(maxsize=64)
def interleaved_pair(name: str, dtype: Any) -> tuple[np.ndarray, int]:
    """Return the synthesis filters as even and odd phase (2, taps), low and high interleaved, and the true length."""
    pair, length = filter_pair(name, dtype)
    return np.stack([pair[:, 0::2].T.ravel(), pair[:, 1::2].T.ravel()]), length


@lru_cache(maxsize=64)
def cosine_matrix(bands: int, dtype: Any) -> np.ndarray:
    """Return the orthonormal DCT-II matrix (K, K): row q is the q-th cosine (theory.md (S.7))."""
    q, k = np.ogrid[:bands, :bands]
    matrix = np.sqrt(2 / bands) * np.cos(np.pi * (2 * k + 1) * q / (2 * bands))
    matrix[0] = np.sqrt(1 / bands)
    return matrix.astype(dtype)


def _cosine(cube: np.ndarray, *, analyse: bool, synthesise: bool, threshold: float = -1.0) -> float:
    """Transform a band-major cube (K, M, N) along wavelength in place; see ``cosine_tiles``."""
    from recon import wavelet_kernels as kernels

    flat = cube.reshape(cube.shape[0], -1)
    matrix = cosine_matrix(cube.shape[0], cube.dtype)
    even = np.ascontiguousarray(matrix[0::2, : -(-cube.shape[0] // 2)])
    odd = np.ascontiguousarray(matrix[1::2, : cube.shape[0] // 2])
    tiles = -(-flat.shape[1] // kernels.TILE)
    sums = np.zeros(tiles)
    threads.run(kernels.cosine_tiles, tiles, even, odd, flat, flat, analyse, threshold, synthesise, sums)
    return float(sums.sum())
