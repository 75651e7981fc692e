"""A picture's channels are taken as curves only when the user says what each of them sees."""

import numpy as np
import pytest
from PIL import Image

from optsim.camera.elsewhere import frames_from
from optsim.cli.app import _code
from optsim.cube import Bands
from optsim.errors import InputError
from optsim.files import read

M, N, K = 8, 6, 3
NM = "500,550,610"
CURVES = "1,2,3;4,5,6;7,8,9"


def gray():
    return np.random.default_rng(0).integers(1, 255, (M, N + K - 1)).astype(np.uint8)


def brought_in(folder, picture, *more):
    picture.save(folder / "f.png")
    np.save(folder / "m.npy", np.random.default_rng(1).random((M, N)) < 0.5)
    words = ["import-measurement", str(folder / "f.png"), "--mask", str(folder / "m.npy"), "--shifts", "1", "--wavelengths", NM]
    return _code([*words, "-o", str(folder / "o.nc"), *more])


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "LA", "L"])
def test_a_gray_picture_stored_as_colours_is_one_channel(tmp_path, mode):
    assert brought_in(tmp_path, Image.fromarray(gray()).convert(mode)) == 0
    found = read(tmp_path / "o.nc")
    assert found.attrs["sensor"] == "mono"
    np.testing.assert_array_equal(found["frames"].values, gray()[None, None])


def test_colours_without_their_responses_are_refused(tmp_path, capsys):
    colours = Image.fromarray(np.random.default_rng(2).integers(0, 255, (M, N + K - 1, 3)).astype(np.uint8))
    for more in ([], ["--response", "1,1,1"]):
        assert brought_in(tmp_path, colours, *more) == 2
        assert "--response: must be 3 curves apart by semicolons, one number a band, for the 3 channels of f.png" in capsys.readouterr().err
    np.save(tmp_path / "cfa.npy", np.zeros((M, N + K - 1), np.uint8))
    assert brought_in(tmp_path, colours, "--cfa", str(tmp_path / "cfa.npy")) == 2
    assert "--cfa: must be given with frames of one channel" in capsys.readouterr().err


def test_colours_with_their_responses_are_channels_of_a_sensor_without_a_make(tmp_path):
    values = np.random.default_rng(2).integers(0, 255, (M, N + K - 1, 3)).astype(np.uint8)
    assert brought_in(tmp_path, Image.fromarray(values), "--response", CURVES) == 0
    found = read(tmp_path / "o.nc")
    assert found.attrs["sensor"] == "three-channel"
    np.testing.assert_array_equal(found["frames"].values[0], values.transpose(2, 0, 1))
    np.testing.assert_array_equal(found["response"].values, np.arange(1, 10).reshape(3, 3))


def test_a_transparency_that_varies_is_refused(tmp_path, capsys):
    picture = Image.fromarray(gray()).convert("LA")
    picture.putpixel((2, 3), (9, 9))
    assert brought_in(tmp_path, picture) == 2
    assert "f.png: must be opaque" in capsys.readouterr().err


def test_three_channels_are_not_believed_to_see_alike_in_python_either():
    with pytest.raises(InputError, match=r"^response: must be stated for 3 channels"):
        frames_from(np.ones((1, 3, M, N)), np.ones((M, N)), np.zeros(K), Bands.from_centers([500.0, 550, 610]))
