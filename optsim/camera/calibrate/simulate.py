"""Spots of a camera that strays from its drawing by its tolerances: what a calibration is tried on (theory.md (C.64))."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from optsim.camera.calibrate.calibrated_map import CalibratedMap
from optsim.camera.calibrate.parameters import Tolerances
from optsim.camera.calibrate.prism_model import prism_model
from optsim.camera.calibrate.spots import Spots
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig

NOISELESS_PX = 1e-6
"""Standard error stated for spots without noise."""
INSIDE_NM = 2.0
FIELD_SHARE = 0.9
_STREAM = 31


class Simulated(NamedTuple):
    """Hold spots and the camera that made them."""

    spots: Spots
    truth: CalibratedMap


def simulate_spots(
    camera: CameraConfig,
    noise_px: float = 0.1,
    seed: int = 0,
    wavelengths: int = 24,
    size: tuple[int, int] = (256, 256),
    tolerances: Tolerances | None = None,
) -> Simulated:
    """Build a camera at random within its tolerances and measure its spots at 3 x 3 places of the field.

    Wavelengths are evenly spaced inside the band-pass; centroids get independent normal errors.

    Args:
        camera: the drawing.
        noise_px: standard error of a centroid, in [0, 10] px; 0 states 1e-6 px.
        seed: of the built camera and of the errors, from 0 to 2^63 - 1.
        wavelengths: from 2 to 10,000.
        size: (rows, columns) of mirrors; the spots lie at 0 and 90 % of the half field.
        tolerances: how far cameras stray.

    Raises:
        InputError: the field at fault; ``wavelength_nm`` when the band-pass leaves a glass's range.
    """
    if not (np.isfinite(noise_px) and 0 <= noise_px <= 10):
        raise InputError("--noise", noise_px, "in [0, 10] px")
    if not 2 <= wavelengths <= 10_000:
        raise InputError("--wavelengths", wavelengths, "from 2 to 10000")
    if not 0 <= seed < 2**63:
        raise InputError("--seed", seed, "an integer from 0 to 2^63 - 1")
    model = prism_model(camera, tolerances)
    built, errors = (
        np.random.Generator(np.random.Philox(s)) for s in np.random.SeedSequence(seed, spawn_key=(_STREAM,)).spawn(2)
    )  # fmt: skip
    truth = CalibratedMap(model, model.drawn + model.tolerance * built.standard_normal(model.drawn.size), camera)
    rays = spot_grid(camera, wavelengths, size)
    x, y, valid = truth.position_px(*rays)
    rays, x, y = tuple(a[valid] for a in rays), x[valid], y[valid]
    if x.size == 0:
        raise InputError("camera.prism", "one that loses all light", "a prism that passes light of the band-pass")
    x, y = (a + noise_px * errors.standard_normal(a.size) for a in (x, y))
    sigma = np.full(x.size, noise_px or NOISELESS_PX)
    return Simulated(Spots(*rays, x, y, sigma, sigma), truth)


def spot_grid(camera: CameraConfig, wavelengths: int, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (wavelength_nm, X_mm, Y_mm) of 3 x 3 places at evenly spaced wavelengths inside the band-pass, (9 wavelengths,) each."""
    inside = min(INSIDE_NM, (camera.bandpass.upper_nm - camera.bandpass.lower_nm) / 4)
    nm = np.linspace(camera.bandpass.lower_nm + inside, camera.bandpass.upper_nm - inside, wavelengths)
    half_y, half_x = (FIELD_SHARE * count / 2 * camera.dmd.pitch_um / 1000 for count in size)
    wavelength, X, Y = np.meshgrid(nm, [-half_x, 0, half_x], [-half_y, 0, half_y], indexing="ij")
    return wavelength.ravel(), X.ravel(), Y.ravel()
