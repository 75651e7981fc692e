"""Count a photograph's photons by samples, independently of the pixels that receive them (theory.md (C.43))."""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.camera.arrays import Array, Kernels
from optsim.camera.field import FieldMap
from optsim.camera.gather import SLAB_BYTES, Rows
from optsim.camera.layout import Account, Layout, Weights
from optsim.camera.row_kernels import line_at, polynomial


class Moments:
    """Hold sums of the open mirrors' light x xi^a over each row of samples, for every wavelength and shot.

    From them follows the light of all wavelengths, and what passes the prism, without any place on the sensor.

    Args:
        states: (L, M, N) float64 of the mirrors.
        samples: s.
        powers: how many powers of xi.
        rows: the fine cube.
        count: n, its wavelengths.
    """

    def __init__(self, states: np.ndarray, samples: int, powers: int, rows: Rows, count: int) -> None:
        shots, mirrors_y, mirrors_x = states.shape
        height, width = mirrors_y * samples, mirrors_x * samples
        xi = (np.arange(width) + 0.5) / (width / 2) - 1
        basis = np.stack([xi**a for a in range(powers)])
        sums = np.zeros((height, shots * powers, count))
        step = max(samples, SLAB_BYTES // (width * count * 4) // samples * samples)
        for first in range(0, height, step):
            cube = rows(first, min(height, first + step), slice(None))
            for v, row in enumerate(cube, first):
                open_ = np.repeat(states[:, v // samples], samples, axis=1)
                np.matmul((open_[:, None] * basis).reshape(-1, width), row.astype(np.float64), out=sums[v])
        self.sums = np.moveaxis(sums.reshape(height, shots, powers, count), 0, 2) / samples**2

    def light(self) -> np.ndarray:
        """Return (L, n): radiance summed over the open mirrors."""
        return np.asarray(self.sums[:, 0].sum(1))

    def passed(self, field: FieldMap) -> np.ndarray:
        """Return (L, n): the same, times what the prism lets through."""
        table, height = field.passed, self.sums.shape[2]
        eta = (np.arange(height) + 0.5) / (height / 2) - 1
        basis = np.stack([eta**p for p in field.powers[2]])
        by_power = np.einsum("pv,lavn->lapn", basis, self.sums[:, : table.shape[1]], optimize=True)
        return np.asarray(np.einsum("nap,lapn->ln", table, by_power) * field.valid)


def account(k: Kernels, layout: Layout, weights: Weights, states: np.ndarray, moments: Moments, rows: Rows) -> Account:
    """Return the account of one photograph: spectra of the open mirrors, and what misses the grid, sample by sample."""
    light, passed = moments.light(), moments.passed(layout.map)
    missed = _missed_light(k, layout, weights, states, rows)
    arriving = light @ weights.arriving
    on_prism = passed @ weights.arriving
    sent = arriving + light @ (weights.blocked + weights.absorbed)
    return Account(
        sent=sent,
        missed=missed[:, 0],
        blocked=light @ weights.blocked,
        absorbed=light @ weights.absorbed,
        reflected=arriving - on_prism,
        outside=passed @ weights.outside - missed[:, 1],
    )


def _missed_light(k: Kernels, layout: Layout, weights: Weights, states: np.ndarray, rows: Rows) -> np.ndarray:
    """Return (L, 2): photons that fall beside the grid, all and those outside H's bands."""
    edge, missed = layout.edge_samples(), np.zeros((len(states), 2))
    s, (height, columns) = layout.samples, layout.fine
    step = max(1, SLAB_BYTES // (columns * weights.arriving.size * 4))
    for first in range(0, height, step):
        last = min(height, first + step)
        there = edge[(edge >= first * columns) & (edge < last * columns)]
        if there.size:
            lost = _missed(k, layout, weights, rows(first, last, slice(None)), there, first) / s**2
            missed += states[:, there // columns // s, there % columns // s] @ lost.T
    return missed


def _missed(k: Kernels, layout: Layout, weights: Weights, cube: np.ndarray, samples: np.ndarray, first: int) -> np.ndarray:
    """Return (2, samples): photons of each sample that fall beside the grid, all and those outside H's bands."""
    t, dr, f, width = k.backend, k.dr, layout.map, layout.fine[1]
    half_rows, half_columns = (k.opaque(t.Float64, n / 2) for n in layout.fine)
    xi = (t.Float64((samples % width).astype(np.float64)) + 0.5) / half_columns - 1
    eta = (t.Float64((samples // width).astype(np.float64)) + 0.5) / half_rows - 1
    count = k.opaque(t.UInt32, weights.arriving.size)
    place = t.UInt32((samples - first * width).astype(np.uint32)) * count
    light = t.Float32(np.ascontiguousarray(cube, np.float32).ravel())
    tables = [(t.Float64(c.ravel()), c.shape[1:], p) for c, p in zip((f.x, f.y, f.passed), f.powers)]
    rates = [t.Float64(np.where(f.valid, v, 0.0)) for v in (weights.arriving, weights.outside)]
    sides = [t.Float64(np.ascontiguousarray(layout.sides[:, i])) for i in (0, 1)]
    top, bottom, left, right = (k.opaque(t.Float64, v) for v in layout.grid.borders())
    middle_row, middle_column = (k.opaque(t.Float64, v) for v in layout.middle)

    def value(table: Any, w: Array) -> Array:
        source, (a, b), powers = table
        numbers = [[dr.gather(t.Float64, source, w * (a * b) + (i * b + j)) for j in range(b)] for i in range(a)]
        return polynomial(line_at(numbers, powers, eta, dr), xi, dr)

    def share(position: Array, side: Array, low: Array, high: Array) -> Array:
        inside = dr.minimum(position + side / 2, high) - dr.maximum(position - side / 2, low)
        return dr.maximum(inside, 0) / side

    def body(w: Array, missed: Array, outside: Array) -> tuple[Array, ...]:
        x, y, passed = (value(table, w) for table in tables)
        wide, high = (dr.gather(t.Float64, side, w) for side in sides)
        on = share(x + middle_column, wide, left, right) * share(y + middle_row, high, top, bottom)
        lost = t.Float64(dr.gather(t.Float32, light, place + w)) * (1 - on) * passed
        return w + 1, *(total + lost * dr.gather(t.Float64, rate, w) for total, rate in zip((missed, outside), rates))

    start = (t.UInt32(0), dr.zeros(t.Float64, samples.size), dr.zeros(t.Float64, samples.size))
    _, missed, outside = dr.while_loop(start, lambda w, *sums: w < count, body, labels=("w", "missed", "outside"))
    dr.eval(missed, outside)
    return np.stack([np.array(missed), np.array(outside)])


def powers_of_xi(fields: list[FieldMap]) -> int:
    """Return how many powers of xi the transmissions need."""
    return max(f.passed.shape[1] for f in fields)
