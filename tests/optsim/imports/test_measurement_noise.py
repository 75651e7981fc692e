"""A foreign measurement whose gain and read noise are stated has a known noise, and what is missing is named by option and attribute."""

import numpy as np
import pytest

from optsim.camera import noise_variance
from optsim.cli.app import _code
from optsim.files import read

SIDE, K, GAIN, READ, DARK_DN = 16, 4, 0.5, 6.0, 20.0


def mask():
    return np.random.default_rng(1).random((SIDE, SIDE)) < 0.5


def mean_electrons():
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    seen = np.zeros((SIDE, SIDE + K - 1))
    for k in range(K):
        seen[:, k : k + SIDE] += mask() * 800 * (1 + np.sin(3 * x + k) * y)
    return seen


def exposures(count):
    rng = np.random.default_rng(2)
    electrons = rng.poisson(mean_electrons(), (count, SIDE, SIDE + K - 1)) + rng.normal(0, READ, (count, SIDE, SIDE + K - 1))
    return np.round(GAIN * electrons + DARK_DN)


def brought_in(folder, *more):
    np.save(folder / "f.npy", exposures(1)[0])
    np.save(folder / "m.npy", mask())
    words = ["import-measurement", str(folder / "f.npy"), "--mask", str(folder / "m.npy"), "--shifts", "1"]
    return _code([*words, "--wavelengths", "450,500,550,600", "--offset", str(DARK_DN), "-o", str(folder / "o.nc"), *more])


def test_the_variance_of_a_foreign_measurement_is_that_of_repeated_exposures(tmp_path):
    assert brought_in(tmp_path, "--gain", str(GAIN), "--read-noise", str(READ)) == 0
    frames = read(tmp_path / "o.nc")
    told = noise_variance(frames)[0, 0]
    assert frames.attrs["units"] == "DN"
    bright = mean_electrons() > 100
    assert (told / exposures(2000).var(axis=0, ddof=1))[bright].mean() == pytest.approx(1, abs=0.02)


def test_weights_and_discrepancy_work_on_it(tmp_path):
    assert brought_in(tmp_path, "--gain", str(GAIN), "--read-noise", str(READ)) == 0
    words = ["reconstruct", str(tmp_path / "o.nc"), "--weighted", "--tau", "discrepancy", "-o", str(tmp_path / "e.nc")]
    assert _code(words) == 0
    assert read(tmp_path / "e.nc")["radiance"].attrs["units"] == "DN"


@pytest.mark.parametrize(("words", "option"), [(["--weighted"], "--weighted"), (["--tau", "discrepancy"], "--tau discrepancy")])
def test_noise_that_nobody_stated_is_asked_for_by_the_option_given(tmp_path, capsys, words, option):
    assert brought_in(tmp_path) == 0
    capsys.readouterr()
    assert _code(["reconstruct", str(tmp_path / "o.nc"), *words, "-o", str(tmp_path / "e.nc")]) == 2
    said = capsys.readouterr().err
    assert f"optsim: {option}: must be given with frames in DN that have the attributes gain, read_noise_e and dark_e_per_s" in said
    assert "o.nc: units 'relative', no gain and read_noise_e and dark_e_per_s" in said
    assert "import-measurement --gain --read-noise" in said


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--gain", "2"], "--gain: must be given with --read-noise, got 2"),
        (["--read-noise", "2"], "--read-noise: must be given with --gain, got 2"),
        (["--gain", "0", "--read-noise", "2"], "--gain: must be above 0 and at most 1e9 DN per electron, got 0"),
        (["--gain", "1", "--read-noise", "-2"], "--read-noise: must be from 0 to 1e9 electrons, got -2"),
        (["--gain", "nan", "--read-noise", "2"], "--gain: must be above 0"),
    ],
)
def test_a_gain_or_read_noise_that_makes_no_sense_is_refused(tmp_path, capsys, words, sentence):
    assert brought_in(tmp_path, *words) == 2
    assert sentence in capsys.readouterr().err


def test_an_attribute_that_is_no_number_is_named(tmp_path):
    assert brought_in(tmp_path, "--gain", str(GAIN), "--read-noise", str(READ)) == 0
    frames = read(tmp_path / "o.nc").assign_attrs(gain="high")
    with pytest.raises(ValueError, match=r"^gain: must be a finite number"):
        noise_variance(frames)
