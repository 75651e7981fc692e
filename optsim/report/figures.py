"""Draw every figure that a run has data for, as PNG and PDF."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from optsim.report import figures_model, figures_more, figures_scores, figures_target
from optsim.report.claims import TARGET_1, TARGET_2
from optsim.report.data import RunData
from optsim.report.gallery import Gallery
from optsim.report.style import Drawn, slug, styled

Builder = Callable[[Path], Drawn | None]


def builders(gallery: Gallery) -> Iterator[tuple[str, Builder]]:
    """Yield (name, builder) of each figure in the order of the page."""
    run = gallery.run
    numbers = {TARGET_1: 5, TARGET_2: 6}
    yield "Fig. 2", figures_model.figure_2
    yield "Fig. 3", partial(figures_model.figure_3, run)
    yield "Fig. 4", figures_model.figure_4
    for target in run.targets:
        number = numbers.get(target)
        scene = f"Fig. {number}" if number else f"scene {target}"
        yield scene, partial(figures_target.figure_scene, gallery, target, number, target != TARGET_1)
    for i, target in enumerate(run.targets):
        yield f"Fig. 7, {target}", partial(figures_target.figure_errors, gallery, target, stem("fig07", i, target))
    for i, target in enumerate(run.targets):
        yield f"Fig. 11, {target}", partial(figures_target.figure_single_shot, gallery, target, stem("fig11", i, target))
    for target in run.targets[:1]:
        yield "frames", partial(figures_more.figure_frames, gallery, target)
        yield "spectra", partial(figures_more.figure_spectra, gallery, target)
    yield "PSNR by band", partial(figures_scores.figure_band_psnr, gallery)
    yield "tau", partial(figures_scores.figure_tau, gallery)
    yield "matched", partial(figures_scores.figure_matched, gallery)
    yield "prism", partial(figures_model.figure_prism, run)


def stem(prefix: str, index: int, target: str) -> str:
    """Return a file stem that no name of a target can break or repeat."""
    return prefix if index == 0 else f"{prefix}-{index + 1}-{slug(target)}"


def draw_figures(run: RunData, directory: Path, progress: Callable[[str, int, int], None] | None = None) -> tuple[Drawn, ...]:
    """Draw all figures of a run into a directory.

    Args:
        run: the run; what it lacks is not drawn.
        directory: made if absent; NAME.png and NAME.pdf are overwritten.
        progress: called with (name, done, total) before each figure.
    """
    drawn = []
    with styled():
        plan = list(builders(Gallery(run)))
        for i, (name, build) in enumerate(plan):
            if progress is not None:
                progress(name, i, len(plan))
            result = build(directory)
            if result is not None:
                drawn.append(result)
    return tuple(drawn)
