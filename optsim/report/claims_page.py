"""The page of the verdict: each claim with its number, interval and verdict, then every reading, the figures and the method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from optsim.report.html import Child, table, tag
from optsim.report.page import figure
from optsim.report.plain_page import plain_page
from optsim.report.style import Drawn

STANDING = {"holds": "holds", "holds_only_if": "partly", "does_not_hold": "fails"}
"""Verdict -> the style class of the report."""
WORDS = {"holds": "holds", "holds_only_if": "holds only", "does_not_hold": "does not hold"}
ROW_STANDING = {"holds": "holds", "sign only": "partly", "opposite sign": "fails", "not decided": ""}
"""What one case shows -> the style class."""


@dataclass(frozen=True)
class ClaimLine:
    """One claim as text: claim, number with interval, where that was measured; (verdict, condition) of base readings and of all cases."""

    claim: str
    number: str
    measured: str
    bases: tuple[str, str]
    every: tuple[str, str]


@dataclass(frozen=True)
class ReadingLine:
    """One claim in one case, all as text; ``p`` is Holm's."""

    claim: str
    reading: str
    where: str
    number: str
    trials: str
    p: str
    spread: str
    outcome: str


@dataclass(frozen=True)
class ClaimsPage:
    """Everything that the page shows.

    Args:
        title: the verdict in one sentence.
        kicker: version and size of the study.
        glance: header and rows of the small table under the title.
        claims: in the paper's order.
        readings: every claim in every case.
        method: paragraphs.
        tables: header and rows of the tables of what was run, and of how the solves went.
        figures: by heading.
        command: the line that makes the run again.
    """

    title: str
    kicker: str
    glance: tuple[Sequence[str], Sequence[Sequence[str]]]
    claims: Sequence[ClaimLine]
    readings: Sequence[ReadingLine]
    method: Sequence[str]
    tables: Sequence[tuple[Sequence[str], Sequence[Sequence[str]]]]
    figures: Sequence[tuple[str, Sequence[Drawn]]] = field(default=())
    command: str = ""


def render_claims_page(page: ClaimsPage) -> str:
    """Write the page as one HTML text that opens offline."""
    return plain_page(
        tab="optsim: the paper’s claims",
        kicker=page.kicker,
        title=page.title,
        lead=[table(*page.glance, numeric_from=2)],
        sections=(
            ("verdicts", "The paper’s claims", _claims(page)),
            ("figures", "Figures", [_group(heading, drawn) for heading, drawn in page.figures if drawn]),
            ("method", "How it was judged", _method(page)),
            ("readings", "Every reading", _readings(page)),
        ),
        foot=f"Every number on this page was computed from rows.json beside it. Again: {page.command}",
    )


def _claims(page: ClaimsPage) -> list[Child]:
    rows = [(line.claim, _judged(*line.bases), _judged(*line.every), [line.number, tag("br"), line.measured]) for line in page.claims]
    intro = "Rueda, Lau and Arce, “Multi-spectral compressive snapshot imaging using RGB image sensors”, Optics Express, 2015."
    header = ("the paper says", "under the base readings", "over all cases", "our number, dB [95 %], and its case")
    return [tag("p", intro), table(header, rows, class_="wide judged", numeric_from=9)]


def _judged(verdict: str, words: str) -> Child:
    if not verdict:
        return words
    return [tag("span", WORDS[verdict], class_=f"verdict {STANDING[verdict]}"), f" {words}"]


def _group(heading: str, drawn: Sequence[Drawn]) -> list[Child]:
    return [tag("h3", heading), *(figure(d) for d in drawn)]


def _method(page: ClaimsPage) -> list[Child]:
    return [
        *(tag("p", text) for text in page.method),
        *(table(header, rows, class_="wide", numeric_from=1) for header, rows in page.tables),
    ]


def _readings(page: ClaimsPage) -> list[Child]:
    header = ("claim", "reading", "R (or shots) and size", "dB [95 %]", "trials", "p (Holm)", "scatter of scenes / masks, dB", "verdict")
    cells = [
        (r.claim, r.reading, r.where, r.number, r.trials, r.p, r.spread, tag("span", r.outcome, class_=ROW_STANDING[r.outcome]))
        for r in page.readings
    ]
    head = tag("thead", tag("tr", [tag("th", text, scope="col") for text in header]))
    body = tag("tbody", [tag("tr", [tag("td", cell) for cell in row]) for row in cells])
    search = tag(
        "p",
        tag("input", type="search", placeholder="filter: target 1 foveon physical", data_filter="all", aria_label="Filter the rows"),
        class_="filter",
    )
    inner = tag("table", head, body, id="all", class_="wide results sortable")
    return [search, tag("div", inner, class_="scroll", tabindex="0", role="region", aria_label="Every reading")]
