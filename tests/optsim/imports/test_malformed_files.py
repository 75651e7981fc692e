"""Malformed files: each is refused by name, within seconds, and this process lives; what is still a cube after all is a valid one."""

import time
from collections import Counter

import numpy as np
import OpenEXR
import pytest
import scipy.io
from PIL import Image

from optsim.cube import Bands, check_cube, make_cube
from optsim.errors import InputError
from optsim.files import Axis, CubeImport, import_cube, write
from optsim.files.reader import Reader

NM = np.arange(450.0, 490.0, 10.0)
AXES = tuple(Axis(name=name) for name in ("y", "x", "wavelength"))
HOW = {True: CubeImport(axes=AXES, wavelengths_nm=tuple(NM)), False: CubeImport(wavelengths_nm=tuple(NM))}
MOST_S = 10.0
DEFAULT, RELEASE = 63, 504


def values():
    return np.random.default_rng(0).random((6, 7, 4)).astype(np.float32)


def make_mat5(path, foreign):
    scipy.io.savemat(path / "a.mat", {"cube": values(), "bands": NM}, do_compression=False)
    return path / "a.mat", path / "a.mat"


def make_mat5_compressed(path, foreign):
    scipy.io.savemat(path / "z.mat", {"cube": values(), "bands": NM}, do_compression=True)
    return path / "z.mat", path / "z.mat"


def make_mat73(path, foreign):
    file = foreign.mat73(path / "h.mat", cube=values(), bands=NM[None])
    return file, file


def make_envi(path, foreign):
    file = foreign.envi(path, values(), nm=NM)
    return file, file


def make_exr(path, foreign):
    channels = {f"S0.{nm:g}nm": np.ascontiguousarray(values()[:, :, k]) for k, nm in enumerate(NM)}
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(path / "c.exr"))
    return path / "c.exr", path / "c.exr"


def make_netcdf(path, foreign):
    write(make_cube(values(), Bands.from_centers(NM)), path / "c.nc")
    return path / "c.nc", path / "c.nc"


def make_npy(path, foreign):
    np.save(path / "c.npy", values())
    return path / "c.npy", path / "c.npy"


def make_png(path, foreign):
    folder = path / "stack"
    folder.mkdir()
    for k in range(len(NM)):
        Image.fromarray((values()[:, :, k] * 65535).astype(np.uint16)).save(folder / f"band_{k + 1}.png")
    return folder, folder / "band_2.png"


MAKERS = (make_mat5, make_mat5_compressed, make_mat73, make_envi, make_exr, make_netcdf, make_npy, make_png)
AXES_STATED = (make_npy,)


def cut(data, rng):
    return data[: int(len(data) * rng.integers(0, 16) / 16)]


def flip_bits(data, rng):
    array = np.frombuffer(data, np.uint8).copy()
    where = rng.integers(0, len(array), rng.integers(1, 9))
    array[where] ^= (1 << rng.integers(0, 8, where.size)).astype(np.uint8)
    return array.tobytes()


def flip_early_bits(data, rng):
    head = min(len(data), 600)
    return flip_bits(data[:head], rng) + data[head:]


def big_number(data, rng):
    at = int(rng.integers(0, max(1, min(len(data), 2048) - 8)))
    number = rng.choice([0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 65535, 2**40, 2**63 - 1])
    size = int(rng.choice([2, 4, 8]))
    return data[:at] + (int(number) % 2 ** (8 * size)).to_bytes(size, rng.choice(["little", "big"])) + data[at + size :]


def blank(data, rng):
    start, length = rng.integers(0, len(data)), rng.integers(1, 200)
    return data[:start] + bytes([int(rng.choice([0, 255, 32]))]) * int(length) + data[start + length :]


def shift(data, rng):
    at, length = int(rng.integers(0, len(data))), int(rng.integers(1, 40))
    return data[:at] + (rng.bytes(length) if rng.random() < 0.5 else b"") + data[at + (0 if rng.random() < 0.5 else length) :]


def splice(data, rng):
    a, b = sorted(rng.integers(0, len(data), 2))
    return data[:a] + data[b:] + data[a:b]


def scribble_digits(data, rng):
    """Change a digit of the text at the file's start (headers of ENVI and NumPy)."""
    digits = [i for i, c in enumerate(data[:1000]) if chr(c).isdigit()]
    if not digits:
        return flip_early_bits(data, rng)
    at = int(rng.choice(digits))
    return data[:at] + rng.choice([b"9999999", b"-1", b"", b"nan", b"0"]) + data[at + 1 :]


MUTATIONS = (cut, flip_bits, flip_early_bits, big_number, blank, shift, splice, scribble_digits)


def attempt(maker, mutation, number, folder, foreign, reader):
    """Import one mutated file; return how it ended and how long it took."""
    folder.mkdir()
    path, victim = maker(folder, foreign)
    rng = np.random.Generator(np.random.Philox([number, MAKERS.index(maker), MUTATIONS.index(mutation)]))
    victim.write_bytes(mutation(victim.read_bytes(), rng))
    start = time.monotonic()
    try:
        cube = import_cube(path, HOW[maker in AXES_STATED], reader)
    except InputError as error:
        took = time.monotonic() - start
        refusal = str(error)
    else:
        took, refusal = time.monotonic() - start, ""
        check_cube(cube)
    named = (path.name, path.stem, victim.name, "--axes", "--wavelengths", "radiance")
    assert not refusal or any(word in refusal for word in named), f"{maker.__name__} {mutation.__name__} {number}: {refusal}"
    return "refused" if refusal else "still a cube", took


def refuse(count, folder, foreign):
    """Try mutated files, formats and mutations in turn, until ``count`` are refused."""
    ended, slowest, number = Counter(), 0.0, 0
    with Reader() as reader:
        while ended["refused"] < count:
            maker = MAKERS[number % len(MAKERS)]
            mutation = MUTATIONS[(number // len(MAKERS)) % len(MUTATIONS)]
            how, took = attempt(maker, mutation, number, folder / str(number), foreign, reader)
            ended[how] += 1
            slowest = max(slowest, took)
            number += 1
            assert number < 4 * count
    print(f"{dict(ended)}, slowest {slowest:.1f} s")
    return ended, slowest


def test_malformed_files_of_every_format_are_refused_by_name(tmp_path, foreign):
    ended, slowest = refuse(DEFAULT, tmp_path, foreign)
    assert ended["refused"] == DEFAULT
    assert slowest < MOST_S


@pytest.mark.slow
def test_five_hundred_malformed_files_are_refused_by_name_and_none_takes_ten_seconds(tmp_path, foreign):
    ended, slowest = refuse(RELEASE, tmp_path, foreign)
    assert ended["refused"] == RELEASE
    assert slowest < MOST_S


def test_the_unharmed_files_are_cubes(tmp_path, foreign):
    with Reader() as reader:
        for maker in MAKERS:
            (tmp_path / maker.__name__).mkdir()
            path, _ = maker(tmp_path / maker.__name__, foreign)
            found = import_cube(path, HOW[maker in AXES_STATED], reader)["radiance"].values
            np.testing.assert_allclose(found, values(), atol=1 / 65535, err_msg=maker.__name__)  # a step of the 16-bit pictures
