"""Measurements made elsewhere are reconstructed; exports are what solvers of the benchmark expect. Judged by plain NumPy."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from PIL import Image

from optsim.camera import band_model_of, check_frames, signal_of
from optsim.camera.elsewhere import frames_from
from optsim.camera.frames import FORMAT
from optsim.cli.app import _code
from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from optsim.files import read, read_cube, write
from optsim.files.grids import TSA_HALVES_NM
from optsim.files.tsa import write_tsa

M, N, K = 12, 10, 5
NM = np.array([450.0, 480, 520, 570, 640])
BANDS = Bands.from_centers(NM)


def scene(seed=0):
    return np.random.default_rng(seed).random((M, N, K))


def mask(shots=1, seed=1):
    return (np.random.default_rng(seed).random((shots, M, N)) < 0.5).astype(float)


def photographed(masks, cube, shifts, width):
    """What a camera with these shifts sees, by interpolating each coded band at the pixels' places."""
    frames = np.zeros((*masks.shape[:2], width))
    for shot, pattern in enumerate(masks):
        for k, shift in enumerate(shifts):
            for row in range(len(pattern)):
                places = np.arange(-1, pattern.shape[1] + 1) + shift
                frames[shot, row] += np.interp(np.arange(width), places, np.pad(pattern[row] * cube[row, :, k], 1), left=0, right=0)
    return frames


@pytest.mark.parametrize(
    "shifts",
    [np.arange(K), 2 * np.arange(K), 0.7 * np.arange(K) + 0.3, 8.0 - 2 * np.arange(K), -1.5 + np.arange(K), [0, 2, 4, 6, 8.25]],
    ids=["1 px", "2 px", "broken", "backwards", "negative", "mixed"],
)
def test_a_frame_of_any_shifts_is_explained_by_its_file(shifts):
    width = N + 9
    frames = frames_from(photographed(mask(), scene(), shifts, width)[0], mask()[0], shifts, BANDS)
    check_frames(frames)
    explained = band_model_of(frames).operator(np.float64).forward(scene())
    np.testing.assert_allclose(explained, signal_of(frames), atol=1e-12)


def test_shots_channels_responses_mosaics_offsets_and_gray_masks_are_explained():
    masks, shifts, width = np.random.default_rng(3).random((2, M, N)), 2.0 * np.arange(K), N + 8
    response = np.random.default_rng(4).random((3, K))
    channels = np.stack([photographed(masks, scene() * row, shifts, width) for row in response], axis=1)
    layers = frames_from(channels + 7, masks, shifts, BANDS, response=response, attrs={"offset": 7.0})
    np.testing.assert_allclose(band_model_of(layers).operator(np.float64).forward(scene()), signal_of(layers), atol=1e-12)
    mosaic = np.random.default_rng(5).integers(0, 3, (M, width))
    seen = np.take_along_axis(channels, mosaic[None, None], axis=1)
    bayer = frames_from(seen, masks, shifts, BANDS, response=response, mosaic=mosaic)
    np.testing.assert_allclose(band_model_of(bayer).operator(np.float64).forward(scene()), signal_of(bayer), atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"frames": np.zeros((M, N + 8, 1, 1, 1))}, "frames"),
        ({"frames": np.full((M, N + 8), np.nan)}, "frames"),
        ({"frames": np.zeros((1, 2, M, N + 8))}, "frames"),
        ({"masks": np.ones((M + 1, N))}, "masks"),
        ({"masks": np.ones((2, M, N))}, "masks"),
        ({"masks": np.full((M, N), 1.5)}, "masks"),
        ({"shift_px": [0, 1, 2]}, "shift_px"),
        ({"shift_px": [0, 1, 2, 3, np.nan]}, "shift_px"),
        ({"shift_px": [0, 1, 2, 3, 99]}, "shift_px"),
        ({"response": np.ones(3)}, "response"),
        ({"mosaic": np.full((M, N + 8), 3)}, "mosaic"),
    ],
)
def test_a_measurement_that_contradicts_itself_names_the_field(changes, field):
    given = {"frames": np.zeros((M, N + 8)), "masks": mask()[0], "shift_px": 2.0 * np.arange(K), **changes}
    with pytest.raises(InputError, match=f"^{field}"):
        frames_from(given.pop("frames"), given.pop("masks"), given.pop("shift_px"), BANDS, **given)


def smooth(size=32, bands=28):
    y, x, k = np.meshgrid(np.linspace(0, 1, size), np.linspace(0, 1, size), np.arange(bands) / bands, indexing="ij")
    return np.exp(-6 * (x - 0.4) ** 2 - 6 * (y - 0.6) ** 2) * (1 + np.sin(4 * k + 3 * x)) / 2


def test_the_verbs_bring_in_a_tsa_measurement_reconstruct_it_and_write_it_back(tmp_path, capsys):
    truth, size = smooth(), 32
    pattern = (np.random.default_rng(6).random((size, size)) < 0.5).astype(float)
    frame = np.zeros((size, size + 54))
    for k in range(28):
        frame[:, 2 * k : 2 * k + size] += pattern * truth[:, :, k]
    scipy.io.savemat(tmp_path / "scene1.mat", {"meas_real": frame})
    scipy.io.savemat(tmp_path / "mask.mat", {"mask": pattern})
    frames, estimate = tmp_path / "frames.nc", tmp_path / "estimate.nc"
    words = [str(tmp_path / "scene1.mat"), "--mask", str(tmp_path / "mask.mat"), "--shifts", "2", "--wavelengths", "tsa-453.5"]
    assert _code(["import-measurement", *words, "-o", str(frames)]) == 0
    assert _code(["reconstruct", str(frames), "--solver", "basis-pursuit", "-o", str(estimate)]) == 0
    found = read_cube(estimate)
    np.testing.assert_array_equal(found["wavelength"].values, TSA_HALVES_NM)
    error = found["radiance"].values - truth
    assert 10 * np.log10(truth.max() ** 2 / np.mean(error**2)) > 20
    capsys.readouterr()
    assert _code(["export", str(frames), "--layout", "tsa", "-o", str(tmp_path / "out")]) == 0
    assert "32 x 32" in capsys.readouterr().err
    back = scipy.io.loadmat(tmp_path / "out" / "Measurements" / "scene1.mat")["meas_real"]
    np.testing.assert_allclose(back * frame.max(), frame, atol=1e-12)
    np.testing.assert_array_equal(scipy.io.loadmat(tmp_path / "out" / "mask.mat")["mask"], pattern)


def test_masks_and_frames_as_pictures_stacks_and_lists_are_brought_in(tmp_path):
    masks, shifts = mask(2), [0.5, 2, 3.25, 5, 8]
    frames = photographed(masks, scene(), shifts, N + 9)
    np.save(tmp_path / "frames.npy", frames + 3)
    for name, stack in (("m.npy", masks.astype(bool)), ("m8.npy", (masks * 255).astype(np.uint8))):
        np.save(tmp_path / name, stack)
        words = ["import-measurement", str(tmp_path / "frames.npy"), "--mask", str(tmp_path / name), "--offset", "3"]
        words += ["--shifts", ",".join(map(str, shifts)), "--wavelengths", ",".join(map(str, NM)), "-o", str(tmp_path / "f.nc")]
        assert _code(words) == 0
        found = read(tmp_path / "f.nc")
        np.testing.assert_allclose(band_model_of(found).operator(np.float64).forward(scene()), signal_of(found), atol=1e-12)
    Image.fromarray((masks[0] * 255).astype(np.uint8)).save(tmp_path / "m.png")
    picture, out = str(tmp_path / "m.png"), str(tmp_path / "g.nc")
    scipy.io.savemat(tmp_path / "g.mat", {"y": frames[0], "junk": np.ones((3, 3))})
    reversed_words = ["--shifts", ",".join(map(str, shifts[::-1])), "--wavelengths", ",".join(map(str, NM[::-1]))]
    words = ["import-measurement", str(tmp_path / "g.mat"), "--mask", picture, *reversed_words, "-o", out]
    assert _code(words) == 0
    found = read(tmp_path / "g.nc")
    np.testing.assert_allclose(band_model_of(found).operator(np.float64).forward(scene()), frames[:1, None], atol=1e-12)


def test_measured_transmissions_above_1_keep_their_h(tmp_path):
    masks = 1.3 * np.random.default_rng(9).random((1, M, N))
    np.save(tmp_path / "f.npy", photographed(masks, scene(), 2.0 * np.arange(K), N + 8)[0])
    np.save(tmp_path / "m.npy", masks[0])
    words = ["import-measurement", str(tmp_path / "f.npy"), "--mask", str(tmp_path / "m.npy"), "--shifts", "2"]
    assert _code([*words, "--wavelengths", ",".join(map(str, NM)), "-o", str(tmp_path / "o.nc")]) == 0
    found = read(tmp_path / "o.nc")
    assert found["mask"].values.max() == 1
    np.testing.assert_allclose(band_model_of(found).operator(np.float64).forward(scene()), signal_of(found), atol=1e-12)


def test_a_step_alone_counts_from_the_band_that_falls_leftmost(tmp_path):
    np.save(tmp_path / "f.npy", np.ones((M, N + 8)))
    np.save(tmp_path / "m.npy", mask()[0])
    for step, expected in (("-2", 8 - 2.0 * np.arange(K)), ("1.5", 1.5 * np.arange(K))):
        words = ["import-measurement", str(tmp_path / "f.npy"), "--mask", str(tmp_path / "m.npy"), "--shifts", step]
        assert _code([*words, "--wavelengths", ",".join(map(str, NM)), "-o", str(tmp_path / "o.nc")]) == 0
        np.testing.assert_array_equal(read(tmp_path / "o.nc")["shift_px"].values, expected)


@pytest.mark.parametrize(
    ("words", "field"),
    [
        (["--shifts", "1,2"], "--shifts"),
        (["--shifts", "two"], "--shifts"),
        (["--response", "1,2"], "--response"),
        (["--wavelengths", "450:640:0"], "--wavelengths"),
        (["--mask", "absent.npy"], "file"),
        (["--variable", "other"], "variable"),
    ],
)
def test_misuse_of_import_measurement_names_the_option(tmp_path, capsys, words, field):
    np.save(tmp_path / "f.npy", np.ones((M, N + 8)))
    np.save(tmp_path / "m.npy", mask()[0])
    given = {"--mask": str(tmp_path / "m.npy"), "--shifts": "2", "--wavelengths": ",".join(map(str, NM))} | dict(
        zip(words[::2], words[1::2])
    )
    code = _code(
        ["import-measurement", str(tmp_path / "f.npy"), *(w for pair in given.items() for w in pair), "-o", str(tmp_path / "o.nc")]
    )
    assert (code, field in capsys.readouterr().err) == (2, True)


def as_learned_solvers_do(folder, step=2):
    """Load and use a folder as loaders of the benchmark do: shift, multiply, add."""
    pattern = scipy.io.loadmat(folder / "mask.mat")["mask"]
    shifted = scipy.io.loadmat(folder / "mask_3d_shift.mat")["mask_3d_shift"]
    truth = scipy.io.loadmat(folder / "Truth" / "scene01.mat")["img"]
    rows, columns, bands = truth.shape
    wide = np.zeros((rows, columns + (bands - 1) * step, bands))
    wide[:, :columns] = pattern[:, :, None] * truth
    for k in range(bands):
        wide[:, :, k] = np.roll(wide[:, :, k], step * k, axis=1)
    placed = np.zeros_like(wide)
    placed[:, :columns] = truth
    for k in range(bands):
        placed[:, :, k] = np.roll(placed[:, :, k], step * k, axis=1)
    return wide.sum(2), (placed * shifted).sum(2)


def test_an_export_is_what_loaders_of_the_benchmark_compute_from_its_truth(tmp_path):
    truth, size = 3.7 * smooth(), 32
    pattern = (np.random.default_rng(6).random((size, size)) < 0.5).astype(float)
    bands = Bands.from_centers(TSA_HALVES_NM)
    frames = frames_from(np.zeros((size, size + 54)), pattern, 2.0 * np.arange(28), bands, response=np.full(28, 0.4))
    signal = band_model_of(frames).operator(np.float64).forward(truth)
    frames = frames_from(signal + 5, pattern, 2.0 * np.arange(28), bands, response=np.full(28, 0.4), attrs={"offset": 5.0})
    missed = write_tsa(frames, tmp_path / "a", truth=truth)
    assert len(missed) == 1  # only the number of pixels
    from_mask, from_shifted = as_learned_solvers_do(tmp_path / "a")
    measured = scipy.io.loadmat(tmp_path / "a" / "simulation_test.mat")["simulation_test"]
    np.testing.assert_allclose(from_mask, measured[0], atol=1e-12)
    np.testing.assert_allclose(from_shifted, measured[0], atol=1e-12)
    real = scipy.io.loadmat(tmp_path / "a" / "Measurements" / "scene1.mat")["meas_real"]
    notes = json.loads((tmp_path / "a" / "measurement.json").read_text())
    np.testing.assert_allclose(real * notes["meas_real_times"] / notes["simulation_test_and_img_times"], measured[0], atol=1e-12)
    assert (real.max(), scipy.io.loadmat(tmp_path / "a" / "Truth" / "scene01.mat")["img"].max()) == (1, 1)
    assert notes["shift_px"] == (2.0 * np.arange(28)).tolist()
    write_tsa(frames, tmp_path / "b", truth=truth)
    for name in ("mask.mat", "mask_3d_shift.mat", "simulation_test.mat"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_an_export_of_broken_shifts_has_its_operator_in_the_shifted_masks_and_says_so(tmp_path):
    shifts, width = [0.5, 1.7, 3, 4.1, 6.9], N + 8
    frames = frames_from(photographed(mask(), scene(), shifts, width), mask(), shifts, BANDS)
    missed = write_tsa(frames, tmp_path)
    assert any("mask_3d_shift" in sentence for sentence in missed)
    shifted = scipy.io.loadmat(tmp_path / "mask_3d_shift.mat")["mask_3d_shift"]
    white = photographed(mask(), np.ones((M, N, K)), shifts, width)[0]
    np.testing.assert_allclose(shifted.sum(2), white, atol=1e-12)
    assert json.loads((tmp_path / "measurement.json").read_text())["shift_px"] == pytest.approx(shifts)


def test_an_export_refuses_what_the_layout_cannot_hold(tmp_path):
    frames = frames_from(np.zeros((1, 3, M, N + 8)), mask()[0], 2.0 * np.arange(K), BANDS, response=np.ones((3, K)))
    with pytest.raises(InputError, match="frames"):
        write_tsa(frames, tmp_path)
    frames = frames_from(np.zeros((M, N + 8)), mask()[0], 2.0 * np.arange(K), BANDS)
    for options, field in (
        ({"shot": 2}, "--shot"),
        ({"truth": np.ones((2, 2, 2))}, "--truth"),
        ({"truth": np.zeros((M, N, K))}, "--truth"),
    ):
        with pytest.raises(InputError, match=field):
            write_tsa(frames, tmp_path, **options)


def test_the_verb_export_wants_a_truth_of_the_same_bands(tmp_path, capsys):
    frames = frames_from(np.ones((M, N + 8)), mask()[0], 2.0 * np.arange(K), BANDS)
    write(frames, tmp_path / "f.nc")
    write(make_cube(scene(), Bands.from_centers(NM + 5)), tmp_path / "c.nc")
    assert _code(["export", str(tmp_path / "f.nc"), "--layout", "tsa", "--truth", str(tmp_path / "c.nc"), "-o", str(tmp_path / "o")]) == 2
    assert "--truth" in capsys.readouterr().err


def test_the_documents_program_writes_a_file_that_optsim_reconstructs_from(tmp_path, monkeypatch):
    text = (Path(__file__).parents[3] / "docs" / "measurement.md").read_text(encoding="utf-8")
    program, import_program = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    truth, pattern = smooth(24, 21), (np.random.default_rng(7).random((24, 24)) < 0.5).astype(float)
    np.save("frame.npy", photographed(pattern[None], truth, 1.5 * np.arange(21), 24 + 31)[0])
    np.save("mask.npy", pattern)
    exec(program, {})
    frames = read("frames.nc")
    check_frames(frames)
    np.testing.assert_allclose(band_model_of(frames).operator(np.float64).forward(truth), signal_of(frames), atol=1e-12)
    assert frames.attrs["format"] == FORMAT
    np.save("cube.npy", truth.transpose(2, 0, 1)[:, ::-1])
    exec(import_program, found := {})
    np.testing.assert_array_equal(found["cube"]["radiance"].values, truth)
