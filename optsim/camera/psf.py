"""How a circular aperture blurs: the incoherent OTF of diffraction and uniform defocus (theory.md (C.32) to (C.34))."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import ArrayLike

from optsim.errors import InputError

WAVE_LIMIT_RAD = 1000.0
"""Above this defocus phase at the pupil's edge, diffraction times the geometrical disc stands for the integral (they differ by 0.004)."""
_FEW = 4096
_NM = 1e-6


def airy_otf(frequency_per_mm: ArrayLike, wavelength_nm: float, f_number: float, defocus_mm: float = 0.0) -> np.ndarray:
    """Return the OTF of a clear circular aperture, in [-1, 1], 1 at frequency 0 (Hopkins 1955; theory.md (C.33)).

    Args:
        frequency_per_mm: radial frequencies in cycles per mm, at least 0, any shape.
        wavelength_nm: above 0 nm.
        f_number: working f-number on the image's side, above 0.
        defocus_mm: distance of the sensor from the focus, either sign.

    Raises:
        InputError: field ``wavelength_nm``, ``f_number``, ``defocus_mm`` or ``frequency_per_mm``.
    """
    for field, value, unit in (("wavelength_nm", wavelength_nm, " nm"), ("f_number", f_number, "")):
        if not 0 < value < math.inf:
            raise InputError(field, value, f"above 0{unit} and finite")
    if not math.isfinite(defocus_mm):
        raise InputError("defocus_mm", defocus_mm, "finite, in mm")
    if not np.all(np.isfinite(frequency_per_mm)):
        raise InputError("frequency_per_mm", "not finite", "finite frequencies in cycles per mm")
    s = 2 * wavelength_nm * _NM * f_number * np.asarray(frequency_per_mm, np.float64)
    phase = abs(defocus_phase_rad(wavelength_nm, f_number, defocus_mm))
    if phase > WAVE_LIMIT_RAD:
        return _radial(s, 0.0) * disc_otf(frequency_per_mm, abs(defocus_mm) / f_number)
    if s.size <= _FEW:
        return _radial(s, phase)
    from scipy.interpolate import CubicSpline

    nodes = np.linspace(0, math.pi, 1025 + int(32 * phase))
    table = np.concatenate([_radial(part, phase) for part in np.array_split(1 - np.cos(nodes), 1 + nodes.size // _FEW)])
    return np.where(s < 2, CubicSpline(nodes, table)(np.arccos(np.clip(1 - s, -1, 1))), 0.0)


def disc_otf(frequency_per_mm: ArrayLike, diameter_mm: float) -> np.ndarray:
    """Return the OTF of a uniform disc, 2 J1(x) / x with x = pi x diameter x frequency (theory.md (C.34))."""
    from scipy.special import j1

    x = math.pi * diameter_mm * np.asarray(frequency_per_mm, np.float64)
    safe = np.where(x > 1e-8, x, 1.0)
    return np.where(x > 1e-8, 2 * j1(safe) / safe, 1.0)


def defocus_phase_rad(wavelength_nm: float, f_number: float, defocus_mm: float) -> float:
    """Return the phase that defocus adds at the pupil's edge: 2 pi / lambda x defocus / (8 N^2), in rad (theory.md (C.32))."""
    return 2 * math.pi / (wavelength_nm * _NM) * defocus_mm / (8 * f_number**2)


def _radial(s: np.ndarray, phase_rad: float) -> np.ndarray:
    """Integrate (C.33) by Gauss-Legendre at frequencies s, 2 being the cutoff."""
    nodes, weights = _legendre(32 + math.ceil(phase_rad / 1.5))
    inside = np.minimum(s, 2.0)[..., None] / 2
    top = np.arccos(inside)
    angle = top * (nodes + 1) / 2
    reach = np.cos(angle) - inside
    turns = 4 * phase_rad * inside * reach / math.pi
    return np.asarray((2 * top / math.pi * reach * np.sinc(turns) * np.cos(angle)) @ weights)


@functools.lru_cache(maxsize=64)
def _legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(count)
