"""Measured and computed spectra by name. The default curves are read from ``scenes/data``; colour-science only when asked."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scenes.errors import InputError
from scenes.model import did_you_mean
from scenes.spectrum import WIDE_RANGE_NM, Spectrum

DATA = Path(__file__).resolve().parent / "data"
ILLUMINANT_FILES = {"xenon": ("kinoton_75p.csv", "Kinoton 75P"), "D65": ("cie_d65.csv", "D65"), "A": ("cie_a.csv", "A")}
SENSOR_FILES = {"nikon-5100": "nikon_5100_npl.csv", "sigma-sd-merrill": "sigma_sd_merrill_npl.csv"}
SAMPLES_FILE = "cie_224_samples.csv"
CHANNELS = ("red", "green", "blue")

PLANCK_H = 6.62607015e-34
"""J s (exact, SI 2019)."""
LIGHT_C = 299792458.0
"""m s^-1 (exact)."""
BOLTZMANN_K = 1.380649e-23
"""J K^-1 (exact, SI 2019)."""
MAX_TEMPERATURE_K = 1e12


@cache
def read_table(file: str) -> dict[str, Spectrum]:
    """Read a CSV of ``scenes/data``: column name -> Spectrum, in the file's order."""
    with (DATA / file).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    table = np.array([[float(cell) for cell in row] for row in rows[1:]])
    return {name: Spectrum(table[:, 0], table[:, i], name) for i, name in enumerate(rows[0][1:], 1)}


def reflectances() -> tuple[str, ...]:
    """Return the names of the 24 patches (BabelColor Average) in the chart's order: rows of six from the top left."""
    return tuple(read_table("babelcolor_average.csv"))


def reflectance(name: str) -> Spectrum:
    """Return the reflectance of a chart's patch (380 to 730 nm in steps of 10 nm) or of a colour sample (380 to 780, 5 nm).

    Args:
        name: one of :func:`reflectances` or of :func:`samples`.

    Raises:
        InputError: field ``reflectance`` for an unknown name, listing all.
    """
    table = read_table("babelcolor_average.csv")
    if name in table:
        return table[name]
    more = read_table(SAMPLES_FILE)
    if name not in more:
        known = f"{', '.join(table)}, or cie224-01 to cie224-{len(more)}"
        raise InputError("reflectance", name, f"one of {known}{did_you_mean(name, [*table, *more])}")
    return more[name]


def samples() -> tuple[str, ...]:
    """Return the names of the 99 colour samples of CIE 224:2017, in order of hue."""
    return tuple(read_table(SAMPLES_FILE))


def training_samples() -> tuple[str, ...]:
    """Return every other one of :func:`samples`, 50: to learn from. None is a test sample or a patch of the chart."""
    return samples()[::2]


def test_samples() -> tuple[str, ...]:
    """Return the other 49 of :func:`samples`: to test with."""
    return samples()[1::2]


def observer() -> dict[str, Spectrum]:
    """Return the colour matching functions x, y, z of the CIE 1931 2 degree observer, 360 to 830 nm in steps of 1 nm."""
    return read_table("cie_1931_2deg.csv")


def illuminant(name: str) -> Spectrum:
    """Return a lamp's relative spectrum: "xenon" (Kinoton 75P), "D65", "A", or any illuminant or light source of colour-science.

    Raises:
        InputError: field ``illuminant`` for an unknown name.
    """
    if name in ILLUMINANT_FILES:
        file, column = ILLUMINANT_FILES[name]
        curve = read_table(file)[column]
        return Spectrum(curve.wavelength_nm, curve.value, name)
    import colour

    known: dict[str, Any] = {}
    for group in (colour.SDS_LIGHT_SOURCES, colour.SDS_ILLUMINANTS):
        known |= {str(key): group for key in group}
    if name not in known:
        hint = did_you_mean(name, [*ILLUMINANT_FILES, *known])
        raise InputError("illuminant", name, f"xenon, D65, A, or a name of colour-science's SDS_ILLUMINANTS or SDS_LIGHT_SOURCES{hint}")
    curve = known[name][name]
    return Spectrum(np.asarray(curve.wavelengths, np.float64), np.asarray(curve.values, np.float64), name)


def sensor_curves(name: str) -> dict[str, Spectrum]:
    """Return a sensor's relative response curves, each channel's maximum 1.

    Args:
        name: "nikon-5100" (Bayer filters), "sigma-sd-merrill" (Foveon layers): keys red, green, blue; or "flat": key mono, the
            same at all wavelengths.

    Raises:
        InputError: field ``sensor`` for an unknown name.
    """
    if name == "flat":
        return {"mono": Spectrum.constant(1.0, name="flat")}
    if name not in SENSOR_FILES:
        known = [*SENSOR_FILES, "flat"]
        raise InputError("sensor", name, f"one of {', '.join(known)}{did_you_mean(name, known)}")
    table = read_table(SENSOR_FILES[name])
    curves = {channel: table[channel].peak_normalised() for channel in CHANNELS}
    return {channel: Spectrum(curve.wavelength_nm, curve.value, f"{name} {channel}") for channel, curve in curves.items()}


def blackbody(temperature_K: float, wavelength_nm: ArrayLike) -> Spectrum:
    """Return Planck's spectral radiance in W m^-2 sr^-1 nm^-1 at the given nodes (theory.md (R.4), (R.5)).

    Computed as log, so that nothing overflows on the way: where the radiance is below the smallest float64 (1 K in the visible: about
    exp(-36000)) the result is exactly 0.

    Args:
        temperature_K: above 0, up to 1e12 K.
        wavelength_nm: (n,) strictly increasing nodes in nm, n >= 2.

    Raises:
        InputError: ``temperature_K`` out of range; or as Spectrum for the nodes.
    """
    if not (np.isfinite(temperature_K) and 0 < temperature_K <= MAX_TEMPERATURE_K):
        raise InputError("temperature_K", temperature_K, f"in (0, {MAX_TEMPERATURE_K:g}] K")
    nodes = Spectrum(np.asarray(wavelength_nm, np.float64), np.zeros(np.size(wavelength_nm))).wavelength_nm
    metres = nodes * 1e-9
    x = PLANCK_H * LIGHT_C / (metres * BOLTZMANN_K * temperature_K)
    with np.errstate(under="ignore"):
        log_expm1 = np.where(x > 1, x + np.log1p(-np.exp(-np.maximum(x, 1))), np.log(np.expm1(np.minimum(x, 1))))
        value = np.exp(np.log(2e-9 * PLANCK_H * LIGHT_C**2) - 5 * np.log(metres) - log_expm1)
    return Spectrum(nodes, value, f"blackbody {temperature_K:g} K")


def line(center_nm: float, width_nm: float) -> Spectrum:
    """Return a spectral line of unit area (theory.md (R.7)): a triangle of that full width at half maximum, 0 elsewhere in 200 to 2500 nm.

    Args:
        center_nm: where it peaks.
        width_nm: full width at half maximum, 1e-3 to 100 nm; the line ends at center -+ width.

    Raises:
        InputError: ``center_nm`` or ``width_nm`` out of range.
    """
    if not (np.isfinite(width_nm) and 1e-3 <= width_nm <= 100):
        raise InputError("width_nm", width_nm, "in [0.001, 100] nm")
    low, high = WIDE_RANGE_NM
    if not (np.isfinite(center_nm) and low + width_nm < center_nm < high - width_nm):
        raise InputError("center_nm", center_nm, f"at least one width inside ({low:g}, {high:g}) nm")
    grid = np.array([low, center_nm - width_nm, center_nm, center_nm + width_nm, high])
    return Spectrum(grid, np.array([0.0, 0.0, 2 / (grid[3] - grid[1]), 0.0, 0.0]), f"line {center_nm:g} nm")


def lines(center_nm: ArrayLike, power: ArrayLike, width_nm: float = 1.0) -> Spectrum:
    """Return the sum of spectral lines, each of its own area.

    Args:
        center_nm: (n,) where they peak, in nm; at least one.
        power: (n,) their areas, at least 0.
        width_nm: full width at half maximum of each, 1e-3 to 100 nm.

    Raises:
        InputError: ``center_nm``, ``power`` or ``width_nm``.
    """
    centers, powers = np.atleast_1d(np.asarray(center_nm, np.float64)), np.atleast_1d(np.asarray(power, np.float64))
    if centers.ndim != 1 or centers.size == 0 or centers.shape != powers.shape:
        raise InputError("power", powers.shape, f"one number for each of the {centers.size} lines")
    if not np.all(np.isfinite(powers)) or powers.min() < 0:
        raise InputError("power", powers.tolist(), "finite and at least 0")
    parts = [line(float(c), width_nm) for c in centers]
    grid = np.unique(np.concatenate([part.wavelength_nm for part in parts]))
    value = sum(p * part.at(grid) for p, part in zip(powers, parts))
    return Spectrum(grid, np.asarray(value), f"{centers.size} lines")
