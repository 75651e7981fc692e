"""Write docs/verdict.md, what became of the paper's claims, from a finished `optsim study paper-claims`.

python -m benchmarks.verdict_page FOLDER [--output docs/verdict.md]
"""

# ruff: noqa: E501
from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

FIGURES = (
    ("readings-target1", "Every reading of target 1: mean paired difference of PSNR with its 95 % interval; yellow: what the paper claims"),
    ("light-gaps", "Foveon, Bayer and mono against light at equal total time; light bands: efficiencies 30 % lower or higher"),
    ("against-ratio", "PSNR against the compression ratio, matched data, basis pursuit"),
)
WORDS = {"holds": "**holds**", "holds_only_if": "**holds only**", "does_not_hold": "**does not hold**,"}
HEADS = ("overall, base readings: ", "overall, all cases: ")


def claims_table(entries: list[dict[str, Any]]) -> str:
    """Return each claim's verdict under the base readings and over all cases, as Markdown."""
    lines = [
        "| claim | under the base readings | over all cases | our number, dB (95 %) |",
        "| --- | --- | --- | --- |",
    ]
    for ident in dict.fromkeys(entry["id"] for entry in entries):
        found = [next((e for e in entries if e["id"] == ident and e["reading"].startswith(head)), None) for head in HEADS]
        told = ["–" if e is None else f"{WORDS[e['verdict']]} {e['reading'].removeprefix(head)}" for e, head in zip(found, HEADS)]
        shown = next(e for e in found if e is not None)
        low, high = shown["interval_db"]
        number = f"{shown['value_db']:+.2f} [{low:+.2f}, {high:+.2f}]".replace("-", "−")
        lines.append(f"| {shown['claim']} | {told[0]} | {told[1]} | {number} |")
    return "\n".join(lines)


def page(folder: Path) -> str:
    """Return the document."""
    entries = json.loads((folder / "claims.json").read_text())["claims"]
    kept = json.loads((folder / "rows.json").read_text())
    rows, config = kept["rows"], kept["config"]
    cpu = sum(row["cpu_seconds"] for row in rows) / 3600
    pictures = "\n\n".join(f"![{words}](figures/verdict-{name}.png)\n\n*{words}.*" for name, words in FIGURES)
    return f"""# What became of the paper's claims

Written by `python -m benchmarks.verdict_page` from one run of `optsim study paper-claims` (seed {config["seed"]}): {len(rows)} solves, {cpu:.1f} hours of one core's time in all,
{config["size"]} x {config["size"]} and {config["large"]} x {config["large"]} mirrors, two targets and {config["scenes"]} random scenes. [How it is judged](study.md); the whole page, with every case, comes from that command.

{claims_table(entries)}

The number is that of the case which stands for the claim under the base readings: one where it holds, if there is one. The claims on random scenes are our question, not the paper's.

{pictures}
"""


def main() -> None:
    """Write the page and copy its figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, default=Path("docs/verdict.md"))
    options = parser.parse_args()
    options.output.write_text(page(options.folder), encoding="utf-8")
    for name, _ in FIGURES:
        shutil.copy(options.folder / "figures" / f"{name}.png", options.output.parent / "figures" / f"verdict-{name}.png")
    print(f"{options.output} written")


if __name__ == "__main__":
    main()
