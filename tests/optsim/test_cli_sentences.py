"""What the command line says when something is missing, wrong or worth a warning: sentences, in the words that the user typed."""

import subprocess
import sys
import warnings

import numpy as np
import pytest
import xarray as xr

from optsim.cli import app
from optsim.cube import Bands, make_cube
from optsim.files import write


def told(capsys, *words):
    assert app._code([str(word) for word in words]) == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("render", "color-checker"), "optsim: render needs -o (--output): File to write."),
        (("render", "color-checker", "--outptu", "c.nc"), "Did you mean --output instead of --outptu?"),
        (("render", "-o", "c.nc"), "optsim: render needs SCENE: "),
        (("score", "a.nc"), "optsim: score needs TRUTH: The true cube."),
        (("render", "color-checker", "-o"), "-o requires an argument"),
        (("render", "color-checker", "--size", "-o", "c.nc"), "--size"),
    ],
)
def test_what_is_missing_is_named_as_it_is_typed(capsys, words, sentence):
    text = told(capsys, *words)
    assert sentence in text
    assert "parameter --output" not in text


def test_of_two_files_the_one_of_the_wrong_kind_is_named(capsys, tmp_path):
    cube, frames = tmp_path / "cube.nc", tmp_path / "frames.nc"
    write(make_cube(np.ones((8, 8, 2)), Bands.parse("500:600:2")), cube)
    write(xr.Dataset({"frames": (("shot", "channel", "y", "x"), np.ones((1, 1, 8, 9)))}), frames)
    for pair in ((frames, cube), (cube, frames)):
        text = told(capsys, "score", *pair)
        assert f"optsim: {frames}: must be a cube or an estimate (with a variable radiance), got 'frames'" in text
        assert str(cube) not in text
    text = told(capsys, "score", cube, tmp_path / "absent.nc")
    assert "absent.nc" in text


def test_a_cube_that_is_damaged_inside_is_named_with_the_place(capsys, tmp_path):
    good = make_cube(np.ones((8, 8, 2)), Bands.parse("500:600:2"))
    write(good, tmp_path / "good.nc")
    good["radiance"].attrs["units"] = "lux"
    write(good, tmp_path / "bad.nc")
    text = told(capsys, "score", tmp_path / "good.nc", tmp_path / "bad.nc")
    assert f"{tmp_path / 'bad.nc'}: radiance.units: must be" in text


def test_a_warning_is_a_sentence_without_a_place_in_the_code(capsys, monkeypatch):
    monkeypatch.delenv(app.TRACEBACK, raising=False)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with pytest.raises(SystemExit, match="0"):
            app.main(["--version"])
        warnings.warn("the lamp is met by chance only", RuntimeWarning, stacklevel=1)
    assert capsys.readouterr().err == "optsim: warning: the lamp is met by chance only\n"


def test_a_render_that_warns_prints_no_file_of_the_program(tmp_path):
    words = ["render", "cornell", "--size", "8", "--error", "1e-3", "--max-samples", "64", "-o", "c.nc"]
    run = subprocess.run([sys.executable, "-m", "optsim", *words], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "optsim: warning: " in run.stderr
    assert ".py" not in run.stderr
    assert "RuntimeWarning" not in run.stderr
