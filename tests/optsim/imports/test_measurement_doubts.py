"""Shifts, masks and offsets that contradict the frame are told when a measurement is brought in. Judged by plain NumPy."""

import numpy as np
import pytest

from optsim.camera.elsewhere import frames_from
from optsim.camera.elsewhere_doubts import doubts
from optsim.cli.app import _code
from optsim.cube import Bands

SIDE, K, STEP = 24, 10, 2
BANDS = Bands.from_centers(np.linspace(450.0, 650.0, K))
WIDTH = SIDE + STEP * (K - 1)


def pattern():
    return (np.random.default_rng(1).random((SIDE, SIDE)) < 0.5).astype(float)


def frame(step=STEP, width=WIDTH):
    scene, seen = 0.2 + np.random.default_rng(0).random((SIDE, SIDE, K)), np.zeros((SIDE, width))
    for k in range(K):
        seen[:, step * k : step * k + SIDE] += pattern() * scene[:, :, k]
    return seen


def brought_in(folder, capsys, *, values=None, mask=None, shifts="2", more=()):
    np.save(folder / "g.npy", frame() if values is None else values)
    np.save(folder / "m.npy", pattern() if mask is None else mask)
    words = ["import-measurement", str(folder / "g.npy"), "--mask", str(folder / "m.npy"), f"--shifts={shifts}", *more]
    code = _code([*words, "--wavelengths", f"450:650:{K}", "-o", str(folder / "o.nc")])
    return code, capsys.readouterr().err


def test_a_measurement_that_fits_together_is_brought_in_without_a_note(tmp_path, capsys):
    code, said = brought_in(tmp_path, capsys)
    assert code == 0
    assert "note" not in said
    noisy = np.pad(frame(), ((0, 0), (0, 5))) + np.random.default_rng(2).normal(0, 0.05, (SIDE, WIDTH + 5))
    assert "note" not in brought_in(tmp_path, capsys, values=noisy)[1]


def test_a_step_that_is_too_small_leaves_lit_columns_that_no_band_explains(tmp_path, capsys):
    code, said = brought_in(tmp_path, capsys, shifts="1")
    light = frame().sum(0)
    share = light[SIDE + K - 1 :].sum() / light.sum()
    assert code == 0
    assert f"note: {K - 1} of {WIDTH} columns carry light that no band explains ({share:.2g} of all; {SIDE + K - 1} to {WIDTH - 1}" in said


def test_a_step_that_is_too_large_lays_bands_off_the_frame(tmp_path, capsys):
    code, said = brought_in(tmp_path, capsys, shifts="3")
    off = sum(3 * k + SIDE > WIDTH for k in range(K))
    assert code == 0
    assert f"note: {off} of {K} bands fall partly off the frame of {WIDTH} columns, that at 650 nm by {K - 1} of the mask's {SIDE}" in said


def test_a_mask_wider_than_the_frame_lays_every_band_off_it(tmp_path, capsys):
    code, said = brought_in(tmp_path, capsys, mask=np.ones((SIDE, 3 * WIDTH)))
    assert code == 0
    assert f"note: {K} of {K} bands fall partly off" in said


def test_the_frame_is_refused_as_its_own_mask(tmp_path, capsys):
    code, said = brought_in(tmp_path, capsys, mask=frame())
    assert code == 2
    assert "--mask: must be the mask" in said


def test_an_offset_above_all_light_is_refused_and_one_amid_it_is_told(tmp_path, capsys):
    code, said = brought_in(tmp_path, capsys, more=["--offset", "500"])
    assert code == 2
    assert f"--offset: must be below {frame().max():g}" in said
    middle = float(np.median(frame()))
    code, said = brought_in(tmp_path, capsys, more=["--offset", f"{middle!r}"])
    assert code == 0
    assert f"note: {np.mean(frame() < middle):.2g} of the pixels are below the offset {middle:g}" in said


@pytest.mark.parametrize("shift", [0.5, -0.25])
def test_a_broken_shift_loses_only_the_share_that_falls_off(shift):
    shifts = np.r_[np.zeros(K - 1), shift]
    (said,) = doubts(frames_from(np.zeros((SIDE, SIDE)), pattern(), shifts, BANDS))
    assert f"1 of {K} bands fall partly off the frame of {SIDE} columns, that at 650 nm by {abs(shift):g} of" in said
