"""Hold what one finding of the page says, and write the cells of its table."""

from __future__ import annotations

from dataclasses import dataclass

from optsim.report.data import SERIES, RunData
from optsim.report.select import Recipe, pick, score

EARLY = "*"
"""Marks a number that a solve stopped before its tolerance stands behind."""


@dataclass(frozen=True)
class Finding:
    """Hold one finding: a label, a sentence or two, short points as a list, and a small table (each may be empty)."""

    label: str
    text: str = ""
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    points: tuple[str, ...] = ()


def cells(run: RunData, recipe: Recipe, target: str, R: float) -> tuple[str, ...]:
    """Write a score a series, two decimals, with a mark when a solve behind it stopped before its tolerance."""
    found = []
    for s in SERIES:
        value = score(run, recipe, target, s, R)
        early = any(row.converged is False for row in pick(run, recipe, target, s, R))
        found.append("not run" if value is None else f"{value:.2f}{EARLY if early else ''}")
    return tuple(found)
