"""Wrong, huge and hostile files: the reader ends at worst, this process goes on."""

import os
import struct
import zlib

import h5py
import numpy as np
import pytest
import scipy.io

from optsim.errors import InputError
from optsim.files import Axis, CubeImport, import_cube
from optsim.files.reader import Reader

NM = tuple(np.arange(450.0, 490.0, 10.0))
AXES = tuple(Axis(name=name) for name in ("y", "x", "wavelength"))


@pytest.fixture(scope="module")
def reader():
    with Reader() as child:
        yield child


def refused(path, reader, match, **how):
    with pytest.raises(InputError, match=match):
        import_cube(path, CubeImport(wavelengths_nm=NM, **how), reader)


def matlab5(path, **variables):
    scipy.io.savemat(path, variables, do_compression=False)
    return path.read_bytes()


def elements(data, at):
    """Yield (position, type, length) of the elements inside a matrix that starts at ``at``."""
    end = at + 8 + struct.unpack("<I", data[at + 4 : at + 8])[0]
    at += 8
    while at < end:
        kind, length = struct.unpack("<II", data[at : at + 8])
        small = kind >> 16
        yield at, kind & 0xFFFF, small or length
        at += 8 if small else 8 + (length + 7) // 8 * 8


@pytest.mark.parametrize("tag", [0, 8, 14, 20, 0xFFFF])
def test_I5_a_wrong_tag_in_a_matlab_variable_is_refused_and_the_next_file_is_read(tmp_path, reader, tag):
    path = tmp_path / "tag.mat"
    data = bytearray(matlab5(path, cube=np.random.default_rng(0).random((3, 5, 4))))
    *_, (at, kind, length) = elements(data, 128)
    assert (kind, length) == (9, 3 * 5 * 4 * 8)
    data[at : at + 4] = struct.pack("<I", tag)
    path.write_bytes(data)
    refused(path, reader, "tag.mat:cube")
    matlab5(tmp_path / "good.mat", cube=np.ones((3, 5, 4)))
    assert import_cube(tmp_path / "good.mat", CubeImport(wavelengths_nm=NM), reader)["radiance"].values.sum() == 60


def test_I5_an_all_zero_file_and_matlab_4_are_refused_by_name(tmp_path, reader):
    (tmp_path / "zero.mat").write_bytes(bytes(4096))
    refused(tmp_path / "zero.mat", reader, "zero.mat")
    scipy.io.savemat(tmp_path / "four.mat", {"cube": np.ones((6, 4))}, format="4")
    refused(tmp_path / "four.mat", reader, r"four\.mat|version 4")
    (tmp_path / "text.mat").write_bytes(bytes(124) + b"\x00\x01IM" + bytes(4000))
    refused(tmp_path / "text.mat", reader, "text.mat")


def test_I5_a_variable_of_2_gb_in_a_small_file_is_refused_before_it_is_allocated(tmp_path, reader):
    path = tmp_path / "huge.mat"
    data = bytearray(matlab5(path, cube=np.zeros((3, 5, 4))))
    at = next(at for at, kind, length in elements(data, 128) if (kind, length) == (5, 12))
    data[at + 8 : at + 20] = struct.pack("<3i", 8192, 8192, 4)
    path.write_bytes(data)
    refused(path, reader, r"huge\.mat:cube.*plausible")


def compressed(path, matrix):
    packed = zlib.compress(matrix, 9)
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(packed)) + packed)
    return len(matrix) / path.stat().st_size


def test_I5_a_zlib_bomb_is_refused(tmp_path, reader):
    path = tmp_path / "bomb.mat"
    assert compressed(path, matlab5(path, cube=np.zeros((500, 500, 16)))[128:]) > 1000
    refused(path, reader, r"bomb\.mat:cube.*plausible")
    path = tmp_path / "hidden.mat"  # behind an array of 480 bytes
    assert compressed(path, matlab5(path, cube=np.zeros((3, 5, 4)))[128:] + bytes(30_000_000)) > 1000
    refused(path, reader, r"hidden\.mat:cube")


def test_I5_broken_matlab_7_3_names_the_variable(tmp_path, foreign, reader):
    path = foreign.mat73(tmp_path / "v73.mat", cube=np.random.default_rng(0).random((6, 7, 4)))
    data = bytearray(path.read_bytes())
    with h5py.File(path) as file:
        at = file["cube"].id.get_chunk_info(0).byte_offset
    data[at + 20 : at + 200] = bytes(180)
    path.write_bytes(data)
    refused(path, reader, "v73.mat:cube")


def test_I6_an_envi_header_that_claims_ten_thousand_billion_numbers_is_refused_before_allocation(tmp_path, foreign, reader):
    path = foreign.envi(tmp_path, np.zeros((5, 5, 1)), nm=[500])
    path.write_text("ENVI\nlines = 100000\nsamples = 100000\nbands = 1000\ndata type = 4\ninterleave = bsq\n")
    assert path.with_suffix(".img").stat().st_size == 100
    refused(path, reader, r"scene.hdr:lines x samples x bands.*100000 x 100000 x 1000")


@pytest.mark.parametrize("line", ["lines = -5", "bands = 1e3", "data type = 6", "data type = 99", "byte order = 2", "interleave = bsx"])
def test_I6_an_envi_header_out_of_range_names_its_entry(tmp_path, foreign, reader, line):
    path = foreign.envi(tmp_path, np.zeros((5, 5, 4)), nm=NM)
    path.write_text(path.read_text() + line + "\n")
    refused(path, reader, f"scene.hdr:{line.split(' =')[0]}")


def test_I6_envi_without_its_other_half_is_refused_by_name(tmp_path, foreign, reader):
    path = foreign.envi(tmp_path, np.zeros((5, 5, 4)), nm=NM)
    path.with_suffix(".img").unlink()
    refused(path, reader, r"scene\.hdr")


def test_I8_an_exr_that_claims_60001_by_60001_is_refused_and_no_memory_taken(tmp_path, reader):
    import OpenEXR

    channels = {f"S0.{nm:g}nm": np.ones((4, 5), np.float32) for nm in NM}
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(tmp_path / "c.exr"))
    data = bytearray((tmp_path / "c.exr").read_bytes())
    at = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    data[at : at + 16] = np.array([0, 0, 60000, 60000], "<i4").tobytes()
    (tmp_path / "c.exr").write_bytes(data)
    refused(tmp_path / "c.exr", reader, r"c\.exr:S0.*at most 8 GiB")
    data[at : at + 16] = np.array([0, 0, 9000, 9000], "<i4").tobytes()
    (tmp_path / "c.exr").write_bytes(data)
    refused(tmp_path / "c.exr", reader, r"c\.exr:S0.*plausible")


def test_an_hdf5_array_that_claims_more_than_its_file_can_hold_is_refused(tmp_path, reader):
    with h5py.File(tmp_path / "empty.h5", "w") as file:
        file.create_dataset("cube", (2000, 2000, 31), np.float64, chunks=(100, 100, 31))
    refused(tmp_path / "empty.h5", reader, r"empty\.h5:cube.*plausible", axes=AXES)


def test_a_numpy_file_of_objects_is_refused_and_nothing_in_it_runs(tmp_path, reader):
    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "ran"),)

    np.save(tmp_path / "evil.npy", np.array([Evil()], object), allow_pickle=True)
    refused(tmp_path / "evil.npy", reader, "evil.npy:dtype", axes=AXES)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("name", ["a b.npy", "ünï.npy", "new\nline.npy", "x" * 250 + ".npy", "-rf.npy", "'; ls.npy"])
def test_I10_odd_names_work(tmp_path, reader, name):
    np.save(tmp_path / name, np.ones((2, 3, 4)))
    assert import_cube(tmp_path / name, CubeImport(axes=AXES, wavelengths_nm=NM), reader)["radiance"].shape == (2, 3, 4)


def test_I10_pipes_devices_and_absent_files_are_refused_without_waiting(tmp_path, reader):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero", tmp_path / "absent.mat"):
        refused(path, reader, "file")


def test_a_child_that_is_killed_is_named_and_started_again(tmp_path, reader):
    np.save(tmp_path / "c.npy", np.ones((2, 3, 4)))
    how = CubeImport(axes=AXES, wavelengths_nm=NM)
    import_cube(tmp_path / "c.npy", how, reader)
    reader._child._process.kill()
    reader._child._process.wait()
    assert import_cube(tmp_path / "c.npy", how, reader)["radiance"].shape == (2, 3, 4)


class Liar:
    """Stands for a child that a file has taken over."""

    alive = True

    def __init__(self, *answers):
        self._answers = list(answers)

    def ask(self, request, files, patience_s):
        return self._answers.pop(0)

    def receive(self, values, patience_s):
        raise ConnectionResetError

    def lift(self, memory):
        pass

    def cause(self):
        return "reader stopped"

    def close(self):
        pass


GOOD = {"name": "array", "shape": [2, 3, 4], "dtype": "<f8"}


@pytest.mark.parametrize(
    "answers",
    [
        [{}],
        [{"found": "x"}],
        [{"found": [{**GOOD, "shape": [-2, 3, 4]}]}],
        [{"found": [{**GOOD, "dtype": "|O"}]}],
        [{"found": [{**GOOD, "dtype": "<f8", "extra": 1}]}],
        [{"found": [{**GOOD, "shape": [2**40, 3, 4]}]}],
        [{"refused": None}],
        [{"refused": ["a"]}],
        [{"failed": {"x": 1}}],
        [{"found": [GOOD]}, {"shape": [2, 3, 5], "dtype": "<f8", "bytes": 240}],
        [{"found": [GOOD]}, {"shape": 7, "dtype": "<f8", "bytes": 192}],
        [{"found": [GOOD]}, {"shape": [2, 3, 4], "dtype": "<f8", "bytes": 192}],
    ],
)
def test_a_child_that_lies_is_refused_with_the_files_name(tmp_path, answers):
    np.save(tmp_path / "c.npy", np.ones((2, 3, 4)))
    reader = Reader()
    reader._child, reader._ready = Liar(*answers), {"npy"}
    with pytest.raises(InputError, match=r"c\.npy"):
        import_cube(tmp_path / "c.npy", CubeImport(axes=AXES, wavelengths_nm=NM), reader)
