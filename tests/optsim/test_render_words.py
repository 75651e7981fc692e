"""What `optsim render` and `optsim explain` take and tell, run in this process."""

import json
import re

import pytest

from optsim.cli import words
from optsim.cli.app import main
from optsim.files import read


def run(*arguments):
    with pytest.raises(SystemExit) as left:
        main([str(a) for a in arguments])
    return left.value.code


def test_render_tells_the_error_it_reached_and_keeps_it_in_the_file(tmp_path, capsys):
    assert run("render", "color-checker", "--size", 8, "--spp", 64, "-o", tmp_path / "c.nc") == 0
    told = re.search(r"error (\S+) \((\S+) to (\S+) at 95 %\) in the worst band, (\d+) paths", capsys.readouterr().err)
    error, low, high = (float(x) for x in told.groups()[:3])
    assert low <= error <= high
    assert read(tmp_path / "c.nc").attrs["error"] == pytest.approx(error, rel=0.05)


def test_a_flat_scene_tells_a_bound_and_that_it_took_no_samples(tmp_path, capsys):
    assert run("render", "color-checker", "--size", 8, "-o", tmp_path / "c.nc") == 0
    assert "at most, without samples" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:the render stopped")
def test_max_samples_ends_a_render_short_of_its_error(tmp_path, capsys):
    options = ("--error", 1e-3, "--without", "spectral_nodes", "--max-samples", 8)
    assert run("render", "color-checker", "--size", 8, *options, "-o", tmp_path / "c.nc") == 0
    assert "8 paths a pixel" in capsys.readouterr().err
    assert read(tmp_path / "c.nc").attrs["error"] > 1e-3


def test_effects_left_out_or_forced_by_word_stand_in_the_file_and_in_what_is_told(tmp_path, capsys):
    assert (
        run("render", "color-checker", "--size", 8, "--spp", 8, "--without", "sky", "--without", "interreflection", "-o", tmp_path / "c.nc")
        == 0
    )
    assert "left out by hand: interreflection, sky" in capsys.readouterr().err
    attrs = read(tmp_path / "c.nc").attrs
    assert attrs["max_depth"] == 2
    assert json.loads(attrs["effects"])["sky"]["decided_by"] == "without"
    assert run("explain", "color-checker", "--without", "sky", "--force", "lens_blur", "--json") == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["effects"]}
    assert (rows["sky"]["on"], rows["lens_blur"]["on"]) == (False, True)


def test_unknown_and_contradictory_effects_are_refused_by_option(tmp_path, capsys):
    assert run("render", "relief", "--force", "moonlight", "-o", tmp_path / "c.nc") == 2
    assert "--force: must be one of interreflection" in capsys.readouterr().err
    assert run("explain", "color-checker", "--force", "sky", "--without", "sky") == 2
    assert "forced" in capsys.readouterr().err
    assert run("explain", "--camera", "default", "--force", "sky") == 2


def test_progress_is_told_in_lines_where_it_cannot_be_drawn_over(monkeypatch, capsys):
    now = iter([0.0, 1.0, 10.5, 12.0, 21.0])
    monkeypatch.setattr(words.time, "monotonic", lambda: next(now))
    with words.progress_bar("rendering") as progress:
        for share in (0.1, 0.25, 0.3, 0.5):
            progress(share, f"error {share:g}")
    assert capsys.readouterr().err.splitlines() == ["rendering 25% error 0.25", "rendering 50% error 0.5"]
