"""Optical glasses by their catalogue names: the refractive index from the Sellmeier formula (theory.md (C.1))."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scenes.errors import InputError
from scenes.model import did_you_mean

FOLDER = Path(__file__).resolve().parent / "data" / "glass"


@cache
def glass_names() -> tuple[str, ...]:
    """Return the names of the glasses that come along."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


@cache
def glass_entry(name: str) -> dict[str, Any]:
    """Return a catalogue glass's name, Sellmeier coefficients, valid range and source.

    Raises:
        InputError: field ``glass`` for an unknown name.
    """
    if name not in glass_names():
        raise InputError("glass", name, f"one of {', '.join(glass_names())}{did_you_mean(name, glass_names())}")
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def glass_index(name: str, wavelength_nm: ArrayLike) -> np.ndarray:
    """Return the refractive index of a catalogue glass against air.

    Args:
        name: one of :func:`glass_names`.
        wavelength_nm: within the range that the formula was fitted in, nm.

    Raises:
        InputError: field ``glass`` for an unknown name, ``wavelength_nm`` outside the range.
    """
    entry, values = glass_entry(name), np.asarray(wavelength_nm, np.float64)
    low, high = entry["range_nm"]
    bad = ~((values >= low) & (values <= high))
    if np.any(bad):
        raise InputError("wavelength_nm", float(values[bad].flat[0]), f"from {low:g} to {high:g} nm, the range of {name}")
    squared = (values / 1000) ** 2
    excess = [b * squared / (squared - c) for b, c in zip(entry["sellmeier_b"], entry["sellmeier_c_um2"], strict=True)]
    return np.asarray(np.sqrt(1 + np.sum(excess, axis=0)))
