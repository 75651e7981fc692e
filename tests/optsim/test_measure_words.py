"""The words of `measure` that choose effects, patterns and light budgets."""

import pytest

from optsim.camera import CameraConfig, sensors
from optsim.camera.effects import present
from optsim.cli.modelled import budget_plan, modelled_camera, pattern_named, warn_of_ratio
from optsim.cube import Bands
from optsim.errors import InputError

FIELD = (16, 16)


def names(camera):
    return {effect.name for effect in present(camera)}


def test_error_zero_models_every_fact_and_a_large_error_leaves_facts_out(capsys):
    camera = CameraConfig()
    assert names(modelled_camera(camera, Bands.paper(), FIELD, 0.0, (), ())) == names(camera)
    few = modelled_camera(camera, Bands.paper(), FIELD, 0.01, (), ())
    assert names(few) < names(camera)
    assert "left out:" in capsys.readouterr().err


def test_an_effect_is_forced_in_and_left_out_by_its_name():
    camera = CameraConfig()
    chosen = names(modelled_camera(camera, Bands.paper(), FIELD, 0.5, ("prnu",), ()))
    assert "prnu" in chosen
    assert "diffraction" not in names(modelled_camera(camera, Bands.paper(), FIELD, 0.0, (), ("diffraction",)))


@pytest.mark.parametrize(
    ("force", "without", "field"), [(("haze",), (), "--force"), ((), ("haze",), "--without"), (("leak",), ("leak",), "--without")]
)
def test_unknown_and_contradicting_effects_are_refused(force, without, field):
    with pytest.raises(InputError) as caught:
        modelled_camera(CameraConfig(), Bands.paper(), FIELD, 0.0, force, without)
    assert caught.value.field == field


def test_patterns_and_budgets_are_found_by_their_words_and_others_refused():
    assert pattern_named("blue-noise").name == "blue-noise"
    with pytest.raises(InputError, match="--pattern"):
        pattern_named("stripes")
    mono = sensors()[0]
    assert budget_plan("b", mono, 2, 0.1).shots == 6
    for letter, time_s in (("Z", 0.1), ("A", None)):
        with pytest.raises(InputError):
            budget_plan(letter, mono, 1, time_s)


def test_more_numbers_than_bands_are_warned_of(capsys):
    mono, _, foveon = sensors()
    warn_of_ratio(mono, 24, 24)
    assert capsys.readouterr().err == ""
    warn_of_ratio(foveon, 9, 24)
    assert "R = 27/24 > 1" in capsys.readouterr().err


def test_sensors_are_found_by_their_words_and_take_curves_of_ones_own(tmp_path):
    from optsim.cli.words import sensor_named

    assert sensor_named("quattro").layer_bins == (2, 2, 1)
    assert sensor_named("mono-silicon").response(650.0)[0] < sensor_named("mono-silicon").response(450.0)[0]
    (tmp_path / "c.csv").write_text("wavelength_nm,mono\n400,0.2\n700,0.4\n")
    assert sensor_named("mono", tmp_path / "c.csv").response(550.0)[0] == pytest.approx(0.3)
    for word, curves, field in (("ccd", None, "--sensor"), ("foveon-physical", tmp_path / "c.csv", "--curves")):
        with pytest.raises(InputError) as caught:
            sensor_named(word, curves)
        assert caught.value.field == field


def test_what_h_knows_is_found_by_its_word():
    from optsim.camera import Exact, OwnShifts, UnitShift
    from optsim.cli.words import knowledge_named

    assert [knowledge_named(word) for word in ("exact", "camera", "unit-shift")] == [Exact(), OwnShifts(), UnitShift()]
