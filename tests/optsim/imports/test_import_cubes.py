"""Foreign cubes come in with the right axes, wavelengths and numbers, judged by other writers."""

import struct
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from PIL import Image

from optsim.cli.app import _code
from optsim.errors import InputError
from optsim.files import Axis, Crop, CubeImport, import_cube, read_cube, write
from optsim.files.grids import TSA_HALVES_NM, TSA_TENTHS_NM
from optsim.files.reader import Reader

NM = np.array([450.0, 470.0, 480.0, 505.0])
SHAPE = (3, 5, 4)
AXES = tuple(Axis(name=name) for name in ("y", "x", "wavelength"))


def cube(seed=0):
    """A (y, x, wavelength) cube that no transposition leaves as it is."""
    return np.random.default_rng(seed).random(SHAPE).astype(np.float32)


@pytest.fixture(scope="module")
def reader():
    with Reader() as child:
        yield child


def imported(path, reader, **how):
    return import_cube(path, CubeImport(**how), reader)


def same(found, values, nm=NM):
    np.testing.assert_array_equal(found["radiance"].values, values)
    np.testing.assert_allclose(found["wavelength"].values, nm, rtol=1e-12)


@pytest.mark.parametrize("interleave", ["bsq", "bil", "bip"])
@pytest.mark.parametrize("dtype", ["<f4", ">f4"])
def test_I7_every_interleave_and_byte_order_of_envi_gives_the_same_cube_bitwise(tmp_path, foreign, reader, interleave, dtype):
    path = foreign.envi(tmp_path, cube(), interleave=interleave, dtype=dtype)
    same(imported(path, reader), cube())


def test_I7_micrometres_descending_wavelengths_an_offset_and_a_scale_factor_change_nothing(tmp_path, foreign, reader):
    counts = np.random.default_rng(1).integers(-3000, 10000, SHAPE).astype(np.int16)
    plain = imported(foreign.envi(tmp_path, (counts / 10000).astype(np.float32), name="plain"), reader)
    forms = {
        "scale": {"values": counts, "dtype": "<i2", "extra": "reflectance scale factor = 10000.0"},
        "um": {"values": counts / np.float64(10000), "unit": "Micrometers", "nm": NM / 1000},
        "descending": {"values": (counts / 10000)[:, :, ::-1], "nm": NM[::-1]},
        "offset": {"values": counts / 10000, "offset": 333},
        "all": {
            "values": counts[:, :, ::-1],
            "dtype": ">i2",
            "extra": "reflectance scale factor = 10000",
            "nm": NM[::-1] / 1000,
            "unit": "um",
            "offset": 17,
            "interleave": "bil",
        },
    }
    for name, form in forms.items():
        found = imported(foreign.envi(tmp_path, form.pop("values"), name=name, **form), reader)
        assert found["radiance"].dtype == np.float32
        same(found, plain["radiance"].values)


def test_envi_written_by_spectral_python_is_read_alike(tmp_path, reader):
    envi = pytest.importorskip("spectral.io.envi")
    values = cube(3)
    for interleave in ("bsq", "bil", "bip"):
        for order in (0, 1):
            path = tmp_path / f"{interleave}{order}.hdr"
            envi.save_image(str(path), values, interleave=interleave, byteorder=order, metadata={"wavelength": [str(w) for w in NM]})
            same(imported(path, reader), values)
            same(imported(path.with_suffix(".img"), reader), values)


def test_the_gains_and_offsets_of_envi_are_applied_band_by_band(tmp_path, foreign, reader):
    extra = "data gain values = {1, 2, 3, 0.5}\ndata offset values = {0, 0, 1, -1}"
    found = imported(foreign.envi(tmp_path, cube(), extra=extra), reader)
    np.testing.assert_allclose(found["radiance"].values, cube() * [1, 2, 3, 0.5] + [0, 0, 1, -1], rtol=1e-6)


def test_envi_pixels_without_data_are_refused_with_their_place(tmp_path, foreign, reader):
    values = cube()
    values[1, 2, 3] = -9999
    path = foreign.envi(tmp_path, values, extra="data ignore value = -9999")
    with pytest.raises(InputError, match=r"\(1, 2, 3\).*--crop"):
        imported(path, reader)
    same(imported(path, reader, crop=Crop(top=2, left=0, height=1, width=5)), values[2:])


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("dtype", ["float64", "float32", "uint16", "uint8"])
def test_matlab_5_files_are_read_as_matlab_shows_them(tmp_path, reader, dtype, compressed):
    values = (cube() * 200).astype(dtype)
    scipy.io.savemat(tmp_path / "a.mat", {"hyper": values, "other": np.eye(3), "wavelengths": NM / 1000}, do_compression=compressed)
    found = imported(tmp_path / "a.mat", reader)
    same(found, values.astype(float))
    assert found["radiance"].dtype == (np.float64 if dtype == "float64" else np.float32)


def test_icvl_and_arad_files_of_matlab_7_3_have_their_axes_reversed_and_their_bands_inside(tmp_path, foreign, reader):
    rad = foreign.mat73(tmp_path / "icvl.mat", rad=cube().astype(np.float64), rgb=cube()[:, :, :3], bands=NM[None])
    same(imported(rad, reader), cube())
    with h5py.File(rad) as file:
        assert file["rad"].shape == (4, 5, 3)  # stored as band, x, y
    arad = foreign.mat73(tmp_path / "arad.mat", cube=cube(), bands=NM[None], norm_factor=np.array([[3.0]]))
    same(imported(arad, reader), cube())


def test_a_picture_that_lies_on_its_side_is_turned_by_its_axes(tmp_path, reader):
    np.save(tmp_path / "turned.npy", np.rot90(cube(), axes=(0, 1)))  # counter-clockwise
    axes = (Axis(name="x", reverse=True), Axis(name="y"), Axis(name="wavelength"))
    same(imported(tmp_path / "turned.npy", reader, axes=axes, wavelengths_nm=tuple(NM)), cube())


def test_kaist_files_need_their_wavelengths_stated_as_two_lists_are_in_use(tmp_path, reader):
    scipy.io.savemat(tmp_path / "scene01.mat", {"img": np.random.default_rng(0).random((4, 6, 28))})
    with pytest.raises(InputError, match=r"tsa-453\.5 or tsa-453\.3"):
        imported(tmp_path / "scene01.mat", reader)
    for grid in (TSA_HALVES_NM, TSA_TENTHS_NM):
        assert imported(tmp_path / "scene01.mat", reader, wavelengths_nm=grid)["radiance"].shape == (4, 6, 28)
    assert max(abs(a - b) for a, b in zip(TSA_HALVES_NM, TSA_TENTHS_NM)) < 0.9


def test_kaist_exr_channels_are_named_by_wavelength(tmp_path, reader):
    import OpenEXR

    nm = np.arange(420, 721, 10)
    planes = np.random.default_rng(2).random((31, 4, 3)).astype(np.float32)
    channels = {f"w{w}nm": np.ascontiguousarray(plane) for w, plane in zip(nm, planes)} | {c: np.zeros((4, 3), np.float32) for c in "RGB"}
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(tmp_path / "scene.exr"))
    same(imported(tmp_path / "scene.exr", reader), planes.transpose(1, 2, 0), nm)


def test_I8_a_missing_band_of_a_regular_exr_is_named_and_reflective_layers_are_read(tmp_path, reader):
    import OpenEXR

    channels = {f"T.{w},000000nm": np.full((2, 3), w / 1000, np.float32) for w in (400, 410, 420, 440, 450)}
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, dict(channels)) as file:
        file.write(str(tmp_path / "gap.exr"))
    with pytest.raises(InputError, match="no band at 430 nm"):
        imported(tmp_path / "gap.exr", reader)
    channels["T.430.0nm"] = np.full((2, 3), 0.43, np.float32)
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, dict(channels)) as file:
        file.write(str(tmp_path / "whole.exr"))
    found = imported(tmp_path / "whole.exr", reader)
    assert found.attrs["source_values"] == "reflectance"
    np.testing.assert_array_equal(found["radiance"].values[1, 2], np.float32([0.40, 0.41, 0.42, 0.43, 0.44, 0.45]))


def test_our_own_exr_comes_back_through_the_child(tmp_path, reader):
    from optsim.cube import Bands, make_cube

    write(make_cube(cube(), Bands.from_centers(NM)), tmp_path / "c.exr")
    same(imported(tmp_path / "c.exr", reader), cube())


def cave_folder(folder, values, mode=None):
    folder.mkdir()
    for k in range(values.shape[2]):
        picture = Image.fromarray(values[:, :, k])
        (picture if mode is None else picture.convert(mode)).save(folder / f"beads_ms_{k + 1:02d}.png")
    (folder / "Thumbs.db").write_bytes(b"junk")
    return folder


def test_a_cave_folder_is_400_to_700_nm_of_full_scale_1(tmp_path, reader):
    values = np.random.default_rng(4).integers(0, 65536, (4, 6, 31)).astype(np.uint16)
    outer = tmp_path / "beads_ms"
    outer.mkdir()
    cave_folder(outer / "beads_ms", values)
    found = imported(outer, reader)
    same(found, (values / 65535).astype(np.float32), np.arange(400, 701, 10))
    assert found.attrs["source_values"] == "value / 65535"


def test_the_cave_scene_that_is_stored_as_gray_colours_of_8_bits_is_read_too(tmp_path, reader):
    values = np.random.default_rng(5).integers(0, 256, (4, 6, 31)).astype(np.uint8)
    same(imported(cave_folder(tmp_path / "w", values, "RGBA"), reader), (values / 255).astype(np.float32), np.arange(400, 701, 10))


def test_a_picture_with_a_transparent_layer_is_gray_and_colours_of_16_bits_are_refused(tmp_path, reader):
    values = np.random.default_rng(8).integers(0, 256, (4, 6, 31)).astype(np.uint8)
    same(imported(cave_folder(tmp_path / "la", values, "LA"), reader), (values / 255).astype(np.float32), np.arange(400, 701, 10))
    folder = cave_folder(tmp_path / "c", values)
    rows = b"".join(b"\0" + bytes(6 * 6) for _ in range(4))
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", 6, 4, 16, 2, 0, 0, 0)), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    data = b"".join(struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks)
    (folder / "beads_ms_03.png").write_bytes(b"\x89PNG\r\n\x1a\n" + data)
    with pytest.raises(InputError, match=r"beads_ms_03.*8 of the 16 bits"):
        imported(folder, reader)


def test_a_folder_with_a_missing_coloured_or_damaged_picture_is_refused_by_name(tmp_path, reader):
    values = np.random.default_rng(6).integers(0, 65536, (4, 6, 31)).astype(np.uint16)
    folder = cave_folder(tmp_path / "c", values)
    whole = (folder / "beads_ms_07.png").read_bytes()
    (folder / "beads_ms_07.png").unlink()
    with pytest.raises(InputError, match="no picture 7"):
        imported(folder, reader)
    (folder / "beads_ms_07.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="beads_ms_07"):
        imported(folder, reader)
    Image.fromarray(np.random.default_rng(7).integers(0, 255, (4, 6, 3)).astype(np.uint8)).save(folder / "beads_ms_07.png")
    with pytest.raises(InputError, match=r"beads_ms_07.*gray"):
        imported(folder, reader)


def test_a_folder_of_pictures_named_by_wavelength_says_its_bands(tmp_path, reader):
    for k, nm in enumerate(NM):
        Image.fromarray((cube()[:, :, k] * 255).astype(np.uint8)).save(tmp_path / f"leaf_{nm:g}nm.png")
    assert imported(tmp_path, reader)["wavelength"].values.tolist() == NM.tolist()


def test_npy_needs_its_axes_stated_and_takes_them_in_any_order(tmp_path, reader):
    np.save(tmp_path / "c.npy", np.asfortranarray(cube().transpose(2, 0, 1)))
    with pytest.raises(InputError, match="--axes"):
        imported(tmp_path / "c.npy", reader, wavelengths_nm=tuple(NM))
    axes = (AXES[2], AXES[0], AXES[1])
    same(imported(tmp_path / "c.npy", reader, axes=axes, wavelengths_nm=tuple(NM)), cube())
    with pytest.raises(InputError, match=r"--wavelengths.*or state --axes"):
        imported(tmp_path / "c.npy", reader, axes=AXES, wavelengths_nm=tuple(NM))


def test_a_netcdf_cube_of_others_tells_its_axes_and_its_wavelengths(tmp_path, reader):
    import xarray as xr

    data = xr.DataArray(cube().transpose(2, 0, 1), dims=("band", "line", "sample"), coords={"band": ("band", NM / 1000, {"units": "um"})})
    xr.Dataset({"reflectance": data}).to_netcdf(tmp_path / "c.nc", engine="h5netcdf")
    same(imported(tmp_path / "c.nc", reader), cube())


def test_links_and_outside_storage_of_hdf5_are_not_followed(tmp_path, reader):
    secret = tmp_path / "secret.bin"
    cube().tofile(secret)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["cube"] = cube()
    with h5py.File(tmp_path / "links.h5", "w") as file:
        file["outer"] = h5py.ExternalLink("other.h5", "cube")
        file["soft"] = h5py.SoftLink("/plain")
        file["plain"] = np.zeros(3)
        file.create_dataset("raw", SHAPE, np.float32, external=[(str(secret), 0, h5py.h5f.UNLIMITED)])
        layout = h5py.VirtualLayout(SHAPE, np.float32)
        layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "cube", SHAPE)
        file.create_virtual_dataset("virtual", layout)
    for name in ("outer", "soft", "raw", "virtual"):
        with pytest.raises(InputError, match=r"--variable.*an array of links\.h5: plain 3"):
            imported(tmp_path / "links.h5", reader, variable=name, axes=AXES)


def test_values_that_are_not_finite_are_refused_with_their_place(tmp_path, reader):
    values = cube()
    values[2, 4, 1] = np.nan
    scipy.io.savemat(tmp_path / "nan.mat", {"img": values})
    with pytest.raises(InputError, match=r"\(2, 4, 1\)"):
        imported(tmp_path / "nan.mat", reader, wavelengths_nm=tuple(NM))


def test_the_scale_is_applied_once_and_noted(tmp_path, reader):
    scipy.io.savemat(tmp_path / "a.mat", {"img": cube()})
    found = imported(tmp_path / "a.mat", reader, wavelengths_nm=tuple(NM), scale=2.5)
    np.testing.assert_array_equal(found["radiance"].values, (cube().astype(np.float64) * 2.5).astype(np.float32))
    assert found.attrs["scale"] == 2.5


def test_a_range_keeps_the_bands_inside_it(tmp_path, reader):
    scipy.io.savemat(tmp_path / "a.mat", {"img": cube()[:, :, ::-1]})
    found = imported(tmp_path / "a.mat", reader, wavelengths_nm=tuple(NM[::-1]), range_nm=(460, 490))
    same(found, cube()[:, :, 1:3], NM[1:3])
    with pytest.raises(InputError, match="--range"):
        imported(tmp_path / "a.mat", reader, wavelengths_nm=tuple(NM), range_nm=(460, 475))


@pytest.mark.parametrize("suffix", [".nc", ".exr"])
def test_the_verb_import_writes_a_cube_that_every_stage_reads(tmp_path, capsys, suffix):
    np.save(tmp_path / "c.npy", cube()[::-1])
    words = ["import", str(tmp_path / "c.npy"), "--axes=-y,x,wavelength", "--wavelengths", "450,470,480,505", "--crop", "1,0,2,3"]
    assert _code([*words, "-o", str(tmp_path / f"c{suffix}")]) == 0
    same(read_cube(tmp_path / f"c{suffix}"), cube()[1:, :3])
    assert "2 x 3 x 4" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "field"),
    [
        (["--axes", "y,x"], "--axes"),
        (["--wavelengths", "500"], "--wavelengths"),
        (["--wavelengths", "400:700:2.5"], "--wavelengths"),
        (["--wavelengths", "nan,1,2,3"], "--wavelengths"),
        (["--crop", "0,0,9,9"], "--crop"),
        (["--scale", "0"], "--scale"),
        (["--range", "700"], "--range"),
        (["--variable", "other"], "--variable"),
    ],
)
def test_misuse_of_import_names_the_option(tmp_path, capsys, words, field):
    np.save(tmp_path / "c.npy", cube())
    given = {"--axes": "y,x,wavelength", "--wavelengths": "450,470,480,505"}
    given |= dict(zip(words[::2], words[1::2]))
    assert _code(["import", str(tmp_path / "c.npy"), *(w for pair in given.items() for w in pair), "-o", str(tmp_path / "o.nc")]) == 2
    assert field in capsys.readouterr().err


def test_the_child_has_no_environment_and_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET_TOKEN", "1")
    np.save(tmp_path / "c.npy", cube())
    with Reader() as child:
        imported(tmp_path / "c.npy", child, axes=AXES, wavelengths_nm=tuple(NM))
        pid = child._child._process.pid
        environment, limits = (Path(f"/proc/{pid}/{name}").read_text() for name in ("environ", "limits"))
    assert "SECRET" not in environment
    assert "HOME" not in environment
    words = {line[:26].strip(): line[26:].split()[0] for line in limits.splitlines()[1:]}
    assert (words["Max file size"], words["Max core file size"], words["Max open files"]) == ("0", "0", "64")
    assert int(words["Max address space"]) < 3 << 30
