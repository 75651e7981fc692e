"""Lay fine samples on the sensor by area, as a gather: every pixel adds up the samples that touch it (theory.md (C.17)).

One Dr.Jit kernel a slab of rows: a thread a pixel, the loop over wavelengths inside. No two threads write to one
place, so that the result has the same bits every time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from optsim.camera.arrays import Array, Kernels
from optsim.camera.layout import Budget, Layout, Weights
from optsim.errors import InputError

SLAB_BYTES = 2**27
SHOTS_PER_PASS = 12
MAX_CANDIDATES = 144

Rows = Callable[[int, int], np.ndarray]
"""``rows(start, stop)`` gives fine rows of the cube, (stop - start, N s, n) float32."""


class Gather:
    """Photograph with Dr.Jit.

    Args:
        k: Dr.Jit and its types.
        layout: geometry.
        weights: spectral weights.
        masks: (L, M, N) uint8, at most 32 shots.
        mosaic: (M, W) curve of each pixel, or None.
        rows: the fine cube.
    """

    def __init__(self, k: Kernels, layout: Layout, weights: Weights, masks: np.ndarray, mosaic: np.ndarray | None, rows: Rows) -> None:
        t = k.backend
        self.k, self.layout, self.weights, self.masks, self.rows = k, layout, weights, masks, rows
        self.x, self.y = t.Float64(layout.map.x.ravel()), t.Float64(layout.map.y.ravel())
        self.degree = layout.map.x.shape[1:]
        self.curves, self.arriving = t.Float64(weights.curves.ravel()), t.Float64(weights.arriving)
        self.mosaic = None if mosaic is None else t.UInt32(mosaic.astype(np.uint32).ravel())
        self.channels = 1 if mosaic is not None else len(weights.curves)
        self.count = k.opaque(t.UInt32, weights.arriving.size)
        self.columns, self.mirrors_x = k.opaque(t.UInt32, layout.fine[1]), k.opaque(t.UInt32, layout.mirrors[1])
        self.middle_row, self.middle_column = (k.opaque(t.Float64, value) for value in layout.middle)
        self.half_rows, self.half_columns = (k.opaque(t.Float64, n / 2) for n in layout.fine)
        self.side = k.opaque(t.Float64, layout.side_px)

    def frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Return frames (L, C', M, W) in the unit of the weights, and the (L,) photons that its pixels received."""
        height, width = self.layout.frame
        shots = len(self.masks)
        frames, photons = np.zeros((shots, self.channels, height, width)), np.zeros(shots)
        if not self.layout.field.valid.any():
            return frames, photons
        reach = self.layout.reach()
        candidates = tuple(math.floor(2 * r) + 1 for r in reach)
        if candidates[0] * candidates[1] > MAX_CANDIDATES:
            raise InputError(
                "camera", f"{self.layout.side_px:g} px", "a sample's image of at least 0.1 px (fewer samples a mirror, or larger mirrors)"
            )
        step = max(1, SLAB_BYTES // (self.layout.fine[1] * self.weights.arriving.size * 4 * self.layout.samples))
        for first in range(0, height, step):
            last = min(height, first + step)
            start, stop = self.layout.fine_rows(first, last, reach[0])
            cube = self.k.backend.Float32(self.rows(start, stop).ravel())
            for l in range(0, shots, SHOTS_PER_PASS):
                sums = self._slab(cube, (start, stop), (first, last), reach, candidates, slice(l, min(shots, l + SHOTS_PER_PASS)))
                frames[l : l + SHOTS_PER_PASS, :, first:last] = sums[:, :-1].reshape(len(sums), self.channels, last - first, width)
                photons[l : l + SHOTS_PER_PASS] += sums[:, -1].sum(-1)
        return frames, photons

    def _slab(
        self,
        cube: Array,
        fine: tuple[int, int],
        rows: tuple[int, int],
        reach: tuple[float, float],
        candidates: tuple[int, ...],
        shots: slice,
    ) -> np.ndarray:
        """Return (shots, C' + 1, pixels): every curve's sums, then photons."""
        t, dr = self.k.backend, self.k.dr
        width = self.layout.frame[1]
        pixel = dr.arange(t.UInt32, (rows[1] - rows[0]) * width)
        span = self.k.opaque(t.UInt32, width)
        row, column = pixel // span + self.k.opaque(t.UInt32, rows[0]), pixel % span
        bits = self._bits(shots)
        count = shots.stop - shots.start
        curve = None if self.mosaic is None else dr.gather(t.UInt32, self.mosaic, row * span + column) * self.count
        sensor_y, sensor_x = t.Float64(row) - self.middle_row, t.Float64(column) - self.middle_column
        sample = _Samples(self, cube, bits, fine, tuple(self.k.opaque(t.Float64, r) for r in reach), candidates)

        def body(w: Array, *sums: Array) -> tuple[Array, ...]:
            light = sample.light(w, sensor_x, sensor_y, count)
            offsets = [curve] if curve is not None else [t.UInt32(c) * self.count for c in range(self.channels)]
            chi = [dr.gather(t.Float64, self.curves, offset + w) for offset in offsets]
            chi.append(dr.gather(t.Float64, self.arriving, w))
            return (w + 1, *(total + light[i // len(chi)] * chi[i % len(chi)] for i, total in enumerate(sums)))

        start = (t.UInt32(0), *(dr.zeros(t.Float64, pixel.shape[0]) for _ in range(count * (self.channels + 1))))
        result = dr.while_loop(start, lambda w, *sums: w < self.count, body, labels=("w", *(f"s{i}" for i in range(len(start) - 1))))
        dr.eval(result)  # all sums in one kernel; reading them one by one would run it once for each
        scale = 1 / (self.layout.side_px**2 * self.layout.samples**2)
        return np.stack([np.array(s) for s in result[1:]]).reshape(count, self.channels + 1, -1) * scale

    def _bits(self, shots: slice) -> Array:
        bits = np.zeros(self.masks.shape[1:], np.uint32)
        for l, mask in enumerate(self.masks[shots]):
            bits |= mask.astype(np.uint32) << np.uint32(l)
        return self.k.backend.UInt32(bits.ravel())

    def polynomials(self, w: Array) -> tuple[list[list[Array]], list[list[Array]]]:
        """Return the field map's coefficients c[a][b] and d[a][b] of wavelength w."""
        t, dr = self.k.backend, self.k.dr
        a, b = self.degree
        base = w * (a * b)
        c, d = ([[dr.gather(t.Float64, table, base + (i * b + j)) for j in range(b)] for i in range(a)] for table in (self.x, self.y))
        return c, d

    def budget(self) -> list[Budget]:
        """Return one account of photons a shot: spectra summed over open mirrors, and what misses the sensor, sample by sample."""
        edge = self.layout.edge_samples()
        s, (height, columns) = self.layout.samples, self.layout.fine
        step = max(s, SLAB_BYTES // (columns * self.weights.arriving.size * 4) // s * s)
        spectrum, missed = np.zeros((len(self.masks), self.weights.arriving.size)), np.zeros((len(self.masks), 2))
        for first in range(0, height, step):
            last = min(height, first + step)
            cube = self.rows(first, last)
            for r in range((last - first) // s):
                mirrors = cube[r * s : (r + 1) * s].sum(0, dtype=np.float64).reshape(columns // s, s, -1).sum(1)
                spectrum += self.masks[:, first // s + r].astype(np.float64) @ mirrors / s**2
            there = edge[(edge >= first * columns) & (edge < last * columns)]
            if there.size:
                lost = self._missed(cube, there, first) / s**2
                open_ = self.masks[:, there // columns // s, there % columns // s].astype(np.float64)
                missed += open_ @ lost.T
        w = self.weights
        sent, blocked, reflected, outside = (
            spectrum @ v for v in (w.arriving + w.blocked + w.reflected, w.blocked, w.reflected, w.outside)
        )
        rows = np.stack([sent, missed[:, 0], blocked, reflected, outside - missed[:, 1]], axis=1)
        return [Budget(*map(float, row)) for row in rows]

    def _missed(self, cube: np.ndarray, samples: np.ndarray, first: int) -> np.ndarray:
        """Return (2, samples): photons of each sample that fall beside the frame, all and those outside H's bands."""
        t, dr, layout = self.k.backend, self.k.dr, self.layout
        width = layout.fine[1]
        xi = (t.Float64((samples % width).astype(np.float64)) + 0.5) / self.half_columns - 1
        eta = (t.Float64((samples // width).astype(np.float64)) + 0.5) / self.half_rows - 1
        place = t.UInt32((samples - first * width).astype(np.uint32)) * self.count
        light, beyond = t.Float32(cube.ravel()), t.Float64(self.weights.outside)
        high_y, high_x = (self.k.opaque(t.Float64, n - 0.5) for n in layout.frame)
        half = self.side / 2

        def share(position: Array, high: Array) -> Array:
            inside = dr.minimum(position + half, high) - dr.maximum(position - half, -0.5)
            return dr.maximum(inside, 0) / self.side

        def body(w: Array, missed: Array, outside: Array) -> tuple[Array, ...]:
            c, d = self.polynomials(w)
            x, y = _evaluate(c, xi, eta * eta), _evaluate(d, xi, eta * eta) * eta
            lost = t.Float64(dr.gather(t.Float32, light, place + w)) * (
                1 - share(x + self.middle_column, high_x) * share(y + self.middle_row, high_y)
            )
            return w + 1, missed + lost * dr.gather(t.Float64, self.arriving, w), outside + lost * dr.gather(t.Float64, beyond, w)

        start = (t.UInt32(0), dr.zeros(t.Float64, samples.size), dr.zeros(t.Float64, samples.size))
        _, missed, outside = dr.while_loop(start, lambda w, *sums: w < self.count, body, labels=("w", "missed", "outside"))
        dr.eval(missed, outside)
        return np.stack([np.array(missed), np.array(outside)])


class _Samples:
    """Find and add up the samples that touch a pixel, for one wavelength."""

    def __init__(
        self, g: Gather, cube: Array, bits: Array, fine: tuple[int, int], reach: tuple[Array, ...], candidates: tuple[int, ...]
    ) -> None:
        self.g, self.cube, self.bits, self.candidates = g, cube, bits, candidates
        self.reach_rows, self.reach_columns = reach
        self.first, self.last = (g.k.opaque(g.k.backend.Int32, v) for v in fine)

    def light(self, w: Array, sensor_x: Array, sensor_y: Array, shots: int) -> list[Array]:
        """Return for each shot the sum of radiance x overlap in px^2 over the open samples round the pixel."""
        g, t, dr = self.g, self.g.k.backend, self.g.k.dr
        c, d = g.polynomials(w)
        row, column = self._corner(c, d, sensor_x, sensor_y)
        columns, s = t.Int32(g.columns), g.layout.samples
        per_row, per_column = 1 / g.half_rows, 1 / g.half_columns
        total = [t.Float64(0) for _ in range(shots)]
        for p in range(self.candidates[0]):
            v = row + p
            eta = (t.Float64(v) + 0.5) * per_row - 1
            in_rows = (v >= self.first) & (v < self.last)
            cx, cy = ([_even(line, eta * eta) for line in table] for table in (c, d))
            line, mirror_line = t.UInt32(v - self.first) * g.columns, t.UInt32(v) // s * g.mirrors_x
            for q in range(self.candidates[1]):
                u = column + q
                xi = (t.Float64(u) + 0.5) * per_column - 1
                overlap = self._overlap(_polynomial(cx, xi) - sensor_x) * self._overlap(_polynomial(cy, xi) * eta - sensor_y)
                active = in_rows & (u >= 0) & (u < columns) & (overlap > 0)
                open_ = dr.gather(t.UInt32, self.bits, mirror_line + t.UInt32(u) // s, active)
                index = (line + t.UInt32(u)) * g.count + w
                value = t.Float64(dr.gather(t.Float32, self.cube, index, active & (open_ != 0))) * overlap
                total = [sum_ + dr.select((open_ & (1 << l)) != 0, value, 0.0) for l, sum_ in enumerate(total)]
        return total

    def _corner(self, c: list[list[Array]], d: list[list[Array]], x: Array, y: Array) -> tuple[Array, Array]:
        """Return the first (row, column) of the samples that can touch the pixel at (x, y)."""
        g, t, dr = self.g, self.g.k.backend, self.g.k.dr
        xi = dr.clip((x - c[0][0]) / c[1][0], -1.1, 1.1)
        eta = dr.clip(y / d[0][0], -1.1, 1.1)
        xi = xi - (_evaluate(c, xi, eta * eta) - x) / c[1][0]
        eta = eta - (_evaluate(d, xi, eta * eta) * eta - y) / d[0][0]
        row = (dr.clip(eta, -2, 2) + 1) * g.half_rows - 0.5 - self.reach_rows
        column = (dr.clip(xi, -2, 2) + 1) * g.half_columns - 0.5 - self.reach_columns
        return t.Int32(dr.ceil(row)), t.Int32(dr.ceil(column))

    def _overlap(self, distance: Array) -> Array:
        """Return the overlap in px of a pixel and a sample's side that are this far apart."""
        dr, side = self.g.k.dr, self.g.side
        return dr.clip((1 + side) / 2 - dr.abs(distance), 0.0, dr.minimum(side, 1.0))


def _even(line: list[Array], squared: Array) -> Array:
    result = line[-1]
    for value in reversed(line[:-1]):
        result = result * squared + value
    return result


def _polynomial(line: list[Array], x: Array) -> Array:
    return _even(line, x)


def _evaluate(table: list[list[Any]], xi: Array, eta_squared: Array) -> Array:
    return _polynomial([_even(line, eta_squared) for line in table], xi)
