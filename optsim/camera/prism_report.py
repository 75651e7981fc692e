"""What a dispersion does to the spectrum, as numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.prism import Dispersion, DoubleAmici
from optsim.camera.stack import Prism
from optsim.cube import PAPER_CENTERS_NM
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.optics import Optics

RANGE_NM = (450.0, 670.0)
MARGIN_PX = 0.05
"""A pixel of which less than this is missing at the band-pass's edge counts as filled."""
FOLD_SAMPLES = 881


def prism_report(
    dispersion: Dispersion | None = None, wavelength_nm: ArrayLike | None = None, range_nm: tuple[float, float] = RANGE_NM
) -> dict[str, Any]:  # fmt: skip
    """Describe a dispersion by its curve, its own equal-pixel bands and its distance from the paper's table.

    Args:
        dispersion: None means the default double Amici prism.
        wavelength_nm: strictly increasing wavelengths in nm of the curve; None: every nm of ``range_nm``.
        range_nm: (low, high) of the band-pass, in which bands are looked for.

    Returns:
        ``wavelength_nm``, ``position_px`` (0 is the centre of the 455 nm pixel), ``nm_per_px`` (None where the curve
        turns back), ``band_center_nm`` [K] and ``band_edge_nm`` [K + 1]: the wavelengths at ``band_px`` and their
        borders half a pixel away, all pixels that the band-pass fills; K is 24 for the default prism.
        ``residual_to_paper_nm`` [24] = wavelength at pixels 0..23 - the paper's table, empty where the dispersion does not
        reach them. ``folds``: whether two wavelengths share a place; there are no bands then. Wavelengths that the prism
        loses by total reflection are left out of the curve and listed in ``lost_nm``.

    Raises:
        InputError: field ``wavelength_nm``.
    """
    dispersion = DoubleAmici.default() if dispersion is None else dispersion
    given = np.arange(range_nm[0], np.nextafter(range_nm[1], np.inf)) if wavelength_nm is None else wavelength_nm
    grid = np.atleast_1d(np.asarray(given, np.float64))
    if grid.ndim != 1 or grid.size == 0 or np.any(np.diff(grid) <= 0):
        raise InputError("wavelength_nm", grid.tolist(), "strictly increasing, in nm")
    x, _, valid = dispersion.position_px(grid)
    ends = dispersion.position_px(np.linspace(*range_nm, FOLD_SAMPLES))
    pixels, folds = _filled_pixels(ends[0][ends[2]])
    center = _reached(dispersion, pixels)
    half = -0.5 if pixels.size > 1 and pixels[1] < pixels[0] else 0.5
    edge = _reached(dispersion, np.append(pixels - half, pixels[-1:] + half)) if center.size else center
    paper = _reached(dispersion, np.arange(len(PAPER_CENTERS_NM)))
    if edge.size == 0:
        center = edge
    return {
        "wavelength_nm": grid[valid].tolist(),
        "position_px": x[valid].tolist(),
        "nm_per_px": _nm_per_px(dispersion, grid[valid]),
        "band_px": pixels[: center.size].tolist(),
        "band_center_nm": center.tolist(),
        "band_edge_nm": edge.tolist(),
        "residual_to_paper_nm": (paper - np.array(PAPER_CENTERS_NM)).tolist() if paper.size else [],
        "folds": folds,
        "lost_nm": grid[~valid].tolist(),
    }


def chief_rays(path: Prism | Optics, wavelength_nm: ArrayLike, pixel_um: float) -> dict[str, list[float | None] | list[bool]]:
    """Tell where chief rays along the axis land, unrounded.

    Args:
        path: a traced prism, or the path from the mirrors through one.
        wavelength_nm: any wavelengths in the glasses' ranges.
        pixel_um: the sensor's pitch.

    Returns:
        ``wavelength_nm``, ``position_mm`` from the optical axis, ``position_px`` = position_mm / pitch, ``transmitted``;
        positions of lost light are None.

    Raises:
        InputError: ``table`` for a camera with a table, which knows no optical axis; ``wavelength_nm``.
    """
    nm = np.atleast_1d(np.asarray(wavelength_nm, np.float64))
    position, passes = path.chief(nm)
    pitch_mm = pixel_um / 1000
    return {
        "wavelength_nm": nm.tolist(),
        "position_mm": [float(p) if ok else None for p, ok in zip(position, passes)],
        "position_px": [float(p) / pitch_mm if ok else None for p, ok in zip(position, passes)],
        "transmitted": [bool(ok) for ok in passes],
    }


def _filled_pixels(x: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the whole pixels inside a curve of positions, from its first wavelength on, and whether the curve turns back."""
    steps = np.diff(x)
    if x.size < 2 or not (np.all(steps > 0) or np.all(steps < 0)):
        return np.zeros(0), True
    low, high = min(x[0], x[-1]) + 0.5 - MARGIN_PX, max(x[0], x[-1]) - 0.5 + MARGIN_PX
    pixels = np.arange(math.ceil(low), math.floor(high) + 1, dtype=np.float64)
    return (pixels if steps[0] > 0 else pixels[::-1]) + 0.0, False


def _reached(dispersion: Dispersion, position_px: np.ndarray) -> np.ndarray:
    """Return the wavelengths at positions; nothing where the dispersion does not reach them all."""
    try:
        return dispersion.wavelength_at(position_px) if position_px.size else np.zeros(0)
    except InputError:
        return np.zeros(0)


def _nm_per_px(dispersion: Dispersion, wavelength_nm: np.ndarray, step_nm: float = 0.01) -> list[float | None]:
    (above, _, up), (below, _, down) = (dispersion.position_px(wavelength_nm + sign * step_nm) for sign in (1, -1))
    change = above - below
    sound = up & down & (np.abs(change) > 1e-12)
    return [float(2 * step_nm / c) if ok else None for c, ok in zip(change, sound)]
