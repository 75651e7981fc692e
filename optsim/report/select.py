"""Find scores among the rows of a run, and write numbers as the page writes them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from optsim.report.data import R_TOLERANCE, SERIES, Row, RunData, Series

TIE_DB = 0.05
"""Two scores closer than this are a tie."""


@dataclass(frozen=True)
class Recipe:
    """Say how an estimate was made: data model, operator, solver, tau rule."""

    model: str
    operator: str
    solver: str
    tau_rule: str | None

    def matches(self, row: Row) -> bool:
        """Tell whether a row was made this way."""
        return (row.model, row.operator, row.solver, row.tau_rule) == (self.model, self.operator, self.solver, self.tau_rule)


def main_recipe(run: RunData) -> Recipe | None:
    """Return the recipe of the main comparison: matched basis pursuit if it was run, else the first row's."""
    best = Recipe("matched", "unit-shift", "basis-pursuit", None)
    if any(best.matches(row) for row in run.rows):
        return best
    if not run.rows:
        return None
    row = run.rows[0]
    return Recipe(row.model, row.operator, row.solver, row.tau_rule)


def pick(run: RunData, recipe: Recipe | None, target: str, series: Series | None = None, R: float | None = None) -> list[Row]:
    """Return the rows of a recipe and target; a series or a ratio narrows further."""
    return [
        row
        for row in run.rows
        if recipe is not None
        and recipe.matches(row)
        and row.target == target
        and (series is None or row.series == series)
        and (R is None or abs(row.R - R) <= R_TOLERANCE)
    ]


def score(run: RunData, recipe: Recipe | None, target: str, series: Series, R: float) -> float | None:
    """Return the PSNR in dB, averaged over seeds, or None when it was not run (or is exact)."""
    values = [row.psnr_db for row in pick(run, recipe, target, series, R) if row.psnr_db is not None]
    return sum(values) / len(values) if values else None


def ratios(run: RunData, recipe: Recipe | None, target: str) -> list[float]:
    """Return the compression ratios that a target was run at, ascending."""
    found: list[float] = []
    for R in sorted(row.R for row in pick(run, recipe, target)):
        if not found or R - found[-1] > R_TOLERANCE:
            found.append(R)
    return found


def scores_at(run: RunData, recipe: Recipe | None, target: str, R: float) -> dict[str, float]:
    """Return series key -> PSNR in dB for the series that were run."""
    found = {s.key: score(run, recipe, target, s, R) for s in SERIES}
    return {key: value for key, value in found.items() if value is not None}


def ratio_text(R: float) -> str:
    """Write a compression ratio as a small fraction: 0.375 -> 3/8."""
    f = Fraction(R).limit_denominator(96)
    return str(f) if abs(float(f) - R) < 1e-4 else f"{R:.3g}"


def db(value: float, sign: bool = False) -> str:
    """Write decibels: one decimal from 1 dB on, two below; a true minus sign."""
    size = abs(value)
    digits = 1 if size >= 0.995 else 2
    text = f"{size:.{digits}f}"
    if float(text) == 0:
        return f"{'±' if sign else ''}{text} dB"
    return f"{'−' if value < 0 else '+' if sign else ''}{text} dB"


def span_text(values: Sequence[float], sign: bool = True) -> str:
    """Write the range of some decibel values, shortest way."""
    low, high = min(values), max(values)
    return db(low, sign) if db(low, sign) == db(high, sign) else f"{db(low, sign).removesuffix(' dB')} to {db(high, sign)}"


def listing(items: Iterable[str], last: str = "and") -> str:
    """Join words: a, b and c."""
    words = list(items)
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else ""
