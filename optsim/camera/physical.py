"""The physical measurement: fine wavelengths and samples, the traced prism, area footprints, exposure (theory.md (C.16) to (C.18))."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from optsim.camera.arrays import kernels
from optsim.camera.band_model import OwnShifts, Shifts, curve_integrals, physical_model
from optsim.camera.camera import CameraConfig
from optsim.camera.dmd import MAX_SEED, check_masks
from optsim.camera.field import FieldMap, fit_field
from optsim.camera.fine import FineCube, Interpolate
from optsim.camera.frames import make_frames
from optsim.camera.gather import Gather
from optsim.camera.layout import Budget, Layout, Weights
from optsim.camera.matched import add_noise, versions
from optsim.camera.model import Model, ranged
from optsim.camera.noise import Noise
from optsim.camera.radiometry import PHOTONS_PER_JOULE_NM
from optsim.camera.sensor import Sensor
from optsim.cube import Bands

if TYPE_CHECKING:
    import xarray as xr

MAX_STEP_PX = 0.5
"""Fine wavelengths farther apart than this leave gaps between their footprints."""


class Exposure(Model):
    """Say how a photograph is exposed and what it takes along.

    Args:
        time_s: of each shot, in [0, 1e9] s; None: the brightest pixel reaches ``fill`` of the full well.
        fill: in (0, 1].
        noise: None gives the mean electrons; else digital numbers.
        interpolate: None refuses a cube that is too coarse.
        shifts: what the H in the file knows about the prism.
        seed: of the noise, and a note of the masks' seed.
        masks_name: distinct or repeated, a note in the file.
    """

    place: ClassVar[str] = "exposure"
    time_s: Annotated[float, ranged(0, 1e9, "s")] | None = None
    fill: Annotated[float, ranged(0, 1, "", "(]")] = 0.9
    noise: Noise | None = None
    interpolate: Interpolate | None = None
    shifts: Shifts = OwnShifts()
    seed: Annotated[int, ranged(0, MAX_SEED, "")] = 0
    masks_name: str = "distinct"


def photograph(
    cube: xr.Dataset, bands: Bands, camera: CameraConfig, sensor: Sensor, masks: np.ndarray, exposure: Exposure | None = None
) -> xr.Dataset:
    """Photograph a fine cube through the camera (theory.md (C.16) to (C.18)).

    Every sample of every mirror is followed at every fine wavelength to its traced place (sub-pixel shift, smile,
    keystone) and laid on the pixels that its square footprint overlaps, by area.

    Args:
        cube: radiance of (M s, N s) pixels, s >= 2, with at least 10 bands inside each of ``bands``; light outside
            ``bands`` but inside the band-pass is in the data and not in H.
        bands: the K bands of the discrete model that goes into the file.
        camera: the optics.
        sensor: one of the three.
        masks: (L, M, N) of 0 and 1.
        exposure: time, noise, interpolation.

    Returns:
        Frames in electrons (means, without noise) or DN, with the camera's own H (or as ``exposure.shifts`` says).
        attrs count photons over all shots: ``photons_sent`` = ``photons_detected`` + ``photons_missed_sensor`` +
        ``photons_blocked`` (band-pass) + ``photons_reflected`` (in the prism); ``photons_outside_bands`` is the
        part of the detected that H does not know.

    Raises:
        InputError: ``cube``, ``masks``, ``sensor.curve``, ``bands``, ``exposure_s`` and what they name.
    """
    exposure = Exposure() if exposure is None else exposure
    masks = check_masks(masks)
    unit = physical_model(camera, sensor, bands, masks, exposure.shifts)
    fine = FineCube(
        cube, bands, (masks.shape[1], masks.shape[2]), exposure.interpolate, (camera.bandpass.lower_nm, camera.bandpass.upper_nm)
    )
    layout, weights = _prepare(camera, sensor, bands, fine, unit.width)
    mean, detected, budgets = _measure(layout, weights, masks, unit.mosaic, fine)
    time_s = _time(mean, exposure, camera.sensor.full_well_e)
    model, values = unit.scaled(time_s), mean * time_s
    attrs = _attributes(camera, exposure, fine, layout, time_s) | _photons(detected, budgets, time_s)
    if exposure.noise is not None:
        values, model, read = add_noise(
            values, model, exposure.noise, full_well_e=camera.sensor.full_well_e, exposure_s=time_s, seed=exposure.seed
        )  # fmt: skip
        attrs |= {"units": "DN", **read}
    return make_frames(values, model, attrs)


def _prepare(camera: CameraConfig, sensor: Sensor, bands: Bands, fine: FineCube, width: int) -> tuple[Layout, Weights]:
    """Trace the field and integrate the spectral weights of every fine band, for one second."""
    rows, columns = fine.shape[0] // fine.samples, fine.shape[1] // fine.samples
    half = camera.dmd.pitch_um / 2000
    lower, upper = camera.bandpass.clip(fine.bands.lower, fine.bands.upper)
    field = fit_field(camera.dispersion, (lower + upper) / 2, columns * half, rows * half)  # blocked light needs no place of its own
    layout = Layout(field, (rows, columns), fine.samples, (rows, width), camera.mirror_px)
    throughput = camera.throughput_m2_sr
    full, passed = (throughput * _photon_share(*edges) for edges in ((fine.bands.lower, fine.bands.upper), (lower, upper)))
    known = np.zeros(fine.bands.count)
    for low, high in zip(bands.lower, bands.upper):
        known += throughput * _photon_share(np.clip(lower, low, high), np.clip(upper, low, high))
    curves = throughput * curve_integrals(sensor, lower, upper)
    weights = Weights(
        curves=np.where(field.valid, curves, 0.0),
        arriving=np.where(field.valid, passed, 0.0),
        outside=np.where(field.valid, np.maximum(passed - known, 0.0), 0.0),
        blocked=full - passed,
        reflected=np.where(field.valid, 0.0, passed),
    )
    return layout, weights


def _check_step(layout: Layout) -> float:
    """Return the largest step between neighbouring fine wavelengths on the axis in px; warn where they lie apart like beads."""
    x, _ = layout.field.at(np.zeros(1), np.zeros(1))
    both = layout.field.valid[1:] & layout.field.valid[:-1]
    step = float(np.abs(np.diff(x[:, 0]))[both].max(initial=0.0))
    if step > MAX_STEP_PX:
        warnings.warn(
            f"the cube's wavelengths lie up to {step:.2g} px apart on the sensor; render more of them (--subdivide)", stacklevel=3
        )
    return step


def _photon_share(lower_nm: np.ndarray, upper_nm: np.ndarray) -> np.ndarray:
    """Return the integral of lambda / (h c) from lower to upper, 0 for empty bands."""
    return np.maximum(upper_nm - lower_nm, 0.0) * (upper_nm + lower_nm) / 2 * PHOTONS_PER_JOULE_NM


def _measure(
    layout: Layout, weights: Weights, masks: np.ndarray, mosaic: np.ndarray | None, fine: FineCube
) -> tuple[np.ndarray, np.ndarray, list[Budget]]:
    """Return frames, detected photons and accounts for one second of exposure."""
    k = kernels()
    if k is None or not isinstance(layout.field, FieldMap):
        from optsim.camera.scatter import Scatter

        scatter = Scatter(layout, weights, masks, mosaic, fine.rows)
        return scatter.frames, scatter.photons, scatter.budget
    gather = Gather(k, layout, weights, masks, mosaic, fine.rows)
    frames, photons = gather.frames()
    return frames, photons, gather.budget()


def _time(mean_per_s: np.ndarray, exposure: Exposure, full_well_e: float) -> float:
    """Return the exposure time: as given, or such that the brightest pixel reaches the fill; 1 s in the dark."""
    if exposure.time_s is not None:
        return float(exposure.time_s)
    brightest = float(mean_per_s.max())
    return exposure.fill * full_well_e / brightest if brightest > 0 else 1.0


def _attributes(camera: CameraConfig, exposure: Exposure, fine: FineCube, layout: Layout, time_s: float) -> dict[str, Any]:
    return {
        "units": "electron",
        "model": "physical-interpolated" if fine.interpolated else "physical",
        "masks": exposure.masks_name,
        "operator": exposure.shifts.name,
        "exposure_s": time_s,
        "full_well": camera.sensor.full_well_e,
        "gain": 1.0,
        "seed": exposure.seed,
        "camera": camera.to_toml(),
        "cube_range_nm": f"{fine.bands.lower[0]:g}-{fine.bands.upper[-1]:g}",
        "bandpass_nm": f"{camera.bandpass.lower_nm:g}-{camera.bandpass.upper_nm:g}",
        "field_error_px": layout.field.error_px,
        "wavelength_step_px": _check_step(layout),
        "versions": versions(),
    }


def _photons(detected: np.ndarray, budgets: list[Budget], time_s: float) -> dict[str, float]:
    def total(name: str) -> float:
        return float(sum(getattr(b, name) for b in budgets)) * time_s

    return {
        "photons_sent": total("sent"),
        "photons_detected": float(detected.sum()) * time_s,
        "photons_missed_sensor": total("missed"),
        "photons_blocked": total("blocked"),
        "photons_reflected": total("reflected"),
        "photons_outside_bands": total("outside"),
    }
