"""Tell the formats of foreign files apart by their contents, never by their names."""

from __future__ import annotations

from pathlib import Path

from optsim.errors import InputError
from optsim.files.guard import regular_file
from optsim.files.reader import Source

HDF5 = b"\x89HDF\r\n\x1a\n"
FIRST_BYTES = 520
MAGIC = (
    (b"\x93NUMPY", "npy", "NumPy (.npy)"),
    (b"\x89PNG\r\n\x1a\n", "png", "PNG"),
    (b"\x76\x2f\x31\x01", "exr", "spectral OpenEXR"),
    (HDF5, "hdf5", "HDF5 or netCDF-4"),
)
READABLE = "ENVI, MATLAB (v5 to v7.3), spectral OpenEXR, NumPy .npy, HDF5, netCDF-4, PNG"
DATA_SUFFIXES = ("", ".img", ".raw", ".dat", ".bin", ".bsq", ".bil", ".bip", ".IMG", ".RAW", ".DAT", ".BIN", ".BSQ", ".BIL", ".BIP")
HEADER_SUFFIXES = (".hdr", ".HDR")


def recognise(path: Path | str, field: str = "file") -> Source:
    """Return a file's format and, for ENVI, its two files.

    Raises:
        InputError: naming the file when it is none of those that can be read, or ENVI without its other half.
    """
    path = Path(path)
    with regular_file(path, field).open("rb") as file:
        first = file.read(FIRST_BYTES)
    for magic, module, title in MAGIC:
        if first.startswith(magic):
            return Source(module, title, (path,))
    if first.startswith(b"ENVI") or first.startswith(b"\xef\xbb\xbfENVI"):
        return Source("envi", "ENVI", (path, _partner(path, DATA_SUFFIXES, field)))
    if first[126:128] in (b"IM", b"MI") and len(first) >= 128:
        return _matlab(path, first, field)
    if any(candidate.is_file() for candidate in _beside(path, HEADER_SUFFIXES)):
        header = _partner(path, HEADER_SUFFIXES, field)
        if header.open("rb").read(7).lstrip(b"\xef\xbb\xbf").startswith(b"ENVI"):
            return Source("envi", "ENVI", (header, path))
    if len(first) >= 20 and first[:4] in _V4_TYPES:
        raise InputError(field, str(path), "newer than MATLAB version 4 (in MATLAB: save -v7), or another file: it looks like version 4")
    raise InputError(field, str(path), f"a file of a known format: {READABLE}")


_V4_TYPES = {code.to_bytes(4, "little") for code in (0, 10, 20, 30, 40, 50)} | {code.to_bytes(4, "big") for code in (1000, 1010, 1020)}
"""First word of a MATLAB 4 file: full matrices in either byte order."""


def _matlab(path: Path, first: bytes, field: str) -> Source:
    version = int.from_bytes(first[124:126], "little" if first[126:128] == b"IM" else "big")
    if version == 0x0200 and first[512:520] == HDF5:
        return Source("hdf5", "MATLAB 7.3", (path,))
    if version == 0x0100:
        return Source("mat5", "MATLAB 5", (path,))
    raise InputError(field, str(path), f"MATLAB of version 5 to 7.3 (this one says {version:#06x})")


def _beside(path: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Return the names that the other half of an ENVI file may have."""
    stems = (path.with_suffix(""), path) if path.suffix else (path,)
    return [candidate for stem in stems for suffix in suffixes if (candidate := stem.with_name(stem.name + suffix)) != path]


def _partner(path: Path, suffixes: tuple[str, ...], field: str) -> Path:
    for candidate in _beside(path, suffixes):
        if candidate.is_file():
            return regular_file(candidate, field)
    tried = ", ".join(candidate.name for candidate in _beside(path, suffixes)[:8])
    raise InputError(field, str(path), f"an ENVI file with its other half beside it (tried {tried})")
