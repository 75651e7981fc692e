"""The page's last sections: what was modelled, which light was lost, why solvers stopped, and where the run comes from."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from optsim.report.data import RunData
from optsim.report.html import Child, Markup, table, tag

CALL = "wall time of this call"
THREADS = "(thread-seconds)"
SUMMED_OVER_SOLVES = ("reconstruct (sum over solves)",)
THREADS_NOTE = "Solves run side by side: these seconds overlap, and are not to be added to wall seconds."
NUMBER = re.compile(r"\d+(\.\d*)?(e[+-]?\d+)?")


def modelled(run: RunData) -> list[Child]:
    """Write which effects were on, and which light never reached a pixel."""
    parts: list[Child] = []
    for target, report in run.explain.items():
        rows = [
            (
                str(e.get("name", "")),
                tag("span", "on" if e.get("on") else "off", class_="on" if e.get("on") else "off"),
                str(e.get("reason", "")),
                plain(e.get("error_without")),
            )
            for e in report.get("effects", ())
        ]
        parts += [
            tag("h3", f"Effects in {target}"),
            table(("effect", "", "because", "relative error without it"), rows, class_="wide", numeric_from=3),
        ]
    if not run.explain:
        parts.append(missing("The scenes’ effects were not recorded."))
    parts.append(tag("h3", "Where the light goes"))
    parts += light(run.lost_light) if run.lost_light else [missing("Not recorded: only physical data lose light.")]
    parts.append(tag("h3", "Why the solvers stopped"))
    if run.rows:
        parts.append(table(("solves", "", "reason (the numbers are of one of them)"), stop_reasons(run), numeric_from=9))
    else:
        parts.append(missing("No solves."))
    return parts


def light(shares: Mapping[str, float]) -> list[Child]:
    """Write the shares of the light at the mirrors: what is lost on the way, and apart from it what is detected."""
    lost: list[tuple[str, str]] = []
    detected: list[tuple[str, str]] = []
    caption = None
    for name, share in shares.items():
        if "band-pass" in name and share == 0:
            lost.append((name, "not rendered"))
            caption = "The fine cube covers 450-670 nm, so what the filter stops was not rendered."
        else:
            (detected if name.startswith("detected") else lost).append((name, f"{100 * share:.3g} %"))
    head = "of the light at the mirrors"
    return [
        table(("lost before a pixel", head), lost, caption=caption) if lost else None,
        table(("reaches a pixel", head), detected) if detected else None,
    ]


def stop_reasons(run: RunData) -> list[tuple[str, str, str]]:
    """Count the solves by outcome and reason; reasons that differ in numbers alone are one."""
    counts: dict[tuple[str, str], int] = {}
    example: dict[tuple[str, str], str] = {}
    for row in run.rows:
        key = ({True: "converged", False: "stopped early", None: "not said"}[row.converged], NUMBER.sub("#", row.stop))
        counts[key] = counts.get(key, 0) + 1
        example.setdefault(key, row.stop)
    return [(str(counts[key]), key[0], example[key]) for key in sorted(counts)]


def plain(value: Any) -> str:
    """Write a JSON value on one line."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.3g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)


def pairs(values: dict[str, Any]) -> Child:
    """Write nested settings as a definition list with dotted names."""
    flat: list[tuple[str, str]] = []

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, dict) and value:
            for key, inner in value.items():
                walk(f"{prefix}.{key}" if prefix else str(key), inner)
        else:
            flat.append((prefix, plain(value)))

    walk("", values)
    return tag("dl", [[tag("dt", name), tag("dd", text)] for name, text in flat]) if flat else missing("Not recorded.")


def provenance(run: RunData) -> list[Child]:
    """Write how to make this page again, and on what it was made."""
    parts: list[Child] = [tag("h3", "To run this again"), tag("pre", tag("code", run.command))]
    parts += [tag("h3", "Configuration"), pairs(dict(run.summary.get("config") or {}))]
    machine = dict(run.summary.get("machine") or {})
    told = machine.get(CALL)
    if isinstance(told, int | float):
        del machine[CALL]
    call = run.timings.get(CALL, told if isinstance(told, int | float) else None)
    parts += [tag("h3", "Machine and versions"), pairs({"optsim": run.summary.get("version"), **machine})]
    parts += [tag("h3", "Time"), *times(run.timings, call)]
    return parts


def times(timings: Mapping[str, float], call: float | None) -> list[Child]:
    """Write the wall time of each stage and of the call, and apart from them the time summed over threads."""
    apart = {name: s for name, s in timings.items() if name.endswith(THREADS) or name in SUMMED_OVER_SOLVES}
    stages = {name: s for name, s in timings.items() if name not in apart and name != CALL}
    rows = [(name, f"{s:.1f} s") for name, s in stages.items()]
    rows += [("sum of these stages", f"{sum(stages.values()):.1f} s")] if len(stages) > 1 else []
    rows += [(CALL, f"{call:.1f} s")] if call is not None else []
    parts: list[Child] = [table(("stage", "wall time"), rows)] if rows else []
    if apart:
        solves = [(name.removesuffix(THREADS).strip(), f"{s:.1f} thread-seconds") for name, s in apart.items()]
        parts.append(table(("summed over threads", "not wall time"), solves, caption=THREADS_NOTE))
    return parts or [missing("Not recorded.")]


def missing(text: str) -> Markup:
    """Write a sentence about what is not there."""
    return tag("p", text, class_="missing")
