"""The physical measurement: fine wavelengths and samples, the traced prism, area footprints, exposure (theory.md (C.16) to (C.18))."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from optsim.camera.band_model import BandModel, OwnShifts, Shifts, physical_model
from optsim.camera.bandpass import passed_photons, photons, support_nm
from optsim.camera.camera import CameraConfig
from optsim.camera.collect import Collected, Scene, collect
from optsim.camera.dmd import MAX_SEED, check_masks, mirror_states
from optsim.camera.fine import FineCube, Interpolate
from optsim.camera.fixed_pattern import fixed_pattern
from optsim.camera.frames import make_frames
from optsim.camera.layer_bins import layer_sites
from optsim.camera.layout import Weights
from optsim.camera.matched import add_noise, versions
from optsim.camera.model import Model, ranged
from optsim.camera.noise import Noise
from optsim.camera.pixels import charges
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
        shifts: what the H in the file knows about the camera.
        gray: allow masks between 0 and 1.
        sub_pixels: cells along a pixel's side on which light is blurred, from 1 to 15; with 3, 4, 5, 9 of them
            3.4, 1.6, 1.0, 0.4 % of an isolated mirror's light land wrong at f/8, of a picture's 2.2, 0.8, 0.35, 0 (theory.md C.f).
        seed: of the noise, and a note of the masks' seed.
        masks_name: distinct or repeated, a note in the file.
    """

    place: ClassVar[str] = "exposure"
    time_s: Annotated[float, ranged(0, 1e9, "s")] | None = None
    fill: Annotated[float, ranged(0, 1, "", "(]")] = 0.9
    noise: Noise | None = None
    interpolate: Interpolate | None = None
    shifts: Shifts = OwnShifts()
    gray: bool = False
    sub_pixels: Annotated[int, ranged(1, 15, "cells a pixel's side")] = 4
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
    masks = check_masks(masks, exposure.gray)
    unit = physical_model(camera, sensor, bands, masks, exposure.shifts, gray=exposure.gray)
    support = support_nm(camera.bandpass)
    fine = FineCube(cube, bands, (masks.shape[1], masks.shape[2]), exposure.interpolate, support)
    half = camera.dmd.pitch_um / 2000
    scene = Scene(
        fine=fine,
        states=mirror_states(masks, camera.dmd).astype(np.float64),
        half_mm=(masks.shape[2] * half, masks.shape[1] * half),
        place_nm=np.clip((np.clip(fine.bands.lower, *support) + np.clip(fine.bands.upper, *support)) / 2, *support),
        frame=(masks.shape[1], unit.width),
    )
    collected = collect(camera.optics, scene, _weights(camera, sensor, bands, fine), exposure.sub_pixels)
    _warn_of_steps(collected.step_px)
    mean = charges(collected.light, unit.mosaic, sensor, camera.sensor)
    time_s = _time(mean, exposure, camera.sensor.full_well_e)
    model, values = unit.scaled(time_s), mean * time_s
    attrs = _attributes(camera, exposure, fine, collected, time_s) | _photons(collected, time_s)
    if exposure.noise is not None:
        values, model, read = _expose(values, model, camera, sensor, exposure, time_s)
        attrs |= read
    return make_frames(values, model, attrs)


def _weights(camera: CameraConfig, sensor: Sensor, bands: Bands, fine: FineCube) -> Weights:
    """Integrate the spectral weights of every fine band, for one second (theory.md (C.38))."""
    lower, upper, bandpass = fine.bands.lower, fine.bands.upper, camera.bandpass
    first, last = support_nm(bandpass)
    inside = np.clip(lower, first, last), np.clip(upper, first, last)
    some = inside[1] > inside[0]
    if some.any():
        sensor.check_range(float(inside[0][some].min()), float(inside[1][some].max()))
    throughput = camera.throughput_m2_sr
    passed = passed_photons(bandpass, lower, upper)
    known = sum(
        passed_photons(bandpass, np.clip(lower, low, high), np.clip(upper, low, high)) for low, high in zip(bands.lower, bands.upper)
    )
    full = photons(lower, upper)
    return Weights(
        curves=throughput * np.stack([passed_photons(bandpass, lower, upper, curve) for curve in sensor.curves]),
        arriving=throughput * passed,
        outside=throughput * np.maximum(passed - known, 0.0),
        blocked=throughput * np.maximum(full - passed, 0.0),
        absorbed=throughput * (1 / camera.relay.transmission - 1) * full,
    )


def _warn_of_steps(step_px: float) -> None:
    if step_px > MAX_STEP_PX:
        warnings.warn(
            f"the cube's wavelengths lie up to {step_px:.2g} px apart on the sensor; render more of them (--subdivide)", stacklevel=3
        )


def _time(mean_per_s: np.ndarray, exposure: Exposure, full_well_e: float) -> float:
    """Return the exposure time: as given, or such that the brightest pixel reaches the fill; 1 s in the dark."""
    if exposure.time_s is not None:
        return float(exposure.time_s)
    brightest = float(mean_per_s.max())
    return exposure.fill * full_well_e / brightest if brightest > 0 else 1.0


def _expose(
    mean_e: np.ndarray, model: BandModel, camera: CameraConfig, sensor: Sensor, exposure: Exposure, time_s: float
) -> tuple[np.ndarray, BandModel, dict[str, float | int | str]]:
    """Return digital numbers, the model in DN, and how to read them."""
    noise = exposure.noise
    assert noise is not None
    rows, columns = mean_e.shape[-2:]
    pattern = fixed_pattern((mean_e.shape[1], rows, columns), camera.sensor)[1] if camera.sensor.dsnu_e > 0 else None
    return add_noise(
        mean_e,
        model,
        noise,
        full_well_e=camera.sensor.full_well_e,
        exposure_s=time_s,
        seed=exposure.seed,
        offset_e=pattern,
        sites=layer_sites(sensor.layer_bins, rows, columns) if mean_e.shape[1] == len(sensor.layer_bins) else None,
    )


def _attributes(camera: CameraConfig, exposure: Exposure, fine: FineCube, collected: Collected, time_s: float) -> dict[str, Any]:
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
        "field_error_px": collected.error_px,
        "wavelength_step_px": collected.step_px,
        "pupil_rays": collected.rays,
        "blur_reach_px": collected.reach_px,
        "versions": versions(),
    }


def _photons(collected: Collected, time_s: float) -> dict[str, float]:
    account = collected.account
    parts = {
        "sent": account.sent,
        "detected": collected.detected,
        "missed_sensor": account.missed,
        "blocked": account.blocked,
        "absorbed": account.absorbed,
        "reflected": account.reflected,
        "outside_bands": account.outside,
    }
    return {f"photons_{name}": float(values.sum()) * time_s for name, values in parts.items()}
