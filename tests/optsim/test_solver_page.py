"""What docs/solvers.md tells a reader to type exists, and works."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

from optsim.camera import Mono, band_model_of, masks_for, measure_matched, signal_of
from optsim.camera.dmd import Distinct
from optsim.cli.app import _code
from optsim.cube import Bands, make_cube
from optsim.files import read, write
from recon import (
    Admm,
    BasisPursuit,
    Fista,
    Gap,
    PlugAndPlay,
    Quality,
    TotalVariation,
    adjoint_error,
    choose_prior,
    never_below,
    reconstruct,
)

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "solvers.md").read_text(encoding="utf-8")
TABLE = TEXT[: TEXT.index("## How fast")]


@pytest.fixture
def frames():
    y, x, k = np.ogrid[:16, :16, :24]
    cube = make_cube((1.2 + np.sin(y / 3 + k / 4) * np.cos(x / 3)) * np.ones((16, 16, 24)), Bands.paper())
    return measure_matched(cube, Mono(), masks_for(Mono(), 3, Distinct(), (16, 16), 0))


def test_every_object_that_the_page_names_can_be_imported_from_where_it_says():
    called = {
        name for code in re.findall(r"`([^`\n]+)`", TABLE) if "optsim." not in code for name in re.findall(r"\b([A-Za-z]\w+)\(", code)
    }
    others = {"Given": "recon.tau", "quality": "optsim.study.library", "f": ""}
    assert {"choose_prior", "never_below", "PlugAndPlay", "adjoint_error", "quality", "learned", "Gpsr"} <= called
    for name in called - {"f"}:
        assert hasattr(importlib.import_module(others.get(name, "recon")), name), name
    for path in re.findall(r"\]\(\.\./([\w/.]+)\)", TABLE):
        assert (ROOT / path).is_file(), path


def test_the_program_of_the_page_reconstructs_a_frames_file(tmp_path, monkeypatch, frames):
    (program,) = re.findall(r"^```python\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)
    write(frames, tmp_path / "frames.nc")
    monkeypatch.chdir(tmp_path)
    exec(program, found := {})
    assert found["solution"].cube.shape == (16, 16, 24)
    assert found["solution"].stop.converged


@pytest.mark.parametrize("solver", [BasisPursuit(), Admm(), Fista(), Gap(max_iterations=5)])
def test_radiance_is_exactly_not_negative_with_every_solver_but_gpsr(frames, solver):
    operator, signal = band_model_of(frames).operator(np.float32), signal_of(frames)
    tau = 1.0 if solver.needs_tau else None
    assert reconstruct(operator, signal, solver=solver, tau=tau, nonnegative=True).cube.min() >= 0


def test_the_calls_of_the_page_that_choose_and_plug_in_work(frames):
    operator, signal = band_model_of(frames).operator(np.float32), signal_of(frames)
    assert adjoint_error(operator) < 1e-5
    choice = choose_prior(operator, signal, (Quality(), TotalVariation()))
    assert choice.errors[[Quality, TotalVariation].index(type(choice.prior))] == min(choice.errors)
    assert never_below(operator, signal, Quality()).cube.shape == (16, 16, 24)
    plugged = reconstruct(operator, signal, prior=PlugAndPlay(denoiser=lambda picture, sigma: picture), solver=Gap(max_iterations=3))
    assert np.isfinite(plugged.cube).all()


def test_the_options_of_the_page_are_those_of_the_command(tmp_path, frames):
    write(frames, tmp_path / "f.nc")
    rows = [line.split(" | ")[2] for line in TABLE.splitlines() if line.startswith("| ") and line.count(" | ") == 3][2:]
    words = {code for row in rows for code in re.findall(r"`(--[^`]+)`", row)}
    assert {"--prior quality", "--prior tv", "--nonnegative", "--weighted --tau discrepancy", "--solver gpsr --tau 1e-4"} <= words
    for options in sorted(words - {"--weighted --tau discrepancy"}):
        more = ["--solver", "gpsr"] if options == "--debias" else []
        command = ["reconstruct", str(tmp_path / "f.nc"), *options.split(), *more, "--max-iterations", "3", "-o", str(tmp_path / "e.nc")]
        assert _code(command) == 0, options
        assert read(tmp_path / "e.nc").attrs["kind"] == "estimate"


def test_the_page_is_what_its_program_writes(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT))
    module = importlib.import_module("benchmarks.solver_page")
    monkeypatch.setattr("sys.argv", ["solver_page", "--output", str(tmp_path / "page.md")])
    monkeypatch.chdir(ROOT)
    module.main()
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == TEXT
