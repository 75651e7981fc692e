"""Mitsuba's own scenes: refused unless trusted, and then rendered to known radiances."""

import numpy as np
import pytest

from optsim.cli.app import main
from optsim.cube import Bands
from optsim.errors import InputError
from optsim.files import read
from optsim.render import RenderSettings

XML = """<scene version="3.0.0">
  <integrator type="direct"/>
  <emitter type="constant"><spectrum name="radiance" type="regular"><float name="wavelength_min" value="400"/>
    <float name="wavelength_max" value="700"/><string name="values" value="1, 4"/></spectrum></emitter>
  <shape type="sphere">
    <bsdf type="diffuse"><spectrum name="reflectance" type="uniform"><float name="value" value="0.5"/></spectrum></bsdf></shape>
  <sensor type="orthographic"><transform name="to_world"><scale value="0.3"/><lookat origin="0,0,3" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="640"/><integer name="height" value="480"/></film></sensor>
</scene>"""


def run(*arguments):
    with pytest.raises(SystemExit) as left:
        main([str(a) for a in arguments])
    return left.value.code


@pytest.fixture
def xml(tmp_path):
    file = tmp_path / "ball.xml"
    file.write_text(XML)
    return file


def test_a_mitsuba_scene_is_refused_without_the_flag_and_told_why(xml, tmp_path, capsys):
    assert run("render", xml, "--size", 4, "-o", tmp_path / "c.nc") == 2
    told = capsys.readouterr().err
    assert "--trust-mitsuba-scene" in told
    assert "any plugin" in told
    assert not (tmp_path / "c.nc").exists()
    assert run("render", "relief", "--size", 4, "--trust-mitsuba-scene", "-o", tmp_path / "c.nc") == 2


def test_a_trusted_scene_is_rendered_in_our_bands_at_our_size(xml, tmp_path, capsys):
    """A grey ball under an even sky of radiance 1 + (nm - 400) / 100 sends back half of it in each band."""
    assert run("render", xml, "--size", 8, "--bands", "450:650:4", "--spp", 512, "--trust-mitsuba-scene", "-o", tmp_path / "c.nc") == 0
    assert "95 %" in capsys.readouterr().err
    cube = read(tmp_path / "c.nc")
    centre = np.array([475.0, 525, 575, 625])
    np.testing.assert_allclose(cube["radiance"].values.mean((0, 1)), 0.5 * (1 + (centre - 400) / 100), rtol=0.01)
    assert cube["radiance"].shape == (8, 8, 4)
    assert "trusted" in cube.attrs["integrator"]


def test_a_trusted_dictionary_is_rendered_and_one_without_a_sensor_refused():
    from optsim.render.trusted import render_trusted

    sky = {"type": "constant", "radiance": {"type": "uniform", "value": 2.0}}
    scene = {"type": "scene", "sky": sky, "eye": {"type": "perspective", "fov": 40.0, "film": {"type": "hdrfilm"}}}
    cube = render_trusted(scene, Bands.from_edges([500.0, 520, 540]), (4, 4), RenderSettings(samples_per_pixel=256))
    np.testing.assert_allclose(cube["radiance"].values.mean((0, 1)), 2.0, rtol=0.02)
    with pytest.raises(InputError, match="sensor"):
        render_trusted({"type": "scene", "sky": sky}, Bands.from_edges([500.0, 520]), (4, 4))


def test_a_trusted_render_goes_on_from_its_checkpoint_with_the_same_bytes(xml, tmp_path):
    from optsim.render.trusted import render_trusted

    bands, settings, file = Bands.from_edges([500.0, 520, 540]), RenderSettings(samples_per_pixel=64), tmp_path / "state"
    whole = render_trusted(xml, bands, (4, 4), settings)

    def stop(done, error):
        if done >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_trusted(xml, bands, (4, 4), settings, stop, file)
    shares = []
    again = render_trusted(xml, bands, (4, 4), settings, lambda done, error: shares.append(done), file)
    assert len(shares) == 4
    assert np.array_equal(again["radiance"].values, whole["radiance"].values)
    assert again.attrs["config_digest"] == whole.attrs["config_digest"]
