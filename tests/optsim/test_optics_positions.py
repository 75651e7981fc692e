"""Where the whole path lands light: against three-dimensional lines and planes, closed forms, a vector Snell law and optiland."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from optsim.camera import CameraConfig, Dispersion, glass
from optsim.camera.faces import Faces
from optsim.camera.mount import SensorMount
from optsim.camera.pupil import rings
from optsim.errors import InputError

BAND = np.linspace(452, 668, 13)
FIELD = np.linspace(-1.75, 1.75, 5)
F1, F2, PITCH_MM = 138.2, 100.0, 0.0099
EDGE = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])


def table_camera(**more):
    """A camera without a prism's own field effects: 550 nm goes straight through, so that lines and planes judge it."""
    return CameraConfig(table={}, **more)


def diagonal(distance):
    """A field point on the diagonal across the tilt's axis."""
    return distance / math.sqrt(2), -distance / math.sqrt(2)


# --- nothing stated, nothing changed ---------------------------------------------------------------------------


@pytest.mark.parametrize("camera", [CameraConfig(), CameraConfig(table={})], ids=["prism", "table"])
def test_the_default_path_is_the_dispersion_to_the_last_bit(camera):
    X, Y = np.meshgrid(FIELD, FIELD)
    ours = camera.optics.position_px(BAND[:, None, None], X, Y)
    for mine, theirs in zip(ours, camera.dispersion.position_px(BAND[:, None, None], X, Y)):
        assert np.array_equal(mine, theirs)
    assert camera.optics.pupil() is None
    assert camera.optics.magnification_px == camera.dispersion.magnification_px


def test_a_chief_ray_given_as_the_pupil_s_middle_is_the_chief_ray():
    camera = CameraConfig(dmd={"tilt_deg": 24}, relay={"distortion_per_mm2": 1e-3, "defocus_mm": 0.1})
    one, other = camera.optics.position_px(BAND, 1.0, -0.5), camera.optics.position_px(BAND, 1.0, -0.5, (0.0, 0.0))
    assert all(np.array_equal(a, b) for a, b in zip(one, other))


def test_a_wavelength_is_found_again_from_where_the_whole_path_lands_it():
    optics = CameraConfig(dmd={"tilt_deg": 24.0, "offset_x_px": 3.0}, relay={"distortion_per_mm2": 1e-3}).optics
    assert isinstance(optics, Dispersion)
    assert np.allclose(optics.wavelength_at(optics.position_px(BAND)[0]), BAND, rtol=0, atol=1e-8)


# --- registration ----------------------------------------------------------------------------------------------


def test_an_offset_moves_every_wavelength_and_place_by_exactly_itself():
    moved = CameraConfig(dmd={"offset_x_px": 0.3125, "offset_y_px": -2.5}).optics.position_px(BAND[:, None], FIELD, 1.0)
    x, y, _ = CameraConfig().optics.position_px(BAND[:, None], FIELD, 1.0)
    assert np.allclose(moved[0], x + 0.3125, rtol=0, atol=1e-12)
    assert np.allclose(moved[1], y - 2.5, rtol=0, atol=1e-12)


def test_turned_and_scaled_mirrors_are_imaged_turned_and_scaled_with_the_dispersion_still_along_rows():
    turn, scale = math.radians(3.0), 1.07
    x, y, _ = table_camera(dmd={"rotation_deg": 3.0, "scale": scale}).optics.position_px(BAND, 1.2, -0.7)
    curve = table_camera().dispersion.position_px(BAND)[0]
    m = F2 / F1 / PITCH_MM
    assert np.allclose(x - curve, scale * m * (math.cos(turn) * 1.2 + math.sin(turn) * 0.7), rtol=0, atol=1e-9)
    assert np.allclose(y, scale * m * (math.sin(turn) * 1.2 - math.cos(turn) * 0.7), rtol=0, atol=1e-9)


# --- tilted mirrors --------------------------------------------------------------------------------------------


def through_a_pinhole(X, Y, tilt, sensor_tilt):
    """Image a point of a tilted plane through the origin onto a tilted plane: lines and planes in three dimensions, in px."""
    axis, across = np.array([1, 1, 0]) / math.sqrt(2), np.array([1, -1, 0]) / math.sqrt(2)
    tilted = math.cos(tilt) * across + math.sin(tilt) * np.array([0, 0, 1])
    a, b = (X + Y) / math.sqrt(2), (X - Y) / math.sqrt(2)
    source = np.array([0, 0, -F1]) + a * (-axis) + b * (np.array([-1, -1, 1]) * tilted)  # the inverted picture, on the lens's other side
    u = math.cos(sensor_tilt) * across + math.sin(sensor_tilt) * np.array([0, 0, 1])
    # source x t = (0, 0, F2) + p axis + q u
    p, q, _ = np.linalg.solve(np.stack([axis, u, -source], axis=1), np.array([0, 0, -F2]))
    return (p + q) / math.sqrt(2) / PITCH_MM, (p - q) / math.sqrt(2) / PITCH_MM


@pytest.mark.parametrize("scheimpflug", [True, False])
@pytest.mark.parametrize("tilt", [24.0, -24.0, 5.0])
def test_tilted_mirrors_are_imaged_by_lines_through_the_pupil_s_middle(tilt, scheimpflug):
    optics = table_camera(dmd={"tilt_deg": tilt}, relay={"scheimpflug": scheimpflug}).optics
    theta = math.radians(tilt)
    sensor_tilt = math.atan(F2 / F1 * math.tan(theta)) if scheimpflug else 0.0
    origin = float(optics.position_px(550.0)[0])
    for X, Y in ((0.0, 0.0), (1.75, 1.75), (1.75, -1.75), (-1.75, 1.75), (0.3, -1.2)):
        x, y, valid = optics.position_px(550.0, X, Y)
        assert valid
        assert (float(x) - origin, float(y)) == pytest.approx(through_a_pinhole(X, Y, theta, sensor_tilt), abs=1e-9)


def test_scheimpflug_leaves_an_anamorphism_of_cos_over_cos_of_four_percent():
    optics = table_camera(dmd={"tilt_deg": 24.0}).optics
    h = 1e-5

    def stretch(sign):
        (x, y, _), (x0, y0, _) = (optics.position_px(550.0, s * h, sign * s * h) for s in (1, -1))
        return math.hypot(float(x - x0), float(y - y0)) / (2 * h * math.sqrt(2)) / (F2 / F1 / PITCH_MM)

    theta = math.radians(24)
    other = math.atan(F2 / F1 * math.tan(theta))
    assert stretch(-1) == pytest.approx(math.cos(theta) / math.cos(other), rel=1e-8)
    assert stretch(1) == pytest.approx(1, rel=1e-8)
    assert stretch(-1) == pytest.approx(0.96, abs=0.001)


def test_with_scheimpflug_all_rays_of_a_mirror_meet_in_one_point_at_the_design_wavelength():
    table, prism = table_camera(dmd={"tilt_deg": 24.0}).optics, CameraConfig(dmd={"tilt_deg": 24.0}).optics
    points = rings(32).points
    for X, Y in ((0, 0), (1.75, 1.75), (1.75, -1.75)):
        assert np.ptp(table.position_px(550.0, X, Y, points)[:2], axis=1).max() < 1e-9
        assert np.ptp(prism.position_px(550.0, X, Y, points)[:2], axis=1).max() < 1e-3  # the prism's own anamorphism


def test_without_scheimpflug_the_corner_s_blur_is_its_depth_over_the_f_number_nine_to_ten_mirrors():
    optics = table_camera(dmd={"tilt_deg": 24.0}, relay={"scheimpflug": False}).optics
    x, y, _ = optics.position_px(550.0, *diagonal(2.5), EDGE)
    diameter_px = math.hypot(x[0] - x[1], y[0] - y[1])
    depth = 2.5 * math.sin(math.radians(24))
    image = 1 / (1 / F2 + 1 / F1 - 1 / (F1 - depth))
    assert diameter_px * PITCH_MM == pytest.approx(F1 / 8 * abs(1 - F2 / image), rel=1e-10)  # the cone's width off its tip
    mirrors = diameter_px * PITCH_MM * F1 / F2 / 0.01368
    assert 9 < mirrors < 10
    assert mirrors == pytest.approx(depth / 8 / 0.01368, rel=0.01)
    assert len(optics.pupil().points) >= 32


def test_mirrors_that_reach_the_lens_are_refused():
    camera = table_camera(dmd={"tilt_deg": 59.0}, relay={"collimator_mm": 10.0, "focal_mm": 7.0})
    with pytest.raises(InputError, match=r"dmd\.tilt_deg"):
        camera.optics.position_px(550.0, *diagonal(11.0))


def test_tilted_mirrors_are_as_sharp_in_the_converging_beam_as_upright_ones():
    points = rings(64).points
    for X, Y in ((1.75, -1.75), (-1.75, 1.75)):
        upright, tilted = (
            CameraConfig(relay={"converging": True}, dmd={"tilt_deg": t}).optics.position_px(550.0, X, Y, points) for t in (0.0, 24.0)
        )
        assert np.hypot(tilted[0].std(), tilted[1].std()) < 1.5 * np.hypot(upright[0].std(), upright[1].std())


def test_a_ray_along_the_sensor_never_meets_it():
    x, y, meets = SensorMount(100.0, 2.0).hit(*np.zeros((2, 3)), np.array([0.0, 0.35, 0.36]), np.array([0.0, -0.35, -0.36]))
    assert meets.tolist() == [True, True, False]  # 2 x 0.36 x sqrt 2 > 1
    assert np.isfinite([x, y]).all()


# --- defocus and distortion ------------------------------------------------------------------------------------


def test_a_defocus_opens_the_cone_to_a_disc_of_defocus_over_the_f_number():
    optics = CameraConfig(relay={"defocus_mm": 0.25}).optics
    for X, Y in ((0.0, 0.0), (1.75, -1.75)):
        x, y, _ = optics.position_px(600.0, X, Y, EDGE)
        assert (x[1] - x[0]) * PITCH_MM == pytest.approx(0.25 / optics.f_number, rel=1e-4)
        assert (y[3] - y[2]) * PITCH_MM == pytest.approx(0.25 / optics.f_number, rel=1e-4)
    assert optics.f_number == pytest.approx(8 * F2 / F1, rel=1e-14)


def test_the_tilt_s_numbers_are_those_of_the_theory():
    plain, tilted = CameraConfig().optics, CameraConfig(dmd={"tilt_deg": 24.0}).optics
    corner = [np.subtract(a, b) for a, b in zip(*(o.position_px(550.0, 1.75, np.array([1.75, -1.75]))[:2] for o in (tilted, plain)))]
    assert np.hypot(*corner).max() == pytest.approx(5.07, abs=0.01)
    other = [np.subtract(a, b) for a, b in zip(*(o.position_px(550.0, -1.75, 1.75)[:2] for o in (tilted, plain)))]
    assert math.hypot(*other) == pytest.approx(9.4, abs=0.05)
    for wavelength, disc in ((455.0, 0.58), (660.0, 0.33)):
        assert abs(tilted.defocus_mm(wavelength)) / tilted.f_number / PITCH_MM == pytest.approx(disc, abs=0.005)


@pytest.mark.parametrize("relay", [{"focal_mm": 50.0, "defocus_mm": -60.0}, {"converging": True, "defocus_mm": -99.0}])
def test_a_sensor_before_the_lens_or_in_the_prism_is_refused(relay):
    with pytest.raises(InputError, match=r"relay\.defocus_mm"):
        CameraConfig(relay=relay).optics.position_px(550.0, 0.0, 0.0)


def test_distortion_moves_light_by_k_r_cubed():
    k = 3e-4
    straight, bent = (CameraConfig(relay={"distortion_per_mm2": v}).optics.position_px(BAND, 1.5, -1.1) for v in (0.0, k))
    x0 = CameraConfig().dispersion.origin_px
    x, y = (straight[0] - x0) * PITCH_MM, straight[1] * PITCH_MM
    assert np.allclose((bent[0] - straight[0]) * PITCH_MM, k * x * (x * x + y * y), rtol=0, atol=1e-12)
    assert np.allclose((bent[1] - straight[1]) * PITCH_MM, k * y * (x * x + y * y), rtol=0, atol=1e-12)


def test_a_distortion_that_folds_the_image_is_refused():
    with pytest.raises(InputError, match=r"relay\.distortion_per_mm2"):
        CameraConfig(relay={"distortion_per_mm2": -1e-2}).optics.position_px(550.0, 10.0, 0.0)


# --- the converging beam ---------------------------------------------------------------------------------------


def vector_trace(wavelength, start, direction, faces, image_mm):
    """Follow one ray by the textbook vector law and line-plane intersections, in three dimensions."""
    k, place, before = direction / np.linalg.norm(direction), np.array(start, float), 1.0
    indices = [float(medium.index(wavelength)) for medium in faces.prism.media] + [1.0]
    for tilt, depth, after in zip(faces.tilts_rad, faces.depth_mm, indices):
        normal = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
        place = place + k * ((np.array([0.0, 0.0, depth]) - place) @ normal) / (k @ normal)
        tangent = (k - (k @ normal) * normal) * before / after
        k, before = tangent + math.sqrt(1 - tangent @ tangent) * normal, after
    return (place + k * (image_mm - place[2]) / k[2])[:2]


def converging(**relay):
    return CameraConfig(relay={"converging": True, "f_number": 6.0, **relay})


def test_rays_through_the_faces_agree_with_a_vector_trace_to_1e_9_px():
    faces = Faces(CameraConfig().dispersion, 25.0)
    rng = np.random.default_rng(5)
    for _ in range(50):
        start, slope, wavelength = rng.uniform(-8, 8, 2), rng.uniform(-0.1, 0.1, 2), np.float64(rng.uniform(450, 670))
        x, y, z, sx, sy, valid = faces.trace(wavelength, (start[0], start[1], np.float64(-3.0)), (slope[0], slope[1]))
        assert valid
        found = np.array([x + sx * (100 - z), y + sy * (100 - z)])
        judge = vector_trace(wavelength, (*start, -3.0), np.array([*slope, 1.0]), faces, 100.0)
        assert np.abs(found - judge).max() / PITCH_MM < 1e-9


def test_optiland_agrees_on_a_whole_spot_diagram_off_the_axis():
    optic = pytest.importorskip("optiland.optic", reason="judge optiland is not installed")
    materials = pytest.importorskip("optiland.materials")
    rays = pytest.importorskip("optiland.rays")
    faces = Faces(CameraConfig().dispersion, 25.0)
    points = rings(400).points * 8.6
    for wavelength in (455.0, 550.0, 660.0):
        slope = (np.array([1.75, -1.1]) * F2 / F1 - points) / F2  # towards one image point
        system = optic.Optic()
        system.surfaces.add(index=0, thickness=np.inf)
        system.surfaces.add(index=1, thickness=2.0, is_stop=True)
        depth = [*faces.depth_mm, 101.0]
        for i, tilt in enumerate(faces.tilts_rad):
            media = [materials.Material(m.name, reference="schott") for m in faces.prism.media] + ["air"]
            system.surfaces.add(index=2 + i, thickness=depth[i + 1] - depth[i], ry=tilt, material=media[i])
        system.surfaces.add(index=6)
        system.wavelengths.add(value=0.55, is_primary=True)
        one = np.ones(len(points))
        N = 1 / np.sqrt(1 + (slope**2).sum(1))
        bundle = rays.RealRays(points[:, 0], points[:, 1], 0 * one, slope[:, 0] * N, slope[:, 1] * N, N, one, wavelength / 1000 * one)
        system.surfaces.trace(bundle)
        position = points[:, 0], points[:, 1], -2 * one
        x, y, z, sx, sy, valid = faces.trace(np.full(len(points), wavelength), position, (slope[:, 0], slope[:, 1]))
        assert valid.all()
        assert np.abs(x + sx * (101 - z) - np.asarray(bundle.x)).max() / PITCH_MM < 1e-9
        assert np.abs(y + sy * (101 - z) - np.asarray(bundle.y)).max() / PITCH_MM < 1e-9


def plate(**relay):
    """One plane plate of the edge's 1 mm in the converging beam."""
    prism = {"glasses": ["N-BK7"], "face_tilt_deg": [0.0, 0.0], "design_position_px": 0.0}
    return CameraConfig(prism=prism, relay={"converging": True, **relay})


def test_a_plane_plate_in_the_converging_beam_moves_the_focus_and_the_chief_ray_by_snell_s_law():
    optics = plate(f_number=1000.0).optics
    n = float(glass("N-BK7").index(550.0))
    for X in (0.5, 2.0, 8.0):
        tangent = X / F1
        inside = math.tan(math.asin(math.sin(math.atan(tangent)) / n))
        focus = F2 + (1 - 1 / n)  # paraxial, for the 1 mm plate
        expected = (focus - 1) * tangent + inside
        assert float(optics.position_px(550.0, X, 0.0)[0]) * PITCH_MM == pytest.approx(expected, rel=1e-9)
        assert float(optics.position_px(550.0, 0.0, X)[1]) * PITCH_MM == pytest.approx(expected, rel=1e-9)


def test_the_converging_beam_is_focused_at_the_design_wavelength_and_blurs_the_others():
    optics = converging().optics
    pupil = optics.pupil()

    def radius(wavelength, defocus=0.0):
        x, y, _ = converging(defocus_mm=defocus).optics.position_px(wavelength, 0.0, 0.0, pupil.points)
        return math.sqrt(np.var(x) + np.var(y))

    best = radius(550.0)
    assert all(radius(550.0, d) > best for d in (-0.01, 0.01))
    assert best < 0.5
    assert optics.position_px(550.0)[0] == pytest.approx(14.5451, abs=1e-9)
    assert len(pupil.points) >= 32


def test_dispersion_grows_with_the_prism_s_distance_from_the_sensor():
    spans = []
    for distance in (40.0, 80.0):
        x = converging(prism_to_sensor_mm=distance).optics.position_px(BAND)[0]
        spans.append(x[-1] - x[0])
    # the lever arm runs from the wedges, a few mm inside the glass, to the sensor
    assert spans[1] / spans[0] == pytest.approx(80 / 40, rel=0.05)


def test_a_narrow_cone_in_the_converging_beam_sees_what_a_chief_ray_sees():
    optics = converging(f_number=500.0).optics
    points = optics.pupil().points
    for wavelength in (455.0, 660.0):
        x, y, _ = optics.position_px(wavelength, 1.0, -1.0, points)
        x0, y0, _ = optics.position_px(wavelength, 1.0, -1.0)
        assert np.abs(x - x0).max() < 0.02
        assert np.abs(y - y0).max() < 0.02


def test_the_converging_beam_s_numbers_are_those_of_the_theory():
    optics, flat = CameraConfig(relay={"converging": True}).optics, CameraConfig().optics
    points = optics.pupil().points
    first, last = (float(optics.position_px(w)[0]) for w in (455.0, 660.0))
    assert last - first == pytest.approx(22.50, abs=0.005)
    assert np.diff(flat.position_px([455.0, 660.0])[0])[0] == pytest.approx(23.21, abs=0.005)
    rms, aside = [], []
    for wavelength in (455.0, 550.0, 660.0):
        for X, Y in ((0.0, 0.0), (1.75, 1.75), (1.75, -1.75), (-1.75, 1.75)):
            x, y, _ = optics.position_px(wavelength, X, Y, points)
            x0, y0, _ = optics.position_px(wavelength, X, Y)
            rms += [x.std(), y.std()]
            aside.append(math.hypot(x.mean() - x0, y.mean() - y0))
    assert (min(rms), max(rms)) == pytest.approx((0.10, 0.25), abs=0.005)
    assert (min(aside), max(aside)) == pytest.approx((0.16, 0.30), abs=0.005)


@pytest.mark.parametrize(
    ("camera", "field"),
    [
        ({"table": {}, "relay": {"converging": True}}, "relay.converging"),
        ({"relay": {"converging": True, "prism_to_sensor_mm": 101.0}}, "relay.prism_to_sensor_mm"),
        ({"relay": {"converging": True, "prism_to_sensor_mm": 2.0}}, "relay.prism_to_sensor_mm"),
    ],
)
def test_a_prism_that_cannot_stand_in_the_beam_is_refused(camera, field):
    with pytest.raises(InputError) as caught:
        _ = CameraConfig(**camera).optics
    assert caught.value.field == field


@pytest.mark.parametrize("bad", [(1.0, 0.1), (0.5,), (float("nan"), 0.0)])
def test_a_point_outside_the_pupil_is_refused(bad):
    with pytest.raises(InputError, match="pupil"):
        CameraConfig().optics.position_px(550.0, 0.0, 0.0, bad)


# --- lost light ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("relay", [{}, {"converging": True, "f_number": 50.0}, {"scheimpflug": False}], ids=["", "converging", "upright"])
def test_lost_light_has_no_position_and_no_transmission_and_no_nan(relay):
    prism = {
        "glasses": ["N-SF66"],
        "face_tilt_deg": [math.degrees(0.37), math.degrees(-0.37)],
        "design_nm": 670.0,
        "design_position_px": 0.0,
    }
    camera = CameraConfig(prism=prism, relay=relay, dmd={"tilt_deg": 10.0, "offset_x_px": 3.0})
    x, y, valid = camera.optics.position_px(np.linspace(450, 670, 221), 0.0, 0.1)
    passed = camera.optics.transmission(np.linspace(450, 670, 221), 0.0, 0.1)
    assert valid.any()
    assert not valid.all()
    assert np.isfinite(x).all()
    assert (x[~valid] == 0).all()
    assert (y[~valid] == 0).all()
    assert ((passed >= 0) & (passed <= 1)).all()
    assert (passed[~valid] == 0).all()


def test_transmission_is_the_prism_s_own_at_the_angle_that_the_light_arrives_at():
    camera = CameraConfig(dmd={"rotation_deg": 5.0, "scale": 1.5, "offset_x_px": 40.0})
    turn = math.radians(5.0)
    X, Y = 1.5 * (math.cos(turn) * 1.0 - math.sin(turn) * 0.4), 1.5 * (math.sin(turn) * 1.0 + math.cos(turn) * 0.4)
    expected = camera.dispersion.transmission(BAND, X, Y)
    assert np.allclose(camera.optics.transmission(BAND, 1.0, 0.4), expected, rtol=1e-12)
    assert (expected < 0.95).all()
    edge = CameraConfig(relay={"converging": True}).optics.transmission(550.0, 0.0, 0.0, (1.0, 0.0))
    slope = 0.5 / 8 * F1 / F2  # of the cone behind the lens
    assert edge == pytest.approx(float(camera.dispersion.transmission(550.0, -slope * F1, 0.0)), rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    tilt=st.floats(-59, 59),
    focal=st.floats(5, 1e3),
    f_number=st.floats(0.5, 100),
    defocus=st.floats(-3, 3),
    distortion=st.floats(-1e-3, 1e-2),
    flags=st.tuples(st.booleans(), st.booleans()),
    turn=st.floats(-10, 10),
    wavelength=st.floats(420, 700),
)
def test_any_camera_gives_finite_places_and_shares_or_a_refusal(
    tilt, focal, f_number, defocus, distortion, flags, turn, wavelength
):  # fmt: skip
    relay = {"focal_mm": focal, "f_number": f_number, "defocus_mm": defocus, "distortion_per_mm2": distortion}
    camera = CameraConfig(
        relay={**relay, "scheimpflug": flags[0], "converging": flags[1]}, dmd={"tilt_deg": tilt, "rotation_deg": turn, "scale": 1.1}
    )
    try:
        optics = camera.optics
        x, y, valid = optics.position_px(wavelength, FIELD[:, None, None], FIELD[:, None], rings(32).points)
        passed = optics.transmission(wavelength, FIELD[:, None, None], FIELD[:, None], rings(32).points)
        transfer = optics.otf(wavelength, FIELD[:, None], FIELD)
    except InputError:
        return
    assert x.shape == y.shape == valid.shape == passed.shape == (5, 5, 36)
    assert np.isfinite(x).all()
    assert np.isfinite(y).all()
    assert ((x == 0) & (y == 0))[~valid].all()
    assert ((passed >= 0) & (passed <= 1)).all()
    assert (np.abs(transfer) <= 1 + 1e-9).all()
