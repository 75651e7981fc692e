"""Say where SSIM and the spectral angle order the sensors otherwise than PSNR does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

from optsim.report.data import R_TOLERANCE, SERIES, Row, RunData, Series
from optsim.report.finding import Finding
from optsim.report.select import Recipe, listing, pick, ratio_text, ratios, scores_at
from optsim.report.wording import side

LABEL = "By other scores"


@dataclass(frozen=True)
class Score:
    """Hold a score other than PSNR: how to read, to sign (+1: more is better) and to write it; smaller gaps than ``tie`` are ties."""

    name: str
    read: Callable[[Row], float | None]
    sign: int
    tie: float
    write: Callable[[float], str]


SCORES = (
    Score("SSIM", lambda row: row.ssim, 1, 0.0005, lambda v: f"{v:.3f}"),
    Score("mean spectral angle", lambda row: row.sam_deg, -1, 0.005, lambda v: f"{v:.2f}°"),
)


def values(run: RunData, recipe: Recipe, place: tuple[str, float], score: Score) -> dict[str, float]:
    """Return series key -> score averaged over seeds, for the series that were run."""
    found = {}
    for s in SERIES:
        known = [v for row in pick(run, recipe, place[0], s, place[1]) if (v := score.read(row)) is not None]
        if known:
            found[s.key] = sum(known) / len(known)
    return found


def reversals(
    run: RunData, recipe: Recipe, places: list[tuple[str, float]], score: Score
) -> dict[tuple[Series, Series], list[tuple[str, float]]]:
    """Return (better, worse by this score) -> the (target, R) at which PSNR says the opposite."""
    found: dict[tuple[Series, Series], list[tuple[str, float]]] = {}
    for place in places:
        psnr, other = scores_at(run, recipe, *place), values(run, recipe, place, score)
        for a, b in combinations([s for s in SERIES if s.key in psnr and s.key in other], 2):
            gap = score.sign * (other[a.key] - other[b.key])
            if abs(gap) < score.tie or side(psnr[a.key] - psnr[b.key]) * gap >= 0:
                continue
            found.setdefault((a, b) if gap > 0 else (b, a), []).append(place)
    return found


def where_text(where: list[tuple[str, float]], places: list[tuple[str, float]]) -> str:
    """Name the (target, R) of a list, or say that they are all."""
    if len(where) == len(places):
        return (
            f"at all {len(places)} combinations of target and R" if len(places) > 1 else f"on {where[0][0]}, R = {ratio_text(where[0][1])}"
        )
    targets = dict.fromkeys(target for target, _ in where)
    return "on " + "; ".join(f"{t}, R = {listing(ratio_text(r) for name, r in where if name == t)}" for t in targets)


def other_scores(run: RunData, recipe: Recipe, R: float) -> Finding:
    """Say at which targets and R the other scores reverse a pair of PSNR's order, with the numbers at one R."""
    places = [(target, r) for target in run.targets for r in ratios(run, recipe, target)]
    points = []
    rows = []
    for score in SCORES:
        known = [p for p in places if len(scores_at(run, recipe, *p).keys() & values(run, recipe, p, score).keys()) > 1]
        if not known:
            continue
        found = reversals(run, recipe, known, score)
        for (better, worse), where in found.items():
            shown = []
            for place in where:
                if abs(place[1] - R) <= R_TOLERANCE:
                    at = values(run, recipe, place, score)
                    shown.append(f"{place[0]} {score.write(at[better.key])} against {score.write(at[worse.key])}")
            numbers = f" (R = {ratio_text(R)}: {'; '.join(shown)})" if shown else ""
            points.append(f"By {score.name}, {better.short} beats {worse.short}, which leads by PSNR, {where_text(where, known)}{numbers}.")
        if not found:
            points.append(f"By {score.name} no pair is ordered against PSNR at any target and R.")
        for place in known:
            if abs(place[1] - R) <= R_TOLERANCE:
                at = values(run, recipe, place, score)
                rows.append((place[0], score.name, *(score.write(at[s.key]) if s.key in at else "not run" for s in SERIES)))
    header = (f"R = {ratio_text(R)}", "score", *(s.short for s in SERIES))
    return Finding(LABEL, "", header if rows else (), tuple(rows), tuple(points))
