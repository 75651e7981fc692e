"""What a dispersion does to the spectrum, as numbers and as a figure."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.inverse import wavelength_at
from optsim.camera.prism import Dispersion, DoubleAmici
from optsim.cube import PAPER_CENTERS_NM
from optsim.errors import InputError

REPORT_NM = np.arange(450.0, 671.0)


def prism_report(dispersion: Dispersion | None = None, wavelength_nm: ArrayLike | None = None) -> dict[str, Any]:
    """Describe a dispersion by its curve, its own equal-pixel bands and its distance from the paper's table.

    Args:
        dispersion: None means the default double Amici prism.
        wavelength_nm: strictly increasing wavelengths in nm of the curve; None: 450, 451 ... 670.

    Returns:
        ``wavelength_nm``, ``position_px`` (0 is the centre of the 455 nm pixel, red positive), ``nm_per_px``,
        ``band_center_nm`` [24] and ``band_edge_nm`` [25] (at pixels 0..23 and their borders -0.5..23.5), and
        ``residual_to_paper_nm`` [24] = band centre - the paper's table. Wavelengths that the prism loses by total
        reflection are left out of the curve and listed in ``lost_nm``.

    Raises:
        InputError: field ``wavelength_nm`` or ``prism``.
    """
    dispersion = DoubleAmici.default() if dispersion is None else dispersion
    grid = np.atleast_1d(np.asarray(REPORT_NM if wavelength_nm is None else wavelength_nm, np.float64))
    if grid.ndim != 1 or grid.size == 0 or np.any(np.diff(grid) <= 0):
        raise InputError("wavelength_nm", grid.tolist(), "strictly increasing, in nm")
    x, _, valid = dispersion.position_px(grid)
    pixels = np.arange(len(PAPER_CENTERS_NM))
    center = wavelength_at(dispersion, pixels)
    edge = wavelength_at(dispersion, np.arange(pixels.size + 1) - 0.5)
    return {
        "wavelength_nm": grid[valid].tolist(),
        "position_px": x[valid].tolist(),
        "nm_per_px": _nm_per_px(dispersion, grid[valid]).tolist(),
        "band_center_nm": center.tolist(),
        "band_edge_nm": edge.tolist(),
        "residual_to_paper_nm": (center - np.array(PAPER_CENTERS_NM)).tolist(),
        "lost_nm": grid[~valid].tolist(),
    }


def _nm_per_px(dispersion: Dispersion, wavelength_nm: np.ndarray, step_nm: float = 0.01) -> np.ndarray:
    above, below = (dispersion.position_px(wavelength_nm + s)[0] for s in (step_nm, -step_nm))
    return 2 * step_nm / (above - below)


def plot_prism(report: dict[str, Any], path: str | PathLike[str]) -> None:
    """Draw the dispersion curve, nm per pixel and the residual to the paper's table; the file's ending chooses its format."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.6), layout="constrained")
    curve, step, residual = figure.subplots(1, 3)
    centers = np.array(PAPER_CENTERS_NM)
    curve.plot(report["wavelength_nm"], report["position_px"], color="black", lw=1.2, label="this dispersion")
    curve.plot(centers, np.arange(centers.size), "o", ms=3.5, mfc="none", color="tab:red", label="Rueda et al. 2015")
    curve.set(xlabel="wavelength (nm)", ylabel="position on the sensor (px)", title="Dispersion")
    curve.legend(frameon=False)
    step.plot(report["wavelength_nm"], report["nm_per_px"], color="black", lw=1.2)
    step.plot(centers, np.gradient(centers.astype(float)), "o", ms=3.5, mfc="none", color="tab:red")
    step.set(xlabel="wavelength (nm)", ylabel="nm per pixel", title="Width of a pixel in the spectrum", ylim=(0, None))
    values = np.array(report["residual_to_paper_nm"])
    residual.axhspan(-0.5, 0.5, color="0.9", label="rounding of the table")
    residual.stem(centers, values, linefmt="k-", markerfmt="ko", basefmt=" ")
    residual.axhline(0, color="black", lw=0.6)
    rms, worst = np.sqrt(np.mean(values**2)), np.abs(values).max()
    span = 1.6 * max(worst, 0.5)
    residual.set(
        ylim=(-span, span), xlabel="band centre (nm)", ylabel="model - table (nm)", title=f"Residual: max {worst:.2f}, rms {rms:.2f} nm"
    )
    residual.legend(frameon=False)
    figure.savefig(path, dpi=150)
