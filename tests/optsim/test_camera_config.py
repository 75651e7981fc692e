"""The camera's config: TOML there and back, refusals that name the key, and the numbers that follow from it."""

import math

import numpy as np
import pytest

from optsim.camera import CameraConfig, CenterTable, DoubleAmici
from optsim.errors import InputError


def test_the_default_camera_is_n_fk5_f5_one_mirror_to_one_pixel():
    camera = CameraConfig()
    assert (camera.prism.outer, camera.prism.inner) == ("N-FK5", "F5")
    assert camera.mirror_px == pytest.approx(1, abs=2e-4)
    prism = camera.dispersion
    assert math.degrees(prism.apex_outer_rad) == pytest.approx(8.1369, abs=5e-5)
    assert math.degrees(prism.apex_inner_rad) == pytest.approx(13.1019, abs=1e-12)
    assert prism.position_px(550.0)[0] == pytest.approx(14.5451, abs=1e-12)
    assert prism == DoubleAmici.default()


@pytest.mark.parametrize(
    "camera",
    [
        CameraConfig(),
        CameraConfig(table={}),
        CameraConfig(prism={"outer": "N-BK7", "inner": "F2", "apex_inner_deg": 12.9415}, relay={"f_number": 4.0}),
    ],
    ids=["default", "table", "other"],
)
def test_a_camera_written_as_toml_reads_back_equal(camera, tmp_path):
    path = tmp_path / "camera.toml"
    path.write_text(camera.to_toml())
    assert CameraConfig.from_toml(path) == camera
    assert CameraConfig.parse_toml("") == CameraConfig()


@pytest.mark.parametrize(
    ("text", "field", "message"),
    [
        ("[prsm]\n", "camera.prsm", "did you mean 'prism'"),
        ("[relay]\nfocal = 3", "camera.relay.focal", "did you mean 'focal_mm'"),
        ("[relay]\nfocal_mm = 0", "camera.relay.focal_mm", "mm"),
        ("[sensor]\npitch_um = 0", "camera.sensor.pitch_um", "um"),
        ("[sensor]\nfull_well_e = 0", "camera.sensor.full_well_e", "electrons"),
        ("[dmd]\npitch_um = -1", "camera.dmd.pitch_um", "um"),
        ("[dmd]\npitch_um = nan", "camera.dmd.pitch_um", "finite"),
        ("[bandpass]\nlower_nm = 700", "camera.bandpass.upper_nm", "above lower_nm"),
        ("[prism]\napex_inner_deg = 90", "camera.prism.apex_inner_deg", "deg"),
        ("[prism]\nouter = 'NBK7'", "camera.prism.outer.glass", "did you mean 'N-BK7'"),
        ("[prism]\n[table]\n", "camera.table", "the only one"),
        ("[table]\ncenters_nm = [500, 500]", "table.centers_nm", "increasing"),
        ("[prism", "--camera", "TOML"),
    ],
)
def test_S6_mistakes_are_refused_by_name(text, field, message):
    with pytest.raises(InputError, match=message) as caught:
        _ = CameraConfig.parse_toml(text).dispersion
    assert caught.value.field == field


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match="--camera"):
        CameraConfig.from_toml(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="--camera"):
        CameraConfig.from_toml(tmp_path / "bytes.toml")


def test_a_prism_without_a_stated_position_lays_455_nm_on_pixel_0():
    prism = CameraConfig.parse_toml("[prism]\nouter = 'N-BK7'\ninner = 'F2'\napex_inner_deg = 12.9415").dispersion
    assert prism.position_px(455.0)[0] == pytest.approx(0, abs=1e-12)


def test_throughput_is_area_times_fill_times_pi_sin_squared():
    camera = CameraConfig(relay={"f_number": 4.0, "transmission": 0.5}, dmd={"pitch_um": 10.0, "fill_factor": 0.9})
    sine = 1 / 8
    assert camera.throughput_m2_sr == pytest.approx(0.5 * 0.9 * 1e-10 * np.pi * sine**2, rel=1e-14)


def test_the_table_takes_the_place_of_the_prism():
    dispersion = CameraConfig(table={}).dispersion
    assert isinstance(dispersion, CenterTable)
    assert dispersion.position_px(660.0)[0] == 23
