"""The verb study: the verdict on the paper's claims, and the paper's experiment."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import cyclopts
from cyclopts import Parameter

from optsim import __version__
from optsim.cli.words import Json, print_json

if TYPE_CHECKING:
    from optsim.study.claims.answer import Claims
    from optsim.study.experiment import Experiment

Quick = Annotated[bool, Parameter(help="Small pictures, few scenes: minutes.", negative="")]
Out = Annotated[Path | None, Parameter(help="Folder for the page, figures and numbers; the same command goes on where it was stopped.")]
Seed = Annotated[int, Parameter(help="0 to 4294967295; the same seed gives the same numbers.")]

Found = TypeVar("Found", "Claims", "Experiment")

app = cyclopts.App(name="study", help_format="markdown", version=__version__)


@app.command(name="paper-claims")
def paper_claims(*, quick: Quick = False, out: Out = None, seed: Seed = 0, json: Json = False) -> None:
    """Judge every claim of the paper under readings that change one factor at a time, with intervals.

    Prints the plan and the expected time first: quick under 5 minutes, in full some 2 hours on two cores. Leaves
    paper-claims.html, claims.json, rows.json and figures/.

    Example: `optsim study paper-claims --quick --out verdict`
    """
    from optsim.study.claims.config import ClaimsConfig
    from optsim.study.claims.run import run_claims

    config = ClaimsConfig.quick(seed) if quick else ClaimsConfig(seed=seed)
    folder = out or Path("optsim-claims-quick" if quick else "optsim-claims")
    _tell(run_claims(config, folder, _command("paper-claims", quick, seed)), _tell_claims, json)


@app.command(name="experiment")
def experiment(*, quick: Quick = False, out: Out = None, seed: Seed = 0, json: Json = False) -> None:
    """Photograph toy bricks with the paper's test bed, emulated, and compare the recovered spectra with the truth.

    8 bits, glass plates, noise; all sensors, R = 1/8 and 1/2. Leaves experiment.html, experiment.json, cubes, frames, estimates and
    figures/ (the paper's Fig. 9 to 11).

    Example: `optsim study experiment --quick --out bricks`
    """
    from optsim.study.experiment import ExperimentConfig, run_experiment

    config = ExperimentConfig.quick(seed) if quick else ExperimentConfig(seed=seed)
    folder = out or Path("optsim-experiment-quick" if quick else "optsim-experiment")
    _tell(run_experiment(config, folder, _command("experiment", quick, seed)), _tell_experiment, json)


def _command(name: str, quick: bool, seed: int) -> str:
    return " ".join(["optsim study", name, *["--quick"] * quick, "--seed", str(seed)])


def _tell(found: Found, in_words: Callable[[Found], None], json: bool) -> None:
    """Print what a study found, as JSON or in words, and where its page lies."""
    if json:
        print_json(found.as_dict())
    else:
        in_words(found)
    print(f"done in {found.seconds:.0f} s: {found.page}", file=sys.stderr)


def _tell_claims(found: Claims) -> None:
    for verdict in found.verdicts:
        e = verdict.best.estimate
        print(f"{verdict.claim.text}; {verdict.among}: {verdict.sentence}")
        print(f"    {e.mean:+.2f} dB [{e.low:+.2f}, {e.high:+.2f}] with {verdict.best.name}; {verdict.best.where}")


def _tell_experiment(found: Experiment) -> None:
    for row in found.rows:
        errors = ", ".join(f"{point} {100 * at['error']:.0f} %" for point, at in row["signatures"].items())
        print(f"{row['sensor']:7s} {row['masks']:9s} R = {row['R']:<6g} {row['psnr_db']:6.2f} dB; error of signatures: {errors}")
