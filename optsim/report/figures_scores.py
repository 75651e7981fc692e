"""Figures of scores: PSNR by band, PSNR against tau, matched against physical data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.report.data import R_TOLERANCE, SERIES, RunData, Series, TauScore
from optsim.report.gallery import Gallery
from optsim.report.select import Recipe, pick, ratio_text, scores_at
from optsim.report.style import COLORS, DASHES, INK, MARKERS, Drawn, log_ticks, new_figure, save
from optsim.report.verdict import MAIN_R
from optsim.report.wording import method_text, model_text, recipe_text, solver_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
    paths = [p for p in run.tau_path if (p.model, p.operator) == ("matched", "unit-shift")]
    order = {target: i for i, target in enumerate(run.targets)}
    places = sorted({(p.target, round(p.R, 9), p.solver) for p in paths}, key=lambda place: (order.get(place[0], len(order)), *place[1:]))
    if not places:
        return None
    columns = min(3, max(sum(place[0] == target for place in places) for target in order))
    lines = -(-len(places) // columns)
    figure = new_figure(10.0, 2.9 * lines + 0.5)
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    for ax in axes[len(places) :]:
        ax.set_axis_off()
    for ax, (target, R, solver) in zip(axes, places):
        for s in SERIES:
            here = [p for p in paths if (p.target, p.sensor, p.masks, p.solver) == (target, s.sensor, s.masks, solver)]
            draw_tau_path(ax, run, s, [p for p in here if abs(p.R - R) < R_TOLERANCE])
            level = scores_at(run, gallery.recipe, target, R).get(s.key)
            if level is not None and here:
                ax.axhline(level, color=COLORS[s.key], linewidth=0.8, linestyle=(0, (1, 2)))
        log_ticks(ax)
        ax.set_title(f"{target}, R = {ratio_text(R)}, {solver_text(solver)}")
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
    if not known or len({tau for tau, _, _ in known}) < len(known):
        return  # nothing to draw, or two paths under one name
    color, first = COLORS[s.key], path[0]
    _, fraction, psnr = zip(*known)
    axes.plot(fraction, psnr, color=color, linestyle=DASHES[s.key], marker=MARKERS[s.key], markersize=4, label=s.label)
    recipes = {rule: Recipe(first.model, first.operator, first.solver, rule) for rule in ("auto", "oracle")}
    for rule, (marker, face) in {"auto": ("o", "none"), "oracle": ("*", color)}.items():
        for row in pick(run, recipes[rule], first.target, s, first.R):
            if row.tau is None:
                continue
            tau, x, y = min(known, key=lambda point, wanted=row.tau: abs(point[0] - wanted))  # type: ignore[misc]
            if abs(tau - row.tau) <= 1e-6 * row.tau:
                axes.plot([x], [y], marker, color=color, markerfacecolor=face, markersize=11, zorder=5)


def figure_matched(gallery: Gallery, directory: Path) -> Drawn | None:
    """Compare matched data with physical data inverted by unit shifts and by the camera's own, solver by solver."""
    run = gallery.run
    physical = [row for row in run.rows if row.model != "matched" and row.series is not None]
    methods = list(dict.fromkeys((row.solver, row.tau_rule) for row in physical))
    methods = [(solver, rule) for solver, rule in methods if rule != "oracle" or (solver, "auto") not in methods]
    places = list(dict.fromkeys((row.target, row.R) for row in physical))
    if not physical:
        return None
    figure = new_figure(10.0, 2.7 * len(methods) + 0.5)
    axes = figure.subplots(len(methods), len(places), squeeze=False, sharey=False)
    for line, (solver, rule) in zip(axes, methods):
        for ax, (target, R) in zip(line, places):
            draw_matched(ax, run, target, R, Recipe("matched", "unit-shift", solver, rule))
        line[0].set_ylabel("mean PSNR, dB")
    handles = {label: handle for ax in axes.ravel() for handle, label in zip(*ax.get_legend_handles_labels())}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3)
    caption = "What the matched set-up hides: data made by the very H that inverts them, against data of the traced prism "
    caption += "inverted with unit shifts and with the camera’s own."
    png, pdf = save(figure, directory, "matched")
    return Drawn(
        "matched", "Matched against physical data", caption, "Bars of PSNR for matched and physical data, by sensor reading.", png, pdf
    )


def draw_matched(axes: Axes, run: RunData, target: str, R: float, matched: Recipe) -> None:
    """Draw the bars of one target, R and solver: matched, then each kind of physical data with each operator."""
    recipes = {"matched data, unit-shift H": matched}
    for model in dict.fromkeys(row.model for row in run.rows if row.model != "matched"):
        recipes[f"{model_text(model)}, unit-shift H"] = replace(matched, model=model)
        recipes[f"{model_text(model)}, the camera’s own H"] = replace(matched, model=model, operator="camera")
    fills = ("#1b1f24", "#8d99a6", "#c8a14b", "#5d4b7a", "#b9a3d6")
    width = 0.8 / len(recipes)
    for i, (label, recipe) in enumerate(recipes.items()):
        values = scores_at(run, recipe, target, R)
        at = [j + (i - (len(recipes) - 1) / 2) * width for j, s in enumerate(SERIES) if s.key in values]
        bars = axes.bar(at, [values[s.key] for s in SERIES if s.key in values], width * 0.92, color=fills[i % 5], label=label)
        axes.bar_label(bars, fmt="%.1f", fontsize=6.5, padding=1.5)
    axes.set_xticks(range(len(SERIES)), [s.short.replace(" ", "\n") for s in SERIES])
    axes.set_title(f"{target}, R = {ratio_text(R)}, {method_text(matched)}")
    axes.set_xlim(-0.6, len(SERIES) - 0.4)
    axes.grid(axis="x", visible=False)
    axes.margins(y=0.1)
