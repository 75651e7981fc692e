"""Figures, one offline page and quick pictures: what a run found, in numbers that the run computed.

``write_report`` loads matplotlib when first called; ``optsim.report.data`` is the contract with the study, and
``optsim.report.show.show`` draws one file.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from optsim.report.data import RunData
    from optsim.report.verdict import Verdict

__all__ = ["make_verdict", "write_report"]


def write_report(run: RunData, directory: Path, progress: Callable[[str, int, int], None] | None = None) -> Path:
    """Write DIR/report.html and DIR/figures: see :func:`optsim.report.write.write_report`."""
    from optsim.report import write

    return write.write_report(run, directory, progress)


def make_verdict(run: RunData) -> Verdict:
    """Return the headline of a run in words: see :func:`optsim.report.verdict.make_verdict`."""
    from optsim.report import verdict

    return verdict.make_verdict(run)
