"""Write a run's report: figures beside it, and one page that holds them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from optsim.report.data import RunData
from optsim.report.figures import draw_figures
from optsim.report.page import render_page


def write_report(run: RunData, directory: Path, progress: Callable[[str, int, int], None] | None = None) -> Path:
    """Draw DIR/figures/*.png and *.pdf, write DIR/report.html and return its path; older ones are replaced.

    Args:
        run: what the run found; pieces that are missing are named on the page.
        directory: made if absent.
        progress: called with (what, done, total) before each figure.

    Raises:
        InputError: when an estimate is not finite or of another shape than its truth.
    """
    directory.mkdir(parents=True, exist_ok=True)
    drawn = draw_figures(run, directory / "figures", progress)
    page = directory / "report.html"
    unfinished = directory / ".report.html.tmp"
    unfinished.write_text(render_page(run, drawn), "utf-8")
    unfinished.replace(page)
    return page
