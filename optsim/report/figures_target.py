"""Figures of the cubes: the paper's Fig. 5, 6, 7 and 11."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.report.chart import curves
from optsim.report.data import SERIES, Series
from optsim.report.gallery import Gallery, finest_window
from optsim.report.select import listing, pick, ratio_text, ratios, score
from optsim.report.style import COLORS, DASHES, INK, MARKERS, MUTED, Drawn, new_figure, picture, save, sci, slug
from optsim.report.verdict import MAIN_R
from optsim.report.wording import recipe_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RADIANCE = "radiance, W m⁻² sr⁻¹ nm⁻¹"
SHORT_NAMES = {"mono-distinct": "mono\ndistinct", "mono-repeated": "mono\nrepeated", "bayer": "Bayer", "foveon": "Foveon"}


def series_with_estimates(gallery: Gallery, target: str, R: float) -> list[Series]:
    """Return the series that have a row at a target and R, in fixed order."""
    return [s for s in SERIES if pick(gallery.run, gallery.recipe, target, s, R)]


def draw_psnr(axes: Axes, gallery: Gallery, target: str) -> None:
    """Plot mean PSNR against R for every series."""
    found = curves(gallery.run, gallery.recipe, target)
    for s, points in found.items():
        R, value = zip(*points)
        axes.plot(R, value, color=COLORS[s.key], linestyle=DASHES[s.key], marker=MARKERS[s.key], label=s.label)
    shown = sorted({R for points in found.values() for R, _ in points})
    axes.set_xticks(shown, [ratio_text(R) for R in shown])
    axes.set_xlabel("compression ratio R")
    axes.set_ylabel("mean PSNR over bands, dB")
    axes.margins(x=0.06, y=0.1)
    if found:
        axes.legend(loc="best")


def window_box(axes: Axes, window: tuple[slice, slice], color: str = "#ffffff") -> None:
    """Outline a window on a picture."""
    from matplotlib.patches import Rectangle

    y, x = window
    for width, edge in ((2.4, "#000000"), (1.2, color)):
        axes.add_patch(
            Rectangle((x.start - 0.5, y.start - 0.5), x.stop - x.start, y.stop - y.start, fill=False, edgecolor=edge, linewidth=width)
        )


def figure_scene(gallery: Gallery, target: str, number: int | None, zoom: bool, directory: Path) -> Drawn | None:
    """Draw a target as the paper's Fig. 5 or 6 does: scene, PSNR against R, reconstructions at the least and the greatest R."""
    if target not in gallery.run.truths or not ratios(gallery.run, gallery.recipe, target):
        return None
    truth = gallery.truth(target).radiance
    window = finest_window(truth)
    found = ratios(gallery.run, gallery.recipe, target)
    shown = sorted({found[0], found[-1]})
    height = 3.5 + len(shown) * (4.5 if zoom else 2.35)
    figure = new_figure(10.0, height)
    top, bottom = np.ravel(figure.subfigures(2, 1, height_ratios=[3.5, height - 3.5], squeeze=False))
    scene, plot = top.subplots(1, 2, width_ratios=[1, 1.45])
    scene.imshow(gallery.srgb(truth, target))
    picture(scene, "(a) the scene, sRGB under its own light")
    if zoom:
        window_box(scene, window)
    draw_psnr(plot, gallery, target)
    plot.set_title(f"(b) {target}", loc="left")
    rows_each = 2 if zoom else 1
    grid = bottom.subplots(rows_each * len(shown), len(SERIES) + 1, squeeze=False)
    false_color = draw_pictures(gallery, target, shown, window if zoom else None, grid)
    recipe = recipe_text(gallery.recipe) if gallery.recipe else ""
    caption = f"{target}, {recipe}: (a) the rendered scene, (b) mean PSNR against R, (c) reconstructions in the scene’s exposure"
    if zoom:
        caption += ", each with the window of the finest bars enlarged below it. False colour there (mean ΔC*ab of 8 × 8 pixel means): "
        told = {R: ", ".join(f"{name} {value:.1f}" for name, value in values.items()) for R, values in false_color.items() if values}
        caption += "; ".join(f"R = {ratio_text(R)}: {text}" for R, text in told.items())
    name = f"fig{number:02d}" if number else f"scene-{slug(target)}"
    title = f"Fig. {number}: {target}" if number else f"Scene and reconstructions: {target}"
    alt = f"The scene {target}, PSNR against compression ratio, and reconstructed pictures at R = {listing(map(ratio_text, shown))}."
    png, pdf = save(figure, directory, name)
    return Drawn(name, title, caption + ".", alt, png, pdf)


def draw_pictures(
    gallery: Gallery, target: str, shown: Sequence[float], window: tuple[slice, slice] | None, grid: np.ndarray
) -> dict[float, dict[str, float]]:
    """Fill the grid: a row (and a row of zooms) for each R, a column for truth and each series; return false colour by R."""
    truth = gallery.truth(target).radiance
    false_color: dict[float, dict[str, float]] = {}
    step = 1 if window is None else 2
    for i, R in enumerate(shown):
        false_color[R] = {}
        rows = grid[step * i : step * (i + 1)]
        for column, s in enumerate((None, *SERIES)):
            cube = truth if s is None else gallery.estimate(target, s, R)
            for ax in rows[:, column]:
                picture(ax, color=COLORS[s.key] if s is not None and cube is not None else None)
            if cube is None:
                rows[0, column].text(0.5, 0.5, "not run", ha="center", va="center", transform=rows[0, column].transAxes, color=MUTED)
                continue
            image = gallery.srgb(cube, target)
            rows[0, column].imshow(image)
            value = score(gallery.run, gallery.recipe, target, s, R) if s else None
            rows[0, column].set_title("truth" if s is None else f"{s.short}, {value:.1f} dB" if value is not None else s.short)
            if window is not None:
                rows[1, column].imshow(image[window])
                if s is not None:
                    false_color[R][s.short] = gallery.chroma_error(cube, target, window)
        rows[0, 0].set_ylabel(f"(c) R = {ratio_text(R)}", color=INK)
        if window is not None:
            rows[1, 0].set_ylabel("enlarged", color=MUTED)
    return false_color


def chosen_bands(count: int, pieces: int) -> list[int]:
    """Return ``pieces`` bands, counted from 1, that end at the last: 4, 8 ... 24 for 24 bands in 6 pieces."""
    return sorted({max(1, round(count * (i + 1) / pieces)) for i in range(pieces)})


def figure_errors(gallery: Gallery, target: str, name: str, directory: Path) -> Drawn | None:
    """Draw the absolute error of six bands, a row for each series, on one scale: the paper's Fig. 7."""
    found = series_with_estimates(gallery, target, MAIN_R)
    if target not in gallery.run.truths or not found:
        return None
    truth, bands = gallery.truth(target).radiance, gallery.bands(target)
    numbers = chosen_bands(bands.count, 6)
    index = [n - 1 for n in numbers]
    errors = {}
    for s in found:
        cube = gallery.estimate(target, s, MAIN_R)
        if cube is not None:
            errors[s] = np.abs(cube[..., index] - truth[..., index])
    if not errors:
        return None
    top = max(float(np.quantile(e, 0.995)) for e in errors.values()) or 1.0
    figure = new_figure(10.0, 1.6 * truth.shape[0] / truth.shape[1] * len(errors) + 0.4)
    axes = figure.subplots(len(errors), len(index), squeeze=False)
    image = None
    for row, (s, error) in zip(axes, errors.items()):
        for i, ax in enumerate(row):
            image = ax.imshow(error[..., i], cmap="magma", vmin=0, vmax=top)
            picture(ax)
            ax.set_xlabel(f"mean {sci(float(error[..., i].mean()))}", fontsize=7.5, color=MUTED)
        row[0].set_ylabel(SHORT_NAMES[s.key], color=COLORS[s.key], fontweight="bold")
    for ax, n in zip(axes[0], numbers):
        ax.set_title(f"band {n}: {bands.center[n - 1]:.0f} nm")
    assert image is not None
    bar = figure.colorbar(image, ax=axes, location="right", shrink=0.6, extend="max", aspect=35)
    bar.set_label(f"absolute error of {RADIANCE}")
    means = ", ".join(f"{s.short} {sci(float(e.mean()))}" for s, e in errors.items())
    caption = (
        f"Absolute error of {len(index)} bands of {target} at R = {ratio_text(MAIN_R)}, one scale for all; "
        "it ends at the 99.5th percentile of the worst row. "
        f"Mean over these bands, in the same unit: {means}."
    )
    alt = f"Error maps of {target}: a row for each sensor reading, a column for each of {len(index)} bands."
    png, pdf = save(figure, directory, name)
    return Drawn(name, f"Fig. 7: absolute error, {target}", caption, alt, png, pdf)


def figure_single_shot(gallery: Gallery, target: str, name: str, directory: Path) -> Drawn | None:
    """Draw four bands from a single colour shot, a row for truth and each series: the paper's Fig. 11."""
    from matplotlib.colors import PowerNorm

    found = series_with_estimates(gallery, target, MAIN_R)
    if target not in gallery.run.truths or not found:
        return None
    truth, bands = gallery.truth(target).radiance, gallery.bands(target)
    numbers = chosen_bands(bands.count, 4)
    rows: list[tuple[str, str, np.ndarray]] = [("truth", INK, truth)]
    for s in found:
        cube = gallery.estimate(target, s, MAIN_R)
        if cube is not None:
            rows.append((SHORT_NAMES[s.key], COLORS[s.key], cube))
    tall = truth.shape[0] / truth.shape[1]
    figure = new_figure(9.0, 1.95 * tall * len(rows) + 0.6)
    axes = figure.subplots(len(rows), len(numbers), squeeze=False)
    image = None
    for row, (label, color, cube) in zip(axes, rows):
        for ax, n in zip(row, numbers):
            image = ax.imshow(cube[..., n - 1], cmap="gray", norm=PowerNorm(0.5, vmin=0, vmax=float(truth.max()) or 1.0, clip=True))
            picture(ax)
        row[0].set_ylabel(label, color=color, fontweight="bold")
    for ax, n in zip(axes[0], numbers):
        ax.set_title(f"band {n}: {bands.center[n - 1]:.0f} nm")
    assert image is not None
    bar = figure.colorbar(image, ax=axes, location="right", shrink=0.6, extend="both", aspect=35)
    bar.set_label(RADIANCE)
    caption = f"Bands {listing(map(str, numbers))} of {target} from a single colour shot, or three monochrome shots "
    caption += f"(R = {ratio_text(MAIN_R)}); one scale for all, grey by the square root."
    alt = f"Grey pictures of {len(numbers)} bands of {target}: truth and a row for each sensor reading."
    png, pdf = save(figure, directory, name)
    return Drawn(name, f"Fig. 11: bands from a single colour shot, {target}", caption, alt, png, pdf)
