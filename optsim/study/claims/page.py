"""From verdicts to the page: sentences, tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from optsim import __version__
from optsim.files.guard import atomic_path
from optsim.report.claims_page import ClaimLine, ClaimsPage, ReadingLine, render_claims_page
from optsim.report.select import listing
from optsim.study.claims.answer import Claims
from optsim.study.claims.conditions import CLEAR, FEWEST, FEWEST_EXACT
from optsim.study.claims.disclosure import disclosures, settings_told
from optsim.study.claims.drawings import draw
from optsim.study.claims.judge import BASES, EVERY, LEVEL, Judged, Overall, Verdict
from optsim.study.claims.plan import cells
from optsim.study.claims.readings import SENSORS, Reading
from optsim.study.claims.worlds import TARGET_2
from optsim.study.statistics import CONFIDENCE, RESAMPLES, Estimate
from optsim.study.store import Store

METHOD = (
    "A trial is a scene behind one random series of masks. Every random scene has masks of its own; the two targets share "
    "theirs, so that their difference is paired. Within a trial all sensors and all readings see the same scene and the "
    "same first mask, and every number here is a mean of differences inside trials. A case is one reading at one R and one "
    "size.",
    f"Intervals hold the mean with {CONFIDENCE:.0%} confidence when scenes and masks are both drawn anew: scenes (for a "
    f"target: masks) are resampled with replacement {RESAMPLES} times, all masks of a scene together, and the percentile "
    "interval is stretched by sqrt(n/(n-1)) t/z for few trials. They are two-sided and not corrected for the number of "
    "cases.",
    "A case holds when the claimed sign is shown (Student’s one-sided test of the same independent means stays below "
    f"{LEVEL:g} after Holm’s correction) and the mean lies in the claimed range (half a decibel or a quarter to either side "
    "of “about”, whichever is larger). Sign only: shown, but of another size. Opposite sign: the same test shows the "
    "contrary. Not decided: neither is shown; with few masks that says little. A claim about all bands, sensors or steps "
    "has the sign of its weakest part, whose number is printed, and the size of all. The base readings of a claim are one "
    "family of Holm’s correction, the changed readings another; nothing is corrected across claims.",
    "A claim holds when every case holds; only if, when some do, and then a condition is named where it sorts the decided "
    f"cases: at least {CLEAR:.0%} of those that meet it hold, at most {1 - CLEAR:.0%} of the others, {FEWEST} or more on "
    f"either side ({FEWEST_EXACT} where there is no exception). "
    "It does not hold when no case holds; its sign may still be shown. Cases with the same solves are counted "
    "once. Cases whose sensors’ shots do not belong to one R (light budgets A and E) stand in the tables and figures, and "
    "are left out of the verdicts: the paper compares at equal R.",
    "Readings change one factor from a stated base. Matched data come from the discrete model itself and are inverted by "
    "basis pursuit, which needs no tau; physical data come from the traced prism at ten wavelengths a band and two samples "
    "along a mirror, and are inverted by Eq. 4 with a tau from held-out detector pixels, for they lie in the range of no H. "
    "The two bases thus differ in data and in method; “matched, Eq. 4 with automatic tau” and “physical, basis pursuit” are "
    "the bridges between them. Data with noise have shot noise, 10 electrons of read noise and 16 bits over a well of "
    "200,000; their tau leaves as much unexplained as the noise explains. They start from a case of their own: budget B at "
    "5000 electrons, responses scaled by photons, layers as they are; against the matched base that changes noise, scaling "
    "and tau together. The test bed is a monochrome camera of 8 bits, alone and behind model glasses.",
)


def write_page(found: Claims, store: Store, command: str) -> None:
    """Draw the figures and write paper-claims.html."""
    drawn = draw(found, store)
    shown = ClaimsPage(
        title=title(found.verdicts),
        kicker=f"optsim {__version__} · the paper’s claims · {sizes(found)}",
        glance=glance(found),
        claims=claim_lines(found.verdicts),
        readings=[reading_line(row) for row in found.rows],
        method=(*METHOD, *settings_told(found.config)),
        tables=(design(found), disclosures(found), false_colors(found)),
        figures=drawn,
        command=command,
    )
    with atomic_path(found.page) as temporary:
        Path(temporary).write_text(render_claims_page(shown), "utf-8")


def title(verdicts: Sequence[Overall]) -> str:
    """Write the verdict in two sentences: under the base readings, then in all cases."""
    bases, every = ([v for v in verdicts if v.among == among and not v.claim.ours] for among in (BASES, EVERY))

    def split(mine: Sequence[Overall]) -> str:
        words = {Verdict.HOLDS: "hold", Verdict.ONLY_IF: "hold only under some", Verdict.DOES_NOT: "under none"}
        counts = {told: sum(v.verdict is verdict for v in mine) for verdict, told in words.items()}
        return listing(f"{count} {told}" for told, count in counts.items() if count)

    first, second = split(bases), split(every)
    rest = ", and as many over every case tried" if first == second else f"; over every case tried {second}"
    return f"Of the paper’s {len(bases)} claims, under the base readings {first}{rest}."


def sizes(found: Claims) -> str:
    """Say how large the study is."""
    trials = {cell for table in found.tables for cell, _ in cells(found.config, table.reading.depth)}
    pictures = listing(f"{s} × {s}" for s in sorted({cell.size for cell in trials}))
    scenes = len({cell.scene for cell in trials if cell.random})
    return (
        f"{len(found.tables)} readings, {len(found.rows)} claims in cases, two targets and {scenes} random scenes, {len(trials)} trials at "
        f"{pictures} × 24"
    )


def glance(found: Claims) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Tabulate what the bases say of each gap at R = 1/8."""
    named = (("bayer-mono", "Bayer − mono"), ("foveon-mono", "Foveon − mono"), ("foveon-bayer", "Foveon − Bayer"))
    lines = []
    for target, words in (("target1", "target 1"), ("target2", "target 2"), ("scenes", "random scenes")):
        for reading in (t.reading for t in found.tables if t.reading.base and t.size == found.config.size):
            rows = {r.claim.ident: r for r in found.rows if r.groups == 1 and _of_base(r, reading, found.config.size)}
            if any(f"{target}-{pair}" in rows for pair, _ in named):
                cells = [number(rows[key].estimate) if (key := f"{target}-{pair}") in rows else "–" for pair, _ in named]
                lines.append((words, reading.name, *cells))
    return ("R = 1/8, dB [95 %]", "base reading", *(name for _, name in named)), lines


def _of_base(row: Judged, base: Reading, size: int) -> bool:
    """Tell whether a case belongs to a base: a claim without mono is the same for both readings of mono."""
    same = row.reading.base and row.reading.data == base.data and row.where.endswith(f"{size} x {size}")
    return same and (row.reading.mono == base.mono or "mono" not in row.claim.measure.sensors)


def false_colors(found: Claims) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Tabulate the false colour on target 2's finest bars at R = 1/8, mono's beside the others'."""
    lines = []
    for table in found.tables:
        if table.reading.base and TARGET_2 in table.scenes:
            seen = [list(table.values(TARGET_2, 1, sensor, lambda row: row["false_color"]).values()) for sensor in SENSORS]
            lines.append((table.reading.name, str(table.size), *(f"{np.mean(v):.1f}" for v in seen)))
    return ("false colour on the finest bars, mean difference of chroma ΔC*ab", "mirrors", *SENSORS), lines


def number(e: Estimate) -> str:
    """Write a number with its interval."""
    return f"{signed(e.mean)} [{signed(e.low)}, {signed(e.high)}]".replace(" ", "\u00a0")


def signed(value: float) -> str:
    """Write a number of dB with its sign, two decimals and a true minus."""
    return f"{value:+.2f}".replace("-", "−")


def claim_lines(verdicts: Sequence[Overall]) -> list[ClaimLine]:
    """Write every claim: over its base readings and over all cases."""
    found = []
    for claim in dict.fromkeys(v.claim for v in verdicts):
        bases, every = (
            next((v for v in verdicts if v.claim is claim and v.among == among), None) for among in ("base readings", "all cases")
        )
        best = (bases or every).best  # type: ignore[union-attr]
        words = [("", "–") if v is None else (v.verdict.value, v.words) for v in (bases, every)]
        text = f"{claim.text} (our question)" if claim.ours else claim.text
        found.append(ClaimLine(text, number(best.estimate), f"{best.name}; {best.where}", *words))
    return found


def reading_line(row: Judged) -> ReadingLine:
    """Write one claim in one case."""
    e = row.estimate
    p = f"{row.p:.3f}" if row.p >= 0.001 else "< 0.001"
    trials = f"{e.cells} masks" if e.scenes == 1 else f"{e.scenes} scenes, {e.cells} masks"
    spread = " / ".join("–" if v is None else f"{v:.2f}" for v in (e.between_scenes, e.between_masks))
    return ReadingLine(row.claim.text, row.name, row.where, number(e), trials, p, spread, row.outcome.value)


def design(found: Claims) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Tabulate on how many trials each kind of reading was run."""
    header = (
        "readings",
        "how many",
        "mirrors",
        "masks of a target",
        "colour shots on targets",
        "random scenes × masks",
        "colour shots there",
    )
    groups: dict[tuple[str, ...], list[Reading]] = {}
    for table in found.tables:
        depth = table.reading.depth
        kind = "base" if table.reading.base else "one factor changed"
        key = (
            f"{table.reading.data}, {kind}",
            str(table.size),
            str(depth.target_masks),
            listing(map(str, depth.groups)),
            f"{depth.scenes} × {depth.masks}" if depth.scenes else "–",
            listing(map(str, depth.scene_groups)) if depth.scenes else "–",
        )
        groups.setdefault(key, []).append(table.reading)
    return header, [(key[0], str(len(mine)), *key[1:]) for key, mine in groups.items()]
