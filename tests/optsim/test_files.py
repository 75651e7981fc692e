"""Round trips, damage and atomicity of files."""

import os
import time

import numpy as np
import pytest

from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from optsim.files import read, read_cube, write
from optsim.files.guard import atomic_path


@pytest.fixture
def cube():
    rng = np.random.default_rng(1)
    bands = Bands.paper()
    return make_cube(rng.random((5, 7, 24)).astype(np.float32), bands, rng.random((5, 7, 24)).astype(np.float32), {"seed": 3, "scene": "t"})


@pytest.mark.parametrize("suffix", [".nc", ".exr"])
def test_a_float32_cube_survives_a_round_trip_bit_for_bit(cube, tmp_path, suffix):
    path = tmp_path / f"ünï code{suffix}"
    write(cube, path)
    back = read_cube(path)
    for name in ("radiance", "stderr"):
        np.testing.assert_array_equal(back[name].values, cube[name].values)
    for name in ("wavelength", "band_lower", "band_upper"):
        np.testing.assert_array_equal(back[name].values, cube[name].values)
    assert back.attrs["seed"] == 3


@pytest.mark.parametrize("suffix", [".nc", ".exr"])
def test_the_same_cube_written_twice_gives_the_same_bytes(cube, tmp_path, suffix):
    write(cube, tmp_path / f"a{suffix}")
    time.sleep(1.1)
    write(cube, tmp_path / f"b{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("view", [np.s_[:, ::2], np.s_[::-1, :], np.s_[:, ::-1]])
def test_I1_strided_and_reversed_cubes_are_written_right(cube, tmp_path, view):
    part = cube.isel(y=view[0], x=view[1])
    write(part, tmp_path / "c.exr")
    np.testing.assert_array_equal(read(tmp_path / "c.exr")["radiance"].values, part["radiance"].values)


def test_I1_fortran_float64_slices_are_written_right(tmp_path):
    values = np.asfortranarray(np.random.default_rng(2).random((6, 5, 3)))
    cube = make_cube(values, Bands.parse("500:600:3"))
    write(cube, tmp_path / "c.exr")
    np.testing.assert_array_equal(read(tmp_path / "c.exr")["radiance"].values, values.astype(np.float32))


@pytest.mark.parametrize("suffix", [".nc", ".exr"])
@pytest.mark.parametrize("sixteenth", range(16))
def test_I4_a_file_cut_at_any_sixteenth_is_refused(cube, tmp_path, suffix, sixteenth):
    path = tmp_path / f"c{suffix}"
    write(cube, path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * sixteenth // 16])
    with pytest.raises(InputError, match="file"):
        read(path)


def test_I8_a_point_as_decimal_mark_is_accepted_and_wavelengths_are_sorted_as_numbers(tmp_path):
    import OpenEXR

    channels = {f"S0.{nm}nm": np.full((2, 3), nm, np.float32) for nm in (1000.0, 450.5, 900.25)}
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(tmp_path / "p.exr"))
    cube = read(tmp_path / "p.exr")
    np.testing.assert_array_equal(cube["wavelength"].values, [450.5, 900.25, 1000])
    np.testing.assert_array_equal(cube["radiance"].values[0, 0], [450.5, 900.25, 1000])


def test_I8_a_missing_band_is_named(cube, tmp_path):
    import OpenEXR

    write(cube.drop_vars("stderr"), tmp_path / "c.exr")
    with OpenEXR.File(str(tmp_path / "c.exr"), separate_channels=True) as file:
        header, channels = dict(file.header()), {k: np.array(v.pixels) for k, v in file.channels().items()}
    name = next(k for k in channels if "536" in k)
    channels.pop(name)
    header.pop("channels")
    with OpenEXR.File(header, channels) as file:
        file.write(str(tmp_path / "d.exr"))
    with pytest.raises(InputError, match="536"):
        read(tmp_path / "d.exr")


def test_I8_a_claimed_60001_by_60001_picture_is_refused_before_it_is_allocated(cube, tmp_path):
    write(cube, tmp_path / "c.exr")
    data = bytearray((tmp_path / "c.exr").read_bytes())
    at = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    data[at : at + 16] = np.array([0, 0, 60000, 60000], "<i4").tobytes()
    (tmp_path / "c.exr").write_bytes(data)
    with pytest.raises(InputError):
        read(tmp_path / "c.exr")


def test_I10_pipes_devices_and_folders_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.nc")
    for path in (tmp_path / "pipe.nc", tmp_path, "/dev/zero", tmp_path / "absent.nc"):
        with pytest.raises(InputError, match="file"):
            read(path)


def test_a_failed_write_leaves_the_old_file_and_no_rubbish(tmp_path):
    path = tmp_path / "x.nc"
    path.write_text("old")

    def write_half() -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        write_half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_units_that_other_writers_give_are_read(tmp_path):
    import OpenEXR

    channels = {f"S0.{nm},000000nm": np.full((2, 2), nm, np.float32) for nm in (500, 510)}
    with OpenEXR.File({"type": OpenEXR.scanlineimage, "emissiveUnits": "W.m^-2.sr^-1"}, channels) as file:
        file.write(str(tmp_path / "o.exr"))
    np.testing.assert_array_equal(read(tmp_path / "o.exr")["radiance"].values[1, 1], [500, 510])


def test_units_of_frequency_are_refused(tmp_path):
    import OpenEXR

    with OpenEXR.File(
        {"type": OpenEXR.scanlineimage, "emissiveUnits": "W.m^-2.sr^-1.Hz^-1"}, {"S0.500nm": np.ones((2, 2), np.float32)}
    ) as file:
        file.write(str(tmp_path / "w.exr"))
    with pytest.raises(InputError, match="emissiveUnits"):
        read(tmp_path / "w.exr")
