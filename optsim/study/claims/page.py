"""From verdicts to the page: sentences, tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from optsim import __version__
from optsim.files.guard import atomic_path
from optsim.report.claims_page import ClaimLine, ClaimsPage, ReadingLine, render_claims_page
from optsim.report.select import listing
from optsim.study.claims.answer import Claims
from optsim.study.claims.drawings import draw
from optsim.study.claims.judge import Judged, Overall, Verdict
from optsim.study.claims.plan import cells
from optsim.study.claims.readings import Reading
from optsim.study.statistics import CONFIDENCE, RESAMPLES, Estimate
from optsim.study.store import Store

METHOD = (
    "A trial is a scene behind one random series of masks. Every random scene has masks of its own; the two targets share "
    "theirs, so that their difference is paired. Within a trial all sensors and all readings see the same scene and the same "
    "first mask, and every number here is a mean of differences inside trials.",
    f"Intervals hold the mean with {CONFIDENCE:.0%} confidence when scenes and masks are both drawn anew: scenes (for a target: "
    f"masks) are resampled with replacement {RESAMPLES} times, all masks of a scene together, and the percentile interval is "
    "stretched by sqrt(n/(n-1)) t/z for few trials.",
    "A verdict needs two things. The claimed sign is shown when Student’s one-sided test of the same independent means stays "
    "below 0.05 after Holm’s correction over all readings of the claim. The claimed size is met when the interval shares a value "
    "with the claimed range (half a decibel or a quarter to either side of “about”, whichever is larger). Both: holds. Sign "
    "alone: sign only. Else: does not hold, which with few masks may also mean that it could not be shown. A claim about all "
    "bands, sensors or steps is judged by its weakest part.",
    "Readings change one factor from a stated base. Matched data come from the discrete model itself and are inverted by basis "
    "pursuit, which needs no tau; physical data come from the traced prism at ten wavelengths a band and two samples along a "
    "mirror, and are inverted by Eq. 4 with a tau from held-out detector pixels, for they lie in the range of no H. Data with "
    "noise have shot noise, 10 electrons of read noise and 16 bits over a well of 200,000; their tau leaves as much unexplained "
    "as the noise explains. The test bed is a monochrome camera of 8 bits, alone and behind model glasses.",
)


def write_page(found: Claims, store: Store, command: str) -> None:
    """Draw the figures and write paper-claims.html."""
    drawn = draw(found, store)
    shown = ClaimsPage(
        title=title(found.verdicts),
        kicker=f"optsim {__version__} · the paper’s claims · {sizes(found)}",
        glance=glance(found),
        claims=[claim_line(v) for v in found.verdicts],
        readings=[reading_line(row) for row in found.rows],
        method=METHOD,
        design=design(found),
        figures=drawn,
        command=command,
    )
    with atomic_path(found.page) as temporary:
        Path(temporary).write_text(render_claims_page(shown), "utf-8")


def title(verdicts: Sequence[Overall]) -> str:
    """Write the verdict in one sentence."""
    counts = {v: sum(o.verdict is v for o in verdicts) for v in Verdict}
    parts = [
        f"{counts[Verdict.HOLDS]} hold under every reading tried",
        f"{counts[Verdict.ONLY_IF]} hold only under some",
        f"{counts[Verdict.DOES_NOT]} under none",
    ]
    return f"Of {len(verdicts)} claims of the paper, {listing(parts)}."


def sizes(found: Claims) -> str:
    """Say how large the study is."""
    trials = {cell for table in found.tables for cell, _ in cells(found.config, table.reading.depth)}
    pictures = listing(f"{s} × {s}" for s in sorted({cell.size for cell in trials}))
    scenes = len({cell.scene for cell in trials if cell.random})
    return f"{len(found.tables)} readings, two targets and {scenes} random scenes, {len(trials)} trials at {pictures} × 24"


def glance(found: Claims) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Tabulate what the bases say of each gap at R = 1/8."""
    named = (("bayer-mono", "Bayer − mono"), ("foveon-mono", "Foveon − mono"), ("foveon-bayer", "Foveon − Bayer"))
    lines = []
    for target, words in (("target1", "target 1"), ("target2", "target 2"), ("scenes", "random scenes")):
        for reading in (t.reading for t in found.tables if t.reading.base and t.size == found.config.size):
            rows = {r.claim.ident: r for r in found.rows if r.reading is reading and r.groups == 1}
            if any(f"{target}-{pair}" in rows for pair, _ in named):
                cells = [number(rows[key].estimate) if (key := f"{target}-{pair}") in rows else "–" for pair, _ in named]
                lines.append((words, reading.name, *cells))
    return ("R = 1/8, dB [95 %]", "base reading", *(name for _, name in named)), lines


def number(e: Estimate) -> str:
    """Write a number with its interval."""
    return f"{signed(e.mean)} [{signed(e.low)}, {signed(e.high)}]".replace(" ", "\u00a0")


def signed(value: float) -> str:
    """Write a number of dB with its sign, two decimals and a true minus."""
    return f"{value:+.2f}".replace("-", "−")


def claim_line(verdict: Overall) -> ClaimLine:
    """Write one claim over all readings."""
    best = verdict.best
    return ClaimLine(verdict.claim.text, number(best.estimate), f"{best.reading.name}; {best.where}", verdict.verdict.value, verdict.words)


def reading_line(row: Judged) -> ReadingLine:
    """Write one claim under one reading."""
    e = row.estimate
    p = f"{row.p:.3f}" if row.p >= 0.001 else "< 0.001"
    spread = " / ".join("–" if v is None else f"{v:.2f}" for v in (e.between_scenes, e.between_masks))
    return ReadingLine(row.claim.text, row.reading.name, row.where, number(e), p, spread, row.verdict.value)


def design(found: Claims) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Tabulate on how many trials each kind of reading was run."""
    header = ("readings", "how many", "mirrors", "masks of a target", "random scenes × masks", "colour shots")
    groups: dict[tuple[str, ...], list[Reading]] = {}
    for table in found.tables:
        depth = table.reading.depth
        kind = "base" if table.reading.base else "one factor changed"
        key = (
            f"{table.reading.data}, {kind}",
            str(table.size),
            str(depth.target_masks),
            f"{depth.scenes} × {depth.masks}" if depth.scenes else "–",
            listing(map(str, depth.groups)),
        )
        groups.setdefault(key, []).append(table.reading)
    return header, [(key[0], str(len(mine)), *key[1:]) for key, mine in groups.items()]
