"""From the light on each pixel to the numbers that are read: crosstalk, binned layers, pixel gains (theory.md (S.41))."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from recon.errors import InputError

MAX_CROSSTALK = 0.2


@dataclass(frozen=True, eq=False)
class Readout:
    """Turn what the pixels receive into what they report: ``gain * bin(crosstalk(light))``, a linear map of frames (L, C, M, W).

    Args:
        gain: broadcastable to (C, M, W), finite and at least 0; None: 1 everywhere.
        bins: C integers of at least 1: the layer's pixels are summed in blocks of that side; the sum stands in the block's
            first pixel (lowest row and column), the others read 0. Blocks at the border may be partial. None: no binning.
        crosstalk: share of a pixel's charge that ends in each of its four neighbours, in [0, 0.2]; beyond the border it is lost.

    Raises:
        InputError: fields ``gain``, ``bins``, ``crosstalk``.
    """

    gain: np.ndarray | None = None
    bins: tuple[int, ...] | None = None
    crosstalk: float = 0.0

    def __post_init__(self) -> None:
        if self.gain is not None:
            gain = np.asarray(self.gain, np.float64)
            if gain.ndim > 3 or not np.isfinite(gain).all() or (gain < 0).any():
                raise InputError("gain", gain.shape, "finite, at least 0, broadcastable to (channels, rows, columns)")
            object.__setattr__(self, "gain", gain)
        if self.bins is not None:
            bins = tuple(int(b) for b in self.bins)
            if any(b < 1 or b != given for b, given in zip(bins, self.bins)):
                raise InputError("bins", self.bins, "integers of at least 1, one a channel")
            object.__setattr__(self, "bins", bins if max(bins, default=1) > 1 else None)
        if not 0 <= self.crosstalk <= MAX_CROSSTALK:
            raise InputError("crosstalk", self.crosstalk, f"in [0, {MAX_CROSSTALK}]")

    @property
    def couples(self) -> bool:
        """Tell whether rows of the sensor mix."""
        return self.crosstalk > 0 or self.bins is not None

    @property
    def plain(self) -> bool:
        """Tell whether nothing is done."""
        return self.gain is None and not self.couples

    def check(self, shape: tuple[int, int, int]) -> None:
        """Refuse frames (C, M, W) that gains or bins don't fit.

        Raises:
            InputError: fields ``gain``, ``bins``.
        """
        if self.bins is not None and len(self.bins) != shape[0]:
            raise InputError("bins", self.bins, f"{shape[0]} integers, one a channel")
        if self.gain is not None:
            try:
                np.broadcast_to(self.gain, shape)
            except ValueError:
                raise InputError("gain", self.gain.shape, f"broadcastable to (channels, rows, columns) = {shape}") from None

    def apply(self, light: np.ndarray) -> np.ndarray:
        """Return what is read, (L, C, M, W); ``light`` is overwritten."""
        if self.crosstalk > 0:
            light = self._leak(light)
        for c, side in enumerate(self.bins or ()):
            if side > 1:
                light[:, c] = _binned(light[:, c], side)
        if self.gain is not None:
            light *= self.gain.astype(light.dtype)
        return light

    def transpose(self, frames: np.ndarray) -> np.ndarray:
        """Apply the transpose of ``apply`` to frames (L, C, M, W) and return a new array (or the same one when nothing is done)."""
        if self.plain:
            return frames
        result = frames * self.gain.astype(frames.dtype) if self.gain is not None else frames.copy()
        for c, side in enumerate(self.bins or ()):
            if side > 1:
                rows, columns = (np.arange(n) // side * side for n in result.shape[2:])
                result[:, c] = result[:, c][:, rows[:, None], columns]
        return self._leak(result) if self.crosstalk > 0 else result

    def _leak(self, light: np.ndarray) -> np.ndarray:
        """Move charge to the four neighbours: symmetric, so it is its own transpose."""
        share = light.dtype.type(self.crosstalk)
        result = (1 - 4 * share) * light
        result[:, :, 1:] += share * light[:, :, :-1]
        result[:, :, :-1] += share * light[:, :, 1:]
        result[..., 1:] += share * light[..., :-1]
        result[..., :-1] += share * light[..., 1:]
        return result

    def matrix(self, shape: tuple[int, int, int, int]) -> Any:
        """Return the map as a SciPy sparse array on frames (L, C, M, W) flattened in the order row, column, channel, shot."""
        from scipy.sparse import block_diag, diags_array, eye_array, kron

        shots, channels, rows, width = shape
        a = self.crosstalk
        line = [
            diags_array([np.ones(n - 1), np.ones(n - 1)], offsets=[-1, 1], shape=(n, n)) if n > 1 else 0 * eye_array(1)
            for n in (rows, width)
        ]
        leak = (1 - 4 * a) * eye_array(rows * width) + a * (kron(eye_array(width), line[0]) + kron(line[1], eye_array(rows)))
        gain = np.broadcast_to(1.0 if self.gain is None else self.gain, (channels, rows, width))
        layers = []
        for c in range(channels):
            side = 1 if self.bins is None else self.bins[c]
            sums = kron(_bin_matrix(width, side), _bin_matrix(rows, side))
            layers.append(diags_array(gain[c].T.ravel()) @ sums @ leak)
        return block_diag(layers * shots, format="csr")


def _binned(layer: np.ndarray, side: int) -> np.ndarray:
    sums = np.add.reduceat(np.add.reduceat(layer, np.arange(0, layer.shape[1], side), axis=1), np.arange(0, layer.shape[2], side), axis=2)
    result = np.zeros_like(layer)
    result[:, ::side, ::side] = sums
    return result


def _bin_matrix(count: int, side: int) -> Any:
    from scipy.sparse import coo_array

    index = np.arange(count)
    return coo_array((np.ones(count), (index // side * side, index)), shape=(count, count))
