"""A fitted vector of parameters as a camera file: faces, lenses, registration and the melts of the glasses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from optsim.camera.calibrate.parameters import COLLIMATOR, FOCAL, OFFSET_X, OFFSET_Y, ROTATION, SCALE
from optsim.camera.calibrate.prism_model import PrismModel, dispersion_name, index_name
from optsim.camera.glass import D_LINE_NM, Glass
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig

SAMPLES = 161
MELT_RANGE_NM = (380.0, 780.0)


def fitted_camera(model: PrismModel, values: np.ndarray, camera: CameraConfig) -> CameraConfig:
    """Return the camera whose drawing is the fitted one; light lands where the model, a registered one, places it.

    A glass whose index or dispersion was fitted becomes a table [glass.NAME-melt], good to 1e-8 in the index.

    Raises:
        InputError: field ``calibration`` when the values lie outside what a camera file may state.
    """
    at = {name: float(value) for name, value in zip(model.names, values)}
    assert camera.prism is not None
    names, own = [], dict(camera.glass)
    for glass in model.glasses:
        if glass is None:
            names.append("air")
            continue
        shift, stretch = at[index_name(glass)], at[dispersion_name(glass)]
        if shift == 0 and stretch == 0:
            names.append(_config_name(glass, camera))
            continue
        names.append(f"{glass.name}-melt")
        own[names[-1]] = melt(glass, shift, stretch)
    relay = camera.relay.model_copy(update={"collimator_mm": at[COLLIMATOR], "focal_mm": at[FOCAL]})
    scale = at[SCALE] * model.drawn_magnification * at[COLLIMATOR] / at[FOCAL]
    registration = {"offset_x_px": at[OFFSET_X], "offset_y_px": at[OFFSET_Y], "rotation_deg": at[ROTATION], "scale": scale}
    try:
        tilts = tuple(math.degrees(t) for t in model.tilts_rad(values))
        shared = {name: getattr(camera.prism, name) for name in ("design_nm", "design_position_px", "fresnel", "field")}
        prism = type(camera.prism)(glasses=tuple(names), face_tilt_deg=tilts, **shared)
        dmd = type(camera.dmd)(**{**camera.dmd.model_dump(), **registration})
    except InputError as error:
        raise InputError("calibration", error.value, f"near enough to the drawing: {error.field} must be {error.allowed}") from None
    return camera.model_copy(update={"prism": prism, "glass": own, "relay": relay, "dmd": dmd})


def melt(glass: Glass, shift: float, stretch: float) -> Glass:
    """Return a glass of index n + shift + stretch (n - n_d), by its own formula with other coefficients and a constant.

    Args:
        glass: of the catalogue.
        shift: of the index, the same at all wavelengths.
        stretch: relative, of n - n_d.
    """
    low, high = max(glass.range_nm[0], MELT_RANGE_NM[0]), min(glass.range_nm[1], MELT_RANGE_NM[1])
    wavelength = np.linspace(low, high, SAMPLES) if high > low else np.linspace(*glass.range_nm, SAMPLES)
    index = glass.index(wavelength)
    change = (index + shift + stretch * (index - float(glass.index(D_LINE_NM)))) ** 2 - index**2
    squared = (wavelength / 1000) ** 2
    poles = [squared / (squared - c) for c in glass.sellmeier_c_um2]
    terms = np.stack([np.ones_like(squared), squared, *poles], axis=1)
    factor = np.linalg.lstsq(terms / np.abs(terms).max(0), change, rcond=None)[0] / np.abs(terms).max(0)
    powers = {p: a for a, p in glass.power_terms}
    for exponent, value in zip((0, 2), factor[:2]):
        powers[exponent] = powers.get(exponent, 0.0) + float(value)
    return Glass(
        name=f"{glass.name}-melt",
        sellmeier_b=tuple(float(b + f) for b, f in zip(glass.sellmeier_b, factor[2:])),
        sellmeier_c_um2=glass.sellmeier_c_um2,
        power_terms=tuple((a, p) for p, a in powers.items()),
        range_nm=(float(wavelength[0]), float(wavelength[-1])),
        source=f"{glass.name} with index + {shift:.3g} and n - n_d times 1 + {stretch:.3g}, from a calibration",
    )


def _config_name(glass: Glass, camera: CameraConfig) -> str:
    """Return the name by which the camera's file calls a glass."""
    assert camera.prism is not None
    asked = camera.prism.glasses or (camera.prism.outer, camera.prism.inner)
    for name, found in zip(asked, camera.prism.media(camera.glass)):
        if found == glass:
            return str(name)
    return glass.name
