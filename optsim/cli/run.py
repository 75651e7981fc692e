"""The main job."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from optsim.errors import InputError


def run(
    *,
    quick: Annotated[bool, Parameter(help="64 x 64, target 1, R = 1/8 and 1/2: under a minute.", negative="")] = False,
    out: Annotated[
        Path | None,
        Parameter(help="Folder for report.html, summary.json, figures, cubes, frames (default optsim-run; with --quick optsim-run-quick)."),
    ] = None,
    seed: Annotated[int | None, Parameter(help="0 to 4294967295 (default 0); the same seed gives the same bytes.")] = None,
    config: Annotated[Path | None, Parameter(help="Study as TOML; its keys are the fields of StudyConfig, see docs/study.md.")] = None,
) -> None:
    """Run the whole study: render both targets, photograph them with three sensors, reconstruct, score, and write the page."""
    from optsim.study.config import StudyConfig
    from optsim.study.run import run_study

    if quick and config is not None:
        raise InputError("--quick", quick, "given without --config")
    study = StudyConfig.quick() if quick else StudyConfig() if config is None else StudyConfig.from_toml(config)
    if seed is not None:
        study = StudyConfig.model_validate(study.model_dump() | {"seed": seed})
    options = ["--quick"] * quick + (["--config", str(config)] if config else []) + ["--seed", str(study.seed)]
    folder = out or Path("optsim-run-quick" if quick else "optsim-run")
    outcome = run_study(study, folder, " ".join(["optsim run", *options]))
    print(f"done in {outcome.seconds:.0f} s: {outcome.page}", file=sys.stderr)
