"""A whole study: what it leaves, that it repeats, resumes, and stops cleanly."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from optsim.study.config import StudyConfig
from optsim.study.plan import SolveTask, shootings, solves
from optsim.study.pool import Progress, Stopped, run_all
from optsim.study.run import run_study
from optsim.study.store import Store, digest

TINY = StudyConfig(size=16, targets=("color-checker",), groups=(1,), gpsr_groups=(1,), physical_groups=(1,), render_error=0.05)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "a"
    return folder, run_study(TINY, folder, quiet=True)


def estimates(folder):
    """Return the bytes of all cubes, frames and estimates."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted([*folder.rglob("*.nc"), *folder.rglob("*.exr")])}


def test_the_default_study_has_every_case_that_it_promises():
    tasks = solves(StudyConfig())
    assert len({t.name for t in tasks}) == len(tasks) == 2 * (4 * 4 + 2 * 4 + 4 + 4 * 4)
    for target in StudyConfig().targets:
        shots = {(s.series.key, s.ratio): s.shots for s in shootings(StudyConfig(), target) if not s.physical}
        assert [shots["mono-distinct", r] for r in (1 / 8, 1 / 4, 3 / 8, 1 / 2)] == [3, 6, 9, 12]
        assert [shots["foveon", r] for r in (1 / 8, 1 / 4, 3 / 8, 1 / 2)] == [1, 2, 3, 4]


def test_a_run_leaves_summary_page_cubes_frames_and_estimates(finished):
    folder, outcome = finished
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["config"]["size"] == 16
    assert len(summary["rows"]) == len(outcome.rows) == 4 + 4 * 2 + 4 * 2 + 4 * 2 * 3
    assert (folder / "report.html").stat().st_size > 10_000
    assert len(list((folder / "frames").glob("*.nc"))) == 8
    assert not list(folder.rglob(".tmp-*"))


def test_a_second_call_finds_everything_finished_and_changes_no_byte(finished):
    folder, _ = finished
    before = estimates(folder)
    stamps = {path: path.stat().st_mtime_ns for path in folder.rglob("*.nc")}
    run_study(TINY, folder, quiet=True)
    assert estimates(folder) == before
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.nc")} == stamps


@pytest.mark.slow
def test_N10_one_worker_and_two_give_the_same_bytes_and_so_does_a_resumed_run(finished, tmp_path):
    folder, _ = finished
    one = TINY.model_copy(update={"workers": 1})
    run_study(one, tmp_path / "b", quiet=True)
    assert estimates(tmp_path / "b") == estimates(folder)
    for path in sorted((tmp_path / "b" / "estimates").glob("*.json"))[::2]:
        path.unlink()
    next((tmp_path / "b" / "estimates").glob("*.nc")).write_bytes(b"damaged")
    (tmp_path / "b" / "cubes" / "color-checker.json").unlink()
    run_study(one, tmp_path / "b", quiet=True)
    assert estimates(tmp_path / "b") == estimates(folder)


def test_an_entry_whose_inputs_changed_is_computed_anew(finished, tmp_path):
    folder, _ = finished
    other = TINY.model_copy(update={"seed": 1, "gpsr_groups": (), "physical_groups": ()})
    run_study(other, tmp_path / "c", quiet=True)
    theirs = estimates(tmp_path / "c")
    assert all(theirs[name] != estimates(folder)[name] for name in theirs)


def test_I13_the_same_task_twice_is_refused_and_one_is_enough():
    with pytest.raises(ValueError, match="twice"):
        StudyConfig(targets=("color-checker", "color-checker"))
    with pytest.raises(ValueError, match="groups"):
        StudyConfig(groups=())
    assert len(solves(StudyConfig(targets=("color-checker",), groups=(1,), gpsr_groups=(), physical_groups=()))) == 4


@pytest.mark.slow
def test_I14_two_runs_on_one_folder_leave_what_one_leaves(finished, tmp_path):
    folder, _ = finished
    code = "from optsim.study.config import StudyConfig\nfrom optsim.study.run import run_study\nfrom pathlib import Path\n"
    code += f"run_study(StudyConfig.model_validate_json({TINY.model_dump_json()!r}), Path({str(tmp_path / 'd')!r}), quiet=True)"
    runs = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(2)]
    assert [run.wait() for run in runs] == [0, 0]
    assert estimates(tmp_path / "d") == estimates(folder)


@pytest.mark.slow
def test_ctrl_c_says_what_stays_and_the_same_command_gives_the_same_bytes(finished, tmp_path):
    folder, _ = finished
    (tmp_path / "s.toml").write_text("".join(f"{k} = {json.dumps(v)}\n" for k, v in TINY.model_dump(mode="json").items() if v is not None))
    words = [sys.executable, "-m", "optsim", "run", "--config", str(tmp_path / "s.toml"), "--out", str(tmp_path / "e")]
    # A shell that starts us in the background hands down SIGINT ignored; a terminal does not.
    run = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    while not list((tmp_path / "e" / "estimates").glob("*.json")) and run.poll() is None:
        time.sleep(0.05)
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130
    assert "the same command goes on from there" in said
    assert subprocess.run(words, capture_output=True).returncode == 0
    assert estimates(tmp_path / "e") == estimates(folder)


@pytest.mark.slow
def test_ctrl_c_in_the_study_of_claims_keeps_its_solves(tmp_path):
    words = [sys.executable, "-m", "optsim", "study", "paper-claims", "--quick", "--out", str(tmp_path)]
    kept = {}
    for enough in (1, 3):  # the second start goes on from the first
        run = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
        while len(list((tmp_path / "solves").rglob("*.json"))) < enough and run.poll() is None:
            time.sleep(0.05)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
        assert run.returncode == 130
        assert "the same command goes on from there" in said
        assert f"{len(kept)} of them finished before" in said
        assert all(path.read_bytes() == record for path, record in kept.items())
        kept = {path: path.read_bytes() for path in (tmp_path / "solves").rglob("*.json")}
    assert len(kept) >= 3


class Piece:
    def __init__(self, name):
        self.name, self.cost = name, 1.0


def test_ctrl_c_stops_running_tasks_and_leaves_the_rest_undone():
    done = []

    def work(task, tick):
        for _ in range(200):
            tick()
            time.sleep(0.01)
        done.append(task.name)
        return "done"

    class Interrupting(Progress):
        def advance(self, cost, text):
            raise KeyboardInterrupt

    def quick(task, tick):
        return "done" if task.name == "first" else work(task, tick)

    with pytest.raises(KeyboardInterrupt), Interrupting(4, quiet=True) as progress:
        run_all([Piece("first"), Piece("a"), Piece("b"), Piece("c")], quick, 2, progress)
    assert done == []


def test_a_failing_task_is_reported_and_the_others_finish():
    def work(task, tick):
        if task.name == "bad":
            raise ValueError("no light")
        return "fine"

    with Progress(3, quiet=True) as progress:
        failures = run_all([Piece("a"), Piece("bad"), Piece("c")], work, 2, progress)
    assert list(failures) == ["bad"]
    assert not isinstance(failures["bad"], Stopped)


def test_a_damaged_or_foreign_record_does_not_count_as_finished(tmp_path):
    import xarray as xr

    store = Store(tmp_path)
    store.keep("x", digest(1), {"a": 1}, {"x.nc": xr.Dataset({"v": ("i", np.arange(3.0))})})
    assert store.finished("x", digest(1)) == {"a": 1}
    assert store.finished("x", digest(2)) is None
    whole = (tmp_path / "x.nc").read_bytes()
    (tmp_path / "x.nc").write_bytes(whole[:-1])
    assert store.finished("x", digest(1)) is None


def test_I3_one_flipped_bit_anywhere_makes_an_entry_unfinished(tmp_path):
    import xarray as xr

    store = Store(tmp_path)
    store.keep("x", digest(1), {}, {"x.nc": xr.Dataset({"v": ("i", np.arange(50.0))})})
    whole = (tmp_path / "x.nc").read_bytes()
    for place in np.random.default_rng(0).integers(0, 8 * len(whole), 200):
        flipped = bytearray(whole)
        flipped[place // 8] ^= 1 << (place % 8)
        (tmp_path / "x.nc").write_bytes(flipped)
        assert store.finished("x", digest(1)) is None
    (tmp_path / "x.nc").write_bytes(whole)
    assert store.finished("x", digest(1)) == {}


def test_I11_a_folder_that_cannot_be_made_is_refused_by_name(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="--out"):
        Store(tmp_path / "file" / "run")


def test_I12_unknown_keys_of_a_study_file_are_refused_with_the_right_one(tmp_path):
    (tmp_path / "s.toml").write_text("sizes = 3\n")
    with pytest.raises(ValueError, match="did you mean size"):
        StudyConfig.from_toml(tmp_path / "s.toml")
    for text in ("render_error = nan\n", "seed = -1\n", "groups = [1, 1]\n", "tau_fractions = [1e-5, 1e-3]\n", "size = 1e5\n"):
        (tmp_path / "s.toml").write_text(text)
        with pytest.raises(ValueError, match=text.split(" =")[0]):
            StudyConfig.from_toml(tmp_path / "s.toml")
    (tmp_path / "s.toml").write_text("size = 32\nsize = 33\n")
    with pytest.raises(ValueError, match="--config"):
        StudyConfig.from_toml(tmp_path / "s.toml")


def test_names_of_tasks_are_fit_for_file_names():
    assert all(set(task.name) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-.") for task in solves(StudyConfig()))
    assert isinstance(solves(StudyConfig())[0], SolveTask)
