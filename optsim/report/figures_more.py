"""Figures beyond the paper's: measured frames, and spectra of points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, SERIES, Capture, Frames
from optsim.report.figures_target import RADIANCE, window_box
from optsim.report.gallery import Gallery, finest_window
from optsim.report.select import ratio_text
from optsim.report.style import COLORS, DASHES, INK, MUTED, Drawn, new_figure, picture, save
from optsim.report.units import frame_unit
from optsim.report.verdict import MAIN_R
from optsim.report.wording import model_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def frame_image(frames: Frames, shot: int = 0) -> np.ndarray:
    """Return one shot as (y, x) grey or (y, x, 3) colour in 0..1, scaled to the shot's maximum; a mosaic is not interpolated."""
    values = np.clip(np.asarray(frames.values[shot], np.float64), 0, None)
    top = values.max()
    values = values / top if top > 0 else values
    if frames.cfa is not None:
        image = np.zeros((*values.shape[1:], 3))
        np.put_along_axis(image, np.asarray(frames.cfa, np.int64)[..., None], values[0][..., None], axis=2)
        return image
    return np.moveaxis(values, 0, -1) if values.shape[0] == 3 else values[0]


def figure_frames(gallery: Gallery, target: str, directory: Path, model: str = "matched") -> Drawn | None:
    """Draw the first shot of each sensor with an enlarged window; ``model`` names the kind of data as a capture does."""
    captures = {s: Capture(target, s.sensor, s.masks, MAIN_R, model) for s in (MONO_DISTINCT, BAYER, FOVEON)}
    frames = {s: f for s, c in captures.items() if (f := gallery.run.frames(c)) is not None}
    if not frames or target not in gallery.run.truths:
        return None
    window = finest_window(gallery.truth(target).radiance, 0.16)
    figure = new_figure(10.0, 6.1)
    axes = figure.subplots(2, len(frames), squeeze=False)
    for column, (s, f) in enumerate(frames.items()):
        image = frame_image(f)
        grey = np.asarray(f.values[0, 0], np.float64)
        shown = axes[0, column].imshow(
            image if f.values.shape[1] == 3 else grey, cmap="gray", vmin=0, vmax=max(float(f.values[0].max()), 1e-300)
        )
        picture(axes[0, column], {"mono": "monochrome, shot 1", "bayer": "Bayer", "foveon": "Foveon"}[s.sensor])
        axes[1, column].imshow(image[window], cmap="gray", vmin=0, vmax=1)
        picture(
            axes[1, column],
            "enlarged" + {"bayer": ", in the colours of its pixels", "foveon": ", three layers as red, green, blue"}.get(s.sensor, ""),
        )
        window_box(axes[0, column], window, "#FFD400")
        if f.values.shape[1] == 1:
            figure.colorbar(shown, ax=axes[0, column], location="bottom", shrink=0.8, aspect=30).set_label(frame_unit(f.units, model))
        else:
            axes[0, column].set_xlabel("brightest layer value = full scale", color=MUTED)
    shape = next(iter(frames.values())).values.shape
    caption = (
        f"What the sensors record of {target} at R = {ratio_text(MAIN_R)}, {model_text(model)}: {shape[2]} × {shape[3]} pixels, "
        f"{shape[3] - gallery.truth(target).radiance.shape[1]} columns wider than the mask by the dispersion. "
        "Each mirror is open or closed; each band is shifted."
    )
    alt = "One coded frame of each sensor, grey for monochrome and Bayer, coloured for Foveon, with enlarged windows."
    png, pdf = save(figure, directory, "frames")
    return Drawn("frames", "Measured frames", caption, alt, png, pdf)


FLAT = 0.03
SAME_COLOUR = 0.01
"""Angle in radians below which two spectra count as one."""


def telling_points(truth: np.ndarray, count: int = 6, without: np.ndarray | None = None) -> list[tuple[int, int]]:
    """Choose (y, x) inside flat, bright patches, spectrally far apart; fewer in a small picture.

    A pixel is flat when it differs from its 3 x 3 mean by at most 3 % of the level, on average over the bands, or, in a noisy or
    textured picture, by less than most bright pixels do; of these the ones deepest inside their patch are candidates. The
    brightest comes first, each next one is the farthest, in direction, from those already chosen. Pixels ``without`` (y, x)
    of bool, lamps say, are left out.
    """
    from scipy.ndimage import distance_transform_edt, label, maximum, maximum_filter, uniform_filter

    cube = np.asarray(truth, np.float64)
    level = cube.mean(-1)
    mean = uniform_filter(cube, (3, 3, 1), mode="nearest")
    rough = maximum_filter(np.abs(cube - mean).mean(-1), 3)
    norm = np.linalg.norm(mean, axis=-1)
    usable = np.ones(level.shape, bool) if without is None or without.all() else ~maximum_filter(without, 3)
    bright = usable & (norm > 0)
    bright &= level >= 0.15 * np.quantile(level[bright], 0.98) if bright.any() else True
    ratio = rough / np.maximum(level, np.finfo(float).tiny)
    limit = max(FLAT, float(np.quantile(ratio[bright], 0.4))) if bright.any() else 0.0
    flat = bright & (ratio <= limit)
    depth = distance_transform_edt(np.pad(flat, 1))[1:-1, 1:-1] if flat.any() else (norm >= np.median(norm)).astype(float)
    patch, count_of = label(depth > 0)
    deepest = np.append(0.0, maximum(depth, patch, np.arange(1, count_of + 1)))
    where = np.argwhere((depth >= 0.6 * deepest[patch]) & (deepest[patch] >= min(1.0 if limit == FLAT else 2.0, depth.max())))
    where = where[:: max(1, len(where) // 4000)]
    y, x = where.T
    directions = mean[y, x] / np.maximum(norm[y, x], np.finfo(float).tiny)[:, None]
    chosen = [int(np.argmax(level[y, x] * (1 + 1e-6 * depth[y, x])))]
    distance = np.full(len(where), np.inf)
    while len(chosen) < min(count, len(where)):
        distance = np.minimum(distance, np.linalg.norm(directions - directions[chosen[-1]], axis=1))
        if distance.max() <= SAME_COLOUR:
            break
        chosen.append(int(np.argmax(distance)))
    return [(int(y[i]), int(x[i])) for i in chosen]


def spectrum_at(cube: np.ndarray, y: int, x: int) -> np.ndarray:
    """Return the mean spectrum of the 3 x 3 window round a pixel, cut at the picture's edge."""
    return np.asarray(cube[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2], np.float64).mean((0, 1))


def figure_spectra(gallery: Gallery, target: str, directory: Path) -> Drawn | None:
    """Plot the spectra of six points: truth and every series at R = 1/8."""
    if target not in gallery.run.truths:
        return None
    estimates = {s: cube for s in SERIES if (cube := gallery.estimate(target, s, MAIN_R)) is not None}
    if not estimates:
        return None
    truth, bands = gallery.truth(target), gallery.bands(target)
    points = telling_points(truth.radiance)
    figure = new_figure(10.0, 5.2)
    left, right = np.ravel(figure.subfigures(1, 2, width_ratios=[1, 2.6], squeeze=False))
    view = left.subplots()
    view.imshow(gallery.srgb(truth.radiance, target))
    picture(view, target)
    axes = right.subplots(2, 3, sharex=True).ravel()
    for ax in axes[len(points) :]:
        ax.set_axis_off()
    for number, ((y, x), ax) in enumerate(zip(points, axes), start=1):
        mark(view, y, x, number)
        mean = spectrum_at(truth.radiance, y, x)
        ax.plot(bands.center, mean, color=INK, linewidth=2.4, label="truth")
        if truth.stderr is not None:
            error = np.sqrt(spectrum_at(truth.stderr.astype(np.float64) ** 2, y, x) / 9)
            ax.fill_between(bands.center, mean - 2 * error, mean + 2 * error, color=INK, alpha=0.2, linewidth=0)
        for s, cube in estimates.items():
            ax.plot(bands.center, spectrum_at(cube, y, x), color=COLORS[s.key], linestyle=DASHES[s.key], linewidth=1.2, label=s.label)
        ax.set_ylim(min(0, ax.get_ylim()[0]), None)
        ax.set_title(f"{number}", loc="left", fontweight="bold")
        ax.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3))
        if number > 3 or len(points) <= 3:
            ax.set_xlabel("wavelength, nm")
    right.supylabel(RADIANCE, fontsize=9)
    handles, labels = axes[0].get_legend_handles_labels()
    left.legend(handles, labels, loc="lower center")
    caption = (
        f"Spectra of {len(points)} flat places of {target}, means of 3 × 3 pixels, chosen for spectra far apart; R = {ratio_text(MAIN_R)}. "
        "The grey band is ±2 standard errors of the rendered truth, where they are known."
    )
    alt = f"Truth and reconstructed spectra at {len(points)} numbered points of {target}."
    png, pdf = save(figure, directory, "spectra")
    return Drawn("spectra", "Spectra of points", caption, alt, png, pdf)


def mark(axes: Axes, y: int, x: int, number: int, color: str = INK) -> None:
    """Write a number on a picture, readable on any ground, beside its point and inside the picture."""
    from matplotlib.patheffects import withStroke

    axes.plot(x, y, "o", markersize=9, markerfacecolor="none", markeredgecolor="white", markeredgewidth=2.4)
    axes.plot(x, y, "o", markersize=9, markerfacecolor="none", markeredgecolor=color, markeredgewidth=1.3)
    effect = [withStroke(linewidth=2.2, foreground="white")]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    place = (6 if abs(right - x) > 0.08 * abs(right - left) else -13, 5 if abs(top - y) > 0.08 * abs(top - bottom) else -12)
    axes.annotate(str(number), (x, y), place, textcoords="offset points", fontsize=9, fontweight="bold", color=color, path_effects=effect)
