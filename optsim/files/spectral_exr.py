"""Spectral OpenEXR in the layout of Fichet, Pacanowski, Wilkie, JCGT 10(3), 2021.

One float32 channel a band, ``S0.454,583333nm`` (unpolarised, emissive; the decimal mark is a comma because a dot
separates layers). Band edges, standard error, provenance and units that are not W m^-2 sr^-1 nm^-1, which the layout does not know,
travel in own attributes and in channels ``stderr.454,583333nm`` that other readers skip.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.cube import UNITS as WATTS
from optsim.cube import Bands, bands_of, make_cube
from optsim.errors import InputError
from optsim.files.guard import atomic_path, declared_size, regular_file

if TYPE_CHECKING:
    import xarray as xr

MAGIC = b"\x76\x2f\x31\x01"
UNITS = "W.m^-2.sr^-1.nm^-1"
READ_UNITS = (UNITS, "W.m^-2.sr^-1", None)
"""The authors' tools and others write the radiance per nanometre of ``S0.<lambda>nm`` channels without the ``nm^-1``."""
_CHANNEL = re.compile(r"^(S0|stderr)\.(\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)nm$")
_OTHER_SPECTRAL = re.compile(r"^(S[1-3]|T)\.\d")


def write_exr(cube: xr.Dataset, path: Path) -> None:
    """Write a cube as spectral EXR (float32), atomically, and read it back to compare.

    Raises:
        InputError: when two bands share a name at 1e-6 nm or a value overflows float32.
        OSError: when what was read back differs from what was written.
    """
    import OpenEXR

    bands = bands_of(cube)
    pixels: dict[str, np.ndarray] = {}
    for kind, variable in (("S0", "radiance"), ("stderr", "stderr")):
        if variable in cube:
            values = cube[variable].values
            for k, center in enumerate(bands.center):
                # A strided slice is written wrongly, without an error (OpenEXR issue 1929): always a contiguous copy.
                pixels[_channel_name(kind, float(center))] = np.ascontiguousarray(values[:, :, k], dtype=np.float32)
    if len(pixels) != bands.count * (2 if "stderr" in cube else 1):
        raise InputError("wavelength_nm", bands.center.tolist(), "distinct at 1e-6 nm, the resolution of EXR channel names")
    if not all(np.isfinite(array).all() for array in pixels.values()):
        raise InputError("radiance", "overflow", "within float32, up to 3.4e38")
    units = str(cube["radiance"].attrs["units"])
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "spectralLayoutVersion": "1.0",
        **({"emissiveUnits": UNITS} if units == WATTS else {"optsimUnits": units}),
        "optsimBands": json.dumps({"lower_nm": bands.lower.tolist(), "upper_nm": bands.upper.tolist(), "center_nm": bands.center.tolist()}),
        "optsimAttributes": json.dumps({str(k): _plain(v) for k, v in cube.attrs.items()}, sort_keys=True),
    }
    with atomic_path(path) as temporary:
        # OpenEXR.File replaces the arrays in the dict that it is given: hand it a copy.
        with OpenEXR.File(header, dict(pixels), num_threads=1) as file:
            file.write(str(temporary))
        with OpenEXR.File(str(temporary), separate_channels=True) as file:
            back = file.channels()
            if set(back) != set(pixels) or any(not np.array_equal(back[name].pixels, array) for name, array in pixels.items()):
                raise OSError(f"{path}: what was read back differs from what was written")


def read_exr(path: Path) -> xr.Dataset:
    """Read an unpolarised emissive spectral EXR as a cube.

    Accepts comma or point as decimal mark. Without our own band attribute, edges lie midway between centres.

    Raises:
        InputError: when the file is damaged, too large, polarised or reflective, or its units are not per nm.
    """
    import OpenEXR

    regular_file(path)
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            header = dict(file.header())
    except Exception as error:
        raise InputError("file", str(path), f"a readable OpenEXR file ({error})") from None
    named = _sorted_channels(path, header)
    low, high = header["dataWindow"]
    height, width = int(high[1]) - int(low[1]) + 1, int(high[0]) - int(low[0]) + 1
    declared_size(f"{path.name}:dataWindow", (height, width, sum(map(len, named.values()))), 4)
    if width * height > 2000 * max(path.stat().st_size, 1):
        raise InputError(f"{path.name}:dataWindow", (height, width), "plausible for the size of the file")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            stacks = {
                kind: np.stack([np.array(channels[name].pixels, np.float32) for _, name in entries], -1)
                for kind, entries in named.items()
                if entries
            }
    except Exception as error:
        raise InputError("file", str(path), f"a readable OpenEXR file ({error})") from None
    centers = np.array([nm for nm, _ in named["S0"]])
    attrs = json.loads(header.get("optsimAttributes", "{}"))
    return make_cube(stacks["S0"], _bands(path, header, centers), stacks.get("stderr"), attrs, str(header.get("optsimUnits", WATTS)))


def _sorted_channels(path: Path, header: dict[str, Any]) -> dict[str, list[tuple[float, str]]]:
    """Sort a header's spectral channels by parsed wavelength: on disk 1000 nm stands before 450 nm."""
    names = [channel.name for channel in header.get("channels", [])]
    if any(_OTHER_SPECTRAL.match(name) for name in names):
        raise InputError("channels", [n for n in names if _OTHER_SPECTRAL.match(n)][:3], "unpolarised and emissive (S0 only)")
    units = header.get("emissiveUnits")
    if units not in READ_UNITS:
        raise InputError("emissiveUnits", units, f"{UNITS!r}, the same without nm^-1, or absent")
    found: dict[str, list[tuple[float, str]]] = {"S0": [], "stderr": []}
    for name in names:
        if match := _CHANNEL.match(name):
            found[match[1]].append((float(match[2].replace(",", ".")), name))
    for entries in found.values():
        entries.sort()
    if not found["S0"]:
        raise InputError("channels", names[:5], f"spectral, named like S0.550,000000nm, in {path.name}")
    missing = sorted({nm for nm, _ in found["S0"]} ^ {nm for nm, _ in found["stderr"]}) if found["stderr"] else []
    if missing:
        raise InputError("channels", missing[:5], "given both as S0 and as stderr (a band is missing)")
    return found


def _bands(path: Path, header: dict[str, Any], centers: np.ndarray) -> Bands:
    text = header.get("optsimBands")
    if text is None:
        if centers.size < 2:
            raise InputError("channels", centers.tolist(), f"at least two bands in {path.name}, or its band edges")
        return Bands.from_centers(centers)
    table = json.loads(text)
    bands = Bands(table["lower_nm"], table["upper_nm"], table["center_nm"])
    if bands.count != centers.size or np.any(np.abs(bands.center - centers) > 1e-3):
        gap = [nm for nm in bands.center if np.min(np.abs(centers - nm)) > 1e-3]
        raise InputError("channels", centers.tolist(), f"all {bands.count} bands that the file's table lists; missing {gap} nm")
    return bands


def _channel_name(kind: str, center_nm: float) -> str:
    return f"{kind}.{center_nm:011.6f}nm".replace(".", ",").replace(f"{kind},", f"{kind}.", 1)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
