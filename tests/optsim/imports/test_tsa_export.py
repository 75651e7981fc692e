"""An export holds what belongs to this measurement only, and says what it had to guess and what solvers will miss."""

import json

import numpy as np
import pytest
import scipy.io

from optsim.camera.elsewhere import frames_from
from optsim.cube import Bands
from optsim.errors import InputError
from optsim.files.tsa import write_tsa

SIDE, K = 12, 5
BANDS = Bands.from_centers([450.0, 480, 520, 570, 640])


def frames(shifts=None, extra=0):
    shifts = 2 * np.arange(K) if shifts is None else np.asarray(shifts)
    rng = np.random.default_rng(0)
    return frames_from(rng.random((SIDE, SIDE + 2 * (K - 1) + extra)), rng.random((SIDE, SIDE)) < 0.5, shifts, BANDS)


def test_an_export_without_a_truth_removes_the_one_that_an_earlier_export_left(tmp_path):
    write_tsa(frames(), tmp_path, truth=np.ones((SIDE, SIDE, K)))
    assert (tmp_path / "Truth" / "scene01.mat").exists()
    write_tsa(frames(), tmp_path)
    assert not (tmp_path / "Truth" / "scene01.mat").exists()


def test_the_truth_of_another_program_is_never_removed_and_the_folder_is_left_as_it_was(tmp_path):
    (tmp_path / "Truth").mkdir()
    scipy.io.savemat(tmp_path / "Truth" / "scene01.mat", {"img": np.ones((2, 2))})
    with pytest.raises(InputError, match=r"^-o: must be a folder without Truth/scene01\.mat, which another program wrote"):
        write_tsa(frames(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["Truth"]
    assert scipy.io.loadmat(tmp_path / "Truth" / "scene01.mat")["img"].shape == (2, 2)


@pytest.mark.parametrize("known", [True, False])
def test_the_export_says_what_simulation_test_is_a_multiple_of(tmp_path, known):
    truth = 3 * np.random.default_rng(1).random((SIDE, SIDE, K))
    write_tsa(frames(), tmp_path, truth=truth if known else None)
    notes = json.loads((tmp_path / "measurement.json").read_text())
    stored = scipy.io.loadmat(tmp_path / "simulation_test.mat")["simulation_test"][0]
    values = frames()["frames"].values[0, 0]
    unit = truth.max() if known else values.max() * 2 / K
    np.testing.assert_allclose(stored, values / unit, rtol=1e-12)
    assert notes["simulation_test_and_img_times"] == pytest.approx(unit)
    assert notes["simulation_test_unit"].startswith("peak of the true cube" if known else "peak of the frame x 2 / bands")


def test_a_wide_frame_and_another_step_are_told_apart(tmp_path):
    steps = [s for s in write_tsa(frames(extra=3), tmp_path) if "operator" in s]
    assert steps == [
        f"the frame is {SIDE + 11} px wide, solvers with 2 px a band built in expect {SIDE + 8}: only solvers that take their operator from"
        " mask_3d_shift.mat are right"
    ]
    for shifts in (np.arange(K), 8 - 2 * np.arange(K), 1 + 1.5 * np.arange(K)):
        (said,) = [s for s in write_tsa(frames(shifts), tmp_path) if "operator" in s]
        assert said.startswith("bands do not fall on columns 0, 2, 4, ...: ")
    assert not [s for s in write_tsa(frames(), tmp_path) if "operator" in s]
