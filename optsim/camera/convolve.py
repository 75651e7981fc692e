"""Blur light laid on a sub-pixel grid by the optics' OTF and bin it to pixels (theory.md (C.41), (C.42))."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from optsim.camera.layout import Grid

NODE_RATIO = 1.1
"""Neighbouring kernels' wavelengths differ by at most this factor; light between is shared linearly."""
TAIL = 5e-3
_FINE_PER_PX = 9
_REACHES_PX = (8, 16, 32, 64, 128)


class Blur(Protocol):
    """Say how the optics blur."""

    def otf(self, wavelength_nm: float, fy: np.ndarray, fx: np.ndarray, /) -> np.ndarray:
        """Return the real OTF at frequencies in cycles per px."""


@dataclass(frozen=True, eq=False)
class Kernels:
    """Hold the kernels of a photograph.

    Args:
        nodes_nm: (R,) increasing wavelengths.
        shares: (R, k, k) of a cell's light on the cells around it; each kernel adds to 1.
        sub: cells along a pixel's side.
    """

    nodes_nm: np.ndarray
    shares: np.ndarray
    sub: int

    @property
    def reach_cells(self) -> int:
        """Return how many cells a kernel extends to each side."""
        return int(self.shares.shape[-1] // 2)

    @property
    def reach_px(self) -> int:
        """Return how many pixels a kernel extends to each side."""
        return -(-self.reach_cells // self.sub)

    def between(self, wavelength_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (lower, upper share): each wavelength's light belongs to node ``lower`` and, in part, to the next."""
        lower = np.clip(np.searchsorted(self.nodes_nm, wavelength_nm, side="right") - 1, 0, max(self.nodes_nm.size - 2, 0))
        if self.nodes_nm.size == 1:
            return lower, np.zeros(lower.shape)
        low, high = self.nodes_nm[lower], self.nodes_nm[lower + 1]
        return lower, np.clip((wavelength_nm - low) / (high - low), 0, 1)


def kernels_for(blur: Blur, lower_nm: float, upper_nm: float, sub: int, largest_px: int) -> Kernels:
    """Sample the optics' blur for a range of wavelengths.

    A kernel is as large as leaves at most 0.5 % of the light beyond it (at most 128 px, or ``largest_px``); that rest
    is folded back into it, so that no light is lost.

    Args:
        blur: the optics.
        lower_nm, upper_nm: the range.
        sub: cells along a pixel's side.
        largest_px: no light travels farther within the picture.
    """
    count = max(1, math.ceil(math.log(upper_nm / lower_nm) / math.log(NODE_RATIO)) + 1) if upper_nm > lower_nm else 1
    nodes = np.geomspace(lower_nm, upper_nm, count)
    reach = _reach(blur, float(nodes[-1]), sub, largest_px)
    return Kernels(nodes, np.stack([kernel(blur, float(w), sub, reach) for w in nodes]), sub)


def kernel(blur: Blur, wavelength_nm: float, sub: int, reach_px: int) -> np.ndarray:
    """Return (k, k) shares of a cell's light on the cells around it, k = 2 reach sub + 1: the PSF, averaged over cells (theory.md (C.41)).

    The PSF comes from the OTF on a grid of at least nine points a pixel, as a periodic sum, so that the kernel adds to
    1 whatever it leaves out; values below 0, which a sharp cutoff leaves, are set to 0.
    """
    size = 2 * reach_px * sub + 1
    each = -(-_FINE_PER_PX // sub)
    each += 1 - each % 2
    frequency = np.fft.fftfreq(size * each, 1 / (sub * each))
    half = frequency[: size * each // 2 + 1]
    transfer = np.sinc(frequency / sub)[:, None] * np.sinc(np.abs(half) / sub)
    transfer = transfer * blur.otf(wavelength_nm, frequency[:, None], np.abs(half)[None, :])
    psf = np.fft.irfft2(transfer, s=(size * each, size * each))[::each, ::each]
    psf = np.maximum(np.roll(psf, (size // 2, size // 2), (0, 1)), 0.0)
    return np.asarray(psf / psf.sum())


def _reach(blur: Blur, wavelength_nm: float, sub: int, largest_px: int) -> int:
    for reach in _REACHES_PX[:-1]:
        if reach >= largest_px:
            return max(1, largest_px)
        wide = kernel(blur, wavelength_nm, sub, 2 * reach)
        inner = reach * sub
        if wide[inner : wide.shape[0] - inner, inner : wide.shape[1] - inner].sum() >= 1 - TAIL:
            return reach
    return min(_REACHES_PX[-1], max(1, largest_px))


class Blurred:
    """Add up planes of light, one node of wavelengths after the other, and return the blurred frames.

    Cells that lie alike in their pixels are one picture of pixels, and blurring and binning one convolution of it
    (theory.md (C.42)): only pictures of the frame's fineness are transformed.

    Args:
        kernels: of all nodes.
        grid: on which the light is laid; it holds the frame.
        frame: (rows, columns) of pixels; pixel (0, 0) of the frame is pixel -``grid.first`` of the grid.
        shape: leading dimensions of the planes.
    """

    def __init__(self, kernels: Kernels, grid: Grid, frame: tuple[int, int], shape: tuple[int, ...]) -> None:
        from scipy import fft

        self.kernels, self.grid, self.frame, self._fft = kernels, grid, frame, fft
        self._reach = kernels.reach_px
        self._size = tuple(fft.next_fast_len(max(n + self._reach, 2 * self._reach + 1), real=True) for n in grid.pixels)
        self._spectrum = np.zeros((*shape, self._size[0], self._size[1] // 2 + 1), np.complex128)

    def add(self, node: int, planes: np.ndarray) -> None:
        """Add light (..., rows, columns) of cells that one node's kernel blurs."""
        sub, (height, width) = self.grid.sub, self.grid.pixels
        shares = self._shares(node)
        for a in range(sub):
            transfer = self._fft.rfft2(np.roll(self._wide(shares[a]), (-self._reach, -self._reach), (1, 2)), workers=-1)
            for index in np.ndindex(planes.shape[:-2]):
                light = planes[index].reshape(height, sub, width, sub)[:, a].transpose(2, 0, 1)
                self._spectrum[index] += np.einsum("bij,bij->ij", self._fft.rfft2(self._wide(light), workers=-1), transfer)

    def inside(self, node: int) -> np.ndarray:
        """Return (rows, columns), the share of each cell's light that ends on the frame."""
        kernel, reach, sub = self.kernels.shares[node], self.kernels.reach_cells, self.grid.sub
        below = np.pad(kernel.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
        (top, bottom), (left, right) = (
            [np.clip((first_of - first) * sub - np.arange(cells) + reach, 0, 2 * reach + 1) for first_of in (0, size)]
            for first, size, cells in zip(self.grid.first, self.frame, self.grid.cells)
        )
        rows = below[bottom] - below[top]
        return np.clip(rows[:, right] - rows[:, left], 0.0, 1.0)

    def frames(self) -> np.ndarray:
        """Return (..., rows, columns) of the frame's pixels; rounding errors below 0 are set to 0."""
        result = np.empty((*self._spectrum.shape[:-2], *self.frame))
        rows, columns = (slice(-first, size - first) for first, size in zip(self.grid.first, self.frame))
        for index in np.ndindex(result.shape[:-2]):
            result[index] = self._fft.irfft2(self._spectrum[index], self._size, workers=-1)[rows, columns]
        return np.maximum(result, 0.0)

    def _shares(self, node: int) -> np.ndarray:
        """Return (sub, sub, 2 reach + 1, 2 reach + 1): shares of the light of cell (a, b) of a pixel on the pixels around it."""
        sub, side = self.grid.sub, 2 * self._reach + 1
        spread = np.pad(self.kernels.shares[node], self._reach * sub - self.kernels.reach_cells + sub - 1)
        for axis in (0, 1):
            spread = np.lib.stride_tricks.sliding_window_view(spread, sub, axis).sum(-1)
        return spread.reshape(side, sub, side, sub)[:, ::-1, :, ::-1].transpose(1, 3, 0, 2)

    def _wide(self, pictures: np.ndarray) -> np.ndarray:
        """Return pictures (count, rows, columns) with zeros behind."""
        wide = np.zeros((len(pictures), *self._size))
        wide[:, : pictures.shape[1], : pictures.shape[2]] = pictures
        return wide
