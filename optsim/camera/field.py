"""Positions over the whole field of mirrors: the exact path, held by a polynomial a wavelength (theory.md (C.16), (C.37))."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

TOLERANCE_PX = 1e-7
TOLERANCE_TRANSMISSION = 1e-7
_DEGREES = ((1, 0), (2, 1), (3, 1), (4, 2), (6, 3), (8, 4), (12, 6))
_CHECK = (np.linspace(-1, 1, 9), np.array([-1.0, -0.55, -0.2, 0.0, 0.3, 0.8, 1.0]))


class Light(Protocol):
    """Say where the light of field points lands and how much of it; ``Optics`` and every dispersion can."""

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors."""

    def position_px(
        self, wavelength_nm: np.ndarray, X_mm: np.ndarray, Y_mm: np.ndarray, /
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Return (x, y, valid) in px."""

    def transmission(self, wavelength_nm: np.ndarray, X_mm: np.ndarray, Y_mm: np.ndarray, /) -> np.ndarray:
        """Return the share of light that passes, in [0, 1]."""


@dataclass(frozen=True, eq=False)
class FieldMap:
    """Hold x = sum c[a,i] xi^a eta^p[i], y and the transmission likewise, for every wavelength; x, y in px from the frame's middle.

    xi and eta run from -1 to 1 between the outer borders of the mirrors.

    Args:
        x, y, passed: (n, A + 1, count) coefficients; ``passed`` of the transmission.
        powers: of eta in x, y and the transmission. Where the optics are mirror-symmetric: the even ones, the
            odd ones, the even ones; else all of them up to the highest.
        valid: (n,) False where the prism loses the wavelength everywhere in the field.
        error_px: largest distance from the exact path on a check grid.
    """

    x: np.ndarray
    y: np.ndarray
    passed: np.ndarray
    powers: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
    valid: np.ndarray
    error_px: float

    def at(self, xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (n, ...) of field points broadcast to one shape (...)."""
        return _evaluate(self.x, self.powers[0], xi, eta), _evaluate(self.y, self.powers[1], xi, eta)

    def passes(self, xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
        """Return (n, ...) shares of light that get through the prism; 0 for a wavelength that it loses."""
        passed = _evaluate(self.passed, self.powers[2], xi, eta)
        return passed * self.valid.reshape(-1, *(1,) * (passed.ndim - 1))

    def part(self, wavelengths: slice | np.ndarray) -> FieldMap:
        """Return the same for some of the wavelengths."""
        tables = (self.x[wavelengths], self.y[wavelengths], self.passed[wavelengths])
        return FieldMap(*tables, self.powers, self.valid[wavelengths], self.error_px)

    def jacobian(self) -> np.ndarray:
        """Return (n, 2, 2) derivatives of (x, y) by (xi, eta) at the middle of the field."""
        columns = []
        for table, powers in ((self.x, self.powers[0]), (self.y, self.powers[1])):
            by_xi = table[:, 1, powers.index(0)] if 0 in powers else np.zeros(len(table))
            by_eta = table[:, 0, powers.index(1)] if 1 in powers else np.zeros(len(table))
            columns.append(np.stack([by_xi, by_eta], axis=-1))
        return np.stack(columns, axis=1)

    def inverse(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Estimate (xi, eta) that land at (n, ...) positions: a linear guess and one correction, as the kernel does."""
        back = np.linalg.inv(self.jacobian()).reshape(len(self.x), 2, 2, *(1,) * (x.ndim - 1))
        zero = np.zeros((1,) * (x.ndim - 1))
        middle = self.at(zero, zero)
        xi, eta = (np.clip(back[:, i, 0] * (x - middle[0]) + back[:, i, 1] * (y - middle[1]), -1.1, 1.1) for i in (0, 1))
        found_x, found_y = (_evaluate_each(c, powers, xi, eta) for c, powers in ((self.x, self.powers[0]), (self.y, self.powers[1])))
        found_x, found_y = found_x - x, found_y - y
        return xi - back[:, 0, 0] * found_x - back[:, 0, 1] * found_y, eta - back[:, 1, 0] * found_x - back[:, 1, 1] * found_y


@dataclass(frozen=True, eq=False)
class TracedField:
    """Answer as a FieldMap by following every point: exact and slow.

    Args:
        light: what is followed.
        wavelength_nm: (n,).
        half_x_mm, half_y_mm: half sides of the field.
        valid: (n,) False where the prism loses the wavelength everywhere in the field.
    """

    light: Light
    wavelength_nm: np.ndarray
    half_x_mm: float
    half_y_mm: float
    valid: np.ndarray
    error_px: float = 0.0

    def at(self, xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (n, ...) of field points broadcast to one shape (...)."""
        x, y, _ = self.light.position_px(*self._points(xi, eta))
        return x, y

    def passes(self, xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
        """Return (n, ...) shares of light that get through the prism."""
        points = self._points(xi, eta)
        return np.where(self.light.position_px(*points)[2], self.light.transmission(*points), 0.0)

    def part(self, wavelengths: slice | np.ndarray) -> TracedField:
        """Return the same for some of the wavelengths."""
        return replace(self, wavelength_nm=self.wavelength_nm[wavelengths], valid=self.valid[wavelengths])

    def jacobian(self) -> np.ndarray:
        """Return (n, 2, 2) derivatives of (x, y) by (xi, eta) at the middle of the field, by differences; nominal where that is lost."""
        step = 1e-3
        points = self._points(step * np.array([1.0, -1.0, 0.0, 0.0]), step * np.array([0.0, 0.0, 1.0, -1.0]))
        x, y, valid = self.light.position_px(*points)
        place = np.stack([x, y], axis=1)
        found = np.stack([place[..., 0] - place[..., 1], place[..., 2] - place[..., 3]], axis=-1) / (2 * step)
        nominal = np.diag([self.half_x_mm, self.half_y_mm]) * self.light.magnification_px
        return np.where(np.asarray(valid.all(1))[:, None, None], found, nominal)

    def _points(self, xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        xi, eta = np.broadcast_arrays(xi, eta)
        return self.wavelength_nm.reshape(-1, *(1,) * xi.ndim), xi * self.half_x_mm, eta * self.half_y_mm


Field = FieldMap | TracedField


def fit_field(light: Light, wavelength_nm: np.ndarray, half_x_mm: float, half_y_mm: float) -> Field:
    """Fit the lowest polynomial degrees that hold the path to 1e-7 px, and the transmission to 1e-7, over the field.

    Where no degree does (a very wide field), or where the prism loses part of the field (at its critical angle), every
    point is followed instead.
    """
    grid_x, grid_y = np.meshgrid(*_CHECK, indexing="ij")
    points = (wavelength_nm[:, None, None], grid_x * half_x_mm, grid_y * half_y_mm)
    passes = light.position_px(*points)[2]
    valid = np.asarray(passes.any((1, 2)))
    traced = TracedField(light, wavelength_nm, half_x_mm, half_y_mm, valid)
    if not np.array_equal(valid, passes.all((1, 2))):
        return traced
    if not valid.any():
        along, across = (np.zeros((valid.size, 2, 1)) for _ in range(2))
        along[:, 1], across[:, 0] = 1.0, 1.0  # any place will do for light that never arrives
        return FieldMap(along, across, np.zeros((valid.size, 1, 1)), ((0,), (1,), (0,)), valid, 0.0)
    half_mm, wavelengths = (half_x_mm, half_y_mm), wavelength_nm[valid][:, None, None]
    symmetric = _symmetric(light, wavelengths, *half_mm)

    def places(X: np.ndarray, Y: np.ndarray) -> list[np.ndarray]:
        return list(light.position_px(wavelengths, X * half_x_mm, Y * half_y_mm)[:2])

    def passed(X: np.ndarray, Y: np.ndarray) -> list[np.ndarray]:
        return [light.transmission(wavelengths, X * half_x_mm, Y * half_y_mm)]

    where = _lowest(places, _DEGREES, symmetric, (False, True), TOLERANCE_PX)
    share = _lowest(passed, ((0, 0), *_DEGREES), symmetric, (False,), TOLERANCE_TRANSMISSION)
    if where is None or share is None:
        return traced
    tables = [_nearest(table, valid) for table in (*where.tables, *share.tables)]
    return FieldMap(tables[0], tables[1], tables[2], (*where.powers, *share.powers), valid, where.error)  # type: ignore[arg-type]


class _Fit(NamedTuple):
    tables: list[np.ndarray]
    powers: list[tuple[int, ...]]
    error: float


def _lowest(
    values: Callable[[np.ndarray, np.ndarray], list[np.ndarray]],
    degrees: Sequence[tuple[int, int]],
    symmetric: bool,
    odd: tuple[bool, ...],
    tolerance: float,
) -> _Fit | None:
    """Interpolate at Chebyshev nodes, half of them in eta where the field is symmetric; return the lowest degrees that suffice."""
    check = np.meshgrid(*_CHECK, indexing="ij")
    exact = values(check[0], check[1])
    for a, b in degrees:
        highest = 2 * b + 2
        powers = [tuple(range(int(symmetric and o), highest, 2 if symmetric else 1)) for o in odd]
        xi = np.cos(np.pi * (np.arange(a + 1) + 0.5) / (a + 1))
        eta = np.cos(np.pi * (np.arange(len(powers[0])) + 0.5) / highest)
        nodes = np.meshgrid(xi, eta, indexing="ij")
        tables = []
        for found, chosen in zip(values(nodes[0], nodes[1]), powers):
            matrix = np.stack([(nodes[0] ** i * nodes[1] ** j).ravel() for i in range(a + 1) for j in chosen], axis=1)
            tables.append(np.linalg.solve(matrix, found.reshape(len(found), -1).T).T.reshape(-1, a + 1, len(chosen)))
        fitted = [_evaluate(table, chosen, check[0], check[1]) for table, chosen in zip(tables, powers)]
        error = float(max(np.abs(f - e).max() for f, e in zip(fitted, exact)))
        if error <= tolerance:
            return _Fit(tables, powers, error)
    return None


def _symmetric(light: Light, wavelength_nm: np.ndarray, half_x_mm: float, half_y_mm: float) -> bool:
    """Tell whether the lower half of the field is the mirror image of the upper one."""
    X, Y = np.array([-0.9, 0.3, 1.0])[:, None] * half_x_mm, np.array([0.35, 1.0]) * half_y_mm
    (x, y, _), (x2, y2, _) = light.position_px(wavelength_nm, X, Y), light.position_px(wavelength_nm, X, -Y)
    t, t2 = light.transmission(wavelength_nm, X, Y), light.transmission(wavelength_nm, X, -Y)
    return bool(max(np.abs(x - x2).max(), np.abs(y + y2).max()) < 1e-2 * TOLERANCE_PX and np.abs(t - t2).max() < 1e-10)


def _evaluate(table: np.ndarray, powers: tuple[int, ...], xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Return (n, ...) sums of table[a, i] xi^a eta^powers[i]."""
    xi, eta = np.broadcast_arrays(xi, eta)
    basis = np.stack([xi.ravel() ** a * eta.ravel() ** p for a in range(table.shape[1]) for p in powers])
    return (table.reshape(len(table), -1) @ basis).reshape(len(table), *xi.shape)


def _evaluate_each(table: np.ndarray, powers: tuple[int, ...], xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Return (n, ...) the same, each wavelength at its own points (n, ...)."""
    result = np.zeros(xi.shape)
    for a in range(table.shape[1]):
        for i, p in enumerate(powers):
            result += table[:, a, i].reshape(-1, *(1,) * (xi.ndim - 1)) * xi**a * eta**p
    return result


def _nearest(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Place coefficients of valid wavelengths; lost ones get those of their nearest valid neighbour (finite, weight 0)."""
    if valid.all():
        return values
    there = np.flatnonzero(valid)
    after = np.clip(np.searchsorted(there, np.arange(valid.size)), 0, there.size - 1)
    before = np.maximum(after - 1, 0)
    closer = np.abs(there[before] - np.arange(valid.size)) < np.abs(there[after] - np.arange(valid.size))
    return np.asarray(values[np.where(closer, before, after)])
