"""The study of a prism as a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.cube import PAPER_CENTERS_NM

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = ("black", "tab:blue", "tab:orange")
NAMES_SHOWN = 3


def plot_prism(report: dict[str, Any], path: str | PathLike[str]) -> None:
    """Draw a report: curve, nm per pixel, residual to the paper's table; below, if studied, field, tolerances, combinations.

    Args:
        report: of :func:`optsim.camera.prism_report.prism_report`, with or without what :func:`optsim.camera.prism_study.study` adds.
        path: its ending chooses the format.
    """
    from matplotlib.figure import Figure

    rows = 2 if report.get("smile") else 1
    figure = Figure(figsize=(13, 3.9 * rows), layout="constrained")
    axes = figure.subplots(rows, 3, squeeze=False)
    _curve(axes[0, 0], report)
    _step(axes[0, 1], report)
    _residual(axes[0, 2], report)
    if rows == 2:
        _smile(axes[1, 0], report["smile"])
        if report["tolerance"] is None:
            for panel in axes[1, 1:]:
                panel.set_axis_off()
        else:
            _tolerance(axes[1, 1], report["tolerance"])
            draw_combinations(axes[1, 2], report["identifiability"]["combinations"])
            axes[1, 2].set_title(f"Spots to {report['identifiability']['sigma_px']:g} px tell apart (blue)", fontsize=10)
    figure.savefig(path, dpi=150)


def _curve(axes: Axes, report: dict[str, Any]) -> None:
    centers = np.array(PAPER_CENTERS_NM)
    axes.plot(report["wavelength_nm"], report["position_px"], color="black", lw=1.2, label="this dispersion")
    if report["residual_to_paper_nm"]:
        axes.plot(centers, np.arange(centers.size), "o", ms=3.5, mfc="none", color="tab:red", label="Rueda et al. 2015")
    axes.set(xlabel="wavelength (nm)", ylabel="position on the sensor (px)", title="Dispersion")
    axes.legend(frameon=False)


def _step(axes: Axes, report: dict[str, Any]) -> None:
    centers = np.array(PAPER_CENTERS_NM)
    values = np.array([np.nan if v is None else abs(v) for v in report["nm_per_px"]])
    axes.plot(report["wavelength_nm"], values, color="black", lw=1.2)
    if report["residual_to_paper_nm"]:
        axes.plot(centers, np.gradient(centers.astype(float)), "o", ms=3.5, mfc="none", color="tab:red")
    top = None if not np.isfinite(values).any() else min(1.15 * np.nanmax(values), 20 * np.nanmedian(values))
    axes.set(xlabel="wavelength (nm)", ylabel="nm per pixel", title="Width of a pixel in the spectrum", ylim=(0, top))


def _residual(axes: Axes, report: dict[str, Any]) -> None:
    values = np.array(report["residual_to_paper_nm"])
    if values.size == 0:
        axes.text(0.5, 0.5, "does not reach the paper's 24 pixels", ha="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    axes.axhspan(-0.5, 0.5, color="0.9", label="rounding of the table")
    axes.stem(np.array(PAPER_CENTERS_NM), values, linefmt="k-", markerfmt="ko", basefmt=" ")
    axes.axhline(0, color="black", lw=0.6)
    rms, worst = np.sqrt(np.mean(values**2)), np.abs(values).max()
    span = 1.6 * max(worst, 0.5)
    title = f"Residual: max {worst:.2f}, rms {rms:.2f} nm"
    axes.set(ylim=(-span, span), xlabel="band centre (nm)", ylabel="model - table (nm)", title=title)
    axes.legend(frameon=False)


def _smile(axes: Axes, smile: dict[str, Any]) -> None:
    lines = (
        (f"upper edge (Y = {smile['Y_mm']:.2f} mm): smile", "smile_px"),
        (f"left edge (X = -{smile['X_mm']:.2f} mm)", "left_px"),
        ("right edge", "right_px"),
    )
    for (label, key), color in zip(lines, COLORS):
        axes.plot(smile["wavelength_nm"], [np.nan if v is None else v for v in smile[key]], color=color, lw=1.2, label=label)
    axes.axhline(0, color="0.6", lw=0.6)
    axes.set(xlabel="wavelength (nm)", ylabel="x less that of the axial curve (px)", title="Smile and stretch over the field")
    axes.legend(frameon=False)


def _tolerance(axes: Axes, tolerance: dict[str, Any]) -> None:
    nm = tolerance["wavelength_nm"]
    for key, label, color in (("aligned_px", "shifted into place", "0.8"), ("bent_px", "and stretched", "tab:blue")):
        low, _, high = tolerance[key]
        axes.fill_between(nm, low, high, color=color, lw=0, label=label)
    rms = tolerance["as_built_rms_px"]["quantile"][1]
    axes.set(xlabel="wavelength (nm)", ylabel="change of position (px)")
    axes.set_title(f"95 % of {tolerance['draws']} built prisms (as built: {rms:.2g} px rms)", fontsize=10)
    axes.legend(frameon=False)


def draw_combinations(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    """Draw how well combinations of parameters are known, as bars: blue where better than by the drawing.

    Args:
        axes: to draw on.
        rows: of :meth:`optsim.camera.calibrate.identify.Combinations.describe`.
    """
    length = np.array([1e12 if row["std_in_tolerances"] is None else row["std_in_tolerances"] for row in rows])
    color = ["lightskyblue" if row["told_apart"] else "0.85" for row in rows]
    place = np.arange(len(rows))
    axes.barh(place, length - 1e-4, left=1e-4, color=color, height=0.7)
    axes.axvline(1, color="black", lw=0.8)
    axes.set(xscale="log", xlim=(1e-4, 1e7), ylim=(len(rows) - 0.5, -0.5), xlabel="standard error (tolerances of the drawing)")
    axes.set_yticks([])
    for y, row in enumerate(rows):
        name = "  ".join(f"{share:+.1f} {name}" for name, share in list(row["parts"].items())[:NAMES_SHOWN])
        axes.text(1.5e-4, y, name, fontsize=6.5, va="center", clip_on=True)
