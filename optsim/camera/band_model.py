"""Camera and bands as plain arrays: what reconstruction needs to build H (theory.md (C.13) to (C.15))."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.camera import CameraConfig
from optsim.camera.dmd import check_masks
from optsim.camera.prism import Dispersion
from optsim.camera.radiometry import photon_integral
from optsim.camera.sensor import Sensor
from optsim.cube import Bands
from optsim.errors import InputError

if TYPE_CHECKING:
    from recon.coded_aperture import CodedAperture

PIECES_PER_BAND = 64
"""A band's light is laid on the sensor in this many exact pieces; 64 and 128 agree to 1e-6 of the light."""


@dataclass(frozen=True, eq=False)
class BandModel:
    """Hold the discrete camera of K bands, ``g[l,c,m,j] = sum response[c,k] taps[k,t] mask[l,m,n] f[m,n,k]``, n = j - first_column[k] - t.

    Args:
        masks: (L, M, N) uint8.
        response: (C, K) float64, frames-units per cube-unit of each spectral curve and band.
        first_column: (K,) int64, sensor column of a band's first tap for mirror column 0.
        taps: (K, T) float64, shares of a band's light on neighbouring columns.
        shift_px: (K,) position of each band's centre wavelength.
        mosaic: (M, W) int8 curve of each pixel, or None.
        width: W, sensor columns.
        bands: the K bands.
        sensor: name of the sensor: mono, bayer or foveon.
        curve_names: the C curves.
    """

    masks: np.ndarray
    response: np.ndarray
    first_column: np.ndarray
    taps: np.ndarray
    shift_px: np.ndarray
    mosaic: np.ndarray | None
    width: int
    bands: Bands
    sensor: str
    curve_names: tuple[str, ...]

    def operator(self, dtype: Any = np.float64) -> CodedAperture:
        """Return H for cubes (M, N, K) and frames (L, C, M, W)."""
        from recon.coded_aperture import CodedAperture

        return CodedAperture(self.masks, self.response, self.first_column, self.taps, mosaic=self.mosaic, width=self.width, dtype=dtype)

    def scaled(self, factor: float) -> BandModel:
        """Return the model with all responses times a factor (exposure, gain)."""
        return replace(self, response=self.response * factor)


@dataclass(frozen=True)
class OwnShifts:
    """Let H know where the prism lays each band: its position and how it spreads over columns."""

    name = "camera"

    def columns(
        self, dispersion: Dispersion, mirror_px: float, lower_nm: np.ndarray, upper_nm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return first columns and taps."""
        return spread_taps(dispersion, mirror_px, lower_nm, upper_nm)


@dataclass(frozen=True)
class UnitShift:
    """Let H believe that band k lands exactly k columns on, as in the paper's discrete model."""

    name = "unit-shift"

    def columns(
        self, dispersion: Dispersion, mirror_px: float, lower_nm: np.ndarray, upper_nm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return first columns 0..K-1 and one tap of 1."""
        return np.arange(lower_nm.size), np.ones((lower_nm.size, 1))


Shifts = OwnShifts | UnitShift


def matched_model(sensor: Sensor, bands: Bands, masks: np.ndarray) -> BandModel:
    """Return the paper's discrete model: band k shifted by k columns, response = mean of the sensor's curve over the band.

    The width of a band and the photon's energy do not enter: unit band weights (theory.md (C.13)).

    Args:
        sensor: one of the three.
        bands: K bands.
        masks: (L, M, N) of 0 and 1.

    Raises:
        InputError: ``masks``, or ``sensor.curve`` when a curve does not cover the bands.
    """
    masks = check_masks(masks)
    rows, columns = masks.shape[1:]
    k = np.arange(bands.count)
    width = columns + bands.count - 1
    mosaic = sensor.mosaic(rows, width)
    return BandModel(
        masks, sensor.band_mean(bands), k, np.ones((k.size, 1)), k.astype(float), mosaic, width, bands, sensor.name, sensor.curve_names
    )


def physical_model(
    camera: CameraConfig, sensor: Sensor, bands: Bands, masks: np.ndarray, shifts: Shifts | None = None, exposure_s: float = 1.0
) -> BandModel:  # fmt: skip
    """Return the camera's own discrete model in electrons per W m^-2 sr^-1 nm^-1 (theory.md (C.10), (C.14), (C.15)).

    Response: exposure x étendue x integral over the band, inside the band-pass, of QE lambda / (h c). The frame has
    the columns from the 455 nm pixel of mirror column 0 to the pixel in which the last column's last band ends.

    Args:
        camera: the optics.
        sensor: one of the three.
        bands: K bands.
        masks: (L, M, N) of 0 and 1.
        shifts: OwnShifts() (default) or UnitShift().
        exposure_s: in (0, 1e9] s; 0 is a dark frame and has no model.

    Raises:
        InputError: ``masks``, ``sensor.curve``, ``bands`` (nothing of a band passes the filter), ``exposure_s``.
    """
    shifts = OwnShifts() if shifts is None else shifts
    masks = check_masks(masks)
    if not 0 < exposure_s <= 1e9:
        raise InputError("exposure_s", exposure_s, "in (0, 1e9] s")
    lower, upper = camera.bandpass.clip(bands.lower, bands.upper)
    if np.any(upper <= lower):
        k = int(np.argmax(upper <= lower))
        passes = f"{camera.bandpass.lower_nm:g}-{camera.bandpass.upper_nm:g} nm"
        raise InputError("bands", (float(bands.lower[k]), float(bands.upper[k])), f"at least partly inside the band-pass {passes}")
    dispersion = camera.dispersion
    first, taps = shifts.columns(dispersion, camera.mirror_px, lower, upper)
    position, _, _ = dispersion.position_px(bands.center)
    rows, columns = masks.shape[1:]
    width = frame_width(dispersion, lower, upper, columns)
    factor = exposure_s * camera.throughput_m2_sr
    return BandModel(
        masks,
        factor * curve_integrals(sensor, lower, upper),
        first.astype(np.int64),
        taps,
        position,
        sensor.mosaic(rows, width),
        width,
        bands,
        sensor.name,
        sensor.curve_names,
    )


def frame_width(dispersion: Dispersion, lower_nm: np.ndarray, upper_nm: np.ndarray, columns: int) -> int:
    """Return W: sensor columns from pixel 0 of mirror column 0 to the pixel in which the last mirror column's last band ends.

    N + K - 1 for the paper's bands. An end that reaches less than 0.05 px into a pixel does not open it.
    """
    reach = max(float(dispersion.position_px(edge)[0].max()) for edge in (lower_nm, upper_nm))
    return columns + max(0, math.ceil(reach - 0.5 - 0.05))


def curve_integrals(sensor: Sensor, lower_nm: np.ndarray, upper_nm: np.ndarray) -> np.ndarray:
    """Return (C, K) integrals of QE lambda / (h c) over bands; bands with upper <= lower give 0."""
    lower, upper = np.asarray(lower_nm), np.asarray(upper_nm)
    some = upper > lower
    if some.any():
        sensor.check_range(float(lower[some].min()), float(upper[some].max()))
    return np.stack([photon_integral(curve, lower, upper) for curve in sensor.curves])


def spread_taps(dispersion: Dispersion, mirror_px: float, lower_nm: np.ndarray, upper_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lay each band's light of one mirror on sensor columns: mirror box * band * pixel box (theory.md (C.15)).

    A band is cut into pieces of equal width in nm; a piece is a box between the traced positions of its ends,
    weighted by its photons (lambda d lambda), so that the integrals are exact for each piece. Pieces that the prism
    loses weigh nothing.

    Returns:
        (first_column (K,) int64, taps (K, T) float64); a band's taps sum to 1, or to the share that the prism passes.
    """
    steps = np.linspace(0, 1, PIECES_PER_BAND + 1)
    edges = lower_nm[:, None] + (upper_nm - lower_nm)[:, None] * steps
    x, _, valid = dispersion.position_px(edges)
    photons = np.diff(edges**2, axis=1)
    weight = photons / photons.sum(1, keepdims=True) * (valid[:, 1:] & valid[:, :-1])
    a, b = np.minimum(x[:, 1:], x[:, :-1]), np.maximum(x[:, 1:], x[:, :-1])
    low = np.floor(np.where(weight > 0, a, np.inf).min(1) - mirror_px / 2 + 0.5)
    high = np.ceil(np.where(weight > 0, b, -np.inf).max(1) + mirror_px / 2 - 0.5)
    dark = ~np.isfinite(low)
    low, high = np.where(dark, 0, low), np.where(dark, 0, high)
    count = int((high - low).max()) + 1
    column = low[:, None] + np.arange(count + 1) - 0.5
    below = (weight[..., None] * _share_below(column[:, None, :], a[..., None], b[..., None], mirror_px)).sum(1)
    taps = np.diff(below, axis=1)
    taps[taps < 1e-15] = 0.0
    return low.astype(np.int64), taps


def _share_below(t: np.ndarray, a: np.ndarray, b: np.ndarray, box: float) -> np.ndarray:
    """Return the share below t of (box of width ``box`` around 0) convolved with (box from a to b): a trapezoid's integral."""

    def mean_ramp(u: np.ndarray) -> np.ndarray:
        """Average max(u - p, 0) over p from a to b, without dividing small differences by b - a."""
        inside = (u > a) & (u < b)
        return np.where(u >= b, u - (a + b) / 2, np.where(inside, (u - a) ** 2 / (2 * np.where(inside, b - a, 1.0)), 0.0))

    return np.clip((mean_ramp(t + box / 2) - mean_ramp(t - box / 2)) / box, 0, 1)
