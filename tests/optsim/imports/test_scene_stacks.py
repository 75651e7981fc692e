"""Stacks of scenes, as the benchmark's test set is kept, give one measurement each."""

import numpy as np
import pytest
import scipy.io

from optsim.camera.elsewhere import frames_from
from optsim.cli.app import _code
from optsim.cube import Bands
from optsim.files import read, write
from optsim.files.arrays import read_pictures

SIDE, K = 8, 3
NM = "500,550,610"
SCENES = np.random.default_rng(0).random((4, SIDE, SIDE + 2 * (K - 1)))


def bring_in(folder, name, *more):
    np.save(folder / "m.npy", np.random.default_rng(1).random((SIDE, SIDE)) < 0.5)
    words = ["import-measurement", str(folder / name), "--mask", str(folder / "m.npy"), "--shifts", "2", "--wavelengths", NM]
    return _code([*words, "-o", str(folder / "o.nc"), *more])


def test_a_test_set_of_the_benchmark_gives_the_scene_asked_for(tmp_path, capsys):
    scipy.io.savemat(tmp_path / "simulation_test.mat", {"simulation_test": SCENES})
    assert bring_in(tmp_path, "simulation_test.mat", "--scene", "3") == 0
    np.testing.assert_array_equal(read(tmp_path / "o.nc")["frames"].values, SCENES[2][None, None])
    for words in ([], ["--scene", "0"], ["--scene", "5"]):
        capsys.readouterr()
        assert bring_in(tmp_path, "simulation_test.mat", *words) == 2
        assert (
            "--scene: must be from 1 to 4, one of the scenes in simulation_test.mat:simulation_test (4, 8, 12)" in capsys.readouterr().err
        )


def test_scenes_of_any_array_are_told_by_its_axes(tmp_path, capsys):
    np.save(tmp_path / "y.npy", SCENES.transpose(1, 2, 0))
    assert bring_in(tmp_path, "y.npy", "--axes", "y,x,scene", "--scene", "4") == 0
    np.testing.assert_array_equal(read(tmp_path / "o.nc")["frames"].values, SCENES[3][None, None])
    np.save(tmp_path / "one.npy", SCENES[0])
    assert bring_in(tmp_path, "one.npy", "--scene", "1") == 2
    assert "--scene: must be absent, as one.npy:array (8, 12) has the axes y, x" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["simulation_test", "meas"])
def test_a_leading_axis_of_one_is_no_row_of_a_picture(tmp_path, name):
    scipy.io.savemat(tmp_path / "a.mat", {name: SCENES[:1]})
    np.testing.assert_array_equal(read_pictures(tmp_path / "a.mat", (name,)), SCENES[:1, None])


def test_every_file_of_an_export_that_holds_the_frame_is_read_back(tmp_path):
    mask = np.random.default_rng(1).random((SIDE, SIDE)) < 0.5
    write(frames_from(SCENES[0], mask, [0, 2, 4], Bands.from_centers([500.0, 550, 610])), tmp_path / "f.nc")
    assert _code(["export", str(tmp_path / "f.nc"), "--layout", "tsa", "-o", str(tmp_path / "out")]) == 0
    found = []
    for name in ("simulation_test.mat", "Measurements/scene1.mat"):
        assert bring_in(tmp_path, f"out/{name}") == 0
        found.append(read(tmp_path / "o.nc")["frames"].values)
    for values, unit in zip(found, (SCENES[0].max() * 2 / K, SCENES[0].max())):
        np.testing.assert_allclose(values * unit, SCENES[0][None, None], rtol=1e-12)
