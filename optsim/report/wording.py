"""Turn scores into clauses: the verb follows the sign, and a gap under 0.05 dB is a tie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from optsim.report.data import BAYER, FOVEON, SERIES, Series
from optsim.report.select import TIE_DB, Recipe, db, listing


def side(gap: float) -> int:
    """Return the sign of a gap in dB, 0 for a tie."""
    return 0 if abs(gap) < TIE_DB else 1 if gap > 0 else -1


def compare(name: str, value: float, others: Sequence[tuple[str, float]]) -> str:
    """Write ``A beats B by x dB and C by y dB``, ``loses to`` or ``ties with``, all in dB."""
    verbs = {1: "beats", 0: "ties with", -1: "loses to"}
    clauses: list[str] = []
    last = None
    for other, reference in others:
        gap = value - reference
        amount = f"({db(gap, sign=True)})" if side(gap) == 0 else f"by {db(abs(gap))}"
        clauses.append(f"{other} {amount}" if side(gap) == last else f"{verbs[side(gap)]} {other} {amount}")
        last = side(gap)
    return f"{name} {listing(clauses)}"


def ordering(scores: Mapping[str, float], numbers: bool = True) -> str:
    """Write the series in ascending order, with their dB; neighbours within 0.05 dB are joined by ≈."""
    ranked = sorted((s for s in SERIES if s.key in scores), key=lambda s: scores[s.key])
    text = ""
    for i, s in enumerate(ranked):
        if i:
            text += " ≈ " if scores[s.key] - scores[ranked[i - 1].key] < TIE_DB else " < "
        text += f"{s.short}\u00a0{scores[s.key]:.2f}" if numbers else s.short
    return f"{text}\u00a0dB" if text and numbers else text


def outcome(scores: Mapping[str, float], mono: Series) -> str | None:
    """Say in one clause how mono stands against the two colour sensors, or None when one was not run."""
    if not {mono.key, BAYER.key, FOVEON.key} <= scores.keys():
        return None
    gaps = {s.short: side(scores[mono.key] - scores[s.key]) for s in (BAYER, FOVEON)}
    signs = set(gaps.values())
    if len(signs) == 1:
        return {1: "mono beats both colour sensors", 0: "mono ties with both colour sensors", -1: "both colour sensors beat mono"}[
            signs.pop()
        ]
    parts = [f"{verb} {name}" for sign, verb in ((1, "beats"), (0, "ties with"), (-1, "loses to")) for name, g in gaps.items() if g == sign]
    return f"mono {parts[0]} but {parts[1]}"


def swaps(reference: Mapping[str, float], other: Mapping[str, float]) -> list[str]:
    """List the pairs of series whose order (or tie) differs between two sets of scores, with both gaps."""
    keys = [s for s in SERIES if s.key in reference and s.key in other]
    found = []
    for i, a in enumerate(keys):
        for b in keys[i + 1 :]:
            first, second = reference[a.key] - reference[b.key], other[a.key] - other[b.key]
            if side(first) != side(second):
                found.append(f"{a.short} − {b.short} is {db(second, sign=True)} instead of {db(first, sign=True)}")
    return found


def few(changes: Sequence[str], most: int = 3, noun: str = "pair") -> str:
    """Join changes, the first ones in full and the rest by number."""
    rest = len(changes) - most
    return "; ".join([*changes[:most], *([f"and {rest} more {noun}{'s' if rest > 1 else ''}"] if rest > 0 else [])])


def recipe_text(recipe: Recipe) -> str:
    """Describe a recipe in words."""
    operator = "" if recipe.model == "matched" else {"unit-shift": ", unit-shift H", "camera": ", the camera’s own H"}[recipe.operator]
    return f"{model_text(recipe.model)}{operator}, {method_text(recipe)}"


def method_text(recipe: Recipe) -> str:
    """Describe solver and tau rule alone."""
    if recipe.tau_rule is None:
        return solver_text(recipe.solver)
    return f"Eq. 4, {solver_text(recipe.solver)}, {'automatic' if recipe.tau_rule == 'auto' else recipe.tau_rule} tau"


def model_text(model: str) -> str:
    """Name the kind of data."""
    return {"matched": "matched data", "physical": "physical data", "physical-interpolated": "physical data from an interpolated cube"}[
        model
    ]


def solver_text(solver: str) -> str:
    """Write a solver's name as prose does."""
    return {"basis-pursuit": "basis pursuit", "gpsr": "GPSR", "admm": "ADMM", "fista": "FISTA"}.get(solver, solver)
