"""Foreign files for tests, written by libraries that optsim does not read them with, or byte by byte."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest

NM = np.array([450.0, 470.0, 480.0, 505.0])


def write_envi(folder, values, *, interleave="bsq", dtype="<f4", unit="Nanometers", nm=NM, offset=0, name="scene", extra=""):
    """Write NAME.hdr and NAME.img with nothing but ``tofile``."""
    codes = {"u1": 1, "i2": 2, "i4": 3, "f4": 4, "f8": 5, "u2": 12, "u4": 13, "i8": 14, "u8": 15}
    order = {"bsq": (2, 0, 1), "bil": (0, 2, 1), "bip": (0, 1, 2)}[interleave]
    rows, columns, bands = values.shape
    listed = ",\n ".join(str(w) for w in nm)
    header = f"""ENVI
description = {{a test = with {unit}}}
samples = {columns}
lines   = {rows}
bands   = {bands}
header offset = {offset}
file type = ENVI Standard
data type = {codes[np.dtype(dtype).str[1:]]}
interleave = {interleave.upper()}
byte order = {1 if dtype.startswith(">") else 0}
wavelength units = {unit}
wavelength = {{
 {listed}
}}
{extra}
"""
    (folder / f"{name}.hdr").write_text(header)
    with (folder / f"{name}.img").open("wb") as file:
        file.write(b"\x07" * offset)
        values.transpose(order).astype(dtype).tofile(file)
    return folder / f"{name}.hdr"


def write_mat73(path, **variables):
    """Write a MATLAB 7.3 file as MATLAB does: HDF5 behind a block of 512 bytes, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            values = np.asarray(values)
            data = file.create_dataset(name, data=values.T, compression="gzip" if values.size > 1 else None)
            kind = {"f8": "double", "f4": "single", "b1": "logical"}.get(values.dtype.str[1:], values.dtype.name)
            data.attrs["MATLAB_class"] = np.bytes_(kind)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan 01 00:00:00 2024 HDF5 schema 1.00 .".ljust(124))
        file.write(b"\x00\x02IM")
    return path


@pytest.fixture(scope="session")
def foreign():
    """The writers of this file."""
    return SimpleNamespace(envi=write_envi, mat73=write_mat73)
