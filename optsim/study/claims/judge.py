"""From measured differences to verdicts: what each case shows, and a word for each claim over base readings and over all cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from optsim.report.select import listing, ratio_text
from optsim.study.claims.captures import Lit
from optsim.study.claims.conditions import Traits, condition
from optsim.study.claims.measures import Table
from optsim.study.claims.paper import CLAIMS, PaperClaim
from optsim.study.claims.readings import Reading
from optsim.study.plan import ratio_of, shots_of
from optsim.study.statistics import Estimate, holm, mean_of, one_sided_p, paired_estimate, weakest

LEVEL = 0.05
"""Chance of any false "sign shown" among the cases of one family: those of a claim under the bases, or under changed readings."""
BASES, EVERY = "base readings", "all cases"
EXAMPLES = 3
"""Cases that are named where no condition sorts them."""


class Verdict(Enum):
    """What became of a claim, in the words of the JSON object."""

    HOLDS = "holds"
    ONLY_IF = "holds_only_if"
    DOES_NOT = "does_not_hold"


class Outcome(Enum):
    """What one case shows."""

    HOLDS = "holds"
    SIGN = "sign only"
    OPPOSITE = "opposite sign"
    UNDECIDED = "not decided"


@dataclass(frozen=True)
class Judged:
    """One claim in one case: under one reading, at one R and size.

    Args:
        claim: which.
        reading: which.
        where: R and size, or the shots where they are not those of one R, as a table has it.
        groups: colour shots; None: over several R.
        estimate: the number with its interval; of several parts the weakest.
        fits: whether the size is met: the mean of every part lies in the claimed range.
        p: of "not above 0", by Holm over its family.
        p_opposite: of "not below 0", alike.
        equal: whether the compared sensors' shots belong to one R.
        alike: changes of other readings whose solves are the same.
    """

    claim: PaperClaim
    reading: Reading
    where: str
    groups: int | None
    estimate: Estimate
    fits: bool
    p: float
    p_opposite: float
    equal: bool = True
    alike: tuple[str, ...] = ()

    @property
    def outcome(self) -> Outcome:
        """Return what it shows."""
        if self.p < LEVEL:
            return Outcome.HOLDS if self.fits else Outcome.SIGN
        return Outcome.OPPOSITE if self.p_opposite < LEVEL else Outcome.UNDECIDED

    @property
    def verdict(self) -> Verdict:
        """Return the word for this case alone: a sign without the size is not what was claimed."""
        return Verdict.HOLDS if self.outcome is Outcome.HOLDS else Verdict.DOES_NOT

    @property
    def name(self) -> str:
        """Return what a table calls its reading: without mono's masks where mono is not compared."""
        reading = self.reading
        known = reading.name if "mono" in self.claim.measure.sensors else reading.name.split(", ", 1)[1]
        return known + (f" (the same solves: {listing(self.alike)})" if self.alike else "")

    @property
    def traits(self) -> Traits:
        """Return what a condition may be made of."""
        found = {"masks": f"if the masks are {self.reading.mono.masks}"} if "mono" in self.claim.measure.sensors else {}
        found["data"] = f"if the data are {self.reading.data}"
        if self.groups is not None:
            found["R"] = f"at R = {_ratio(self.groups)}"
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object of this case."""
        return _entry(self.claim, f"{self.name}; {self.where}", self.estimate, self.verdict)


@dataclass(frozen=True)
class Overall:
    """One claim over several cases.

    Args:
        claim: which.
        among: which cases, ``BASES`` or ``EVERY``.
        verdict: over them.
        words: under which condition.
        best: the case that stands for it.
        counts: how many cases show what.
    """

    claim: PaperClaim
    among: str
    verdict: Verdict
    words: str
    best: Judged
    counts: Mapping[Outcome, int]

    @property
    def sentence(self) -> str:
        """Return verdict and condition as one sentence part."""
        start = {Verdict.HOLDS: "holds", Verdict.ONLY_IF: "holds only", Verdict.DOES_NOT: "does not hold,"}
        return f"{start[self.verdict]} {self.words}"

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object of this claim."""
        return _entry(self.claim, f"overall, {self.among}: {self.words}", self.best.estimate, self.verdict)


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
    """Judge every claim in every case that bears on it; p values are corrected within a family.

    A family is what one claim is asked under the bases, or under changed readings: bases come first, and questions
    asked in passing don't weaken them.
    """
    found = list(_merged(row for table in tables for row in _measured(table, seed)))
    families: dict[tuple[str, bool], list[int]] = {}
    for i, row in enumerate(found):
        families.setdefault((row.claim.ident, row.reading.base), []).append(i)
    for mine in families.values():
        above, below = (holm([p(found[i]) for i in mine]) for p in (lambda row: row.p, lambda row: row.p_opposite))
        for i, p, opposite in zip(mine, above, below):
            found[i] = replace(found[i], p=p, p_opposite=opposite)
    return found


def _merged(rows: Iterable[Judged]) -> Iterator[Judged]:
    """Count the same solves once, whatever readings they come from."""
    first: dict[tuple[Any, ...], Judged] = {}
    for row in rows:
        sensors, reading = row.claim.measure.sensors, row.reading
        mono = reading.mono.key if "mono" in sensors else ""
        key = (row.claim.ident, row.where, mono, reading.depth, *(reading.recipes[s] for s in sorted(sensors)))
        known = first.get(key)
        if known is None:
            first[key] = row
        elif reading.change not in (known.reading.change, *known.alike):
            first[key] = replace(known, alike=(*known.alike, reading.change))
    return iter(first.values())


def _measured(table: Table, seed: int) -> list[Judged]:
    found = []
    groups = sorted({g for scene in table.scenes for g in table.groups(scene)})
    for claim in CLAIMS:
        measure = claim.measure
        if not measure.sensors & table.reading.touched:
            continue
        for g in groups if measure.steady else groups[:1]:
            parts = list(measure.parts(table, g))
            if parts:
                weak = weakest(parts)
                opposite = one_sided_p({scene: [-v for v in values] for scene, values in weak.items()})
                estimate = paired_estimate(weak, seed)
                fits = all(claim.size.met(mean_of(part)) for part in parts)
                shots, equal = _shots(table.reading, measure.sensors, g) if measure.steady else ("from R to R", True)
                where = f"{shots}, {table.size} x {table.size}"
                own = g if measure.steady else None
                found.append(Judged(claim, table.reading, where, own, estimate, fits, estimate.p, opposite, equal))
    return found


def _shots(reading: Reading, sensors: Iterable[str], groups: int) -> tuple[str, bool]:
    """Return R, or the sensors' shots where a light budget gives them others, and whether it is one R."""
    usual = {s: shots_of(s, groups) for s in sorted(sensors)}
    captures = {s: reading.recipes[s].capture for s in usual}
    own = {s: capture.shots if isinstance(capture, Lit) else usual[s] for s, capture in captures.items()}
    if own == usual:
        return f"R = {_ratio(groups)}", True
    return "shots: " + listing(f"{name} {count}" for name, count in own.items()), False


def _ratio(groups: int) -> str:
    return ratio_text(ratio_of(groups))


def overall(rows: Sequence[Judged]) -> list[Overall]:
    """Say of each claim whether it holds always, sometimes or never: under the base readings, then in all cases.

    Cases whose sensors' shots are not those of one R are left out: the paper compares at equal R.
    """
    found = []
    for claim in CLAIMS:
        mine = [row for row in rows if row.claim.ident == claim.ident and row.equal]
        bases = [row for row in mine if row.reading.base]
        found += [_over(claim, among, chosen) for among, chosen in ((BASES, bases), (EVERY, mine)) if chosen]
    return found


def _over(claim: PaperClaim, among: str, rows: Sequence[Judged]) -> Overall:
    counts = {outcome: sum(row.outcome is outcome for row in rows) for outcome in Outcome}
    holding, signed = counts[Outcome.HOLDS], counts[Outcome.HOLDS] + counts[Outcome.SIGN]
    order = list(Outcome)
    best = min(rows, key=lambda row: (order.index(row.outcome), not row.reading.base, row.groups not in (1, None)))
    if holding == len(rows):
        return Overall(claim, among, Verdict.HOLDS, f"in all {len(rows)}", best, counts)
    if holding:
        return Overall(claim, among, Verdict.ONLY_IF, _when(rows, lambda row: row.outcome is Outcome.HOLDS), best, counts)
    if signed:
        sign = "in all" if signed == len(rows) else _when(rows, lambda row: row.outcome is Outcome.SIGN)
        return Overall(claim, among, Verdict.DOES_NOT, f"never of the claimed size ({claim.size}); its sign {sign}", best, counts)
    least = min(rows, key=lambda row: (not row.reading.base, row.groups not in (1, None)))
    words = f"in none of {len(rows)}: opposite sign in {counts[Outcome.OPPOSITE]}, not decided in {counts[Outcome.UNDECIDED]}"
    return Overall(claim, among, Verdict.DOES_NOT, words, least, counts)


def _when(rows: Sequence[Judged], good: Callable[[Judged], bool]) -> str:
    """Say when: by a condition that sorts the decided cases, or all of them, else by the cases themselves."""
    decided = [row for row in rows if row.outcome is not Outcome.UNDECIDED]
    by_trait = (condition([row.traits for row in chosen], [good(row) for row in chosen]) for chosen in (decided, rows))
    named = next((words for words in by_trait if words), None)
    mine = [row for row in rows if good(row)]
    if named:
        return f"{named}; {len(mine)} of {len(rows)} in all"
    shown = [f"{row.name}, {row.where}" for row in mine[:EXAMPLES]]
    more = f" and {len(mine) - EXAMPLES} more" if len(mine) > EXAMPLES else ""
    return f"in {len(mine)} of {len(rows)}: {'; '.join(shown)}{more}"
