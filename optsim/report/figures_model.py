"""Figures of the model: the paper's Fig. 2, 3 and 4, and the prism's dispersion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from optsim.cube import PAPER_CENTERS_NM
from optsim.report.data import BAYER, Capture, Response, RunData
from optsim.report.matrices import bayer_blocks, foveon_matrix, mono_matrices
from optsim.report.style import CHANNELS, GRID, INK, MUTED, Drawn, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BAND_COLORS = ("#4B3F9E", "#2F7FC1", "#1B9E77", "#B8A300", "#E8793A", "#B3233B")


def draw_non_zeros(
    axes: Axes, matrix: np.ndarray, color_of: np.ndarray, colors: Sequence[str], rows_per_block: int, columns_per_block: int
) -> None:
    """Paint the non-zeros of a matrix, each in the colour of its category, with lines between its blocks."""
    from matplotlib.colors import ListedColormap

    shown = np.where(matrix != 0, color_of + 1, 0)
    axes.imshow(shown, cmap=ListedColormap(["#ffffff", *colors]), vmin=-0.5, vmax=len(colors) + 0.5)
    for row in range(rows_per_block, matrix.shape[0], rows_per_block):
        axes.axhline(row - 0.5, color=MUTED, linewidth=0.6)
    for column in range(columns_per_block, matrix.shape[1], columns_per_block):
        axes.axvline(column - 0.5, color=GRID, linewidth=0.6)
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(True)


def figure_2(directory: Path) -> Drawn:
    """Draw the non-zeros of H for a 4 x 4 x 6 cube: one band, six bands, six bands dispersed."""
    matrices = mono_matrices()
    figure = new_figure(10.0, 2.25)
    axes = figure.subplots(1, 3, width_ratios=[H.shape[1] + 6 for H in matrices])
    titles = ("(a) one band", "(b) six bands, no dispersion", "(c) six bands, dispersed")
    for ax, H, title in zip(axes, matrices, titles):
        band = np.broadcast_to(np.arange(H.shape[1]) // 16, H.shape)
        draw_non_zeros(ax, H, band, BAND_COLORS, H.shape[0], 16)
        ax.set_anchor("N")
        size = f"{H.shape[0]} × {H.shape[1]}"
        ax.set_title(f"{title}\n{size}" + (f", {np.count_nonzero(H)} non-zeros" if H.shape[1] > 16 else ""), loc="left")
        ax.set_xlabel("voxel (row, then column, then band)" if H.shape[1] > 16 else "voxel")
        ax.set_xticks(np.arange(0, H.shape[1] + 1, 16) - 0.5, range(0, H.shape[1] + 1, 16))
        ax.set_yticks(np.arange(0, H.shape[0] + 1, 4) - 0.5, range(0, H.shape[0] + 1, 4))
    axes[0].set_ylabel("sensor pixel")
    counts = [int(np.count_nonzero(H)) for H in matrices]
    caption = (
        "Non-zeros of H for a 4 × 4 × 6 cube, monochrome, every mirror open; colour is the band. "
        f"One band is the identity ({counts[0]} non-zeros); without dispersion the six bands fall on the same 16 pixels ({counts[1]}); "
        "with it each band moves one column, four rows of H, further and the frame grows to "
        f"{matrices[2].shape[0]} pixels ({counts[2]})."
    )
    alt = "Three matrices: one diagonal; six diagonals side by side; six diagonals, each four rows lower than the one before."
    png, pdf = save(figure, directory, "fig02")
    return Drawn("fig02", "Fig. 2: the sensing matrix, monochrome", caption, alt, png, pdf)


def figure_4(directory: Path) -> Drawn:
    """Draw the non-zeros of H for Bayer and Foveon with stylised bands, three colour blocks stacked."""
    figure = new_figure(10.0, 6.1)
    axes = figure.subplots(1, 2, sharey=True)
    pair = (("(a) Bayer, RGGB", bayer_blocks()), ("(b) Foveon", foveon_matrix()))
    for ax, (title, H) in zip(axes, pair):
        rows = H.shape[0] // 3
        color = np.broadcast_to((np.arange(H.shape[0]) // rows)[:, None], H.shape)
        draw_non_zeros(ax, H, color, [CHANNELS[c] for c in ("red", "green", "blue")], rows, 16)
        ax.set_title(f"{title}: {H.shape[0]} × {H.shape[1]}, {np.count_nonzero(H)} non-zeros", loc="left")
        ax.set_xlabel("voxel (row, then column, then band)")
        ax.set_xticks(np.arange(0, H.shape[1] + 1, 16) - 0.5, range(0, H.shape[1] + 1, 16))
        ax.set_yticks([rows * (c + 0.5) - 0.5 for c in range(3)], ["red", "green", "blue"], rotation=90, va="center")
        ax.tick_params(axis="y", length=0)
    axes[0].set_ylabel("sensor pixel, one block a colour")
    counts = [int(np.count_nonzero(H)) for _, H in pair]
    caption = (
        "The same cube seen by colour sensors, with stylised curves (real ones never reach zero): Bayer blue takes bands 1 and 2, "
        "green 2 to 5, red 5 and 6; Foveon blue 1 to 4, green 3 to 5, red 5 and 6. "
        f"Bayer’s blocks have empty rows where a pixel has another colour: {counts[0]} non-zeros against {counts[1]}."
    )
    alt = "Two matrices of three stacked blocks, red, green and blue: diagonals where a colour sees a band; Bayer's are broken."
    png, pdf = save(figure, directory, "fig04")
    return Drawn("fig04", "Fig. 4: the sensing matrix, Bayer and Foveon", caption, alt, png, pdf)


def mosaic_corner(run: RunData) -> np.ndarray:
    """Return the 4 x 4 corner of the run's Bayer mosaic, or RGGB when no Bayer frame was kept."""
    for row in run.rows:
        if row.series == BAYER:
            frames = run.frames(Capture(row.target, row.sensor, row.masks, row.R, row.model))
            if frames is not None and frames.cfa is not None and min(frames.cfa.shape) >= 4:
                return np.asarray(frames.cfa[:4, :4])
    return np.tile([[0, 1], [1, 2]], (2, 2))


def draw_layout(axes: Axes, sensor: str, mosaic: np.ndarray) -> None:
    """Sketch 4 x 4 pixels of a sensor; Foveon as three layers, blue on top."""
    from matplotlib.patches import Polygon, Rectangle

    names = ("red", "green", "blue")
    if sensor == "foveon":
        for level, name in enumerate(names):
            z = 1.35 * level
            for i in range(4):
                for j in range(4):
                    u, v = np.array([j, j + 1, j + 1, j]), np.array([i, i, i + 1, i + 1])
                    corners = np.stack([u + 0.55 * v, z + 0.42 * v], axis=1)
                    axes.add_patch(Polygon(corners, facecolor=CHANNELS[name], edgecolor="white", linewidth=0.8, alpha=0.85))
            axes.text(6.35, z + 1.1, f"{name} layer", va="center", fontsize=8)
        axes.set_xlim(-0.1, 8.7)
        axes.set_ylim(-0.2, 4.6)
    else:
        for i in range(4):
            for j in range(4):
                name = "mono" if sensor == "mono" else names[int(mosaic[i, j])]
                face = "#b9bec3" if sensor == "mono" else CHANNELS[name]
                axes.add_patch(Rectangle((j, 3 - i), 1, 1, facecolor=face, edgecolor="white", linewidth=1.2))
                if sensor == "bayer":
                    axes.text(j + 0.5, 3.5 - i, name[0].upper(), ha="center", va="center", color="white", fontsize=9, fontweight="bold")
        axes.set_xlim(-2.2, 6.2)
        axes.set_ylim(-0.1, 4.1)
    axes.set_aspect("equal")
    axes.set_axis_off()


def draw_response(axes: Axes, response: Response, low: float, high: float) -> None:
    """Plot the curves of a sensor over the camera's wavelengths."""
    for name, values in response.curves.items():
        color = CHANNELS.get(name, INK)
        axes.plot(response.wavelength_nm, values, color=color, label=name)
        axes.fill_between(response.wavelength_nm, values, color=color, alpha=0.12, linewidth=0)
    axes.axvspan(low, high, facecolor="#000000", alpha=0.045, linewidth=0)
    margin = 0.12 * (high - low)
    axes.set_xlim(low - margin, high + margin)
    axes.set_ylim(0, None)
    axes.set_xlabel("wavelength, nm")


def figure_3(run: RunData, directory: Path) -> Drawn | None:
    """Draw the three sensors' layouts and the curves that the run used."""
    titles = {"mono": "Monochrome", "bayer": "Bayer", "foveon": "Foveon"}
    known = [s for s in titles if s in run.responses]
    if not known:
        return None
    truth = next(iter(run.truths.values()), None)
    low, high = (float(truth.bands.lower[0]), float(truth.bands.upper[-1])) if truth else (452.5, 668.5)
    figure = new_figure(10.0, 4.6)
    axes = figure.subplots(2, len(known), height_ratios=[1, 1.25], squeeze=False)
    mosaic = mosaic_corner(run)
    for column, sensor in enumerate(known):
        axes[0, column].set_title(titles[sensor], fontsize=11)
        draw_layout(axes[0, column], sensor, mosaic)
        draw_response(axes[1, column], run.responses[sensor], low, high)
        if run.responses[sensor].source:
            axes[1, column].set_title(fill(run.responses[sensor].source, 44), fontsize=8, color=MUTED)
    axes[1, 0].set_ylabel("relative response")
    caption = (
        "Sensor layouts and the response curves of this run, each curve as published (its own maximum 1). "
        f"The grey span is what the camera sees, {low:g} to {high:g} nm. "
        "Foveon’s blue layer lies on green, green on red: each takes part of the light of the ones below."
    )
    alt = "Sketches of a monochrome, a Bayer and a three-layer Foveon sensor above plots of their spectral response."
    png, pdf = save(figure, directory, "fig03")
    return Drawn("fig03", "Fig. 3: the three sensors", caption, alt, png, pdf)


def figure_prism(run: RunData, directory: Path) -> Drawn | None:
    """Draw where the prism puts each wavelength, how many nm a pixel holds, and its distance from the paper's table."""
    report = run.prism
    if report is None:
        return None
    wavelength, position = np.array(report["wavelength_nm"]), np.array(report["position_px"])
    residual = np.array(report["residual_to_paper_nm"])
    paper = np.array(PAPER_CENTERS_NM, float)
    figure = new_figure(10.0, 3.4)
    left, middle, right = figure.subplots(1, 3)
    left.plot(wavelength, position, color=INK, label="traced prism")
    left.plot(paper, np.arange(paper.size), "o", color="#D55E00", markersize=3.5, label="the paper’s table")
    left.set_ylabel("position on the sensor, px")
    left.legend(loc="lower right")
    middle.plot(wavelength, report["nm_per_px"], color=INK)
    middle.set_ylabel("dispersion, nm per px")
    middle.set_ylim(0, None)
    right.axhline(0, color=MUTED, linewidth=0.8)
    right.vlines(paper[: residual.size], 0, residual, color="#0072B2", linewidth=1.6)
    right.plot(paper[: residual.size], residual, "o", color="#0072B2", markersize=3.5)
    right.set_ylabel("prism − paper’s table, nm")
    for ax in (left, middle, right):
        ax.set_xlabel("wavelength, nm")
    rms, worst = float(np.sqrt(np.mean(residual**2))), float(np.abs(residual).max())
    caption = (
        f"The double Amici prism of this run. Position 0 is the centre of the 455 nm pixel, red positive. "
        f"Its {residual.size} equal-pixel band centres differ from the paper’s table by {rms:.2f} nm rms, at most {worst:.2f} nm."
    )
    alt = "Three plots against wavelength: position in pixels, nanometres per pixel, and residual to the paper's band centres."
    png, pdf = save(figure, directory, "prism")
    return Drawn("prism", "Dispersion of the prism", caption, alt, png, pdf)
