"""The scenes beside the two targets: what makes each of them what it is called."""

import numpy as np
import pytest

import scenes
from scenes.bricks import Bricks
from scenes.dim_bright import DimBright
from scenes.errors import InputError
from scenes.library import illuminant, observer, reflectance, reflectances, samples, training_samples
from scenes.library import test_samples as held_out_samples
from scenes.metamers import metamer_pairs, tristimulus_weights
from scenes.procedural import Procedural
from scenes.scene import Textured
from scenes.textured import TexturedBoard, random_weights


def colour_of(curve, lamp):
    """Tristimulus values by colour-science, which shares no code with the scene."""
    colour = pytest.importorskip("colour")
    shape = colour.SpectralShape(380, 780, 1)
    sd = colour.SpectralDistribution(dict(zip(shape.wavelengths, curve.at(shape.wavelengths))))
    light = colour.SDS_ILLUMINANTS[lamp].copy().align(shape, interpolator=colour.LinearInterpolator)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    return np.asarray(colour.colorimetry.sd_to_XYZ_integration(sd, illuminant=light, cmfs=cmfs))


def difference(a, b, lamp):
    colour = pytest.importorskip("colour")
    white = colour_of(scenes.Spectrum.constant(1.0, 380, 780), lamp)
    labs = [colour.XYZ_to_Lab(colour_of(c, lamp) / white[1], colour.XYZ_to_xy(white)) for c in (a, b)]
    return float(colour.delta_E(*labs, method="CIE 2000"))


def test_metamers_look_alike_under_D65_and_unlike_under_A_and_differ_as_spectra():
    pairs = metamer_pairs()
    assert len(pairs) == 24
    under_day = [difference(*pair, "D65") for pair in pairs]
    under_lamp = [difference(*pair, "A") for pair in pairs]
    assert max(under_day) < 0.05
    assert np.median(under_lamp) > 1
    nm = np.linspace(450, 670, 100)
    apart = [np.sqrt(np.mean((a.at(nm) - b.at(nm)) ** 2)) for a, b in pairs]
    assert min(apart) > 0.02  # a dark sample leaves little room
    assert np.median(apart) > 0.1
    assert all(c.value.min() >= 0 and c.value.max() <= 1 for pair in pairs for c in pair)


def test_the_weights_of_the_observer_give_white_a_luminance_of_one():
    nodes = np.arange(380.0, 781.0, 5.0)
    assert tristimulus_weights(nodes)[1].sum() == pytest.approx(1, abs=1e-12)
    assert set(observer()) == {"x", "y", "z"}


def test_samples_to_learn_from_and_to_test_with_share_nothing_with_each_other_or_the_chart():
    train, test = set(training_samples()), set(held_out_samples())
    assert not train & test
    assert train | test == set(samples())
    assert not (train | test) & set(reflectances())
    curves = {name: reflectance(name) for name in (*samples(), *reflectances())}
    nm = np.arange(400.0, 701.0, 10.0)
    table = np.stack([c.at(nm) for c in curves.values()])
    distance = np.linalg.norm(table[:, None] - table[None], axis=-1) + 10 * np.eye(len(table))
    assert distance.min() > 1e-3


def test_random_weights_are_mixtures_whose_fields_fall_off_as_asked():
    weights = random_weights((128, 96), 5, 1.0, 7)
    np.testing.assert_allclose(weights.sum(-1), 1, atol=1e-6)
    assert weights.min() >= 0
    assert np.array_equal(weights, random_weights((128, 96), 5, 1.0, 7))
    assert not np.array_equal(weights, random_weights((128, 96), 5, 1.0, 8))

    def roughness(exponent):
        field = random_weights((128, 128), 2, exponent, 1)[..., 0]
        return float(np.abs(np.diff(field, axis=0)).mean() / field.std())

    assert roughness(0.0) > roughness(1.0) > roughness(2.0)


def test_the_textured_board_has_no_two_neighbouring_texels_alike():
    texture = TexturedBoard(texels=61).texture()
    change = np.abs(np.diff(texture.weights, axis=1)).max(-1)
    assert np.mean(change > 0) > 0.999
    table = texture.table(np.linspace(450, 670, 24))
    assert np.linalg.matrix_rank(table, tol=1e-2 * np.linalg.norm(table)) >= 6


def test_alcoves_fall_by_ten_and_their_walls_keep_the_light_apart():
    scene = DimBright().build()
    peaks = np.array([light.spectrum.maximum for light in scene.lights])
    np.testing.assert_allclose(peaks[1:] / peaks[:-1], 0.1)
    assert len(scene.lights) == 7
    from scenes.visibility import first_pair_that_sees_each_other

    assert first_pair_that_sees_each_other(scene) is None


def test_the_reference_points_of_the_bricks_are_what_the_camera_sees_there():
    recipe = Bricks()
    scene = recipe.build()
    pytest.importorskip("trimesh")
    for name, (x, y) in recipe.picture_points().items():
        (origin,), (d,) = scene.viewpoint.rays(np.array([x]), np.array([y]))
        nearest, hit = np.inf, None
        for shape in scene.shapes:
            for corners in shape.polygons():
                for k in range(1, len(corners) - 1):
                    distance = ray_triangle(origin, d, corners[[0, k, k + 1]])
                    if distance < nearest:
                        nearest, hit = distance, shape
        point = recipe.reference_points()[name]
        assert hit.material == point.material, (name, hit.name)
        np.testing.assert_allclose(origin + nearest * d, point.position, atol=3e-4)


def ray_triangle(origin, d, corners):
    """Distance along a ray to a triangle (Moeller and Trumbore 1997), infinite when missed."""
    e1, e2 = corners[1] - corners[0], corners[2] - corners[0]
    p = np.cross(d, e2)
    determinant = e1 @ p
    if abs(determinant) < 1e-18:
        return np.inf
    t = origin - corners[0]
    u = t @ p / determinant
    q = np.cross(t, e1)
    v, far = d @ q / determinant, e2 @ q / determinant
    return far if u >= 0 and v >= 0 and u + v <= 1 and far > 0 else np.inf


def test_random_scenes_differ_by_number_repeat_by_number_and_are_drawn_from_their_own_half():
    one = Procedural(seed=5).build()
    assert one == Procedural(seed=5).build()
    assert one != Procedural(seed=6).build()
    for training, own in ((False, held_out_samples()), (True, training_samples())):
        scene = Procedural(seed=3, training=training).build()
        curves = [s for m in scene.materials.values() for s in m.curves]
        assert {s.name for s in curves} <= set(own)
        assert any(isinstance(m, Textured) for m in scene.materials.values())
    assert scenes.scene_by_name("procedural-12").seed == 12
    with pytest.raises(InputError, match="scene"):
        scenes.scene_by_name("procedural-x")


def test_flat_random_scenes_are_proven_flat_and_solid_ones_are_not():
    from scenes.visibility import first_pair_that_sees_each_other

    assert first_pair_that_sees_each_other(Procedural(seed=1).build()) is None
    assert first_pair_that_sees_each_other(Procedural(seed=1, solids=3).build()) is not None


def test_a_lamp_of_any_kind_may_light_any_scene():
    for recipe in scenes.SCENES:
        scene = type(recipe)(**({"lamp": illuminant("D65")})).build()
        assert scene.lights[0].spectrum.label.startswith("D65") or scene.lights[0].spectrum.wavelength_nm.size > 2
