"""Figures beyond the paper's: measured frames, spectra of points, PSNR by band, tau, matched against physical."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, R_TOLERANCE, SERIES, Capture, Frames, RunData, Series, TauScore
from optsim.report.figures_target import RADIANCE, window_box
from optsim.report.gallery import Gallery, finest_window
from optsim.report.select import Recipe, ratio_text, ratios, scores_at
from optsim.report.style import COLORS, DASHES, INK, MARKERS, MUTED, Drawn, log_ticks, new_figure, picture, save
from optsim.report.verdict import MAIN_R
from optsim.report.wording import model_text, recipe_text

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


def figure_frames(gallery: Gallery, target: str, directory: Path) -> Drawn | None:
    """Draw the first shot of each sensor with an enlarged window."""
    captures = {s: Capture(target, s.sensor, s.masks, MAIN_R, "matched") for s in (MONO_DISTINCT, BAYER, FOVEON)}
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
            unit = {"relative": "sum of band radiances, W m⁻² sr⁻¹ nm⁻¹", "electron": "signal, electrons", "DN": "signal, DN"}.get(
                f.units, f.units
            )
            figure.colorbar(shown, ax=axes[0, column], location="bottom", shrink=0.8, aspect=30).set_label(unit)
        else:
            axes[0, column].set_xlabel("brightest layer value = full scale", color=MUTED)
    shape = next(iter(frames.values())).values.shape
    caption = (
        f"What the sensors record of {target} at R = {ratio_text(MAIN_R)}, {model_text('matched')}: {shape[2]} × {shape[3]} pixels, "
        f"{shape[3] - gallery.truth(target).radiance.shape[1]} columns wider than the mask by the dispersion. "
        "Each mirror is open or closed; each band is shifted."
    )
    alt = "One coded frame of each sensor, grey for monochrome and Bayer, coloured for Foveon, with enlarged windows."
    png, pdf = save(figure, directory, "frames")
    return Drawn("frames", "Measured frames", caption, alt, png, pdf)


def telling_points(truth: np.ndarray, count: int = 6) -> list[tuple[int, int]]:
    """Choose (y, x) inside flat, bright patches, spectrally far apart; fewer in a small picture.

    A pixel is flat when it differs from its 3 x 3 mean by at most 3 % of the level, on average over the bands; of these
    the ones deepest inside their patch are candidates. The brightest comes first, each next one is the farthest, in
    direction, from those already chosen.
    """
    from scipy.ndimage import distance_transform_edt, maximum_filter, uniform_filter

    cube = np.asarray(truth, np.float64)
    level = cube.mean(-1)
    mean = uniform_filter(cube, (3, 3, 1), mode="nearest")
    rough = maximum_filter(np.abs(cube - mean).mean(-1), 3)
    norm = np.linalg.norm(mean, axis=-1)
    flat = (rough <= 0.03 * level) & (norm > 0) & (level >= 0.15 * np.quantile(level, 0.98))
    depth = distance_transform_edt(np.pad(flat, 1))[1:-1, 1:-1] if flat.any() else (norm >= np.median(norm)).astype(float)
    where = np.argwhere(depth >= 0.6 * depth.max())
    where = where[:: max(1, len(where) // 4000)]
    y, x = where.T
    directions = mean[y, x] / np.maximum(norm[y, x], np.finfo(float).tiny)[:, None]
    chosen = [int(np.argmax(level[y, x] * (1 + 1e-6 * depth[y, x])))]
    distance = np.full(len(where), np.inf)
    while len(chosen) < min(count, len(where)):
        distance = np.minimum(distance, np.linalg.norm(directions - directions[chosen[-1]], axis=1))
        if distance.max() <= 1e-3:
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
    """Write a number on a picture, readable on any ground."""
    from matplotlib.patheffects import withStroke

    axes.plot(x, y, "o", markersize=9, markerfacecolor="none", markeredgecolor="white", markeredgewidth=2.4)
    axes.plot(x, y, "o", markersize=9, markerfacecolor="none", markeredgecolor=color, markeredgewidth=1.3)
    effect = [withStroke(linewidth=2.2, foreground="white")]
    axes.annotate(str(number), (x, y), (6, 5), textcoords="offset points", fontsize=9, fontweight="bold", color=color, path_effects=effect)


def band_psnr(cube: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the (K,) PSNR of each band in dB, peak = maximum of the true cube; an exact band is NaN (a gap in a curve)."""
    mse = np.mean((cube - truth) ** 2, axis=(0, 1))
    with np.errstate(divide="ignore"):
        value = 10 * np.log10(float(truth.max()) ** 2 / mse)
    return np.where(np.isfinite(value), value, np.nan)


def figure_band_psnr(gallery: Gallery, directory: Path) -> Drawn | None:
    """Plot PSNR by band at R = 1/8 for every target."""
    targets = [t for t in gallery.run.targets if t in gallery.run.truths and scores_at(gallery.run, gallery.recipe, t, MAIN_R)]
    if not targets:
        return None
    figure = new_figure(10.0, 3.5)
    axes = figure.subplots(1, len(targets), squeeze=False)[0]
    for ax, target in zip(axes, targets):
        truth, bands = gallery.truth(target).radiance, gallery.bands(target)
        for s in SERIES:
            cube = gallery.estimate(target, s, MAIN_R)
            if cube is not None:
                ax.plot(
                    bands.center,
                    band_psnr(cube, truth),
                    color=COLORS[s.key],
                    linestyle=DASHES[s.key],
                    marker=MARKERS[s.key],
                    markersize=3.5,
                    label=s.label,
                )
        ax.set_xlabel("wavelength, nm")
        ax.set_title(target)
    axes[0].set_ylabel("PSNR of the band, dB")
    axes[0].legend(loc="best")
    caption = f"PSNR band by band at R = {ratio_text(MAIN_R)}; the peak is the maximum of the whole true cube, "
    caption += "so that a dim band scores higher for the same relative error."
    png, pdf = save(figure, directory, "band-psnr")
    return Drawn("band-psnr", "PSNR by band", caption, "PSNR against wavelength, a line for each sensor reading.", png, pdf)


def figure_tau(gallery: Gallery, directory: Path) -> Drawn | None:
    """Plot PSNR against the tau fraction; mark the automatic and the oracle choice and the level of the main recipe."""
    run = gallery.run
    order = {target: i for i, target in enumerate(run.targets)}
    places = sorted({(p.target, round(p.R, 9)) for p in run.tau_path}, key=lambda place: (order.get(place[0], len(order)), place[1]))
    if not places:
        return None
    columns = min(2, len(places))
    lines = -(-len(places) // columns)
    figure = new_figure(10.0, 3.1 * lines + 0.5)
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    for ax in axes[len(places) :]:
        ax.set_axis_off()
    for ax, (target, R) in zip(axes, places):
        for s in SERIES:
            path = [p for p in run.tau_path if (p.target, p.sensor, p.masks) == (target, s.sensor, s.masks) and abs(p.R - R) < R_TOLERANCE]
            draw_tau_path(ax, run, s, path)
            level = scores_at(run, gallery.recipe, target, R).get(s.key)
            if level is not None and path:
                ax.axhline(level, color=COLORS[s.key], linewidth=0.8, linestyle=(0, (1, 2)))
        log_ticks(ax)
        ax.set_title(f"{target}, R = {ratio_text(R)}")
        ax.set_xlabel("tau / tau_max")
        ax.set_ylabel("mean PSNR, dB")
    axes[0].plot([], [], "o", markersize=11, markerfacecolor="none", markeredgecolor=INK, label="automatic tau")
    axes[0].plot([], [], "*", markersize=11, color=INK, label="oracle tau")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(labels)))
    main = recipe_text(gallery.recipe) if gallery.recipe else "the main recipe"
    caption = (
        "Eq. 4 solved along a path of tau (from tau_max on, the zero cube is optimal). Rings: the tau chosen without the truth; "
        f"stars: the best on the path. Dotted: {main}."
    )
    png, pdf = save(figure, directory, "tau")
    return Drawn(
        "tau",
        "How the score depends on tau",
        caption,
        "PSNR against tau fraction for each sensor reading, with chosen values marked.",
        png,
        pdf,
    )


def draw_tau_path(axes: Axes, run: RunData, s: Series, path: Sequence[TauScore]) -> None:
    """Plot one path and the marks of the rows that chose a tau on it."""
    known = sorted((p.tau, p.tau_fraction, p.psnr_db) for p in path if p.psnr_db is not None)
    if not known:
        return
    color, first = COLORS[s.key], path[0]
    _, fraction, psnr = zip(*known)
    axes.plot(fraction, psnr, color=color, linestyle=DASHES[s.key], marker=MARKERS[s.key], markersize=4, label=s.label)
    for row in run.rows:
        same = row.series == s and row.target == first.target and abs(row.R - first.R) < R_TOLERANCE and row.model == "matched"
        if not same or row.tau is None or row.tau_rule is None:
            continue
        _, (tau, x, y) = min((abs(point[0] - row.tau), point) for point in known)
        if abs(tau - row.tau) <= 1e-6 * row.tau:
            ring = row.tau_rule == "auto"
            marker, face = ("o", "none") if ring else ("*", color)
            axes.plot([x], [y], marker, color=color, markerfacecolor=face, markersize=11, zorder=5)


def figure_matched(gallery: Gallery, directory: Path) -> Drawn | None:
    """Compare matched data with physical data inverted by unit shifts and by the camera's own."""
    run, main = gallery.run, gallery.recipe
    models = list(dict.fromkeys(row.model for row in run.rows if row.model != "matched"))
    if not models or main is None:
        return None
    recipes = {"matched data, unit-shift H": replace(main, model="matched", operator="unit-shift")}
    for model in models:
        recipes[f"{model_text(model)}, unit-shift H"] = replace(main, model=model, operator="unit-shift")
        recipes[f"{model_text(model)}, the camera’s own H"] = replace(main, model=model, operator="camera")
    places = [(t, R) for t in run.targets for R in ratios(run, Recipe(models[0], "unit-shift", main.solver, main.tau_rule), t)]
    if not places:
        return None
    figure = new_figure(10.0, 3.7)
    axes = figure.subplots(1, len(places), squeeze=False)[0]
    fills = ("#1b1f24", "#8d99a6", "#c8a14b", "#5d4b7a", "#b9a3d6")
    width = 0.8 / len(recipes)
    for ax, (target, R) in zip(axes, places):
        for i, (label, recipe) in enumerate(recipes.items()):
            values = scores_at(run, recipe, target, R)
            at = [j + (i - (len(recipes) - 1) / 2) * width for j, s in enumerate(SERIES) if s.key in values]
            heights = [values[s.key] for s in SERIES if s.key in values]
            bars = ax.bar(at, heights, width * 0.92, color=fills[i % 5], label=label)
            ax.bar_label(bars, fmt="%.1f", fontsize=6.5, padding=1.5)
        ax.set_xticks(range(len(SERIES)), [s.short.replace(" ", "\n") for s in SERIES])
        ax.set_title(f"{target}, R = {ratio_text(R)}")
        ax.grid(axis="x", visible=False)
        ax.margins(y=0.1)
    axes[0].set_ylabel("mean PSNR, dB")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    caption = "What the matched set-up hides: data made by the very H that inverts them, against data of the traced prism "
    caption += "inverted with unit shifts and with the camera’s own."
    png, pdf = save(figure, directory, "matched")
    return Drawn(
        "matched", "Matched against physical data", caption, "Bars of PSNR for matched and physical data, by sensor reading.", png, pdf
    )
