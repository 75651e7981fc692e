"""Light that paths cannot find is named, and only that: from lights of no size by way of polished glass and metal."""

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.render import RenderSettings, explain, render
from scenes.lights import AreaLight, ConstantSky, DirectionalLight, PointLight
from scenes.materials import Conductor, Dielectric, Diffuse
from scenes.scene import Scene
from scenes.shapes import Box, Rectangle
from scenes.viewpoint import Orthographic

FLOOR = Rectangle(name="floor", material="grey", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
PANE = Box(name="pane", material="pane", center=(0, 0, 0.5), half_u=(3, 0, 0), half_v=(0, 3, 0), half_w=(0, 0, 0.01))
GREY, GLASS = Diffuse(reflectance=0.5), Dielectric(index=1.5)
SUN = DirectionalLight(direction=(0.3, 0, -1), irradiance=1.0)
BULB = PointLight(position=(0, 0, 2), intensity=1.0)
LAMP = AreaLight(center=(0, 0, 2), half_u=(0.5, 0, 0), half_v=(0, -0.5, 0), radiance=1.0)
SKY = ConstantSky(radiance=1.0)


def scene(light, pane=GLASS, shapes=(FLOOR, PANE)):
    view = Orthographic(origin=(0, 0, 0.4), target=(0, 0, 0), up=(0, 1, 0), half_height=0.5)
    return Scene(name="pane", shapes=shapes, materials={"grey": GREY, "pane": pane}, lights=(light,), viewpoint=view)


@pytest.mark.parametrize("light", [SUN, BULB], ids=["sun", "bulb"])
@pytest.mark.parametrize("pane", [GLASS, Conductor(eta=1.5, k=3.0)], ids=["glass", "metal"])
def test_lights_of_no_size_beside_polished_things_are_warned_of(light, pane):
    (sentence,) = explain(scene(light, pane)).warnings
    assert sentence.startswith("lights[0]: light of no size")
    assert "'pane'" in sentence


def test_nothing_is_missing_from_lights_with_a_size_nor_where_nothing_is_polished():
    for light in (LAMP, SKY):
        assert explain(scene(light)).warnings == ()
    for light in (SUN, BULB):
        assert explain(scene(light, GREY)).warnings == ()
        assert explain(scene(light, shapes=(FLOOR,))).warnings == ()


@pytest.mark.parametrize("light", [SUN, BULB], ids=["sun", "bulb"])
def test_the_light_that_is_warned_of_is_missing_and_an_area_lights_is_not(light):
    bands, settings = Bands.parse("500:600:2"), RenderSettings(samples_per_pixel=64)
    with pytest.warns(RuntimeWarning, match="light of no size"):
        dark = render(scene(light), bands, (4, 4), settings)["radiance"].values
    assert np.all(dark == 0)
    lit = render(scene(LAMP), bands, (4, 4), settings)["radiance"].values.mean()
    bare = render(scene(LAMP, shapes=(FLOOR,)), bands, (4, 4), settings)["radiance"].values.mean()
    assert 0.75 < lit / bare < 1.0
