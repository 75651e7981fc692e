"""The inverse of a dispersion: which wavelength lands at a given place (theory.md (C.20))."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from optsim.errors import InputError

SEARCH_NM = (380.0, 780.0)
STEPS, HALVINGS = 800, 40


class Positions(Protocol):
    """Place wavelengths along the sensor."""

    def position_px(self, wavelength_nm: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) on the axis."""


def wavelength_at(dispersion: Positions, position_px: ArrayLike, range_nm: tuple[float, float] | None = None) -> np.ndarray:
    """Return the wavelengths in nm that land at given positions of the axis (X = Y = 0), by bisection to 1e-10 nm.

    Args:
        dispersion: places wavelengths, increasing or decreasing.
        position_px: of any shape, in px from the 455 nm pixel.
        range_nm: where to search, cut to 380-780 nm where it reaches into them; None: 380-780 nm.

    Raises:
        InputError: field ``prism`` when the dispersion folds over, or does not reach a position; ``position_px`` not finite.
    """
    low_nm, high_nm = search_range(range_nm)
    target = np.atleast_1d(np.asarray(position_px, np.float64))
    if not np.all(np.isfinite(target)):
        raise InputError("position_px", float(target[~np.isfinite(target)].flat[0]), "finite positions in px")
    if target.size == 0:
        return target
    grid = np.linspace(low_nm, high_nm, STEPS + 1)
    x, _, valid = dispersion.position_px(grid)
    grid, x = grid[valid], x[valid]
    sign = 1.0 if x.size > 1 and x[-1] > x[0] else -1.0
    if grid.size < 2 or np.any(np.diff(sign * x) <= 0):
        raise InputError(
            "prism", "a dispersion that folds over or loses light", f"increasing with wavelength over {low_nm:g}-{high_nm:g} nm"
        )
    along = sign * target
    if along.min() < sign * x[0] or along.max() > sign * x[-1]:
        form = f"a dispersion that reaches px {target.min():g} to {target.max():g} within {low_nm:g}-{high_nm:g} nm"
        raise InputError("prism", (float(x[0]), float(x[-1])), form)
    left = np.clip(np.searchsorted(sign * x, along, side="right") - 1, 0, grid.size - 2)
    low, high = grid[left], grid[left + 1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        below = sign * dispersion.position_px(middle)[0] <= along
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return ((low + high) / 2).reshape(np.shape(position_px))


def folds(dispersion: Positions, range_nm: tuple[float, float] = SEARCH_NM) -> np.ndarray:
    """Return the wavelengths in nm at which the dispersion turns back, d x / d wavelength = 0, to 1e-6 nm; empty for a usable prism."""
    from scipy.optimize import minimize_scalar

    grid = np.linspace(*range_nm, STEPS + 1)
    x, _, valid = dispersion.position_px(grid)
    step = np.sign(np.diff(x)) * (valid[1:] & valid[:-1])
    turns = np.flatnonzero(step[1:] * step[:-1] < 0) + 1
    found = []
    for i in turns:
        sign = -step[i - 1]
        result = minimize_scalar(
            lambda w, sign=sign: sign * float(dispersion.position_px(np.array([w]))[0][0]),
            bounds=(grid[i - 1], grid[i + 1]),
            method="bounded",
            options={"xatol": 1e-6},
        )
        found.append(float(result.x))
    return np.array(found)


def search_range(range_nm: tuple[float, float] | None) -> tuple[float, float]:
    """Return the part of a range inside 380-780 nm, or the whole range where nothing of it lies there."""
    if range_nm is None:
        return SEARCH_NM
    low, high = max(range_nm[0], SEARCH_NM[0]), min(range_nm[1], SEARCH_NM[1])
    return (low, high) if high > low else range_nm
