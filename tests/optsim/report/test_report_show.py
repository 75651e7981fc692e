"""One file, one picture: cubes down to one pixel, frames of every sensor, and refusals by name."""

import json

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from optsim.report.color import SceneLight, srgb
from optsim.report.data import Capture
from optsim.report.show import cube_figure, looked_at, show, thin
from optsim.report.style import styled


def words(figure):
    """Return every text of a figure, the labels of subfigures and colour bars included."""
    import matplotlib.text

    return " | ".join(t.get_text() for t in figure.findobj(matplotlib.text.Text))


def is_picture(path):
    pixels = np.asarray(Image.open(path).convert("RGB"), float)
    return min(pixels.shape[:2]) > 200 and pixels.std() > 5


@pytest.mark.parametrize("size", [(1, 1, 1), (2, 3, 2), (64, 64, 24), (5, 200, 3)])
def test_I16_a_cube_of_any_size_opens(tmp_path, size):
    *shape, count = size
    bands = Bands.from_edges(np.linspace(450, 650, count + 1))
    cube = np.random.Generator(np.random.Philox(3)).uniform(0, 1, (*shape, count))
    assert is_picture(show(make_cube(cube, bands, 0.01 * cube), tmp_path / "c.png"))


@pytest.mark.parametrize("value", [0.0, 0.5])
def test_I16_a_cube_of_equal_values_states_its_scale_and_standard_error(value):
    with styled():
        figure = cube_figure(make_cube(np.full((8, 8, 24), value), Bands.paper(), np.full((8, 8, 24), 0.0125)), None)
        text = words(figure)
    assert f"{value:.4g} to {value:.4g} (all values are equal)" in text
    assert "median 0.013" in text or "median 0.012" in text
    assert "W m⁻² sr⁻¹ nm⁻¹" in text
    assert "±2 standard errors" in text


def test_I16_a_value_that_is_not_finite_is_refused(tmp_path):
    cube = make_cube(np.ones((4, 4, 24)), Bands.paper())
    cube["radiance"].values[1, 2, 3] = np.nan
    with pytest.raises(InputError, match="radiance"):
        show(cube, tmp_path / "c.png")
    assert not (tmp_path / "c.png").exists()


def test_I16_a_large_cube_is_thinned_before_it_is_read():
    lazy = make_cube(np.broadcast_to(np.float32(1), (3000, 1500, 1)).copy(), Bands.from_edges([500.0, 510.0]))
    small, step = thin(lazy)
    assert step == 3
    assert small.sizes["y"] == 1000
    assert small.sizes["x"] == 500
    with styled():
        assert "one pixel in 3 each way" in words(cube_figure(lazy, [(2999, 1499)]))


def test_spectra_are_those_of_the_points_asked_for(tmp_path):
    cube = np.random.Generator(np.random.Philox(5)).uniform(0, 1, (12, 9, 24))
    with styled():
        figure = cube_figure(make_cube(cube, Bands.paper()), [(3, 7), (11, 0)])
        lines = [line for ax in figure.findobj(lambda a: hasattr(a, "get_ylabel") and a.get_ylabel()) for line in ax.get_lines()]
    shown = [line.get_ydata() for line in lines if len(line.get_ydata()) == 24]
    assert np.array_equal(shown[0], cube[3, 7])
    assert np.array_equal(shown[1], cube[11, 0])


@pytest.mark.parametrize("points", [[(12, 0)], [(0, -1)], [], [(0, 0)] * 9])
def test_points_outside_the_picture_are_refused(tmp_path, points):
    with pytest.raises(InputError, match="points"):
        show(make_cube(np.ones((12, 9, 24)), Bands.paper()), tmp_path / "c.png", points)


@pytest.mark.parametrize(("sensor", "R", "units"), [("mono", 0.25, "relative"), ("bayer", 0.25, "electron"), ("foveon", 0.125, "DN")])
def test_frames_of_every_sensor_open(run, tmp_path, sensor, R, units):
    frames = run.frames(Capture("color-checker", sensor, "distinct", R, "matched"))
    data = xr.Dataset({"frames": (("shot", "channel", "y", "x"), frames.values)}, attrs={"units": units, "sensor": sensor})
    if frames.cfa is not None:
        data["cfa"] = (("y", "x"), frames.cfa)
    assert is_picture(show(data, tmp_path / "f.png"))


def test_a_file_of_another_kind_or_name_is_refused(tmp_path):
    with pytest.raises(InputError, match="file"):
        show(xr.Dataset({"temperature": ("x", [1.0])}), tmp_path / "x.png")
    with pytest.raises(InputError, match="--out"):
        show(make_cube(np.ones((2, 2, 24)), Bands.paper()), tmp_path / "x.html")


def lit(cube, white, lamps=()):
    data = make_cube(cube, Bands.paper())
    return data.assign_attrs(illuminant=json.dumps({"white": list(white), "lamps": [list(lamp) for lamp in lamps]}))


def test_a_lamp_in_the_picture_sets_neither_its_exposure_nor_its_points():
    """A room of two greys with a lamp a hundred times as bright, and the lamp's edge half covered."""
    cube = np.full((40, 40, 24), 0.1)
    cube[:, 20:] *= 0.5
    without = lit(cube, np.full(24, 0.2), [np.full(24, 10.0)])
    cube = cube.copy()
    cube[4:8, 4:12] = 10.0
    cube[8, 4:12] = 5.0
    look, plain = looked_at(lit(cube, np.full(24, 0.2), [np.full(24, 10.0)])), looked_at(without)
    np.testing.assert_allclose(look.exposure.white, plain.exposure.white)
    assert look.top == pytest.approx(0.1)
    assert not any(3 <= y <= 9 and 3 <= x <= 12 for y, x in look.points)
    assert looked_at(make_cube(cube, Bands.paper())).top == 10.0, "nothing is known of a lamp there"


def test_the_white_of_a_picture_is_its_lamps_colour_and_not_its_brightest_surfaces():
    red = np.linspace(0.1, 1.0, 24)
    cube = np.broadcast_to(0.3 * red, (20, 20, 24)).copy()
    flat = looked_at(lit(cube, np.ones(24))).exposure
    own = looked_at(make_cube(cube, Bands.paper())).exposure
    shown = srgb(cube, Bands.paper(), flat)[0, 0]
    assert shown[0] > shown[2] + 0.2, "red under white light"
    np.testing.assert_allclose(srgb(cube, Bands.paper(), own)[0, 0], 1.0, atol=1e-3)


def test_an_estimate_is_shown_at_the_points_and_in_the_exposure_of_the_truth(tmp_path):
    rng = np.random.Generator(np.random.Philox(5))
    truth = np.kron(rng.uniform(0.1, 1, (3, 3, 24)), np.ones((10, 10, 1)))
    estimate = make_cube(truth * rng.uniform(0.5, 1.5, truth.shape), Bands.paper())
    with styled():
        figure = cube_figure(estimate, None, make_cube(truth, Bands.paper()))
    for y, x in looked_at(make_cube(truth, Bands.paper())).points:
        assert f"y {y}, x {x}" in words(figure)
    with pytest.raises(InputError, match="--points-from"):
        show(estimate, tmp_path / "c.png", like=make_cube(truth[:-1], Bands.paper()))


@pytest.mark.parametrize("text", [None, "", "{}", '{"white": [1, 2], "lamps": []}', '{"white": "x", "lamps": 3}'])
def test_an_attribute_about_light_that_does_not_fit_is_ignored(text):
    assert SceneLight.of(text, 24) is None
