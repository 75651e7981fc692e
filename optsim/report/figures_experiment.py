"""Figures of the experiment: spectral signatures of reference points against the truth (the paper's Fig. 10 b, c)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from optsim.report.data import Series
from optsim.report.select import ratio_text
from optsim.report.style import COLORS, DASHES, INK, MARKERS, Drawn, new_figure, save

Spectra = Mapping[tuple[str, float], Sequence[float]]
"""(series key, R) -> radiance in every band."""


def figure_signatures(
    wavelength_nm: Sequence[float],
    truths: Mapping[str, Sequence[float]],
    seen: Mapping[str, Spectra],
    series: Sequence[Series],
    ratios: Sequence[float],
    directory: Path,
) -> Drawn:
    """Draw a row for each R, a column for each reference point: the truth and every sensor's estimate.

    Args:
        wavelength_nm: of the bands.
        truths: point -> true radiance.
        seen: point -> estimates.
        series, ratios: in the order of drawing.
        directory: where the files go.
    """
    figure = new_figure(10.0, 3.2 * len(ratios) + 0.3)
    axes = figure.subplots(len(ratios), len(truths), sharex=True, squeeze=False)
    for row, R in zip(axes, ratios):
        for ax, (point, truth) in zip(row, truths.items()):
            ax.plot(wavelength_nm, truth, color=INK, linewidth=2.4, label="truth")
            for s in series:
                values = seen[point].get((s.key, R))
                if values is not None:
                    look = {"linestyle": DASHES[s.key], "marker": MARKERS[s.key]}
                    ax.plot(wavelength_nm, values, color=COLORS[s.key], markersize=3.2, linewidth=1.2, label=s.label, **look)
            ax.set_title(f"{point}, R = {ratio_text(R)}", loc="left")
            ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
        row[0].set_ylabel("radiance, W m⁻² sr⁻¹ nm⁻¹")
    for ax in axes[-1]:
        ax.set_xlabel("wavelength, nm")
    axes[0, 0].legend(loc="best", fontsize=7.5)
    png, pdf = save(figure, directory, "fig10bc")
    caption = (
        "Mean spectrum of 3 × 3 pixels at the front of the green chest and of the red helmet: "
        "the scene’s truth and what each sensor recovers."
    )
    alt = "Spectra of two points: truth and four estimates each."
    return Drawn("fig10bc", "Fig. 10 b, c: spectral signatures", caption, alt, png, pdf)
