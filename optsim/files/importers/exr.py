"""Spectral OpenEXR: the layout of Fichet, Pacanowski, Wilkie (JCGT 10(3), 2021), and channels that are named by wavelength (KAIST)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import IO, Any

import numpy as np

from optsim.errors import InputError
from optsim.files.importers.found import Found
from optsim.files.spectral_exr import READ_UNITS, UNITS

LIBRARIES = ("OpenEXR",)
"""Imported by the child before the clock runs."""
LAYOUT = re.compile(r"^(S0|T)\.(\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)nm$")
PLAIN = re.compile(r"^w?(\d+(?:[.,]\d+)?)\s*nm$")
UNREADABLE = re.compile(r"^(S[1-3]|T)\.\d")
QUANTITY = {"S0": "radiance", "T": "reflectance", "w": "as in the file"}
MOST_BANDS = 10_000


def survey(files: Sequence[IO[bytes]]) -> list[Found]:
    """Describe the stack of spectral channels of each kind: S0 (radiance), T (reflectance), w (named by wavelength alone)."""
    header = _header(files)
    low, high = header["dataWindow"]
    shape = int(high[1]) - int(low[1]) + 1, int(high[0]) - int(low[0]) + 1
    if min(shape) < 1:
        raise InputError("dataWindow", shape, "at least 1 x 1")
    result = []
    for kind, entries in _channels(header).items():
        centers = [nm for nm, _ in entries]
        _check_gap(centers)
        described = {"axes": ("y", "x", "wavelength"), "wavelengths": tuple(centers), "unit": "nm", "quantity": QUANTITY[kind]}
        result.append(Found(name=kind, shape=(*shape, len(entries)), dtype="<f4", **described))
    return result


def read(files: Sequence[IO[bytes]], name: str) -> np.ndarray:
    """Read the channels of one kind, sorted by wavelength: (y, x, wavelength) float32."""
    import OpenEXR

    entries = _channels(_header(files))[name]
    with OpenEXR.File(_path(files), separate_channels=True, num_threads=1) as file:
        channels = file.channels()
        planes = [np.array(channels[channel].pixels, np.float32) for _, channel in entries]
    return np.ascontiguousarray(np.stack(planes, -1))


def extent(files: Sequence[IO[bytes]]) -> int:
    """Return the bytes of all channels when unpacked."""
    header = _header(files)
    low, high = header["dataWindow"]
    return max(0, int(high[1]) - int(low[1]) + 1) * max(0, int(high[0]) - int(low[0]) + 1) * 4 * len(header.get("channels", []))


def prove(files: Sequence[IO[bytes]]) -> None:
    """Read all channels, and forget them: what ends or stops this process would have ended or stopped the parent."""
    import OpenEXR

    with OpenEXR.File(_path(files), separate_channels=True, num_threads=1) as file:
        for channel in file.channels().values():
            np.array(channel.pixels)


def _path(files: Sequence[IO[bytes]]) -> str:
    (file,) = files
    return f"/dev/fd/{file.fileno()}"  # OpenEXR takes paths only


def _header(files: Sequence[IO[bytes]]) -> dict[str, Any]:
    import OpenEXR

    with OpenEXR.File(_path(files), header_only=True, num_threads=1) as file:
        if len(file.parts) != 1:
            raise InputError("parts", len(file.parts), "one: a single-part file")
        return dict(file.header())


def _channels(header: dict[str, Any]) -> dict[str, list[tuple[float, str]]]:
    """Return (wavelength, name) of the spectral channels of each kind, by increasing wavelength."""
    found: dict[str, list[tuple[float, str]]] = {}
    channels = header.get("channels", [])
    for channel in channels[:MOST_BANDS]:
        match = LAYOUT.match(channel.name)
        plain = PLAIN.match(channel.name)
        if match or plain:
            kind, text = (match[1], match[2]) if match else ("w", plain[1])  # type: ignore[index]
            if (channel.xSampling, channel.ySampling) != (1, 1):
                raise InputError(channel.name, (channel.xSampling, channel.ySampling), "sampled at every pixel")
            found.setdefault(kind, []).append((float(text.replace(",", ".")), channel.name))
        elif UNREADABLE.match(channel.name):
            raise InputError("channels", channel.name, "unpolarised and not bispectral (S0 or T)")
    if "S0" in found and header.get("emissiveUnits") not in READ_UNITS:
        raise InputError("emissiveUnits", header.get("emissiveUnits"), f"{UNITS!r}, the same without nm^-1, or absent")
    if not found:
        names = [channel.name for channel in channels[:5]]
        raise InputError("channels", names, "spectral, named like S0.550,000000nm, T.550nm or w550nm")
    return {kind: sorted(entries) for kind, entries in found.items()}


def _check_gap(centers: list[float]) -> None:
    """Refuse a regular grid with a hole in it."""
    steps = np.diff(centers)
    if steps.size < 3:
        return
    step = float(np.median(steps))
    regular = np.abs(steps - step) <= 1e-3 * step
    holes = ~regular & (np.abs(steps / step - np.round(steps / step)) <= 1e-3) & (steps > 1.5 * step)
    if step > 0 and holes.any() and (regular | holes).all():
        k = int(np.argmax(holes))
        gap = [round(centers[k] + step * i, 6) for i in range(1, round(float(steps[k]) / step))]
        raise InputError("channels", f"no band at {', '.join(f'{nm:g}' for nm in gap[:5])} nm", f"every {step:g} nm, as the others are")
