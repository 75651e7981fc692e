"""The paper's claims beside this run's numbers: each verdict is computed by a stated rule."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, MONO_REPEATED, SERIES, Series
from optsim.report.gallery import Gallery, finest_window
from optsim.report.select import TIE_DB, db, listing, ratio_text, ratios, score, span_text
from optsim.report.verdict import MAIN_R, gaps_over_ratios
from optsim.report.wording import side

TARGET_1, TARGET_2 = "color-checker", "color-checker-bars"
RULE = (
    "Rule of the verdicts: a size holds when it is met to 0.5 dB or a quarter, whichever is larger, at every R that was run; "
    f"a gap under {TIE_DB} dB is a tie; a claim about the sign holds only if it holds everywhere it was run."
)


@dataclass(frozen=True)
class Claim:
    """Hold one line: what the paper says, how "mono" is read, what this run found, and the verdict.

    ``standing`` is holds, partly, fails or open.
    """

    claim: str
    reading: str
    found: str
    verdict: str
    standing: str


def judge(gaps: Sequence[float], size: float, up_to: bool = False) -> tuple[str, str]:
    """Compare gaps in dB with a claimed size; ``up_to`` compares only the largest gap."""
    if not gaps:
        return "not run", "open"
    signs = {side(g) for g in gaps}
    if signs == {0}:
        return "a tie", "fails"
    if signs == {-1}:
        return "reversed", "fails"
    if signs != {1}:
        return "sign differs over R", "partly"
    tolerance = max(0.5, size / 4)
    checked = [max(gaps)] if up_to else list(gaps)
    if all(abs(g - size) <= tolerance for g in checked):
        return "holds", "holds"
    return "sign holds, size differs", "partly"


def make_claims(gallery: Gallery) -> list[Claim]:
    """Return every claim with its verdict, in the paper's order."""
    claims = []
    for target, words, bayer, foveon, up_to in ((TARGET_1, "Target 1", 3.0, 4.0, True), (TARGET_2, "Target 2", 1.5, 2.0, False)):
        for mono in (MONO_REPEATED, MONO_DISTINCT):
            size = f"up to {bayer:g} dB" if up_to else f"about {bayer:g} dB"
            claims.append(gap_claim(gallery, f"{words}: Bayer {size} above mono", target, BAYER, mono, bayer, up_to))
            claims.append(gap_claim(gallery, f"{words}: Foveon about {foveon:g} dB above mono", target, FOVEON, mono, foveon, False))
        claims.append(
            gap_claim(gallery, f"{words}: Foveon about {foveon - bayer:g} dB above Bayer", target, FOVEON, BAYER, foveon - bayer, False)
        )
    claims.append(harder_target(gallery))
    claims += [whole_spectrum(gallery, mono) for mono in (MONO_REPEATED, MONO_DISTINCT)]
    claims += [aliasing(gallery), more_shots(gallery)]
    claims.append(Claim("On the test bed: colour 2 to 4 dB above mono on average", "", "needs the paper's bench", "not simulated", "open"))
    return claims


def gap_claim(gallery: Gallery, claim: str, target: str, a: Series, b: Series, size: float, up_to: bool) -> Claim:
    """Judge a claimed gap between two series over every R."""
    gaps = gaps_over_ratios(gallery.run, gallery.recipe, target, a, b)
    reading = b.label.split(", ")[1] if b.sensor == "mono" else ""
    found = f"{span_text(list(gaps.values()))} at R = {listing(ratio_text(R) for R in gaps)}" if gaps else f"{target} was not run"
    return Claim(claim, reading, found, *judge(list(gaps.values()), size, up_to))


def harder_target(gallery: Gallery) -> Claim:
    """Judge "target 2 is about 10 dB lower for all sensors"."""
    run, recipe = gallery.run, gallery.recipe
    drops: dict[str, list[float]] = {}
    for s in SERIES:
        for R in ratios(run, recipe, TARGET_2):
            first, second = score(run, recipe, TARGET_1, s, R), score(run, recipe, TARGET_2, s, R)
            if first is not None and second is not None:
                drops.setdefault(s.short, []).append(first - second)
    found = "; ".join(f"{name} {span_text(values, sign=False)}" for name, values in drops.items())
    verdict = judge([v for values in drops.values() for v in values], 10.0)
    return Claim("Target 2: about 10 dB lower than target 1 for every sensor", "", found or "both targets are needed", *verdict)


def band_errors(gallery: Gallery, target: str, R: float) -> Mapping[str, np.ndarray]:
    """Return series key -> (K,) mean absolute error per band, W m^-2 sr^-1 nm^-1."""
    if target not in gallery.run.truths:
        return {}
    truth = gallery.truth(target).radiance
    found = {s.key: gallery.estimate(target, s, R) for s in SERIES}
    return {key: np.abs(cube - truth).mean((0, 1)) for key, cube in found.items() if cube is not None}


def whole_spectrum(gallery: Gallery, mono: Series) -> Claim:
    """Judge "the colour sensors' error is lower over the whole spectrum" for one reading of mono."""
    counts: list[tuple[int, int]] = []
    parts = []
    for target in (TARGET_1, TARGET_2):
        errors = band_errors(gallery, target, MAIN_R)
        for s in (BAYER, FOVEON):
            if mono.key in errors and s.key in errors:
                lower = int(np.sum(errors[s.key] < errors[mono.key]))
                counts.append((lower, errors[s.key].size))
                parts.append(f"{s.short} lower in {lower} of {errors[s.key].size} bands ({target}, mean absolute error)")
    if not counts:
        standing = ("not run", "open")
    elif all(n == total for n, total in counts):
        standing = ("holds", "holds")
    elif all(n == 0 for n, _ in counts):
        standing = ("reversed", "fails")
    else:
        standing = ("in some bands only", "partly")
    return Claim(
        "The colour sensors’ error is lower over the whole spectrum",
        mono.label.split(", ")[1],
        "; ".join(parts) or "R = 1/8 was not run",
        *standing,
    )


def aliasing(gallery: Gallery) -> Claim:
    """Judge "Foveon shows artefacts but no colour aliasing": at most half of Bayer's false colour on the finest bars."""
    claim = "Target 2: Bayer shows colour aliasing, Foveon does not"
    if TARGET_2 not in gallery.run.truths:
        return Claim(claim, "", f"{TARGET_2} was not run", "not run", "open")
    window = finest_window(gallery.truth(TARGET_2).radiance)
    errors = {}
    for s in SERIES:
        cube = gallery.estimate(TARGET_2, s, MAIN_R)
        if cube is not None:
            errors[s.key] = gallery.chroma_error(cube, TARGET_2, window)
    found = "false colour on the finest bars (mean ΔC*ab of 8 × 8 pixel means), R = 1/8: " + ", ".join(
        f"{s.short} {errors[s.key]:.1f}" for s in SERIES if s.key in errors
    )
    if BAYER.key not in errors or FOVEON.key not in errors:
        return Claim(claim, "", "R = 1/8 was not run", "not run", "open")
    ratio = errors[FOVEON.key] / errors[BAYER.key] if errors[BAYER.key] > 0 else np.inf
    verdict = ("holds", "holds") if ratio <= 0.5 else ("less, not none", "partly") if ratio < 0.95 else ("not seen here", "fails")
    return Claim(claim, "", found, *verdict)


def more_shots(gallery: Gallery) -> Claim:
    """Judge "every sensor improves with the number of shots"."""
    run, recipe = gallery.run, gallery.recipe
    steps = []
    for target in run.targets:
        for s in SERIES:
            values = [v for R in ratios(run, recipe, target) if (v := score(run, recipe, target, s, R)) is not None]
            steps += [b - a for a, b in pairwise(values)]
    claim = "Every sensor improves with the number of shots"
    if not steps:
        return Claim(claim, "", "one R only", "not run", "open")
    better = sum(side(g) > 0 for g in steps)
    found = f"{better} of {len(steps)} steps to the next R improve; smallest step {db(min(steps), sign=True)}"
    return Claim(
        claim, "", found, *(("holds", "holds") if better == len(steps) else ("partly", "partly") if better else ("reversed", "fails"))
    )
