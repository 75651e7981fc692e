"""What is wrong with foreign data is said in the options and file names that the user typed, with a remedy."""

import numpy as np
import pytest
import scipy.io

from optsim.camera.elsewhere import frames_from
from optsim.cli.app import _code
from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from optsim.files import read, write

M, N, K = 8, 6, 3
NM = "500,550,610"
BANDS = Bands.from_centers([500.0, 550, 610])


@pytest.fixture
def folder(tmp_path):
    np.save(tmp_path / "f.npy", 1 + np.random.default_rng(0).random((M, N + 4)))
    np.save(tmp_path / "m.npy", np.random.default_rng(1).random((M, N)) < 0.5)
    return tmp_path


def bring_in(folder, **changes):
    given = {"--mask": "m.npy", "--shifts": "2", "--wavelengths": NM, "-o": "o.nc"} | {
        f"--{k.replace('_', '-')}": v for k, v in changes.items()
    }
    given["-o"] = given.pop("--o", given["-o"])
    paths = ("--mask", "--cfa", "-o")
    words = [str(w) for k, v in given.items() for w in (k, folder / v if k in paths else v)]
    return _code(["import-measurement", str(folder / "f.npy"), *words])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"shifts": "0,1,99"}, "--shifts: must be such that band 2 falls on the frame: above -6 and below 10 px, got 99"),
        ({"mask": "rows.npy"}, "--mask: must be 8 rows, as the frames have, got '7 rows'"),
        ({"mask": "two.npy"}, "--mask: must be one a frame: 1, got '2 masks'"),
        ({"mask": "minus.npy"}, "--mask: must be from 0 to 1; first bad (shot, row, column) is (0, 2, 3), got -0.5"),
        ({"mask": "zero.npy"}, "--mask: must be open somewhere in every shot, got 'shot 1 closed everywhere'"),
        ({"mask": "several.mat"}, "--mask-variable: must be the name of one of the arrays of several.mat, got 'a (7, 7), b (8, 8)'"),
        ({"mask_variable": "other"}, "--mask-variable: must be a picture in m.npy: "),
        ({"variable": "other"}, "--variable: must be a picture in f.npy: "),
        ({"axes": "y,x,z"}, "--axes: must be out of scene, shot, channel, y, x"),
        ({"cfa": "cfa.npy"}, "one number a band, as --cfa has indices from 0 to 2, got '1 curve'"),
        ({"cfa": "m.npy", "response": "1,1,1;2,2,2"}, "--cfa: must be integers from 0 to 1, of the frames' shape (8, 10)"),
        ({"cfa": "broken.npy"}, "--cfa: must be whole numbers from 0 to 100; first other at (y, x) (1, 2), got 0.5"),
        ({"offset": "nan"}, "--offset: must be a finite number"),
        ({"wavelengths": "450,450,460"}, "--wavelengths: must be at least two centres in nm, all different (450 stands 2 times)"),
        ({"o": "o.exr"}, "-o: must be a file path that ends in .nc, got"),
    ],
)  # fmt: skip
def test_misuse_names_the_option_the_value_and_what_is_allowed(folder, capsys, changes, sentence):
    mask = np.load(folder / "m.npy").astype(float)
    minus, broken = mask.copy(), np.zeros((M, N + 4))
    minus[2, 3], broken[1, 2] = -0.5, 0.5
    for name, values in {"rows": mask[1:], "two": np.stack([mask, mask]), "minus": minus, "zero": 0 * mask, "broken": broken}.items():
        np.save(folder / f"{name}.npy", values)
    np.save(folder / "cfa.npy", np.arange(M * (N + 4)).reshape(M, -1) % 3)
    scipy.io.savemat(folder / "several.mat", {"a": np.ones((7, 7)), "b": np.ones((8, 8))})
    assert bring_in(folder, **changes) == 2
    assert sentence in capsys.readouterr().err
    assert not (folder / "o.nc").exists()


def test_a_frame_that_is_not_finite_is_named_by_file_and_place(folder, capsys):
    values = np.load(folder / "f.npy")
    values[3, 7] = np.nan
    np.save(folder / "f.npy", values)
    assert bring_in(folder) == 2
    assert "f.npy: must be finite everywhere; first bad (shot, channel, y, x) is (0, 0, 3, 7)" in capsys.readouterr().err


def test_a_cube_that_is_not_finite_is_named_by_file_and_place_with_the_remedy(tmp_path, capsys):
    values = np.ones((4, 5, 3))
    values[0, 2, 1] = np.inf
    np.save(tmp_path / "c.npy", values)
    words = ["import", str(tmp_path / "c.npy"), "--axes", "y,x,wavelength", "--wavelengths", NM, "-o", str(tmp_path / "o.nc")]
    assert _code(words) == 2
    said = capsys.readouterr().err
    assert "c.npy:array: must be finite everywhere; first bad (y, x, band) is (0, 2, 1); --crop and --range leave such places out" in said
    assert _code([*words, "--crop", "1,0,3,5"]) == 0


def test_a_cube_given_as_frames_is_said_to_be_one(tmp_path, capsys):
    cube, estimate, other = tmp_path / "c.nc", tmp_path / "e.nc", tmp_path / "bad.nc"
    write(make_cube(np.ones((4, 4, 3)), BANDS), cube)
    write(make_cube(np.ones((4, 4, 3)), BANDS, attrs={"kind": "estimate"}), estimate)
    write(frames_from(np.ones((4, 6)), np.ones((4, 4)), [0, 1, 2], BANDS).drop_vars("tap"), other)
    for verb in (["reconstruct"], ["export", "--layout", "tsa"]):
        for path, kind in ((cube, "'a cube'"), (estimate, "'an estimate'")):
            assert _code([*verb, str(path), "-o", str(tmp_path / "o.nc")]) == 2
            assert f"optsim: {path}: must be frames, as measure or import-measurement writes them, got {kind}" in capsys.readouterr().err
        assert _code([*verb, str(other), "-o", str(tmp_path / "o.nc")]) == 2
        assert f"optsim: {other}: tap: must be a variable of the file" in capsys.readouterr().err


def test_frames_are_not_written_as_exr_by_measure_or_in_python(tmp_path, capsys):
    write(make_cube(np.ones((4, 4, 3)), BANDS), tmp_path / "c.nc")
    assert _code(["measure", str(tmp_path / "c.nc"), "--sensor", "mono", "--shots", "1", "-o", str(tmp_path / "f.exr")]) == 2
    assert "-o: must be a file path that ends in .nc, got" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"ends in \.nc"):
        write(frames_from(np.ones((4, 6)), np.ones((4, 4)), [0, 1, 2], BANDS), tmp_path / "f.exr")


def test_lists_that_begin_with_a_minus_need_no_equals_sign(folder):
    assert bring_in(folder, shifts="-1,0.9,2.1") == 0
    np.testing.assert_array_equal(read(folder / "o.nc")["shift_px"].values, [-1, 0.9, 2.1])
    values = np.random.default_rng(3).random((4, 5, 3))
    np.save(folder / "c.npy", values)
    words = ["import", str(folder / "c.npy"), "--axes", "-y,x,wavelength", "--wavelengths", NM, "-o", str(folder / "c.nc")]
    assert _code(words) == 0
    np.testing.assert_array_equal(read(folder / "c.nc")["radiance"].values, values[::-1])


def test_axes_and_scale_of_an_import_are_printed_with_their_unit_and_kept(tmp_path, capsys):
    np.save(tmp_path / "c.npy", np.ones((3, 4, 5)))
    words = ["import", str(tmp_path / "c.npy"), "--axes", "wavelength,-y,x", "--wavelengths", NM, "--scale", "0.25"]
    assert _code([*words, "-o", str(tmp_path / "o.nc")]) == 0
    assert ", array, axes wavelength,-y,x: as in the file, times 0.25 W m^-2 sr^-1 nm^-1" in capsys.readouterr().err
    assert read(tmp_path / "o.nc").attrs["source_axes"] == "wavelength,-y,x"


def test_the_quality_mode_says_which_bands_it_knows(tmp_path, capsys):
    infrared = Bands.from_centers(np.linspace(900.0, 1000.0, 3))
    write(frames_from(np.ones((16, 18)), np.eye(16), [0, 1, 2], infrared), tmp_path / "f.nc")
    assert _code(["reconstruct", str(tmp_path / "f.nc"), "--prior", "quality", "-o", str(tmp_path / "e.nc")]) == 2
    said = capsys.readouterr().err
    assert "--prior: must be tv, l1 or group-l1, as quality needs bands within 380 to 780 nm" in said
    assert "got 'quality for bands from 875 to 1025 nm'" in said
