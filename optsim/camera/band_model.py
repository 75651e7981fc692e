"""Camera and bands as plain arrays: what reconstruction needs to build H (theory.md (C.13) to (C.15))."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.bandpass import passed_photons, support_nm
from optsim.camera.camera import CameraConfig
from optsim.camera.dmd import check_masks
from optsim.camera.knowledge import Assumed, Exact, OwnShifts, Scope, Shifts, UnitShift
from optsim.camera.optics_config import BandpassConfig
from optsim.camera.prism import Dispersion
from optsim.camera.radiometry import photon_integral
from optsim.camera.sensor import Sensor
from optsim.camera.spread import PIECES_PER_BAND, Passed, pieces, spread_taps
from optsim.cube import Bands
from optsim.errors import InputError

if TYPE_CHECKING:
    from recon.coded_aperture import CodedAperture
    from recon.field_aperture import FieldAperture

__all__ = [
    "Assumed",
    "BandModel",
    "Exact",
    "OwnShifts",
    "Shifts",
    "UnitShift",
    "curve_integrals",
    "frame_width",
    "matched_model",
    "physical_model",
    "spread_taps",
]


@dataclass(frozen=True, eq=False)
class BandModel:
    """Hold the discrete camera of K bands (theory.md (C.14)).

    In its simple form ``g[l,c,m,j] = sum response[c,k] taps[k,t] mask[l,m,n] f[m,n,k]`` with n = j - first_column[k] - t. In its
    full form weights vary over the field, light leaves its row, mirrors leak and pixels differ (theory.md (S.40), (S.41)).

    Args:
        masks: (L, M, N) uint8, the patterns shown; float64 when they are gray.
        response: (C, K) float64, frames-units per cube-unit of each spectral curve and band.
        first_column: (K,) int64, sensor column of a band's first tap for mirror column 0; full form: (K, 1|M, 1|N).
        taps: (K, T) float64, shares of a band's light on neighbouring columns; full form: (K, 1|M, 1|N, Tr, Tc).
        shift_px: (K,) position of each band's centre wavelength.
        mosaic: (M, W) int8 curve of each pixel, or None.
        width: W, sensor columns.
        bands: the K bands.
        sensor: name of the sensor: mono, bayer or foveon.
        curve_names: the C curves.
        first_row: full form: (K, 1|M, 1|N) int64, sensor row of the first tap for mirror row 0.
        mirrors: (L, M, N) float64, what each mirror really sends out; None: the masks.
        gain: (M, W) response of each pixel over that of a perfect one; None: 1.
        bins: C sides of the blocks of pixels that each layer sums; None: no binning.
        crosstalk: share of charge that ends in each of the four neighbours.
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
    first_row: np.ndarray | None = None
    mirrors: np.ndarray | None = None
    gain: np.ndarray | None = None
    bins: tuple[int, ...] | None = None
    crosstalk: float = 0.0

    def operator(self, dtype: Any = np.float32) -> CodedAperture | FieldAperture:
        """Return H for cubes (M, N, K) and frames (L, C, M, W): the simple operator where it suffices."""
        from recon.coded_aperture import CodedAperture
        from recon.field_aperture import FieldAperture
        from recon.readout import Readout
        from recon.spread import Spread

        masks = self.masks if self.mirrors is None else self.mirrors
        readout = Readout(self.gain, self.bins, self.crosstalk)
        if self.taps.ndim == 2 and readout.plain:
            gray = masks.dtype != np.uint8
            columns = (self.first_column, self.taps)
            return CodedAperture(masks, self.response, *columns, mosaic=self.mosaic, width=self.width, dtype=dtype, gray=gray)
        if self.taps.ndim == 2:
            spread = Spread(np.zeros(len(self.taps), np.int64), self.first_column, self.taps[:, None, None, None, :])
        else:
            assert self.first_row is not None
            spread = Spread(self.first_row, self.first_column, self.taps)
        return FieldAperture(masks, self.response, spread, mosaic=self.mosaic, readout=readout, width=self.width, dtype=dtype)

    def scaled(self, factor: float) -> BandModel:
        """Return the model with all responses times a factor (exposure, gain)."""
        return replace(self, response=self.response * factor)


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
    camera: CameraConfig,
    sensor: Sensor,
    bands: Bands,
    masks: np.ndarray,
    knowledge: Shifts | None = None,
    exposure_s: float = 1.0,
    gray: bool = False,
) -> BandModel:
    """Return the camera's own discrete model in electrons per W m^-2 sr^-1 nm^-1 (theory.md (C.10), (C.14), (C.15)).

    Response: exposure x étendue x integral over the band of filter x prism's transmission x QE lambda / (h c). The frame has
    the columns from the 455 nm pixel of mirror column 0 to the pixel in which the last column's last band ends.

    Args:
        camera: the optics.
        sensor: one of the sensors.
        bands: K bands.
        masks: (L, M, N) of 0 and 1; with ``gray`` any value between.
        knowledge: what H knows: OwnShifts() (default), UnitShift(), Assumed(...) or Exact().
        exposure_s: in (0, 1e9] s; 0 is a dark frame and has no model.
        gray: allow masks between 0 and 1.

    Raises:
        InputError: ``masks``, ``sensor.curve``, ``bands`` (nothing of a band passes the filter), ``exposure_s``.
    """
    knowledge = OwnShifts() if knowledge is None else knowledge
    masks = check_masks(masks, gray)
    if not 0 < exposure_s <= 1e9:
        raise InputError("exposure_s", exposure_s, "in (0, 1e9] s")
    lower, upper = _inside(bands, camera.bandpass)
    dispersion = camera.dispersion
    position, _, _ = dispersion.position_px(bands.center)
    rows, columns = masks.shape[1:]
    width = frame_width(dispersion, *camera.bandpass.clip(bands.lower, bands.upper), columns)
    scope = Scope(camera, lower, upper, (rows, columns), collected_light(camera, sensor))
    landing = knowledge.land(scope)
    gain, crosstalk = knowledge.pixels(scope, width)
    mirrors = knowledge.mirrors(scope, masks)
    factor = exposure_s * camera.throughput_m2_sr
    return BandModel(
        masks=masks,
        response=factor * band_response(camera, sensor, lower, upper),
        first_column=landing.first_column.astype(np.int64),
        taps=landing.taps,
        shift_px=position,
        mosaic=sensor.mosaic(rows, width),
        width=width,
        bands=bands,
        sensor=sensor.name,
        curve_names=sensor.curve_names,
        first_row=landing.first_row,
        mirrors=None if mirrors is masks else mirrors,
        gain=gain,
        bins=sensor.layer_bins if max(sensor.layer_bins) > 1 else None,
        crosstalk=crosstalk,
    )


def _inside(bands: Bands, bandpass: BandpassConfig) -> tuple[np.ndarray, np.ndarray]:
    """Return the parts of bands that the filter passes at all."""
    support = support_nm(bandpass)
    lower, upper = np.clip(bands.lower, *support), np.clip(bands.upper, *support)
    if np.any(upper <= lower):
        k = int(np.argmax(upper <= lower))
        passes = f"{bandpass.lower_nm:g}-{bandpass.upper_nm:g} nm"
        raise InputError("bands", (float(bands.lower[k]), float(bands.upper[k])), f"at least partly inside the band-pass {passes}")
    return lower, upper


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


def band_response(camera: CameraConfig, sensor: Sensor, lower_nm: np.ndarray, upper_nm: np.ndarray) -> np.ndarray:
    """Return (C, K) integrals of QE x filter x prism's transmission x lambda / (h c) over bands inside the filter's support.

    Curve and filter are integrated exactly in 64 pieces a band; the prism's transmission on the axis is taken at each piece's middle.
    """
    sensor.check_range(float(lower_nm.min()), float(upper_nm.max()))
    edges, _ = pieces(lower_nm, upper_nm, PIECES_PER_BAND)
    low, high = edges[:, :-1].ravel(), edges[:, 1:].ravel()
    share = camera.optics.transmission((low + high) / 2)
    parts = np.stack([passed_photons(camera.bandpass, low, high, curve) for curve in sensor.curves]) * share
    result: np.ndarray = parts.reshape(len(sensor.curves), *edges[:, 1:].shape).sum(2)
    return result


def collected_light(camera: CameraConfig, sensor: Sensor) -> Passed:
    """Return what a sensor's curves together collect between two wavelengths, behind filter and prism on the axis."""
    optics = camera.optics

    def light(low: np.ndarray, high: np.ndarray) -> np.ndarray:
        total: np.ndarray = sum(passed_photons(camera.bandpass, low, high, curve) for curve in sensor.curves)  # type: ignore[assignment]
        return total * optics.transmission((low + high) / 2)

    return light
