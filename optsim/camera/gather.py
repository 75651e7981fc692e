"""Lay fine samples on the sensor by area, as a gather: every cell adds up the samples that touch it (theory.md (C.17), (C.40)).

One Dr.Jit kernel a slab of rows: a thread a strip of cells one pixel wide, the loops over wavelengths and rows of
samples inside. No two threads write to one place, so that the result has the same bits every time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from optsim.camera.arrays import Array, Kernels
from optsim.camera.layout import Layout
from optsim.errors import InputError

SLAB_BYTES = 2**27
MAX_CANDIDATES = 400
MAX_SPREAD = 1.5
"""Neighbouring wavelengths are handled together while their places lie within this many samples."""
_WIDE = 4

Rows = Callable[[int, int, slice], np.ndarray]
"""``rows(start, stop, wavelengths)`` gives fine rows of the cube, (stop - start, N s, n) float32."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Say how a layout is laid, the same for all parts of its wavelengths, so that one kernel serves them.

    Args:
        k: Dr.Jit and its types.
        reach: how far a sample that touches a strip can be from its estimated place, in samples along (rows, columns).
        block: wavelengths handled together.
        before: how far before the first wavelength's place a block's others lie, in samples along (rows, columns).
        window: (rows, columns) of samples that are looked at.
    """

    k: Kernels
    reach: tuple[float, float]
    block: int
    before: tuple[float, float]
    window: tuple[int, int]

    @classmethod
    def of(cls, k: Kernels, layout: Layout) -> Plan:
        """Find the window.

        Raises:
            InputError: field ``camera`` when a sample's image is too small for a kernel of bounded size.
        """
        reach = layout.reach()
        block = next(b for b in (4, 2, 1) if b == 1 or np.ptp(layout.spread(b), axis=0).max() <= MAX_SPREAD)
        before, behind = layout.spread(block)
        rows, columns = (math.floor(2 * r + float(s)) + 1 for r, s in zip(reach, behind - before))
        if rows * columns > MAX_CANDIDATES:
            side = float(layout.sides.min())
            raise InputError("camera", f"{side:g} px", "a sample's image of at least 0.1 px (fewer samples a mirror, or larger mirrors)")
        return cls(k, reach, block, (float(before[0]), float(before[1])), (rows, columns))


class Gather:
    """Lay light with Dr.Jit.

    Args:
        plan: how.
        layout: geometry, of the wavelengths that are laid.
        weights: (P, n) of each plane that is summed.
        states: (L, M, N) float64, what each mirror sends on, from 0 to 1.
        rows: the fine cube.
        wavelengths: which of the cube's wavelengths are laid.
    """

    def __init__(self, plan: Plan, layout: Layout, weights: np.ndarray, states: np.ndarray, rows: Rows, wavelengths: slice) -> None:
        k = self.k = plan.k
        self.layout, self.states, self.rows, self.wavelengths = layout, states, rows, wavelengths
        self.planes, self.plan, self.block, self.window = len(weights), plan, plan.block, plan.window
        self.table = _Table(layout, weights, self.block)
        t = k.backend
        self.values, self.back = t.Float64(self.table.values.ravel()), t.Float64(self.table.back.ravel())
        self.columns, self.mirrors_x = k.opaque(t.UInt32, layout.fine[1]), k.opaque(t.UInt32, layout.mirrors[1])
        self.half_rows, self.half_columns = (k.opaque(t.Float64, n / 2) for n in layout.fine)

    def sums(self) -> np.ndarray:
        """Return (L, P, rows, columns) of cells."""
        grid, shots = self.layout.grid, len(self.states)
        (height, width), sub = grid.pixels, grid.sub
        sums = np.zeros((shots, self.planes, height, sub, width, sub))
        per_row = self.layout.fine[1] * self.table.blocks * self.block * 4 * self.layout.samples
        step, together = max(1, SLAB_BYTES // per_row), self._shots_together()
        for first in range(0, height, step):
            last = min(height, first + step)
            start, stop = self._fine_rows(first, last)
            cube = self.k.backend.Float32(self._padded(self.rows(start, stop, self.wavelengths)).ravel())
            for l in range(0, shots, together):
                chosen = slice(l, min(shots, l + together))
                self._slab(cube, (start, stop), (first, last), chosen, sums[chosen, :, first:last])
        return sums.reshape(shots, self.planes, *grid.cells)

    def _fine_rows(self, first: int, last: int) -> tuple[int, int]:
        sub = self.layout.grid.sub
        return self.layout.fine_rows(first * sub, last * sub, self.plan.reach[0] - self.plan.before[0] + self.window[0])

    def _shots_together(self) -> int:
        """Return how many shots fit into one pass without too many sums a thread."""
        each = self.layout.grid.sub * (self.layout.grid.sub * self.planes + self.block)
        return 2 ** int(np.clip(math.log2(200 / each), 0, 4))

    def _padded(self, cube: np.ndarray) -> np.ndarray:
        missing = self.table.blocks * self.block - cube.shape[-1]
        return np.ascontiguousarray(cube if missing == 0 else np.pad(cube, ((0, 0), (0, 0), (0, missing))), np.float32)

    def _slab(self, cube: Array, fine: tuple[int, int], rows: tuple[int, int], shots: slice, sums: np.ndarray) -> None:
        """Write (shots, planes, pixel rows, sub, pixels, sub)."""
        t, dr, grid = self.k.backend, self.k.dr, self.layout.grid
        width, sub, count = grid.pixels[1], grid.sub, shots.stop - shots.start
        pixel = dr.arange(t.UInt32, (rows[1] - rows[0]) * width)
        span = self.k.opaque(t.UInt32, width)
        middle_row, middle_column = self.layout.middle
        top, left = (self.k.opaque(t.Float64, v) for v in (grid.first[0] + rows[0] - middle_row, grid.first[1] - middle_column))
        place = t.Float64(pixel % span) + left, t.Float64(pixel // span) + top
        touching = _Touching(self, cube, fine, shots, place)
        cells = sub * sub

        def body(b: Array, *totals: Array) -> tuple[Array, ...]:
            light, weights = touching.light(b)
            added = list(totals)
            for i in range(self.block):
                for l, p, q in np.ndindex(count, self.planes, cells):
                    index = (l * self.planes + p) * cells + q
                    added[index] = dr.fma(light[(i * cells + q) * count + l], weights[i][p], added[index])
            return (b + 1, *added)

        start = (t.UInt32(0), *(dr.zeros(t.Float64, pixel.shape[0]) for _ in range(count * self.planes * cells)))
        last = self.k.opaque(t.UInt32, self.table.blocks)
        labels = ("b", *(f"s{i}" for i in range(len(start) - 1)))
        result = dr.while_loop(start, lambda b, *totals: b < last, body, labels=labels)
        dr.eval(result)  # all sums in one kernel; reading them one by one would run it once for each
        for index, total in enumerate(result[1:]):
            shot, plane, row, column = np.unravel_index(index, (count, self.planes, sub, sub))
            sums[shot, plane, :, row, :, column] = np.array(total).reshape(rows[1] - rows[0], width)


class _Table:
    """Arrange what a kernel reads for one wavelength: polynomials, the way back, sides, weights; in packets of four numbers."""

    def __init__(self, layout: Layout, weights: np.ndarray, block: int) -> None:
        f, n = layout.map, weights.shape[1]
        self.x_shape, self.y_shape, self.t_shape = f.x.shape[1:], f.y.shape[1:], f.passed.shape[1:]
        self.varies = f.passed[0].size > 1
        norm = f.valid / (layout.sides.prod(1) * layout.samples**2)
        constant = norm if self.varies else norm * f.passed[:, 0, 0]
        zero = np.zeros((1,))
        middle = np.stack([p[:, 0] for p in f.at(zero, zero)], axis=1)
        back = np.linalg.inv(f.jacobian()).reshape(n, 4)
        parts = [f.x.reshape(n, -1), f.y.reshape(n, -1), f.passed.reshape(n, -1)[:, : f.passed[0].size * self.varies]]
        parts += [layout.sides, (weights * constant).T]
        self.starts = np.cumsum([0, *(p.shape[1] for p in parts)])
        table = np.concatenate(parts, axis=1)
        self.packets = -(-table.shape[1] // _WIDE)
        self.blocks = -(-n // block)
        # the last block repeats the last wavelength with weight 0
        self.values = np.zeros((self.blocks * block, self.packets * _WIDE))
        self.values[:n, : table.shape[1]] = table
        self.values[n:, : self.starts[4]] = table[-1, : self.starts[4]]
        self.back = np.zeros((self.blocks, 2 * _WIDE))
        self.back[:, :6] = np.concatenate([middle, back], axis=1)[::block]

    def read(self, k: Kernels, values: Array, w: Array) -> list[list[Array]]:
        """Return the parts of wavelength w."""
        numbers = _read(k, values, w, self.packets)
        return [numbers[a:b] for a, b in zip(self.starts, self.starts[1:])]


def _read(k: Kernels, values: Array, index: Array, packets: int) -> list[Array]:
    """Return the numbers of one line of a table."""
    numbers: list[Array] = []
    for i in range(packets):
        packet = k.dr.gather(k.backend.Array4f64, values, index * packets + i)
        numbers += [packet[j] for j in range(_WIDE)]
    return numbers


class _Touching:
    """Find and add up the samples that touch a pixel, strip by strip of its cells, for one block of wavelengths."""

    def __init__(self, g: Gather, cube: Array, fine: tuple[int, int], shots: slice, place: tuple[Array, Array]) -> None:
        t, k = g.k.backend, g.k
        self.g, self.cube, (self.x, self.y) = g, cube, place
        self.count = shots.stop - shots.start
        self.first, self.last = (k.opaque(t.Int32, v) for v in fine)
        self.early_rows, self.early_columns = (k.opaque(t.Float64, b - r) for b, r in zip(g.plan.before, g.plan.reach))
        wide = min(self.count, 2) if self.count < 3 else _WIDE
        self.state_packets = -(-self.count // wide)
        states = np.zeros((*g.states.shape[1:], self.state_packets * wide))
        states[..., : self.count] = np.moveaxis(g.states[shots], 0, -1)
        self.states, self.state_type = t.Float64(states.ravel()), _packet(k, "Float64", "f64", wide)
        self.light_type = _packet(k, "Float32", "f", g.block)
        self.powers = g.layout.map.powers

    def light(self, b: Array) -> tuple[list[Array], list[list[Array]]]:
        """Return sums of radiance x overlap for (wavelength of the block, cell of the pixel, shot), and the weights of each wavelength."""
        g, t, dr = self.g, self.g.k.backend, self.g.k.dr
        sub = g.layout.grid.sub
        parts = [g.table.read(g.k, g.values, b * g.block + i) for i in range(g.block)]
        shapes = (g.table.x_shape, g.table.y_shape, g.table.t_shape)
        tables = [tuple(_square(p[i], s) for i, s in enumerate(shapes) if p[i]) for p in parts]
        back = _read(g.k, g.back, b, 2)
        middle_row, middle_column = self._place(tables[0], back)
        light: list[Array] = [None] * (g.block * sub * sub * self.count)
        rows, labels = t.Int32(g.window[0]), ("p", *(f"l{i}" for i in range(g.block * sub * self.count)))
        for strip in range(sub):
            down = (strip + 0.5) / sub - 0.5
            row = t.Int32(dr.ceil(middle_row + back[5] * down * g.half_rows + self.early_rows))
            column = t.Int32(dr.ceil(middle_column + back[3] * down * g.half_columns + self.early_columns))

            def body(p: Array, *sums: Array, row: Array = row, column: Array = column, down: float = down) -> tuple[Array, ...]:
                return (p + 1, *self._row(row + p, column, b, tables, [q[3] for q in parts], self.y + down, list(sums)))

            start = (t.Int32(0), *(dr.zeros(t.Float64, dr.width(self.x)) for _ in labels[1:]))
            result = dr.while_loop(start, lambda p, *sums: p < rows, body, labels=labels)
            for i, c, l in np.ndindex(g.block, sub, self.count):
                light[((i * sub + strip) * sub + c) * self.count + l] = result[1 + (i * sub + c) * self.count + l]
        return light, [q[4] for q in parts]

    def _row(self, v: Array, column: Array, b: Array, tables: list[Any], sides: list[Any], y: Array, light: list[Array]) -> list[Array]:
        """Add one row of samples to the strip at y."""
        g, t, dr = self.g, self.g.k.backend, self.g.k.dr
        s, sub = g.layout.samples, g.layout.grid.sub
        eta = (t.Float64(v) + 0.5) / g.half_rows - 1
        in_rows = (v >= self.first) & (v < self.last)
        lines = [tuple(line_at(table, powers, eta, dr) for table, powers in zip(parts, self.powers)) for parts in tables]
        start, mirrors = t.UInt32(v - self.first) * g.columns, t.UInt32(v) // s * g.mirrors_x
        for q in range(g.window[1]):
            u = column + q
            xi = (t.Float64(u) + 0.5) / g.half_columns - 1
            active = in_rows & (u >= 0) & (u < t.Int32(g.columns))
            states = self._states(mirrors + t.UInt32(u) // s, active)
            values = _numbers(dr.gather(self.light_type, self.cube, (start + t.UInt32(u)) * g.table.blocks + b, active), g.block)
            for i, (line, (wide, high)) in enumerate(zip(lines, sides)):
                along, across = polynomial(line[0], xi, dr) - self.x, polynomial(line[1], xi, dr) - y
                value = t.Float64(values[i]) * _overlap(dr, dr.abs(across), high, 1 / sub)
                if g.table.varies:
                    value *= polynomial(line[2], xi, dr)
                for c in range(sub):
                    share = value * _overlap(dr, dr.abs(along - ((c + 0.5) / sub - 0.5)), wide, 1 / sub)
                    for l in range(self.count):
                        index = (i * sub + c) * self.count + l
                        light[index] = dr.fma(share, states[l], light[index])
        return light

    def _states(self, mirror: Array, active: Array) -> list[Array]:
        """Return each shot's state of a mirror."""
        dr, packets, wide = self.g.k.dr, self.state_packets, min(self.count, 2) if self.count < 3 else _WIDE
        numbers: list[Array] = []
        for i in range(packets):
            numbers += _numbers(dr.gather(self.state_type, self.states, mirror * packets + i, active), wide)
        return numbers[: self.count]

    def _place(self, table: Any, back: list[Array]) -> tuple[Array, Array]:
        """Return the (row, column) of samples, not rounded, that lands in the middle of the pixel: a linear guess and one correction."""
        g, dr = self.g, self.g.k.dr
        dx, dy = self.x - back[0], self.y - back[1]
        xi = dr.clip(back[2] * dx + back[3] * dy, -1.1, 1.1)
        eta = dr.clip(back[4] * dx + back[5] * dy, -1.1, 1.1)
        dx, dy = (polynomial(line_at(table[i], self.powers[i], eta, dr), xi, dr) - p for i, p in ((0, self.x), (1, self.y)))
        xi, eta = xi - back[2] * dx - back[3] * dy, eta - back[4] * dx - back[5] * dy
        return (dr.clip(eta, -2, 2) + 1) * g.half_rows - 0.5, (dr.clip(xi, -2, 2) + 1) * g.half_columns - 0.5


def _packet(k: Kernels, single: str, letter: str, wide: int) -> Any:
    """Return the type that reads ``wide`` neighbouring numbers at once."""
    if wide == 1:
        return getattr(k.backend, single)
    return getattr(k.backend, f"Array{wide}{letter}")


def _numbers(packet: Array, wide: int) -> list[Array]:
    return [packet] if wide == 1 else [packet[i] for i in range(wide)]


def _overlap(dr: Any, distance: Array, side: Array, cell: float) -> Array:
    """Return the overlap in px of a cell and a sample's side whose middles are this far apart."""
    return dr.clip((cell + side) * 0.5 - distance, 0.0, dr.minimum(side, cell))


def _square(numbers: list[Array], shape: tuple[int, ...]) -> list[list[Array]]:
    return [numbers[i * shape[1] : (i + 1) * shape[1]] for i in range(shape[0])]


def line_at(table: list[list[Array]], powers: tuple[int, ...], eta: Array, dr: Any) -> list[Array]:
    """Return the coefficients in xi of a table [a][i] on the line eta, ``powers`` being those of eta."""
    step = powers[1] - powers[0] if len(powers) > 1 else 1
    base = eta * eta if step == 2 else eta
    line = [polynomial(row, base, dr) for row in table]
    return [value * eta for value in line] if powers[0] == 1 else line


def polynomial(line: list[Array], x: Array, dr: Any) -> Array:
    """Return the sum of line[a] x^a."""
    result = line[-1]
    for value in reversed(line[:-1]):
        result = dr.fma(result, x, value)
    return result
