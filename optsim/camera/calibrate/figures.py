"""A calibration as a figure: the curve against the drawing, the misfit, and what the spots tell apart."""

from __future__ import annotations

from os import PathLike

import numpy as np

from optsim.camera.calibrate.calibrated_map import CalibratedMap
from optsim.camera.calibrate.result import Calibration
from optsim.camera.prism_figures import draw_combinations


def plot_calibration(found: Calibration, path: str | PathLike[str], truth: CalibratedMap | None = None) -> None:
    """Draw a calibration; the file's ending chooses its format.

    Args:
        found: the calibration.
        path: PNG, PDF or SVG.
        truth: the camera that made the spots, where it is known.
    """
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4.2), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=[1.1, 1, 1.3])
    curve, misfit, parts = axes
    assert isinstance(curve, Axes)
    nm = np.linspace(found.spots.wavelength_nm.min(), found.spots.wavelength_nm.max(), 120)
    at = found.curve(nm)
    drawn = CalibratedMap(found.model, found.model.drawn, found.camera).position_px(nm)[0]
    middle = float(np.mean(at.x_px - drawn))
    low, high = (at.x_px - drawn - middle + sign * 1.96 * at.sigma_x_px for sign in (-1, 1))
    curve.fill_between(nm, low, high, color="0.8", lw=0, label="95 % interval")
    curve.plot(nm, at.x_px - drawn - middle, color="black", lw=1.2, label="fitted")
    if truth is not None:
        curve.plot(nm, truth.position_px(nm)[0] - drawn - middle, color="tab:red", lw=1, ls="--", label="truth")
    curve.set(xlabel="wavelength (nm)", ylabel="position (px)", title=f"Fitted less drawn curve, and less {middle:+.2f} px")
    curve.legend(frameon=False)
    x, y = np.split(found.misfit, 2)
    scatter = misfit.scatter(x, y, c=found.spots.wavelength_nm, cmap="turbo", s=9)
    figure.colorbar(scatter, ax=misfit, label="wavelength (nm)")
    misfit.set(xlabel="x: fitted - measured (px)", ylabel="y (px)", title=f"Misfit, rms {found.rms_px:.3g} px", aspect="equal")
    draw_combinations(parts, found.split.describe())
    parts.set_title("Told apart (blue)")
    figure.savefig(path, dpi=150)
