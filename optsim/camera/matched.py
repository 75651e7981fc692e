"""The matched measurement: data made by the band model H itself, as in the paper's simulations (theory.md (C.13))."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optsim.camera.band_model import BandModel, matched_model
from optsim.camera.frames import make_frames
from optsim.camera.noise import Noise, expose
from optsim.camera.sensor import Sensor
from optsim.cube import UNITS, bands_of, check_cube
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr


def measure_matched(
    cube: xr.Dataset,
    sensor: Sensor,
    masks: np.ndarray,
    *,
    masks_name: str = "distinct",
    seed: int = 0,
    noise: Noise | None = None,
    full_well_e: float = 20_000.0,
    fill: float = 0.9,
) -> xr.Dataset:
    """Apply the paper's discrete model to a band cube: g = H f.

    Args:
        cube: (M, N, K) radiance, K bands.
        sensor: one of the three.
        masks: (L, M, N) of 0 and 1.
        masks_name: distinct or repeated, a note in the file.
        seed: of the noise, and a note of the masks' seed.
        noise: None gives noise-free frames in units relative to the cube's; else the brightest pixel is set to
            ``fill`` of the full well and frames are digital numbers.
        full_well_e: with noise, in (0, 1e12] electrons.
        fill: with noise, in (0, 1].

    Returns:
        Frames of shape (L, C, M, N + K - 1), float64.

    Raises:
        InputError: ``masks``, ``radiance``, ``sensor.curve``, ``fill`` or as :func:`optsim.camera.noise.expose`.
    """
    check_cube(cube)
    radiance, radiance_units = cube["radiance"].values, cube["radiance"].attrs["units"]
    model = matched_model(sensor, bands_of(cube), masks)
    if model.masks.shape[1:] != radiance.shape[:2]:
        raise InputError("masks", model.masks.shape[1:], f"of the cube's size {radiance.shape[:2]}, one mirror a cube pixel")
    if model.masks.any():
        values = model.operator(np.float64).forward(radiance.astype(np.float64))
    else:  # H = 0 is refused as an operator, but closed mirrors are a valid measurement
        values = np.zeros((model.masks.shape[0], sensor.channels, radiance.shape[0], model.width))
    attrs = {"units": "relative", "model": "matched", "masks": masks_name, "seed": seed, "operator": "unit-shift", "versions": versions()}
    if radiance_units != UNITS:
        attrs["cube_units"] = radiance_units
    if noise is not None:
        if not 0 < fill <= 1:
            raise InputError("fill", fill, "in (0, 1]")
        brightest = float(values.max())
        scale = fill * full_well_e / brightest if brightest > 0 else 1.0
        values, model, read = add_noise(values * scale, model.scaled(scale), noise, full_well_e=full_well_e, exposure_s=0.0, seed=seed)
        attrs |= {"full_well": full_well_e, **read}
    return make_frames(values, model, attrs)


def add_noise(
    mean_e: np.ndarray,
    model: BandModel,
    noise: Noise,
    *,
    full_well_e: float,
    exposure_s: float,
    seed: int,
    offset_e: np.ndarray | None = None,
    sites: np.ndarray | None = None,
) -> tuple[np.ndarray, BandModel, dict[str, float | int | str]]:
    """Expose mean electrons and return digital numbers, the model in DN, and the attributes that say how to read them.

    Arguments as of :func:`optsim.camera.noise.expose`.
    """
    exposed = expose(mean_e, noise, full_well_e=full_well_e, exposure_s=exposure_s, seed=seed, offset_e=offset_e, sites=sites)
    attrs: dict[str, float | int | str] = {
        "units": "DN",
        "gain": exposed.gain,
        "offset": exposed.dark_dn,
        "bits": noise.bits,
        "read_noise_e": noise.read_noise_e,
        "dark_e_per_s": noise.dark_e_per_s,
        "saturated_pixels": exposed.saturated,
    }
    return exposed.dn, model.scaled(exposed.gain), attrs


def versions() -> str:
    """Name the program and the libraries that a measurement depends on."""
    import importlib.metadata

    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("optsim", "numpy", "drjit"))
