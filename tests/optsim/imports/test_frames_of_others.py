"""A frames file that somebody wrote by hand is refused by the name of what is wrong with it, and never stops the process."""

import time
from collections import Counter

import numpy as np
import pytest

from optsim.camera import Bayer, Distinct, band_model_of, check_frames, masks_for, measure_matched
from optsim.camera.elsewhere import frames_from
from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from optsim.files import read, write
from recon.errors import InputError as ReconInputError

BANDS = Bands.from_centers([450.0, 480, 520, 570, 640])
MASK, TAP = ("shot", "mirror_y", "mirror_x"), ("wavelength", "column")


def frames():
    return frames_from(np.ones((12, 18)), np.ones((12, 10)), 2.0 * np.arange(5), BANDS)


@pytest.mark.parametrize("name", [*frames().data_vars, "wavelength", "band_lower", "band_upper"])
def test_a_missing_variable_is_named(name):
    with pytest.raises(InputError, match=f"^{name}"):
        check_frames(frames().drop_vars(name))


@pytest.mark.parametrize("name", ["format", "units", "sensor"])
def test_a_missing_attribute_is_named(name):
    found = frames()
    del found.attrs[name]
    with pytest.raises(InputError, match=f"^{name}"):
        check_frames(found)


@pytest.mark.parametrize(
    ("name", "dims", "values"),
    [
        ("frames", ("shot", "y", "channel", "x"), np.ones((1, 12, 1, 18))),
        ("mask", ("shot", "mirror_x", "mirror_y"), np.ones((1, 10, 12))),
        ("mask", MASK, np.ones((1, 11, 10))),
        ("mask", MASK, np.full((1, 12, 10), "open")),
        ("mask", MASK, np.full((1, 12, 10), np.nan)),
        ("first_column", ("wavelength",), 1.5 * np.arange(5)),
        ("tap", ("wavelength",), np.ones(5)),
        ("tap", ("wavelength", "field_y", "field_x", "row", "column"), np.ones((5, 1, 1, 1, 1))),
        ("cfa", ("y", "x"), np.ones((12, 18))),
        ("response", ("wavelength", "curve"), np.ones((5, 1))),
    ],
)
def test_a_variable_of_another_form_is_named(name, dims, values):
    with pytest.raises(InputError, match=rf"^({name}|first_column)"):
        check_frames(frames().drop_vars(name, errors="ignore").assign({name: (dims, values)}))


@pytest.mark.parametrize("value", ["dark", np.inf])
def test_an_offset_that_is_no_number_is_named(value):
    with pytest.raises(InputError, match=r"^offset"):
        check_frames(frames().assign_attrs(offset=value))


def test_curves_and_channels_that_do_not_fit_are_named():
    found = frames().drop_vars("curve").assign(response=(("curve", "wavelength"), np.ones((2, 5))))
    with pytest.raises(InputError, match=r"^frames.*curve"):
        check_frames(found)


def mutated(data, seed):
    """Damage a file: bits, zeros, a cut, or a number that is far too large."""
    rng = np.random.Generator(np.random.Philox(seed))
    array, kind = np.frombuffer(data, np.uint8).copy(), seed % 4
    at = int(rng.integers(0, len(array)))
    if kind == 0:
        array[rng.integers(0, len(array), 4)] ^= 1 << int(rng.integers(0, 8))
    elif kind == 1:
        array[at : at + int(rng.integers(1, 200))] = rng.choice([0, 255])
    elif kind == 2:
        array = array[:at]
    else:
        number = int(rng.choice([2**31 - 1, 2**63 - 1, 65535])).to_bytes(8, "little")
        array[at : at + 8] = np.frombuffer(number, np.uint8)[: len(array) - at]
    return array.tobytes()


def read_damaged(count, folder):
    """Read damaged frames files until ``count`` are refused."""
    sensor, cube = Bayer.nikon(), make_cube(np.random.default_rng(0).random((8, 8, 24)), Bands.paper())
    write(measure_matched(cube, sensor, masks_for(sensor, 1, Distinct(), (8, 8), 1)), folder / "frames.nc")
    data, ended, slowest, number = (folder / "frames.nc").read_bytes(), Counter(), 0.0, 0
    path = folder / "damaged.nc"
    while ended["refused"] < count:
        path.write_bytes(mutated(data, number))
        start = time.monotonic()
        try:
            band_model_of(read(path)).operator(np.float64)
            ended["accepted"] += 1
        except (InputError, ReconInputError):
            ended["refused"] += 1
        slowest, number = max(slowest, time.monotonic() - start), number + 1
    print(f"{dict(ended)}, slowest {slowest:.1f} s")
    return slowest


def test_damaged_frames_files_are_refused_in_time(tmp_path):
    assert read_damaged(30, tmp_path) < 10


@pytest.mark.slow
def test_two_hundred_damaged_frames_files_are_refused_in_time(tmp_path):
    assert read_damaged(200, tmp_path) < 10
