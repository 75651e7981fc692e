"""The page's last sections: what was modelled, which light was lost, why solvers stopped, and where the run comes from."""

from __future__ import annotations

import json
import re
from typing import Any

from optsim.report.data import RunData
from optsim.report.html import Child, Markup, table, tag

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
    parts.append(tag("h3", "Light that never reaches a pixel"))
    if run.lost_light:
        lost = [(name, f"{100 * value:.3g} %") for name, value in run.lost_light.items()]
        parts.append(table(("where it goes", "of the light at the mirrors"), lost))
    else:
        parts.append(missing("Not recorded: only physical data lose light."))
    parts.append(tag("h3", "Why the solvers stopped"))
    if run.rows:
        parts.append(table(("solves", "", "reason (the numbers are of one of them)"), stop_reasons(run), numeric_from=9))
    else:
        parts.append(missing("No solves."))
    return parts


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
    parts += [tag("h3", "Machine and versions"), pairs({"optsim": run.summary.get("version"), **dict(run.summary.get("machine") or {})})]
    parts.append(tag("h3", "Time"))
    if run.timings:
        rows = [(name, f"{seconds:.1f} s") for name, seconds in run.timings.items()]
        parts.append(table(("stage", "wall time"), [*rows, ("sum", f"{sum(run.timings.values()):.1f} s")]))
    else:
        parts.append(missing("Not recorded."))
    return parts


def missing(text: str) -> Markup:
    """Write a sentence about what is not there."""
    return tag("p", text, class_="missing")
