"""The discrete camera H of K bands as a Dr.Jit function of masks and cube, deterministic forwards and backwards (theory.md (C.74))."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.aligned import aligned
from optsim.camera.arrays import Array, Kernels, kernels
from optsim.errors import InputError

if TYPE_CHECKING:
    from recon.coded_aperture import CodedAperture


class BandCamera:
    """Photograph cubes through gray masks by (C.14), with derivatives by masks and cube.

    A lane adds up one pixel, or one mirror on the way back: both directions gather, so that frames and derivatives
    have the same bits every time.

    Args:
        aperture: the camera's H; its masks only say how many shots and mirrors there are.

    Raises:
        InputError: field ``libLLVM`` where Dr.Jit cannot run.
    """

    def __init__(self, aperture: CodedAperture) -> None:
        k = kernels()
        if k is None:
            raise InputError("libLLVM", None, "usable: gradients are Dr.Jit's (optsim doctor says what is missing)")
        self.k: Kernels = k
        t = k.backend
        self.shots, self.rows, self.columns = aperture.masks.shape
        self.bands, self.taps = aperture.taps.shape
        self.channels, self.width = aperture.out_shape[1], aperture.width
        self.curves = len(aperture.response)
        self.response, self.weights = t.Float64(aligned(aperture.response)), t.Float64(aligned(aperture.taps))
        self.first = t.Int32(aligned(aperture.first_column, np.int32))
        self.mosaic = None if aperture.mosaic is None else t.UInt32(aligned(aperture.mosaic, np.uint32))

    @property
    def frame_shape(self) -> tuple[int, int, int, int]:
        """Return (L, C', M, W)."""
        return self.shots, self.channels, self.rows, self.width

    def frames(self, masks: Any, cube: Any) -> Any:
        """Return frames (L, C', M, W), a TensorXf64; gradients flow from masks (L, M, N) and cube (M, N, K), TensorXf64 or NumPy."""
        flat = [self._flat(masks, (self.shots, self.rows, self.columns), "masks"), self._flat(cube, self._cube_shape, "cube")]
        return self.k.backend.TensorXf64(self.k.dr.custom(_operation(self.k), self, *flat), self.frame_shape)

    @property
    def _cube_shape(self) -> tuple[int, int, int]:
        return self.rows, self.columns, self.bands

    def _flat(self, value: Any, shape: tuple[int, ...], name: str) -> Array:
        if tuple(value.shape) != shape:
            raise InputError(name, tuple(value.shape), f"of shape {shape}")
        t = self.k.backend
        return t.Float64(aligned(value)) if isinstance(value, np.ndarray) else value.array

    def forward(self, masks: Array, cube: Array) -> Array:
        """Return flat frames of flat arguments: every pixel sums over bands and taps."""
        t, dr, block = self.k.backend, self.k.dr, self.bands * self.taps
        lane = dr.arange(t.UInt32, self.rows * self.width * block)
        pixel, tap = lane // block, lane % block
        band, row = tap // self.taps, pixel // self.width
        n = t.Int32(pixel % self.width) - dr.gather(t.Int32, self.first, band) - t.Int32(tap % self.taps)
        active = (n >= 0) & (n < self.columns)
        mirror = row * self.columns + t.UInt32(n)
        weight = dr.gather(t.Float64, self.weights, tap) * dr.gather(t.Float64, cube, mirror * self.bands + band, active)
        parts = []
        for l in range(self.shots):
            light = weight * dr.gather(t.Float64, masks, mirror + l * self.rows * self.columns, active)
            parts += [light * self._chi(c, pixel, band) for c in range(self.channels)]
        dr.eval(parts)
        return dr.concat([dr.block_sum(part, block, mode="evaluated") for part in parts])

    def by_masks(self, cube: Array, back: Array) -> Array:
        """Return (L M N) derivatives by the masks of ``<back, frames>``: every mirror sums over bands, taps and channels."""
        t, dr, block = self.k.backend, self.k.dr, self.bands * self.taps
        lane = dr.arange(t.UInt32, self.rows * self.columns * block)
        light = dr.gather(t.Float64, cube, lane // self.taps)
        parts = [light * part for part in self._returned(lane, back)]
        dr.eval(parts)
        return dr.concat([dr.block_sum(part, block, mode="evaluated") for part in parts])

    def by_cube(self, masks: Array, back: Array) -> Array:
        """Return (M N K) derivatives by the cube of ``<back, frames>``."""
        t, dr, mirrors = self.k.backend, self.k.dr, self.rows * self.columns
        lane = dr.arange(t.UInt32, mirrors * self.bands * self.taps)
        mirror = lane // (self.bands * self.taps)
        total = t.Float64(0)
        for l, part in enumerate(self._returned(lane, back)):
            total = total + part * dr.gather(t.Float64, masks, mirror + l * mirrors)
        return dr.block_sum(total, self.taps, mode="evaluated")

    def _returned(self, lane: Array, back: Array) -> list[Array]:
        """Return for every shot the light that frames send back to lane (mirror, band, tap), summed over channels."""
        t, dr, block = self.k.backend, self.k.dr, self.bands * self.taps
        mirror, tap = lane // block, lane % block
        band, row = tap // self.taps, mirror // self.columns
        j = t.Int32(mirror % self.columns) + dr.gather(t.Int32, self.first, band) + t.Int32(tap % self.taps)
        active = (j >= 0) & (j < self.width)
        pixel = row * self.width + t.UInt32(j)
        weight = dr.gather(t.Float64, self.weights, tap)
        chi = [self._chi(c, pixel, band, active) for c in range(self.channels)]
        size, parts = self.rows * self.width, []
        for l in range(self.shots):
            total = t.Float64(0)
            for c in range(self.channels):
                total = total + chi[c] * dr.gather(t.Float64, back, pixel + (l * self.channels + c) * size, active)
            parts.append(weight * total)
        return parts

    def _chi(self, channel: int, pixel: Array, band: Array, active: Array | bool = True) -> Array:
        """Return the response of a channel at a pixel to a band."""
        t, dr = self.k.backend, self.k.dr
        curve = t.UInt32(channel) if self.mosaic is None else dr.gather(t.UInt32, self.mosaic, pixel, active)
        return dr.gather(t.Float64, self.response, curve * self.bands + band, active)


@functools.cache
def _operation(k: Kernels) -> Any:
    """Return the camera as a Dr.Jit operation with its own derivatives."""

    class Photograph(k.dr.CustomOp):  # type: ignore[name-defined]
        """Frames are linear in masks and in the cube."""

        def eval(self, camera: BandCamera, masks: Array, cube: Array) -> Array:
            self.camera, self.masks, self.cube = camera, k.dr.detach(masks), k.dr.detach(cube)
            return camera.forward(self.masks, self.cube)

        def forward(self) -> None:
            change = self.camera.forward(self.grad_in("masks"), self.cube) + self.camera.forward(self.masks, self.grad_in("cube"))
            self.set_grad_out(change)

        def backward(self) -> None:
            back = self.grad_out()
            self.set_grad_in("masks", self.camera.by_masks(self.cube, back))
            self.set_grad_in("cube", self.camera.by_cube(self.masks, back))

        def name(self) -> str:
            return "photograph by bands"

    return Photograph
