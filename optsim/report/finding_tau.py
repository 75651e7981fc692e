"""Say how the ordering moves with the tau of Eq. 4: at every tau that was tried, and at the taus that were chosen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

from optsim.report.data import R_TOLERANCE, SERIES, Row, RunData, Series
from optsim.report.finding import Finding, cells
from optsim.report.select import Recipe, db, listing, pick, ratio_text, scores_at, span_text
from optsim.report.wording import few, method_text, side, solver_text, swaps

LABEL = "How tau changes it"
Gaps = dict[float, dict[str, float]]


def fraction_text(value: float) -> str:
    """Write tau / tau_max with the fewest digits: 0.0003 -> 3e-4."""
    digits, power = f"{value:.2e}".split("e")
    return f"{float(digits):g}e{int(power)}"


def path_scores(run: RunData, target: str, R: float) -> dict[float, dict[str, dict[str, float]]]:
    """Return tau fraction (descending) -> solver -> series key -> mean PSNR in dB, of matched data's tau paths."""
    found: dict[float, dict[str, dict[str, list[float]]]] = {}
    for p in run.tau_path:
        if (p.target, p.model, p.operator) != (target, "matched", "unit-shift") or abs(p.R - R) > R_TOLERANCE or p.psnr_db is None:
            continue
        key = next((s.key for s in SERIES if (s.sensor, s.masks) == (p.sensor, p.masks)), None)
        if key is not None:
            found.setdefault(float(f"{p.tau_fraction:.3g}"), {}).setdefault(p.solver, {}).setdefault(key, []).append(p.psnr_db)
    return {
        f: {solver: {key: sum(v) / len(v) for key, v in scores.items()} for solver, scores in found[f].items()}
        for f in sorted(found, reverse=True)
    }


def path_places(run: RunData, main: Recipe) -> list[tuple[str, float]]:
    """Return the (target, R) at which both a tau path and the main recipe compare at least two series."""
    places = []
    for target in run.targets:
        for R in sorted({p.R for p in run.tau_path if p.target == target}):
            reference = scores_at(run, main, target, R)
            tried = [scores for solvers in path_scores(run, target, R).values() for scores in solvers.values()]
            if any(len(reference.keys() & scores.keys()) > 1 for scores in tried):
                places.append((target, R))
    return places


def gaps(run: RunData, target: str, R: float, a: Series, b: Series) -> Gaps:
    """Return tau fraction -> solver -> PSNR of a minus PSNR of b in dB."""
    found: Gaps = {}
    for fraction, solvers in path_scores(run, target, R).items():
        for solver, scores in solvers.items():
            if a.key in scores and b.key in scores:
                found.setdefault(fraction, {})[solver] = scores[a.key] - scores[b.key]
    return found


def agreement(yes: tuple[str, ...], no: tuple[str, ...]) -> str:
    """Say which solvers find a flip and which do not."""
    names = ", ".join(solver_text(s) for s in yes)
    if no:
        return f"{names}; not {', '.join(solver_text(s) for s in no)}"
    return f"{names} agree" if len(yes) > 1 else names


def flips(run: RunData, main: Recipe, target: str, R: float) -> Iterator[str]:
    """Yield a clause for each pair of series and each set of taus at which its order is not that of the main recipe."""
    reference = scores_at(run, main, target, R)
    for a, b in combinations([s for s in SERIES if s.key in reference], 2):
        was = side(reference[a.key] - reference[b.key])
        cases: dict[tuple[int, tuple[str, ...], tuple[str, ...]], dict[float, list[float]]] = {}
        for fraction, found in gaps(run, target, R, a, b).items():
            for now in {side(g) for g in found.values()} - {was}:
                yes = tuple(sorted(s for s, g in found.items() if side(g) == now))
                no = tuple(sorted(found.keys() - set(yes)))
                cases.setdefault((now, yes, no), {})[fraction] = [found[s] for s in yes]
        for (now, yes, no), where in cases.items():
            sizes = [abs(g) for values in where.values() for g in values]
            first, second = (a, b) if now >= 0 else (b, a)
            verb = f"leads {second.short} by {span_text(sizes, sign=False)}" if now else f"ties with {second.short}"
            taus = listing(fraction_text(f) for f in where)
            yield f"at tau = {taus} of tau_max, {first.short} {verb} ({agreement(yes, no)})"


def tried_text(run: RunData, places: list[tuple[str, float]]) -> str:
    """Write the range of tau / tau_max that was tried at some places."""
    fractions = {f for place in places for f in path_scores(run, *place)}
    low, high = fraction_text(min(fractions)), fraction_text(max(fractions))
    return f"tau = {low} of tau_max" if low == high else f"every tau tried from {low} to {high} of tau_max"


def tau_lead(run: RunData, main: Recipe, target: str, R: float) -> str:
    """Write one sentence for the head of the page, or nothing when no tau path was run."""
    places = path_places(run, main)
    if not places:
        return ""
    name = solver_text(main.solver)
    here = next(((t, r) for t, r in places if t == target and abs(r - R) <= R_TOLERANCE), None)
    elsewhere = sum(len(list(flips(run, main, *place))) for place in places if place != here)
    if here is None:
        text = f"not tried on {target} at R = {ratio_text(R)}"
    elif found := list(flips(run, main, *here)):
        text = f"at R = {ratio_text(R)}, {few(found, 2, 'flip')}; {name} orders them otherwise"
    else:
        text = f"at R = {ratio_text(R)} not at all, at {tried_text(run, [here])}"
    if len(places) > 1:
        text += "; at other targets or R " + (
            f"{elsewhere} flip{'s' if elsewhere > 1 else ''} (see below)" if elsewhere else "no pair flips"
        )
    return f"{LABEL}: {text}."


def path_points(run: RunData, main: Recipe) -> list[str]:
    """Write the flips of every target and R, one line each, and what was tried."""
    places = path_places(run, main)
    if not places:
        return ["No path over tau with two sensors was run: the orderings in the table are those at the chosen taus alone."]
    name = solver_text(main.solver)
    found = {place: list(flips(run, main, *place)) for place in places}
    points = [f"{target}, R = {ratio_text(R)}: {'; '.join(clauses)}." for (target, R), clauses in found.items() if clauses]
    steady = [place for place, clauses in found.items() if not clauses]
    if steady:
        where = "; ".join(
            f"{target} at R = {listing(ratio_text(r) for t, r in steady if t == target)}" for target in dict.fromkeys(t for t, _ in steady)
        )
        points.append(f"No pair flips against {name} at {tried_text(run, steady)}: {where}.")
    return points


def chosen_end(run: RunData, rows: list[Row]) -> str | None:
    """Return ``smallest`` or ``largest`` when all these rows chose the same end of their path's grid of tau, else None."""
    ends = set()
    for row in rows:
        taus = [
            p.tau
            for p in run.tau_path
            if (p.target, p.sensor, p.masks, p.solver, p.model, p.operator)
            == (row.target, row.sensor, row.masks, row.solver, row.model, row.operator)
            and abs(p.R - row.R) <= R_TOLERANCE
        ]
        if row.tau is None or len(set(taus)) < 2:
            return None
        ends.add("smallest" if row.tau <= min(taus) * (1 + 1e-9) else "largest" if row.tau >= max(taus) * (1 - 1e-9) else None)
    return ends.pop() if len(ends) == 1 else None


def cost_points(run: RunData, recipes: Sequence[Mapping[str, Recipe]], target: str, Rs: list[float]) -> list[str]:
    """Say what choosing tau without the truth costs, apart from the cases in which there is nothing to choose."""
    costs: list[tuple[float, str]] = []
    ends: list[str] = []
    for R in Rs:
        for rules in recipes:
            found = {rule: scores_at(run, recipe, target, R) for rule, recipe in rules.items()}
            for s in SERIES:
                if s.key not in found["auto"] or s.key not in found["oracle"]:
                    continue
                end = chosen_end(run, [row for recipe in rules.values() for row in pick(run, recipe, target, s, R)])
                if end:
                    ends.append(end)
                else:
                    costs.append((found["oracle"][s.key] - found["auto"][s.key], f"{s.short}, R = {ratio_text(R)}"))
    total = len(costs) + len(ends)
    points = []
    for end, meaning in (("smallest", "Eq. 4’s limit of basis pursuit"), ("largest", "a larger one may score higher")):
        if count := ends.count(end):
            how_many = ("all" if count > 1 else "the one") if count == total else str(count)
            cases = f"{how_many} {f'{total} cases' if count == total and total > 1 else 'case' if count == total else f'of {total} cases'}"
            points.append(f"In {cases} automatic and oracle choice both want the {end} tau offered: {meaning}.")
    if costs:
        cost, where = max(costs)
        amount = f"up to {db(cost)} ({where})" if side(cost) > 0 else "less than 0.05 dB"
        points.append(f"{'Elsewhere, choosing' if ends else 'Choosing'} tau without the truth costs {amount}.")
    return points


def shares_tau(row: Row, rows: Sequence[Row]) -> bool:
    """Tell whether the other rule chose the same tau for the same solve."""
    return any(replace(other.solve, tau_rule=row.tau_rule) == row.solve and other.tau == row.tau for other in rows if other is not row)


def tau_finding(run: RunData, main: Recipe, target: str) -> Finding:
    """Say how the ordering and the scores move with the tau of Eq. 4."""
    penalised = [row for row in run.rows if row.tau_rule is not None and row.model == "matched" and row.target == target]
    if not penalised:
        return Finding(LABEL, "Eq. 4 with a finite tau was not run.")
    name = solver_text(main.solver)
    rows: list[tuple[str, ...]] = []
    changed: list[str] = []
    Rs = sorted({row.R for row in penalised})
    solvers = dict.fromkeys(row.solver for row in penalised)
    recipes = [{rule: Recipe("matched", "unit-shift", solver, rule) for rule in ("oracle", "auto")} for solver in solvers]
    compared = 0
    for R in Rs:
        reference = scores_at(run, main, target, R)
        if reference:
            rows.append((ratio_text(R), name, *cells(run, main, target, R)))
        for rule, recipe in ((rule, recipe) for rules in recipes for rule, recipe in rules.items()):
            scores = scores_at(run, recipe, target, R)
            if scores:
                compared += len(scores.keys() & reference.keys()) > 1
                rows.append((ratio_text(R), method_text(recipe), *cells(run, recipe, target, R)))
                word = "automatic" if rule == "auto" else rule
                changed += [
                    f"with {word} tau ({solver_text(recipe.solver)}), R = {ratio_text(R)}, {swap}" for swap in swaps(reference, scores)
                ]
    points = path_points(run, main)
    if changed:
        points.append(f"At the chosen taus of {target}, against {name}: {few(changed, 4)}.")
    elif compared:
        points.append(f"At the taus chosen for {target} (the rows of the table) no pair flips; for other taus see above.")
    else:
        points.append("Too few scores at chosen taus to compare orderings.")
    points += cost_points(run, recipes, target, Rs)
    early = sum(row.converged is False for row in penalised)
    if early:
        points.append(
            f"{early} of these {len(penalised)} solves reached their limit of iterations first: "
            f"part of their distance to {name} is unfinished work, not tau."
        )
    alone = [row for row in penalised if row.extra.get("at_edge") is True and not shares_tau(row, penalised)]
    if alone:
        points.append(
            f"{len(alone)} of the {len(penalised)} chosen taus lie at an end of the grid that one rule alone chose: "
            "a tau beyond it may score higher."
        )
    return Finding(LABEL, "", ("R", f"{target}: mean PSNR, dB", *(s.short for s in SERIES)), tuple(rows), tuple(points))
