"""docs/files.md does what it says: every example in it is read, and the formula of H is run as printed."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from optsim.camera import CameraConfig, Distinct, glass_names, masks_for, measure_matched, sensors
from optsim.cube import PAPER_CENTERS_NM, Bands, make_cube
from optsim.files import write

TEXT = (Path(__file__).parents[2] / "docs" / "files.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)


DEFAULT_CAMERA, STACK_CAMERA, TABLE_CAMERA = blocks("toml")
(PROGRAM,) = blocks("python")


@pytest.mark.parametrize("sensor", sensors(), ids=lambda s: s.name)
def test_the_printed_formula_of_h_gives_the_matched_frames(tmp_path, monkeypatch, capsys, sensor):
    values = np.random.Generator(np.random.Philox(5)).uniform(0, 2, (6, 7, 24))
    cube = make_cube(values, Bands.paper())
    masks = masks_for(sensor, 3, Distinct(), (6, 7), 1)
    write(cube, tmp_path / "cube.nc")
    write(measure_matched(cube, sensor, masks), tmp_path / "frames.nc")
    monkeypatch.chdir(tmp_path)
    exec(PROGRAM, {})
    assert float(capsys.readouterr().out) < 1e-12


def test_the_printed_cameras_are_the_default_and_the_papers_table():
    assert CameraConfig.parse_toml(DEFAULT_CAMERA) == CameraConfig() == CameraConfig.parse_toml("")
    assert tomllib.loads(DEFAULT_CAMERA) == tomllib.loads(CameraConfig().to_toml())
    table = CameraConfig.parse_toml(TABLE_CAMERA)
    assert table == CameraConfig.parse_toml("[table]\n[sensor]\nfull_well_e = 40000")
    np.testing.assert_allclose(table.dispersion.position_px(np.array(PAPER_CENTERS_NM, float))[0], np.arange(24), atol=1e-12)


def test_the_printed_stack_is_the_same_with_the_catalogues_glass():
    own, built_in = (CameraConfig.parse_toml(text) for text in (STACK_CAMERA, STACK_CAMERA.replace('"my flint", "N', '"N-SF10", "N')))
    nm = np.array([450.0, 520, 650])
    np.testing.assert_allclose(own.dispersion.position_px(nm)[0], built_in.dispersion.position_px(nm)[0], atol=1e-9)


def test_the_document_names_every_glass():
    for name in glass_names():
        assert f"`{name}`" in TEXT
