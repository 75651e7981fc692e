"""A foreign measurement and its estimate are in the unit that the measurement says of itself, in files, figures and scores."""

import matplotlib.text
import numpy as np
import pytest

from optsim.camera import Mono, cube_units_of, masks_for, measure_matched
from optsim.camera.dmd import Distinct
from optsim.camera.elsewhere import frames_from
from optsim.cli.app import _code
from optsim.cube import UNITS, Bands, make_cube
from optsim.errors import InputError
from optsim.files import read, read_cube, write
from optsim.report.show import cube_figure, frames_figure
from optsim.report.style import styled

K = 4
BANDS = Bands.from_centers([450.0, 500, 560, 640])


def foreign(response=None, **attrs):
    rng = np.random.default_rng(0)
    return frames_from(rng.random((16, 19)), rng.random((16, 16)) < 0.5, np.arange(K), BANDS, response=response, attrs=attrs)


def words(figure):
    return " | ".join(t.get_text() for t in figure.findobj(matplotlib.text.Text))


@pytest.mark.parametrize(
    ("response", "attrs", "unit"),
    [
        (None, {}, "relative"),
        (None, {"units": "DN"}, "DN"),
        (np.full(K, 2.0), {}, "relative / response"),
        (np.full(K, 2.0), {"units": "electron"}, "electron / response"),
        (np.full(K, 2.0), {"units": "electron", "cube_units": UNITS}, UNITS),
    ],
)
def test_the_estimate_of_a_foreign_measurement_is_in_its_own_unit_over_response(response, attrs, unit):
    assert cube_units_of(foreign(response, **attrs)) == unit


def test_a_unit_that_no_cube_has_is_refused():
    with pytest.raises(InputError, match=r"cube_units: must be one of .*got 'lux'"):
        foreign(cube_units="lux")


def test_our_own_frames_give_watts_and_those_of_a_relative_cube_its_unit():
    masks = masks_for(Mono(), 1, Distinct(), (8, 8), 0)
    cube = np.ones((8, 8, K))
    assert cube_units_of(measure_matched(make_cube(cube, BANDS), Mono(), masks)) == UNITS
    assert cube_units_of(measure_matched(make_cube(cube, BANDS, units="DN"), Mono(), masks)) == "DN"


@pytest.mark.parametrize("suffix", [".nc", ".exr"])
def test_reconstruct_writes_the_unit_and_score_and_show_read_it(tmp_path, capsys, suffix):
    write(foreign(np.full(K, 2.0)), tmp_path / "f.nc")
    estimate = tmp_path / f"e{suffix}"
    assert _code(["reconstruct", str(tmp_path / "f.nc"), "--solver", "gap", "--max-iterations", "2", "-o", str(estimate)]) == 0
    found = read_cube(estimate)
    assert found["radiance"].attrs["units"] == "relative / response"
    write(make_cube(found["radiance"].values + 1, BANDS), tmp_path / "t.nc")
    capsys.readouterr()
    assert _code(["score", str(estimate), str(tmp_path / "t.nc")]) == 0
    said = capsys.readouterr()
    assert f"the estimate is in frame units over response, the truth in {UNITS}" in said.err
    assert f"RMSE                    1 {UNITS}" in said.out
    write(make_cube(found["radiance"].values + 1, BANDS, units="relative / response"), tmp_path / "r.nc")
    assert _code(["score", str(estimate), str(tmp_path / "r.nc")]) == 0
    said = capsys.readouterr()
    assert (said.err, "W m" in said.out) == ("", False)
    with styled():
        assert "W m" not in words(cube_figure(found, None))
        assert "radiance, frame units over response" in words(cube_figure(found, None))


def test_frames_of_others_are_shown_in_relative_units_and_ours_as_sums_of_radiances(tmp_path):
    write(foreign(), tmp_path / "f.nc")
    with styled():
        text = words(frames_figure(read(tmp_path / "f.nc")))
        assert "relative units: " in text
        assert "W m" not in text
        ours = measure_matched(make_cube(np.ones((8, 8, K)), BANDS), Mono(), masks_for(Mono(), 1, Distinct(), (8, 8), 0))
        assert "sum of band radiances, W m⁻² sr⁻¹ nm⁻¹" in words(frames_figure(ours))


def test_an_estimate_in_relative_units_is_not_photographed_in_watts(tmp_path, capsys):
    write(make_cube(np.ones((8, 8, K)), BANDS, units="relative"), tmp_path / "c.nc")
    words_given = ["measure", str(tmp_path / "c.nc"), "--sensor", "mono", "--shots", "1", "--physical", "--interpolate"]
    assert _code([*words_given, "-o", str(tmp_path / "f.nc")]) == 2
    assert "radiance.units: must be 'W m-2 sr-1 nm-1'" in capsys.readouterr().err
