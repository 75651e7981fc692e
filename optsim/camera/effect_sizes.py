"""How large each optical effect is: how far it moves light, and what share of the light is wrong without it (theory.md C.i)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from optsim.camera.camera import CameraConfig
from optsim.camera.psf import airy_otf
from optsim.camera.pupil import rings
from optsim.cube import Bands

_RAYS = rings(196)
_PLACES = (-1.0, -0.5, 0.0, 0.5, 1.0)
_WAVELENGTHS = 5
_FREQUENCIES = 400
_AIRY = 1.2196698912665045


class Size(NamedTuple):
    """Hold the size of an effect.

    Args:
        px: the farthest that it moves light, or the diameter over which it spreads it, in sensor pixels; 0 when it moves none.
        relative: the largest share of a mirror's light that is on another pixel, missing or in excess without it, in [0, 1].
    """

    px: float
    relative: float


class View(NamedTuple):
    """Hold what a size is measured on: the camera, the camera without the effect, the bands, and (rows, columns) of mirrors."""

    camera: CameraConfig
    without: CameraConfig
    bands: Bands
    field: tuple[int, int]

    @property
    def corner_mm(self) -> float:
        """Return the half diagonal of the mirrors."""
        return math.hypot(*self.field) / 2 * self.camera.dmd.pitch_um / 1000


def misplaced(u: np.ndarray, v: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Return the share of a pixel-sized image's light that leaves its pixel when its points move by (u, v) px (theory.md (C.65))."""
    kept = np.clip(1 - np.abs(u), 0, None) * np.clip(1 - np.abs(v), 0, None)
    return float(1 - np.average(kept, weights=weight))


def geometry(view: View) -> Size:
    """Trace rays through the pupil with and without the effect, from 25 places of the field at five wavelengths (theory.md (C.67)).

    ``px`` is the distance of the mean displacement plus the diameter of the disc with the rays' spread, both from ray to
    the same ray; light that either camera loses is left out.
    """
    half_y, half_x = (n / 2 * view.camera.dmd.pitch_um / 1000 for n in view.field)
    wavelength = np.linspace(view.bands.lower[0], view.bands.upper[-1], _WAVELENGTHS)[:, None, None, None]
    X, Y = half_x * np.array(_PLACES)[:, None, None], half_y * np.array(_PLACES)[:, None]
    x, y, valid = view.camera.optics.position_px(wavelength, X, Y, _RAYS.points)
    x0, y0, valid0 = view.without.optics.position_px(wavelength, X, Y, _RAYS.points)
    share = np.broadcast_to(_RAYS.weights, x.shape) * (valid & valid0)
    lit = share.sum(-1) > 0
    if not lit.any():
        return Size(0.0, 0.0)
    u, v, share = (a[lit] for a in (x - x0, y - y0, share))
    share = share / share.sum(-1, keepdims=True)
    mean_u, mean_v = ((share * a).sum(-1) for a in (u, v))
    spread = (share * ((u - mean_u[:, None]) ** 2 + (v - mean_v[:, None]) ** 2)).sum(-1)
    px = np.hypot(mean_u, mean_v) + 2 * np.sqrt(2 * spread)
    return Size(float(px.max()), max(misplaced(*rays) for rays in zip(u, v, share)))


def diffraction(view: View) -> Size:
    """Return the Airy disc's diameter to its first dark ring at the longest wavelength, and what leaves the pixel (theory.md (C.66))."""
    pitch_mm, f_number, longest = view.camera.sensor.pitch_um / 1000, view.camera.optics.f_number, float(view.bands.upper[-1])
    cutoff = pitch_mm / (longest * 1e-6 * f_number)
    steps = (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES * cutoff
    fx, fy = np.meshgrid(steps, steps)
    transfer = airy_otf(np.hypot(fx, fy) / pitch_mm, longest, f_number)
    kept = 4 * (np.sinc(fx) ** 2 * np.sinc(fy) ** 2 * transfer).sum() * (cutoff / _FREQUENCIES) ** 2
    return Size(2 * _AIRY / cutoff, float(np.clip(1 - kept, 0, 1)))


def fresnel(view: View) -> Size:
    """Return the largest share that the prism's faces reflect away, over the field and five wavelengths."""
    half_y, half_x = (n / 2 * view.camera.dmd.pitch_um / 1000 for n in view.field)
    wavelength = np.linspace(view.bands.lower[0], view.bands.upper[-1], _WAVELENGTHS)[:, None, None]
    X, Y = half_x * np.array(_PLACES)[:, None], half_y * np.array(_PLACES)
    passed, without = (camera.optics.transmission(wavelength, X, Y) for camera in (view.camera, view.without))
    lit = without > 0
    return Size(0.0, float(1 - (passed[lit] / without[lit]).min()) if lit.any() else 0.0)


def leak(view: View) -> Size:
    """Return the leak: with half of the mirrors off, the light that they add to that of the others."""
    return Size(0.0, view.camera.dmd.leak)


def defects(view: View) -> Size:
    """Return the share of mirrors with a wrong state."""
    return Size(0.0, min(1.0, view.camera.dmd.dead_share + view.camera.dmd.stuck_share))


def edges(view: View) -> Size:
    """Return what a flank adds outside and takes inside, an eighth of its width each, over the narrower end band (theory.md (C.68))."""
    narrower = float(min(view.bands.width[0], view.bands.width[-1]))
    return Size(0.0, min(1.0, view.camera.bandpass.edge_nm / 4 / narrower))


def crosstalk(view: View) -> Size:
    """Return the charge that leaves a pixel for its four neighbours."""
    return Size(1.0, min(1.0, 4 * view.camera.sensor.crosstalk))


def prnu(view: View) -> Size:
    """Return the relative standard deviation of the response."""
    return Size(0.0, view.camera.sensor.prnu)


def dsnu(view: View) -> Size:
    """Return the standard deviation of the offset over the full well."""
    return Size(0.0, min(1.0, view.camera.sensor.dsnu_e / view.camera.sensor.full_well_e))


def cos4(view: View) -> Size:
    """Return the loss in the corner, 1 - cos^4."""
    focal_mm = view.camera.objective.focal_mm
    return Size(0.0, 0.0 if focal_mm is None else 1 - math.cos(math.atan(view.corner_mm / focal_mm)) ** 4)


def objective(view: View) -> Size:
    """Return the full width at half maximum on the sensor, and what leaves a mirror for its neighbours."""
    sigma = view.camera.objective.psf_um / view.camera.dmd.pitch_um
    steps = np.linspace(-6, 6, 241) * sigma
    u, v = np.meshgrid(steps, steps)
    weight = np.exp(-(u**2 + v**2) / (2 * sigma**2))
    return Size(2 * math.sqrt(2 * math.log(2)) * sigma * view.camera.mirror_px, misplaced(u, v, weight))
