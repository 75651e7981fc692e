"""Orthonormal bases in which a cube is sparse: a 2-D wavelet along the picture times a basis along wavelength."""

from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from pydantic import Field, PositiveInt, field_validator

from recon import threads
from recon.coded_aperture import empty_cube
from recon.config import Config
from recon.errors import InputError
from recon.spectral_basis import Cosine
from recon.turning import turn

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
    """Psi = (orthogonal 2-D wavelet, periodised) Kronecker (orthonormal basis along wavelength); theory.md (S.6), (S.63).

    Coefficients are packed as ``pywt.coeffs_to_array`` packs them, spectral coefficients along the last axis. Arrays
    keep band-major memory; float32 stays float32. Where ``picture`` is set, cubes of those sides are continued by zeros to
    ``theta_shape``, the next sides that can be halved, and cut again by ``synthesis``: Psi Psi^T = I on the cube. Cubes
    that have the longer sides already are transformed as they are.

    Args:
        wavelet: an orthogonal family of PyWavelets: haar, dbN, symN, coifN.
        level: how often the picture is halved; both sides must be divisible by 2^level, or be ``picture``'s. 0: no wavelet.
        spectral: the basis along wavelength: ``Cosine()`` or ``Learned``.
        picture: rows and columns of the cubes that are to be padded; ``for_shape`` sets it when needed.

    Raises:
        InputError: ``basis.wavelet`` for an unknown or not orthogonal wavelet; ``basis.level`` with the largest valid level
            when a cube's sides don't allow it.
    """

    wavelet: str = DEFAULT_WAVELET
    level: int = Field(default=DEFAULT_LEVEL, ge=0, le=30)
    spectral: Any = Cosine()
    picture: tuple[PositiveInt, PositiveInt] | None = None

    @field_validator("wavelet")
    @classmethod
    def _orthogonal(cls, name: str) -> str:
        _filters(name)
        return name

    @field_validator("spectral")
    @classmethod
    def _is_spectral(cls, spectral: Any) -> Any:
        if not callable(getattr(spectral, "matrix", None)):
            raise InputError("basis.spectral", spectral, "a basis along wavelength: recon.Cosine() or recon.learned(samples)")
        return spectral

    @classmethod
    def for_shape(
        cls, shape: tuple[int, ...], wavelet: str = DEFAULT_WAVELET, level: int = DEFAULT_LEVEL, spectral: Any = None
    ) -> "Kronecker":
        """Return the basis of full depth for cubes of ``shape`` (M, N, K), padded where their sides ask for it.

        ``level`` is lowered only for pictures with a side shorter than 2^level.
        """
        depth = min(level, max(largest_level(shape), min(shape[:2]).bit_length() - 1))
        picture = None if largest_level(shape) >= depth else (int(shape[0]), int(shape[1]))
        return cls(wavelet=wavelet, level=depth, spectral=Cosine() if spectral is None else spectral, picture=picture)

    def theta_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of the coefficients of cubes of this shape (M, N, K): longer than the cube where it is padded."""
        if tuple(shape[:2]) != self.picture:
            return tuple(shape)
        step = 2**self.level
        return (-(-shape[0] // step) * step, -(-shape[1] // step) * step, *shape[2:])

    def require(self, shape: tuple[int, ...]) -> None:
        """Refuse a cube shape (M, N, K) that cannot be halved ``level`` times and is not to be padded."""
        deepest = largest_level(self.theta_shape(shape))
        if self.level > deepest:
            raise InputError(
                "basis.level",
                self.level,
                f"at most {deepest} for a {shape[0]} x {shape[1]} picture (sides divisible by 2^level); Kronecker.for_shape pads",
            )

    def analysis(self, cube: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return theta = Psi^T f for a cube (M, N, K)."""
        source, target = self._arrays(self._padded(cube), out)
        self._wavelet(source, target, forward=True)
        turn(self.spectral.matrix(target.shape[0], target.dtype), target, target)
        return target.transpose(1, 2, 0)

    def synthesis(self, theta: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return f = Psi theta for coefficients (M, N, K); cut to ``picture``, unless ``out`` has the coefficients' shape."""
        cut = self._cut_of(theta, out)
        source, target = self._arrays(theta, None if cut else out)
        if target is not source:
            target[...] = source
        turn(self.spectral.matrix(target.shape[0], target.dtype).T, target, target)
        self._wavelet(target, target, forward=False)
        whole = target.transpose(1, 2, 0)
        if not cut:
            return whole
        result = empty_cube((*cut, whole.shape[2]), whole.dtype) if out is None else out
        result[...] = whole[: cut[0], : cut[1]]
        return result

    def shrink(self, cube: np.ndarray, threshold: float, weights: np.ndarray | None = None) -> float:
        """Replace a band-major cube by ``Psi soft(Psi^T f, threshold weights)`` in place; return the weighted l1 norm of what is left.

        The cube has the coefficients' shape (``theta_shape``). The coefficients never go to memory between the two spectral transforms.

        Args:
            cube: (M, N, K), a view of band-major memory.
            threshold: at least 0.
            weights: (K,) one a spectral coefficient; None: all 1.
        """
        _, target = self._arrays(cube, cube)
        matrix = self.spectral.matrix(target.shape[0], target.dtype)
        turn(matrix, target, target)
        total = self.shrink_bands(target, threshold, weights)
        turn(matrix.T, target, target)
        return total

    def shrink_bands(self, cube: np.ndarray, threshold: float, weights: np.ndarray | None = None) -> float:
        """As ``shrink`` for a cube of spectral coefficients, band-major (K, M, N): one pass over it, a band at a time in cache."""
        from recon import wavelet_kernels as kernels

        factors = np.ones(cube.shape[0]) if weights is None else np.asarray(weights, np.float64)
        sums = np.zeros(cube.shape[0])
        limits = (threshold * factors).astype(cube.dtype)
        threads.run(kernels.shrink_bands, cube.shape[0], cube, *filter_pair(self.wavelet, cube.dtype), self.level, limits, sums)
        return float(factors @ sums)

    def _padded(self, cube: np.ndarray) -> np.ndarray:
        array = np.asarray(cube)
        if array.ndim != 3 or self.theta_shape(array.shape) == array.shape:
            return array
        whole = empty_cube(self.theta_shape(array.shape), array.dtype if array.dtype == np.float32 else np.float64)
        whole[...] = 0
        whole[: array.shape[0], : array.shape[1]] = array
        return whole

    def _cut_of(self, theta: np.ndarray, out: np.ndarray | None) -> tuple[int, int] | None:
        """Return the sides to cut a synthesis to, if any."""
        if self.picture is None or np.ndim(theta) != 3 or np.shape(theta) != self.theta_shape((*self.picture, np.shape(theta)[2])):
            return None
        return self.picture if out is None or out.shape[:2] == self.picture else None

    def _wavelet(self, source: np.ndarray, target: np.ndarray, *, forward: bool) -> None:
        from recon import wavelet_kernels as kernels

        if self.level == 0 and source is target:
            return
        kernel = kernels.analysis_bands if forward else kernels.synthesis_bands
        threads.run(kernel, source.shape[0], source, *filter_pair(self.wavelet, target.dtype), self.level, target)

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
