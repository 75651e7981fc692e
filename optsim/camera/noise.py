"""From mean electrons to digital numbers: shot noise, dark current, full well, read noise, converter (theory.md (C.12))."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from optsim.camera.model import Model, ranged
from optsim.errors import InputError

MAX_MEAN_E = 1e15
"""Largest mean that is drawn: float64 still counts single electrons, and NumPy's generator is exact."""
_STREAM = 0x6E6F6973  # keeps noise streams apart from every other use of the same seed


class Noise(Model):
    """Describe the exposure chain of one pixel.

    Args:
        read_noise_e: standard deviation of the Gaussian read noise, in [0, 1e7] electrons.
        dark_e_per_s: dark current in [0, 1e9] electrons a second.
        bits: of the converter, 1 to 16.
        offset_dn: digital number at no charge, in [0, 65535].
        gain_dn_per_e: in (0, 1e6] DN an electron; None: the full well reaches the converter's largest number.
        shot_noise: False leaves the mean undrawn.
    """

    place: ClassVar[str] = "noise"
    read_noise_e: Annotated[float, ranged(0, 1e7, "electrons")] = 10.0
    dark_e_per_s: Annotated[float, ranged(0, 1e9, "electrons/s")] = 0.0
    bits: Annotated[int, ranged(1, 16, "bits")] = 12
    offset_dn: Annotated[float, ranged(0, 65535, "DN")] = 0.0
    gain_dn_per_e: Annotated[float, ranged(0, 1e6, "DN per electron", "(]")] | None = None
    shot_noise: bool = True

    @property
    def top_dn(self) -> int:
        """Return the converter's largest number, 2^bits - 1."""
        return 2**self.bits - 1

    def gain(self, full_well_e: float) -> float:
        """Return DN per electron.

        Raises:
            InputError: ``noise.offset_dn`` when it leaves no room, ``sensor.full_well_e`` when not above 0.
        """
        _check_well(full_well_e)
        if self.offset_dn >= self.top_dn:
            raise InputError("noise.offset_dn", self.offset_dn, f"below {self.top_dn} DN, the largest of {self.bits} bits")
        return (self.top_dn - self.offset_dn) / full_well_e if self.gain_dn_per_e is None else self.gain_dn_per_e


@dataclass(frozen=True, eq=False)
class Exposed:
    """Hold digital numbers and what is needed to read them.

    Args:
        dn: float64 whole numbers of 0..2^bits - 1, the shape of the mean.
        gain: DN per electron.
        dark_dn: mean level of a pixel without light: offset and dark current; what an estimate subtracts.
        saturated: how many pixels hold the largest number or a full well.
    """

    dn: np.ndarray
    gain: float
    dark_dn: float
    saturated: int


def expose(
    mean_e: np.ndarray,
    noise: Noise,
    *,
    full_well_e: float,
    exposure_s: float,
    seed: int,
    offset_e: np.ndarray | None = None,
    sites: np.ndarray | None = None,
) -> Exposed:
    """Expose pixels once (theory.md (C.12)), in the order of EMVA 1288: light and dark current, well, read-out, converter.

    Charge is min(Poisson(mean + dark), full well); then Gaussian read noise and the pixel's own offset, gain, offset,
    rounding half to even, clipping to 0..2^bits - 1. The response's fixed pattern (PRNU) is part of the mean. The noise of frame
    (shot, channel) is drawn from its own Philox stream keyed by (seed, shot, channel), so it depends neither on other
    frames nor on the order of work.

    Args:
        mean_e: (L, C, M, W) mean photoelectrons of one exposure, from 0 to 1e15.
        noise: the chain.
        full_well_e: in (0, 1e12] electrons.
        exposure_s: the time the dark current adds up, at least 0 s.
        seed: from 0 to 2^63 - 1.
        offset_e: (M, W) or (C, M, W) fixed pattern of the dark signal (DSNU), in electrons.
        sites: (C, M, W) bool, where a layer has a pixel; elsewhere the dark level is written, without noise.

    Raises:
        InputError: ``exposure_s``, ``offset_e``, ``sites``, ``seed``, ``radiance`` (mean not finite, negative or too large),
            or see :meth:`Noise.gain`.
    """
    mean, gain = _means(mean_e), noise.gain(full_well_e)
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError("seed", seed, "an integer from 0 to 2^63 - 1")
    pattern = _pattern(offset_e, mean.shape[1:])
    if sites is not None and sites.shape != mean.shape[1:]:
        raise InputError("sites", sites.shape, f"of the frames' shape {mean.shape[1:]} (channel, y, x)")
    dark_e = _dark(noise, mean, full_well_e, exposure_s)
    dark_dn = noise.offset_dn + gain * dark_e
    dn = np.full(mean.shape, dark_dn)
    saturated = 0
    for shot, channel in np.ndindex(mean.shape[:2]):
        level = mean[shot, channel] + dark_e
        stream = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(_STREAM, shot, channel))))
        charge = np.minimum(stream.poisson(level) if noise.shot_noise else level, full_well_e)
        full = charge >= full_well_e
        if noise.read_noise_e > 0:
            charge = charge + noise.read_noise_e * stream.standard_normal(charge.shape)
        read = np.rint(np.clip(gain * (charge + pattern[channel]) + noise.offset_dn, 0, noise.top_dn))
        here = np.True_ if sites is None else sites[channel]
        np.copyto(dn[shot, channel], read, where=here)
        saturated += int(np.count_nonzero((full | (read == noise.top_dn)) & here))
    return Exposed(dn, gain, dark_dn, saturated)


def _pattern(offset_e: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """Return the pixels' own offsets (C, M, W) in electrons."""
    pattern = np.zeros(1) if offset_e is None else np.asarray(offset_e, np.float64)
    if not np.all(np.isfinite(pattern)):
        raise InputError("offset_e", "not finite", "finite electrons in every pixel")
    try:
        return np.broadcast_to(pattern, shape)
    except ValueError:
        raise InputError("offset_e", pattern.shape, f"broadcastable to (channel, y, x) = {shape}") from None


def _dark(noise: Noise, mean: np.ndarray, full_well_e: float, exposure_s: float) -> float:
    """Return the dark electrons of the exposure; refuse one that is too long, warn of one that fills the well."""
    if not (np.isfinite(exposure_s) and exposure_s >= 0):
        raise InputError("exposure_s", exposure_s, "finite and at least 0 s")
    dark_e = noise.dark_e_per_s * exposure_s
    largest = float(mean.max(initial=0.0)) + dark_e
    if largest > MAX_MEAN_E:
        raise InputError(
            "exposure_s", exposure_s, f"at most {exposure_s * MAX_MEAN_E / largest:.6g} s for this light ({MAX_MEAN_E:g} electrons a pixel)"
        )
    if dark_e >= full_well_e:
        warnings.warn(
            f"dark current alone fills the well: {dark_e:g} electrons in {exposure_s:g} s, full well {full_well_e:g}", stacklevel=3
        )
    return dark_e


def _means(mean_e: np.ndarray) -> np.ndarray:
    mean = np.asarray(mean_e, np.float64)
    if mean.ndim != 4:
        raise InputError("frames", mean.shape, "of dims (shot, channel, y, x)")
    if not np.all(np.isfinite(mean)) or mean.min() < 0:
        raise InputError(
            "radiance",
            float(mean[~(np.isfinite(mean) & (mean >= 0))].flat[0]),
            "such that every pixel's mean is finite and at least 0 electrons",
        )
    return mean


def _check_well(full_well_e: float) -> None:
    if not (np.isfinite(full_well_e) and 0 < full_well_e <= 1e12):
        raise InputError("sensor.full_well_e", full_well_e, "in (0, 1e12] electrons")
