"""Micrometres and Angstrom that are taken for nanometres are refused or told."""

import numpy as np
import pytest

from optsim.cli.app import _code
from optsim.errors import InputError
from optsim.files import CubeImport, import_cube
from optsim.files.reader import Reader


def cube():
    return np.random.default_rng(0).random((3, 4, 4)).astype(np.float32)


def words_of(verb, folder, wavelengths):
    out = ["-o", str(folder / "o.nc"), "--wavelengths", wavelengths]
    if verb == "import":
        np.save(folder / "c.npy", cube())
        return ["import", str(folder / "c.npy"), "--axes", "y,x,wavelength", *out]
    np.save(folder / "f.npy", np.ones((3, 7)))
    np.save(folder / "m.npy", np.eye(3, 4))
    return ["import-measurement", str(folder / "f.npy"), "--mask", str(folder / "m.npy"), "--shifts", "1", *out]


@pytest.mark.parametrize("verb", ["import", "import-measurement"])
@pytest.mark.parametrize(
    ("wavelengths", "sentence"),
    [
        ("0.4:0.7:4", "--wavelengths: must be centres from 100 to 20000 nm: um times 1000, got [0.4"),
        ("40000:70000:4", "--wavelengths: must be centres from 100 to 20000 nm: Angstrom over 10, got [40000.0"),
        ("450,450,460,470", "--wavelengths: must be at least two"),
    ],
)
def test_numbers_that_are_no_nanometres_or_stand_twice_are_refused(tmp_path, capsys, verb, wavelengths, sentence):
    assert _code(words_of(verb, tmp_path, wavelengths)) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["import", "import-measurement"])
def test_bands_beyond_2600_nm_are_told_as_they_may_be_angstrom(tmp_path, capsys, verb):
    assert _code(words_of(verb, tmp_path, "4000:7000:4")) == 0
    assert "note: bands from 4000 to 7000 nm, beyond 2600: if these are Angstrom" in capsys.readouterr().err
    assert _code(words_of(verb, tmp_path, "900:1700:4")) == 0
    assert "Angstrom" not in capsys.readouterr().err


def test_an_envi_header_whose_unit_contradicts_its_numbers_is_refused(tmp_path, foreign):
    path = foreign.envi(tmp_path, cube(), nm=np.array([0.4, 0.5, 0.6, 0.7]), unit="Nanometers")
    with Reader() as reader, pytest.raises(InputError, match=r"scene\.hdr:wavelength: must be centres from 100 to 20000 nm: um times 1000"):
        import_cube(path, None, reader)
    with Reader() as reader:
        stated = import_cube(path, CubeImport(wavelengths_nm=(400.0, 500.0, 600.0, 700.0)), reader)
    assert stated["wavelength"].values[0] == 400
