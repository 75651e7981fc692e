"""Effects of a camera file: each fact has one, each can be left out, and its size is what closed forms say."""

import math

import numpy as np
import pytest
from scipy import integrate, special

from optsim.camera.camera import CameraConfig
from optsim.camera.effect_sizes import misplaced
from optsim.camera.effects import EFFECTS, effect_named, present, ranked, reduced, required
from optsim.camera.glass import glass
from optsim.camera.optics_config import BandpassConfig, DmdConfig, ObjectiveConfig, SensorConfig
from optsim.camera.pupil import rings
from optsim.camera.relay import Relay
from optsim.cube import Bands
from optsim.errors import InputError

DESIGN = {
    "prism": {"outer", "inner", "apex_outer_deg", "apex_inner_deg", "glasses", "face_tilt_deg", "design_nm", "design_position_px"},
    "objective": {"focal_mm", "f_number"},
    "dmd": {"pitch_um", "fill_factor", "defect_seed"},
    "relay": {"collimator_mm", "focal_mm", "f_number", "transmission", "prism_to_sensor_mm", "prism_aperture_mm", "pupil_rays"},
    "bandpass": {"lower_nm", "upper_nm"},
    "sensor": {"pitch_um", "full_well_e", "pattern_seed"},
}
"""Fields that say what the camera is, not how it departs from an ideal one."""

WORST = CameraConfig(
    objective=ObjectiveConfig(focal_mm=50, psf_um=3),
    dmd=DmdConfig(leak=1e-3, tilt_deg=24, offset_x_px=0.3, rotation_deg=0.1, scale=1.001, dead_share=1e-3, stuck_share=1e-4),
    relay=Relay(defocus_mm=0.05, distortion_per_mm2=1e-4, scheimpflug=False, converging=True, prism_to_sensor_mm=90),
    bandpass=BandpassConfig(edge_nm=4),
    sensor=SensorConfig(prnu=0.01, dsnu_e=20, crosstalk=0.01),
)

COLLIMATED = WORST.model_copy(update={"relay": WORST.relay.model_copy(update={"converging": False})})
"""In a converging beam the rays through the pupil see the whole field: smile is then no fact of its own."""


def test_every_fact_of_a_camera_file_is_a_design_choice_or_belongs_to_one_effect():
    stated = [key for effect in EFFECTS for key in effect.facts(WORST)]
    assert len(stated) == len(set(stated))
    for table, design in DESIGN.items():
        fields = set(type(getattr(WORST, table)).model_fields)
        of_effects = {key.split(".")[1] for key in stated if key.split(".")[0] == table}
        assert fields == design | of_effects, table


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_leaving_an_effect_out_changes_its_own_facts_only_and_leaves_no_size(effect):
    camera = COLLIMATED if effect.name == "smile" else WORST
    assert effect.present(camera)
    ideal = effect.ideal(camera)
    assert not effect.present(ideal)
    assert effect.size(ideal, Bands.paper()) == (0, 0)
    before, after = camera.model_dump(), ideal.model_dump()
    changed = {f"{table}.{field}" for table in DESIGN for field in before[table] if before[table][field] != after[table][field]}
    assert changed <= set(effect.facts(WORST))
    assert changed
    size = effect.size(camera, Bands.paper())
    assert 0 < size.relative <= 1
    assert size.px >= 0


def test_a_camera_without_any_effect_but_smile_is_the_ideal_camera():
    plain, ideal = reduced(WORST, [effect_named("smile")]), WORST.ideal()
    assert [effect.name for effect in present(plain)] == ["smile"]
    assert plain.model_copy(update={"objective": ideal.objective, "relay": ideal.relay}) == ideal
    assert plain.relay.model_copy(update={"prism_to_sensor_mm": None}) == ideal.relay
    assert present(reduced(WORST, ())) == ()


def test_keeping_every_effect_changes_nothing():
    assert reduced(WORST, EFFECTS) == WORST


def test_an_effect_cannot_be_kept_without_the_one_it_rests_on():
    with pytest.raises(InputError, match="tilt, on which tilt-defocus rests"):
        reduced(WORST, [effect_named("tilt-defocus")])


def test_no_error_requires_everything_that_is_present_and_full_error_nothing():
    assert set(required(WORST, 0.0)) == set(present(WORST))
    camera = CameraConfig()
    assert {effect.name for effect in required(camera, 0.0)} == {effect.name for effect in present(camera)}
    assert required(camera, 1.0) == ()


def test_what_is_left_out_adds_up_to_no_more_than_the_error_asked_for():
    for error in (1e-4, 1e-3, 1e-2, 0.1, 0.5):
        rows = ranked(WORST, error)
        assert sum(row.size.relative for row in rows if not row.required) <= error * (1 + 1e-12)
        assert [row.size.relative for row in rows] == sorted((row.size.relative for row in rows), reverse=True)


def test_an_error_outside_zero_to_one_is_refused():
    for error in (-0.1, 1.1, math.nan):
        with pytest.raises(InputError, match="--error"):
            required(CameraConfig(), error)


def test_light_displaced_by_half_a_pixel_leaves_half_of_itself_on_the_next():
    assert misplaced(np.array([0.5]), np.array([0.0])) == 0.5
    assert misplaced(np.array([0.5]), np.array([0.5])) == 0.75
    assert misplaced(np.array([2.0]), np.array([0.0])) == 1


def test_the_diffraction_share_agrees_with_the_airy_pattern_integrated_in_space():
    camera, bands = CameraConfig(), Bands.paper()
    px, relative = effect_named("diffraction").size(camera, bands)
    scale = math.pi * camera.sensor.pitch_um / (bands.upper[-1] * 1e-3 * 8 * camera.relay.magnification)
    assert px == pytest.approx(2 * 3.8317059702075125 / scale, rel=1e-12)
    angles = (np.arange(64) + 0.5) / 64 * math.pi / 2

    def kept(r: float) -> float:
        pattern = (special.j1(scale * r) / r) ** 2 / math.pi if r > 0 else 0.0
        box = np.clip(1 - r * np.cos(angles), 0, None) * np.clip(1 - r * np.sin(angles), 0, None)
        return pattern * 2 * math.pi * r * box.mean()

    inside = integrate.quad(kept, 0, math.sqrt(2), limit=400)[0]
    assert relative == pytest.approx(1 - inside, abs=1e-3)


def test_defocus_is_a_disc_of_defocus_over_the_f_number():
    camera = CameraConfig(relay=Relay(defocus_mm=0.1))
    px = effect_named("defocus").size(camera, Bands.paper(), (1, 1)).px
    assert px == pytest.approx(100 / (8 * 100 / 138.2) / 9.9, rel=0.01)


def test_tilted_mirrors_without_scheimpflug_blur_ten_mirrors_in_two_corners_and_none_in_the_others():
    camera = CameraConfig(dmd=DmdConfig(tilt_deg=24), relay=Relay(scheimpflug=False))
    half = 128 * camera.dmd.pitch_um / 1000
    x, _, _ = camera.optics.position_px(
        550.0, np.array([[1], [-1], [1], [-1]]) * half, np.array([[1], [-1], [-1], [1]]) * half, rings(900).points
    )
    assert np.ptp(x[:2], axis=1).max() < 1e-9
    disc = half * math.sqrt(2) * math.tan(math.radians(24)) / 8 / camera.dmd.pitch_um * 1000
    assert 9 < disc < 11
    assert np.ptp(x[2:], axis=1).mean() == pytest.approx(disc * math.cos(math.radians(24)), rel=0.05)
    assert effect_named("tilt-defocus").size(camera, Bands.paper()).px > 9


def test_an_offset_moves_everything_by_itself():
    camera = CameraConfig(dmd=DmdConfig(offset_x_px=0.3, offset_y_px=-0.4))
    assert effect_named("registration").size(camera, Bands.paper()) == pytest.approx((0.5, 1 - 0.7 * 0.6), rel=1e-9)


def test_rotation_moves_the_corner_by_the_chord():
    camera = CameraConfig(dmd=DmdConfig(rotation_deg=1.0))
    radius = math.hypot(128, 128) * camera.mirror_px
    px = effect_named("registration").size(camera, Bands.paper()).px
    assert px == pytest.approx(2 * radius * math.sin(math.radians(0.5)), rel=2e-3)


def test_distortion_moves_the_corner_by_its_cube_and_the_ends_of_the_spectrum_a_little_more():
    camera = CameraConfig(relay=Relay(distortion_per_mm2=1e-4))
    corner = math.hypot(128, 128) * camera.mirror_px * 9.9e-3
    farthest = math.hypot(128 * camera.mirror_px + 16, 128 * camera.mirror_px) * 9.9e-3
    px = effect_named("distortion").size(camera, Bands.paper()).px
    assert 1e-4 * corner**3 < px * 9.9e-3 < 1e-4 * farthest**3


def test_smile_is_what_the_trace_adds_to_the_curve_on_the_axis():
    camera = CameraConfig()
    half = 128 * camera.dmd.pitch_um / 1000
    wavelength = np.linspace(452.5, 668.5, 5)
    x, y, _ = camera.dispersion.position_px(wavelength[:, None], np.array([half, -half]), half)
    axis, _, _ = camera.dispersion.position_px(wavelength[:, None])
    m = camera.dispersion.magnification_px
    away = np.hypot(x - axis - m * np.array([half, -half]), y - m * half).max()
    assert effect_named("smile").size(camera, Bands.paper()).px == pytest.approx(away, rel=1e-6)


def test_fresnel_at_two_outer_faces_loses_about_four_per_cent_each():
    n = float(glass("N-FK5").index(550))
    once = 1 - ((n - 1) / (n + 1)) ** 2
    relative = effect_named("fresnel").size(CameraConfig(), Bands.paper()).relative
    assert 1 - once**2 < relative < 1 - once**2 + 0.015


def test_an_unknown_effect_is_refused_with_the_names_there_are():
    with pytest.raises(InputError, match="diffraction, defocus"):
        effect_named("gravity")
