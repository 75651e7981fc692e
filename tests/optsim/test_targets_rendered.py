"""The rendered targets against closed forms: Lambert's law under an integrated lamp, and bars on whole mirrors."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

from optsim.cube import Bands
from optsim.render import RenderSettings, render
from scenes.checker_bars import CheckerBars
from scenes.color_checker import ColorChecker, Region
from scenes.library import illuminant, reflectance, reflectances

BANDS = Bands.from_edges([452.5, 500.0, 580.0, 668.5])


def lambertian(light, x, y, curve):
    """Integrate over the lamp for a point of the board; multiply by the band mean of lamp x reflectance on a fine grid."""
    u, v, c = (np.asarray(p) for p in (light.half_u, light.half_v, light.center))
    area = np.linalg.norm(np.cross(u, v))

    def density(a, b):
        r = c + a * u + b * v - [x, y, 0]
        return area * r[2] * -(r @ light.normal) / np.linalg.norm(r) ** 4

    factor = dblquad(density, -1, 1, -1, 1, epsabs=1e-10, epsrel=1e-8)[0]
    means = []
    for low, high in zip(BANDS.lower, BANDS.upper, strict=True):
        grid = np.linspace(low, high, 20001)
        means.append(np.trapezoid(light.radiance.at(grid) * curve.at(grid), grid) / (high - low))
    return factor * np.array(means) / np.pi


def mirrors(box: Region, size: int) -> tuple[slice, slice]:
    """Return the mirrors that lie wholly inside a region."""
    left, top = (math.ceil(v * size - 1e-9) for v in box[:2])
    right, bottom = (math.floor(v * size + 1e-9) for v in box[2:])
    return slice(top, bottom), slice(left, right)


@pytest.mark.parametrize("lamp", ["xenon", "D65", "A"])
def test_every_patch_has_the_radiance_of_lamberts_law_in_every_band(lamp):
    recipe = ColorChecker(lamp=illuminant(lamp))
    scene = recipe.build()
    cube = render(scene, BANDS, (64, 64), RenderSettings(samples_per_pixel=64, seed=1)).radiance.values
    for name, box in recipe.patch_boxes().items():
        rows, columns = mirrors(box, 64)
        x = ((columns.start + columns.stop) / 128 - 0.5) * recipe.side_m
        y = (0.5 - (rows.start + rows.stop) / 128) * recipe.side_m
        got = cube[rows, columns].reshape(-1, BANDS.count).mean(0)
        np.testing.assert_allclose(got, lambertian(scene.lights[0], x, y, reflectance(name)), rtol=3e-3)


def test_bars_of_two_and_one_mirrors_fill_whole_mirrors_and_leave_whole_gaps():
    recipe = CheckerBars()
    scene = recipe.build()
    cube = render(scene, BANDS, (256, 256), RenderSettings(samples_per_pixel=16, seed=2)).radiance.values
    plain = render(ColorChecker().build(), BANDS, (256, 256), RenderSettings(samples_per_pixel=16, seed=2)).radiance.values
    white = next(name for name in reflectances() if name.startswith("white"))
    for group in recipe.bar_columns().values():
        rows = slice(round(group.top * 256), round(group.bottom * 256))
        barred = np.zeros(256, bool)
        for left, right in group.columns:
            barred[round(left * 256) : round(right * 256)] = True
        first, last = round(group.columns[0][0] * 256), round(group.columns[-1][1] * 256)
        region = slice(first, last)
        bars, gaps = cube[rows, region][:, barred[region]], cube[rows, region][:, ~barred[region]]
        ratio = gaps / plain[rows, region][:, ~barred[region]]
        assert np.mean(np.abs(ratio - 1) < 1e-5) > 0.999, "a sample on a border may fall to either side, in float32"
        assert ratio.mean() == pytest.approx(1, abs=1e-3)
        x = ((first + last) / 512 - 0.5) * recipe.side_m
        y = (0.5 - (group.top + group.bottom) / 2) * recipe.side_m
        expected = lambertian(scene.lights[0], x, y, reflectance(white))
        np.testing.assert_allclose(bars.reshape(-1, BANDS.count).mean(0), expected, rtol=3e-3)
        np.testing.assert_allclose(bars, np.broadcast_to(expected, bars.shape), rtol=0.1)
    above = slice(0, round(0.02 * 256))
    np.testing.assert_allclose(cube[above], plain[above], rtol=0.02)
