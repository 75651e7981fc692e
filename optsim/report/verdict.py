"""Say what the run found: a title, the numbers under it, and findings, each computed from rows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, MONO_REPEATED, R_TOLERANCE, SERIES, RunData, Series
from optsim.report.finding import Finding, cells
from optsim.report.finding_scores import other_scores
from optsim.report.finding_tau import tau_finding, tau_lead
from optsim.report.select import Recipe, db, listing, main_recipe, pick, ratio_text, ratios, score, scores_at, span_text
from optsim.report.wording import compare, few, method_text, model_text, ordering, outcome, recipe_text, side, swaps

EXPECTED = (MONO_REPEATED, BAYER, FOVEON, MONO_DISTINCT)
"""The ordering, ascending, that an earlier estimate with painted targets expected of basis pursuit."""
MAIN_R = 0.125
"""One colour shot against three mono shots: where the headline is read."""
OPERATOR_NAMES = {"unit-shift": "unit-shift H", "camera": "the camera’s own shifts"}
PAIRS = ((BAYER, MONO_DISTINCT), (FOVEON, MONO_DISTINCT), (BAYER, MONO_REPEATED), (FOVEON, MONO_REPEATED), (FOVEON, BAYER))


@dataclass(frozen=True)
class Verdict:
    """Hold the page's lead.

    Args:
        title: the honest headline, one sentence.
        basis: target, R and recipe that the title speaks of, with the scores in ascending order.
        readings: one sentence a reading of "three monochrome shots".
        findings: what else bears on the title.
        tau: one sentence on how tau moves the ordering, or nothing when it was not tried.
    """

    title: str
    basis: str
    readings: tuple[str, ...]
    findings: tuple[Finding, ...]
    tau: str = ""


def make_verdict(run: RunData) -> Verdict:
    """Build the lead of the page from a run; what was not run is said, not guessed."""
    recipe = main_recipe(run)
    target = next((t for t in run.targets if ratios(run, recipe, t)), None)
    if recipe is None or target is None:
        return Verdict("Nothing was reconstructed in this run.", "summary.json holds no rows.", (), ())
    R = min(ratios(run, recipe, target), key=lambda r: abs(r - MAIN_R))
    scores = scores_at(run, recipe, target, R)
    sentences = [text for mono in (MONO_DISTINCT, MONO_REPEATED) if (text := reading(scores, mono))]
    basis = f"{target}, R = {ratio_text(R)}, {recipe_text(recipe)}: {ordering(scores) or 'exact'}."
    early = sum(row.converged is False for row in pick(run, recipe, target, R=R))
    if early:
        basis += f" {early} of these solves stopped before their tolerance."
    findings = (
        expectation(run, recipe, target),
        over_ratios(run, recipe, (target, R)),
        other_scores(run, recipe, R),
        tau_finding(run, recipe, target),
        matched_finding(run, target, R),
        caution(run),
    )
    kept = tuple(f for f in findings if f.text or f.rows or f.points)
    return Verdict(title(scores), basis, tuple(sentences), kept, tau_lead(run, recipe, target, R))


def title(scores: dict[str, float]) -> str:
    """Write the headline from the scores at one target and R."""
    clauses = {mono.key: clause for mono in (MONO_DISTINCT, MONO_REPEATED) if (clause := outcome(scores, mono))}
    distinct, repeated = clauses.get(MONO_DISTINCT.key), clauses.get(MONO_REPEATED.key)
    if distinct and repeated:
        return f"By PSNR: if monochrome’s three shots use three different masks, {distinct}; if they repeat one mask, {repeated}."
    if distinct:
        return f"By PSNR: if monochrome’s three shots use three different masks, {distinct}; the repeated mask was not run."
    if repeated:
        return f"By PSNR: if monochrome’s three shots repeat one mask, {repeated}; three different masks were not run."
    return f"Not all sensors were run: {ordering(scores) or 'no score to compare'}."


def reading(scores: dict[str, float], mono: Series) -> str | None:
    """Compare one reading of mono with the colour sensors, in numbers."""
    others = [(s.short, scores[s.key]) for s in (BAYER, FOVEON) if s.key in scores]
    if mono.key not in scores or not others:
        return None
    lead = "Three different masks" if mono is MONO_DISTINCT else "One mask, three times"
    return f"{lead}: {compare('mono', scores[mono.key], others)}."


def gaps_over_ratios(run: RunData, recipe: Recipe | None, target: str, a: Series, b: Series) -> dict[float, float]:
    """Return R -> PSNR of a minus PSNR of b in dB, where both were run."""
    gaps = {}
    for R in ratios(run, recipe, target):
        left, right = score(run, recipe, target, a, R), score(run, recipe, target, b, R)
        if left is not None and right is not None:
            gaps[R] = left - right
    return gaps


def over_ratios(run: RunData, recipe: Recipe, main: tuple[str, float]) -> Finding:
    """Say whether the headline's ordering holds at every other R and target; tabulate the range of each gap."""
    reference = scores_at(run, recipe, *main)
    rows, exceptions, count = [], [], 0
    for target in run.targets:
        found = ratios(run, recipe, target)
        if not found:
            continue
        where = ratio_text(found[0]) + (f" to {ratio_text(found[-1])}" if len(found) > 1 else "")
        spans = [list(gaps_over_ratios(run, recipe, target, a, b).values()) for a, b in PAIRS]
        rows.append((target, where, *(span_text(s) if s else "not run" for s in spans)))
        for R in found:
            scores = scores_at(run, recipe, target, R)
            if (target, R) == main or len(scores) < 2:
                continue
            count += 1
            changed = swaps(reference, scores)
            if changed:
                exceptions.append(f"{target}, R = {ratio_text(R)}: {few(changed)}")
    others = "the other combination" if count == 1 else f"all {count} other combinations"
    if count == 0:
        text = "Only one target and one R were run."
    elif exceptions:
        text = f"The ordering differs at {len(exceptions)} of the {count} other combinations of target and R. {'. '.join(exceptions)}."
    else:
        text = f"The ordering is the same at {others} of target and R that {'was' if count == 1 else 'were'} run."
    header = ("target", "R", *(f"{a.short} − {b.short}" for a, b in PAIRS))
    return Finding("Every target and R", text, header, tuple(rows))


def expectation(run: RunData, recipe: Recipe, target: str) -> Finding:
    """Confirm or refute the ordering that was expected before the run."""
    expected = " < ".join(s.short for s in EXPECTED)
    lead = f"An earlier estimate with painted targets expected, by basis pursuit at R = 1/8, {expected}."
    scores = scores_at(run, recipe, target, MAIN_R)
    missing = [s.short for s in EXPECTED if s.key not in scores]
    if recipe.solver != "basis-pursuit":
        text = "Basis pursuit was not run here, so this run neither confirms nor refutes it."
    elif missing:
        text = f"Not decided here: {listing(missing)} at R = 1/8 was not run."
    else:
        wrong = []
        for low, high in pairwise(EXPECTED):
            gap = scores[high.key] - scores[low.key]
            if side(gap) < 1:
                wrong.append(f"{high.short} {'ties with' if side(gap) == 0 else 'is below'} {low.short} ({db(gap, sign=True)})")
        verdict = f"Refuted for the rendered {target}: {listing(wrong)}" if wrong else f"Confirmed for the rendered {target}"
        text = f"{verdict}. Found: {ordering(scores)}."
    return Finding("The ordering expected beforehand", f"{lead} {text}")


def matched_finding(run: RunData, target: str, R: float) -> Finding:
    """Say what data made by the very operator that inverts them hide, for each way of solving that was tried on others."""
    label = "What matched data hide"
    physical = [row for row in run.rows if row.model != "matched" and row.target == target and abs(row.R - R) <= R_TOLERANCE]
    if not physical:
        return Finding(label, f"Physical data were not run at R = {ratio_text(R)} on {target}.")
    text = "Matched data come from the very H that inverts them; physical data from the traced prism, integrated finely over wavelength."
    methods = dict.fromkeys(Recipe("matched", "unit-shift", row.solver, row.tau_rule) for row in physical)
    if any(m.tau_rule is None for m in methods) and any(m.tau_rule for m in methods):
        text += " Eq. 4 may leave a residual; basis pursuit fits data exactly, what H does not know of them included, and so amplifies it."
    rows, points = [], []
    for matched in sorted(methods, key=lambda m: ("auto", "oracle", None).index(m.tau_rule)):
        rows.append((f"{method_text(matched)}: matched data", *cells(run, matched, target, R)))
        for model in dict.fromkeys(row.model for row in physical):
            for operator, name in OPERATOR_NAMES.items():
                recipe = replace(matched, model=model, operator=operator)
                if pick(run, recipe, target, R=R):
                    rows.append((f"{method_text(matched)}: {model_text(model)}, {name}", *cells(run, recipe, target, R)))
                    if matched.tau_rule != "oracle" or replace(matched, tau_rule="auto") not in methods:
                        points.append(moved(run, matched, recipe, target, R))
    header = (f"{target}, R = {ratio_text(R)}, dB", *(s.short for s in SERIES))
    return Finding(label, text, header, tuple(rows), tuple(filter(None, points)))


def moved(run: RunData, matched: Recipe, recipe: Recipe, target: str, R: float) -> str:
    """Say in one line by how much a recipe's scores lie off those of matched data, and whether it changes the ordering."""
    base, scores = scores_at(run, matched, target, R), scores_at(run, recipe, target, R)
    moves = [scores[key] - base[key] for key in scores if key in base]
    if not moves:
        return ""
    changed = swaps(base, scores)
    verdict = f"the order changes ({few(changed, 1)})" if changed else "the order stays" if len(moves) > 1 else "one sensor only"
    early = sum(row.converged is False for row in pick(run, recipe, target, R=R))
    unfinished = f"; {early} of these solves stopped before their tolerance" if early else ""
    case = f"{method_text(recipe)}, {model_text(recipe.model)}, {OPERATOR_NAMES[recipe.operator]}"
    return f"{case}: {span_text(moves)} against matched data; {verdict}{unfinished}."


def caution(run: RunData) -> Finding:
    """Say how many mask seeds stand behind the numbers and how many solves stopped early."""
    seeds = sorted({row.seed for row in run.rows})
    text = (
        "One mask seed: no interval can be given. Run other seeds (--seed) to see how far a gap between sensors depends on the masks."
        if len(seeds) == 1
        else (f"Scores are means over {len(seeds)} mask seeds.")
    )
    told = [row for row in run.rows if row.converged is not None]
    early = [row for row in told if row.converged is False]
    if early:
        text += f" {len(early)} of {len(told)} solves stopped before their tolerance; they are marked in the table of results."
    elif told:
        text += f" All {len(told)} solves reached their tolerance."
    return Finding("How sure", text)
