"""The two Dr.Jit kernels of the gather: lay each row of samples, then add rows up (theory.md (C.40))."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.aligned import aligned
from optsim.camera.arrays import Array, Kernels

if TYPE_CHECKING:
    from optsim.camera.gather import Gather

_WIDE = 4


class Slab:
    """Run both kernels for some rows of samples and some shots."""

    def __init__(self, g: Gather, fine: tuple[int, int], shots: slice) -> None:
        k, t, layout = g.plan.k, g.plan.k.backend, g.layout
        self.g, self.k, self.t, self.shots = g, k, t, shots.stop - shots.start
        self.threads = (fine[1] - fine[0]) * g.strips
        self.strips, self.columns, self.mirrors = (k.opaque(t.UInt32, v) for v in (g.strips, layout.fine[1], layout.mirrors[1]))
        self.count, self.samples_rows = k.opaque(t.UInt32, self.threads), k.opaque(t.UInt32, fine[1] - fine[0])
        self.first, self.half_columns = k.opaque(t.UInt32, fine[0]), k.opaque(t.Float64, layout.fine[1] / 2)
        self.left = k.opaque(t.Float64, layout.grid.first[1] - 0.5 - layout.middle[1])
        self.top = k.opaque(t.Float64, layout.grid.first[0] - 0.5 - layout.middle[0])
        self.blocks = k.opaque(t.UInt32, g.table.blocks)
        self.state_wide = min(self.shots, 2) if self.shots < 3 else _WIDE
        self.state_packets = -(-self.shots // self.state_wide)
        states = np.zeros((*g.states.shape[1:], self.state_packets * self.state_wide))
        states[..., : self.shots] = np.moveaxis(g.states[shots], 0, -1)
        self.states = t.Float64(aligned(states))

    def laid(self, cube: np.ndarray, lines: np.ndarray) -> tuple[Array, Array]:
        """Return what each row of samples lays on its rows of cells, and the first of these rows."""
        g, t, dr = self.g, self.t, self.k.dr
        thread = dr.arange(t.UInt32, self.threads)
        v, strip = thread // self.strips, thread % self.strips
        row = _Row(self, t.Float32(cube), t.Float64(lines), v, strip)

        def body(b: Array, *totals: Array) -> tuple[Array, ...]:
            return (b + 1, *row.block(b, list(totals)))

        size = g.high * self.shots * g.planes * g.cells
        start = (t.UInt32(0), *(dr.zeros(t.Float64, self.threads) for _ in range(size)))
        labels = ("b", *(f"s{i}" for i in range(size)))
        totals = dr.while_loop(start, lambda b, *_: b < self.blocks, body, labels=labels)[1:]
        held = dr.empty(t.Float64, size * self.threads)
        for i, total in enumerate(totals):
            dr.scatter(held, total, thread + self.count * i, mode=dr.ReduceMode.Permute)
        dr.eval(held, row.start)
        return held, row.start

    def added(self, laid: tuple[Array, Array], first: int, last: int) -> np.ndarray:
        """Return (shots, planes, last - first, strips x cells): every cell's rows of samples added up."""
        g, t, dr, (held, starts) = self.g, self.t, self.k.dr, laid
        size, high = self.shots * g.planes * g.cells, t.Int32(g.high)
        thread = dr.arange(t.UInt32, (last - first) * g.strips)
        strip = thread % self.strips
        cell = t.Int32(thread // self.strips) + self.k.opaque(t.Int32, first)

        def halve(low: Array, top: Array) -> tuple[Array, Array]:
            middle = (low + top) // 2
            behind = dr.gather(t.Int32, starts, middle * self.strips + strip) + high <= cell
            return dr.select(behind, middle + 1, low), dr.select(behind, top, middle)

        low, top = dr.zeros(t.UInt32, thread.shape[0]), dr.zeros(t.UInt32, thread.shape[0]) + self.samples_rows
        low, _ = dr.while_loop((low, top), lambda low, top: low < top, halve, labels=("low", "top"))

        def touches(v: Array, *_: Array) -> Array:
            inside = v < self.samples_rows
            return inside & (dr.gather(t.Int32, starts, v * self.strips + strip, inside) <= cell)

        def body(v: Array, *totals: Array) -> tuple[Array, ...]:
            at = v * self.strips + strip
            place = t.UInt32(cell - dr.gather(t.Int32, starts, at)) * size
            return (v + 1, *(total + dr.gather(t.Float64, held, (place + i) * self.count + at) for i, total in enumerate(totals)))

        start = (low, *(dr.zeros(t.Float64, thread.shape[0]) for _ in range(size)))
        totals = dr.while_loop(start, touches, body, labels=("v", *(f"s{i}" for i in range(size))))[1:]
        out, wide = dr.empty(t.Float64, size * thread.shape[0]), self.k.opaque(t.UInt32, thread.shape[0])
        for i, total in enumerate(totals):
            dr.scatter(out, total, (wide * (i // g.cells) + thread) * g.cells + i % g.cells, mode=dr.ReduceMode.Permute)
        return np.array(out).reshape(self.shots, g.planes, last - first, g.strips * g.cells)


class _Row:
    """Follow a row of samples over the cells of a thread, for one block of wavelengths after the other."""

    def __init__(self, slab: Slab, cube: Array, lines: Array, v: Array, strip: Array) -> None:
        g, t, dr = slab.g, slab.t, slab.k.dr
        self.slab, self.cube, self.line_table, self.v = slab, cube, lines, v
        self.fixed_table = t.Float64(aligned(g.table.fixed))
        self.light_type = packet_type(slab.k, "Float32", "f", g.plan.block)
        self.state_type = packet_type(slab.k, "Float64", "f64", slab.state_wide)
        self.side = 1 / g.layout.grid.sub
        self.left = t.Float64(strip * g.plan.pixels) + slab.left
        self.early = slab.k.opaque(t.Float64, g.plan.early)
        self.mirror_row = (v + slab.first) // g.layout.samples * slab.mirrors
        middle = slab.k.opaque(t.UInt32, g.table.middle)
        (x, y, _), (wide, high, *_) = self._line(middle), self._fixed(middle)
        nominal = polynomial(y, dr.clip(self._place(x, wide), -1.1, 1.1), dr) / high
        low = slab.k.opaque(t.Float64, g.low)
        self.start = t.Int32(dr.floor((nominal + low - slab.top) * g.layout.grid.sub))
        self.upper = slab.top + (t.Float64(self.start) + 1) * self.side

    def block(self, b: Array, totals: list[Array]) -> list[Array]:
        """Add a block of wavelengths to the sums (rows of cells, shots, planes, cells)."""
        slab, g, t, dr = self.slab, self.slab.g, self.slab.t, self.slab.k.dr
        size, cells, rows = g.plan.block, g.cells, g.high
        lines, fixed = [self._line(b * size + i) for i in range(size)], [self._fixed(b * size + i) for i in range(size)]
        place = (dr.clip(self._place(lines[0][0], fixed[0][0]), -2, 2) + 1) * slab.half_columns - 0.5
        first = t.Int32(dr.ceil(place + self.early))
        across = [[dr.fma(self.left + c * self.side, q[0], 0.5) for c in range(cells + 1)] for q in fixed]
        down = [[dr.fma(self.upper + r * self.side, q[1], 0.5) for r in range(rows - 1)] for q in fixed]
        samples = [self._sample(first + q, b) for q in range(g.plan.window)]
        # sums are finished one after the other, so that few numbers are held at a time
        light = [self._light(samples, lines[i], across[i], down[i], i) for i in range(size)]
        for r, l, p, c in np.ndindex(rows, slab.shots, g.planes, cells):
            index = ((r * slab.shots + l) * g.planes + p) * cells + c
            for i in range(size):
                totals[index] = dr.fma(light[i][(r * slab.shots + l) * cells + c], fixed[i][2 + p], totals[index])
        return totals

    def _sample(self, u: Array, b: Array) -> tuple[Array, list[Array], list[Array]]:
        """Return xi, radiances of the block and each shot's state of the sample in column u; nothing beside the field."""
        slab, g, t, dr = self.slab, self.slab.g, self.slab.t, self.slab.k.dr
        active = (u >= 0) & (u < t.Int32(slab.columns))
        place = t.UInt32(u)
        packet = dr.gather(self.light_type, self.cube, (self.v * slab.columns + place) * slab.blocks + b, active)
        states = self._states(self.mirror_row + place // g.layout.samples, active)
        return (t.Float64(u) + 0.5) / slab.half_columns - 1, numbers_of(packet, g.plan.block), states

    def _light(self, samples: list[Any], line: list[list[Array]], across: list[Array], down: list[Array], i: int) -> list[Array]:
        """Return light of one wavelength on (rows of cells, shots, cells)."""
        slab, t, dr = self.slab, self.slab.t, self.slab.k.dr
        cells, rows = self.slab.g.cells, self.slab.g.high
        light: list[Array] = [t.Float64(0)] * (rows * slab.shots * cells)
        for xi, values, states in samples:
            value = t.Float64(values[i])
            if line[2]:
                value *= polynomial(line[2], xi, dr)
            parts_y = _parts(down, polynomial(line[1], xi, dr), dr, True)
            parts_x = _parts(across, polynomial(line[0], xi, dr), dr, False)
            for l, c in np.ndindex(slab.shots, cells):
                share = value * states[l] * parts_x[c]
                for r in range(rows):
                    index = (r * slab.shots + l) * cells + c
                    light[index] = dr.fma(share, parts_y[r], light[index])
        return light

    def _line(self, w: Array) -> list[list[Array]]:
        """Return the coefficients of x, y and the transmission along the row."""
        slab, table = self.slab, self.slab.g.table
        numbers = self._read(self.line_table, self.v * slab.blocks * slab.g.plan.block + w, table.line_packets)
        starts = np.cumsum([0, *table.lengths])
        return [numbers[a:b] for a, b in pairwise(starts)]

    def _fixed(self, w: Array) -> list[Array]:
        return self._read(self.fixed_table, w, self.slab.g.table.packets)

    def _read(self, values: Array, index: Array, packets: int) -> list[Array]:
        k, numbers = self.slab.k, []
        for i in range(packets):
            packet = k.dr.gather(k.backend.Array4f64, values, index * packets + i)
            numbers += [packet[j] for j in range(_WIDE)]
        return numbers

    def _place(self, line: list[Array], wide: Array) -> Array:
        """Return the xi that lands in the middle of the thread's cells: a linear guess and one correction."""
        dr, g = self.slab.k.dr, self.slab.g
        target, slope = (self.left + g.plan.pixels / 2) * wide, 1 / line[1]
        guess = dr.clip((target - line[0]) * slope, -1.1, 1.1)
        return guess - (polynomial(line, guess, dr) - target) * slope

    def _states(self, mirror: Array, active: Array) -> list[Array]:
        """Return each shot's state of a mirror."""
        slab, numbers = self.slab, []
        for i in range(slab.state_packets):
            numbers += numbers_of(slab.k.dr.gather(self.state_type, slab.states, mirror * slab.state_packets + i, active), slab.state_wide)
        return numbers[: slab.shots]


def _parts(edges: list[Array], place: Array, dr: Any, whole: bool) -> list[Array]:
    """Return the shares of a sample between neighbouring edges; ``whole``: also before the first and after the last."""
    below = [dr.clip(edge - place, 0.0, 1.0) for edge in edges]
    between = [b - a for a, b in pairwise(below)]
    return [below[0], *between, 1 - below[-1]] if whole else between


def packet_type(k: Kernels, single: str, letter: str, wide: int) -> Any:
    """Return the type that reads ``wide`` neighbouring numbers at once."""
    if wide == 1:
        return getattr(k.backend, single)
    return getattr(k.backend, f"Array{wide}{letter}")


def numbers_of(packet: Array, wide: int) -> list[Array]:
    """Return the single numbers of a packet."""
    return [packet] if wide == 1 else [packet[i] for i in range(wide)]


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
