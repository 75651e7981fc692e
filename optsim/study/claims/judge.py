"""From measured differences to verdicts: one of three words a claim and reading, and one for the claim over all readings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from optsim.report.select import ratio_text
from optsim.study.claims.measures import Table
from optsim.study.claims.paper import CLAIMS, PaperClaim
from optsim.study.claims.readings import Reading
from optsim.study.plan import BANDS, MONO_SHOTS_PER_GROUP
from optsim.study.statistics import Estimate, holm, paired_estimate, weakest

LEVEL = 0.05
"""Chance of any false "holds" among the readings of one claim."""


CLEAR = 0.7
"""A condition is named when so large a part of the readings that meet it hold, and at most the rest of the others."""
FEWEST = 3
"""Readings that must meet a condition, and that must miss it, before it is named: fewer show nothing but themselves."""


class Verdict(Enum):
    """What became of a claim."""

    HOLDS = "holds"
    ONLY_IF = "holds_only_if"
    DOES_NOT = "does_not_hold"


@dataclass(frozen=True)
class Judged:
    """One claim under one reading.

    Args:
        claim: which.
        reading: which.
        where: R and size, as a table has it.
        groups: colour shots; None: over several R.
        estimate: the number with its interval; of several parts the weakest.
        p: Holm's, over the readings of its claim.
        verdict: ``ONLY_IF`` here: it is above 0, but not of the claimed size.
    """

    claim: PaperClaim
    reading: Reading
    where: str
    groups: int | None
    estimate: Estimate
    p: float = 1.0
    verdict: Verdict = Verdict.DOES_NOT

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object of this row."""
        e = self.estimate
        return _entry(self.claim, f"{self.reading.name}; {self.where}", e, self.verdict)


@dataclass(frozen=True)
class Overall:
    """One claim over all its readings.

    Args:
        claim: which.
        verdict: over all.
        words: under which condition.
        best: the reading that stands for it.
        counts: how many readings hold, hold in sign only, do not hold.
    """

    claim: PaperClaim
    verdict: Verdict
    words: str
    best: Judged
    counts: tuple[int, int, int]

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object of this claim."""
        return _entry(self.claim, f"overall: {self.words}", self.best.estimate, self.verdict)


def _entry(claim: PaperClaim, reading: str, e: Estimate, verdict: Verdict) -> dict[str, Any]:
    return {
        "id": claim.ident,
        "claim": claim.text,
        "reading": reading,
        "value_db": e.mean,
        "interval_db": [e.low, e.high],
        "verdict": verdict.value,
    }


def judge(tables: Sequence[Table], seed: int) -> list[Judged]:
    """Judge every claim under every reading that bears on it; the p values of a claim are corrected over all its readings."""
    found = list(_once(row for table in tables for row in _measured(table, seed)))
    adjusted: dict[int, float] = {}
    for claim in CLAIMS:
        mine = [i for i, row in enumerate(found) if row.claim is claim]
        adjusted |= dict(zip(mine, holm([found[i].estimate.p for i in mine])))
    return [_decided(row, adjusted[i]) for i, row in enumerate(found)]


def _once(rows: Iterable[Judged]) -> Iterator[Judged]:
    """Leave out what another reading of mono repeats: a claim without mono is the same claim."""
    seen = set()
    for row in rows:
        key = (row.claim.ident, row.reading.data, row.reading.change, row.where)
        if "mono" in row.claim.measure.sensors or key not in seen:
            yield row
        seen.add(key)


def _decided(row: Judged, p: float) -> Judged:
    """Return a row with its verdict."""
    met = row.claim.size.met(row.estimate.low, row.estimate.high)
    shown = p < LEVEL and row.estimate.mean > 0
    return replace(row, p=p, verdict=(Verdict.HOLDS if met else Verdict.ONLY_IF) if shown else Verdict.DOES_NOT)


def _measured(table: Table, seed: int) -> list[Judged]:
    found = []
    groups = sorted({g for scene in table.scenes for g in table.groups(scene)})
    size = f"{table.size} x {table.size}"
    for claim in CLAIMS:
        if not claim.measure.sensors & table.reading.touched:
            continue
        for g in groups if claim.measure.steady else groups[:1]:
            parts = list(claim.measure.parts(table, g))
            if parts:
                R = f"R = {ratio_text(MONO_SHOTS_PER_GROUP * g / BANDS)}" if claim.measure.steady else "from R to R"
                found.append(
                    Judged(claim, table.reading, f"{R}, {size}", g if claim.measure.steady else None, paired_estimate(weakest(parts), seed))
                )
    return found


def overall(rows: Sequence[Judged]) -> list[Overall]:
    """Say of each claim whether it holds under every reading, under some, or under none."""
    found = []
    for claim in CLAIMS:
        mine = [row for row in rows if row.claim.ident == claim.ident]
        if mine:
            found.append(_over(claim, mine))
    return found


def _over(claim: PaperClaim, rows: Sequence[Judged]) -> Overall:
    counts = tuple(sum(row.verdict is v for row in rows) for v in (Verdict.HOLDS, Verdict.ONLY_IF, Verdict.DOES_NOT))
    assert len(counts) == 3
    signed = [row for row in rows if row.verdict is not Verdict.DOES_NOT]
    full = [row for row in rows if row.verdict is Verdict.HOLDS]
    if len(full) == len(rows):
        return Overall(claim, Verdict.HOLDS, f"under all {len(rows)} readings", rows[0], counts)
    if not signed:
        return Overall(claim, Verdict.DOES_NOT, f"under none of {len(rows)} readings", rows[0], counts)
    best = min(full or signed, key=lambda row: (not row.reading.base, row.groups != 1))
    condition = _condition(rows, [row.verdict is not Verdict.DOES_NOT for row in rows])
    size = f"of the claimed size ({claim.size}) under {len(full)}" if claim.size.high is not None or claim.size.low > 0 else ""
    words = f"{condition} ({len(signed)} of {len(rows)} readings{', ' + size if size else ''})"
    return Overall(claim, Verdict.ONLY_IF, words, best, counts)


def _condition(rows: Sequence[Judged], good: Sequence[bool]) -> str:
    """Name the condition that sorts the readings best: mask rule, data, both, or the readings themselves."""
    if all(good):
        return "its sign under every reading"
    traits: list[tuple[str, Mapping[str, Any]]] = [
        (f"if the masks are {mono}", {"mono": mono}) for mono in dict.fromkeys(r.reading.mono.masks for r in rows)
    ]
    traits += [(f"if the data are {data}", {"data": data}) for data in dict.fromkeys(r.reading.data for r in rows)]
    traits += [(f"{a} and {b.removeprefix('if ')}", {**x, **y}) for a, x in traits for b, y in traits if "mono" in x and "data" in y]

    def inside(row: Judged, trait: Mapping[str, Any]) -> bool:
        own = {"mono": row.reading.mono.masks, "data": row.reading.data}
        return all(own[key] == value for key, value in trait.items())

    def agreement(trait: Mapping[str, Any]) -> float:
        return sum(inside(row, trait) == g for row, g in zip(rows, good)) / len(rows)

    shown = [t for t in traits if FEWEST <= sum(inside(row, t[1]) for row in rows) <= len(rows) - FEWEST]
    if shown:
        words, trait = max(shown, key=lambda t: agreement(t[1]))
        held = sum(g for row, g in zip(rows, good) if inside(row, trait))
        total = sum(inside(row, trait) for row in rows)
        others, rest = sum(good) - held, len(rows) - total
        if agreement(trait) == 1:
            return words
        if held >= CLEAR * total and others <= (1 - CLEAR) * rest:
            return f"{words}: {held} of {total} such readings, {others} of the {rest} others"
    return "under single readings, see the table"
