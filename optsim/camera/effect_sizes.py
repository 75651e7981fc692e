"""How large each optical effect is: how far it moves light, and what share of the light is wrong without it (theory.md C.i)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from optsim.camera.camera import CameraConfig
from optsim.cube import Bands

_DISC = 2000
_FREQUENCIES = 400


class Size(NamedTuple):
    """Hold the size of an effect.

    Args:
        px: the farthest that it moves light, or the diameter over which it spreads it, in sensor pixels; 0 when it moves none.
        relative: the largest share of a mirror's light that is on another pixel, missing or in excess without it, in [0, 1].
    """

    px: float
    relative: float


def misplaced(u: np.ndarray, v: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Return the share of a pixel-sized image's light that leaves its pixel when its points move by (u, v) px (theory.md (C.65))."""
    kept = np.clip(1 - np.abs(u), 0, None) * np.clip(1 - np.abs(v), 0, None)
    return float(1 - np.average(kept, weights=weight))


def diffraction(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the Airy disc's diameter to its first dark ring at the longest wavelength, and what leaves the pixel (theory.md (C.66))."""
    cutoff = camera.sensor.pitch_um / (bands.upper[-1] * 1e-3 * _image_f_number(camera))

    def transfer(rho: np.ndarray) -> np.ndarray:
        nu = np.clip(rho / cutoff, 0, 1)
        return np.asarray(2 / math.pi * (np.arccos(nu) - nu * np.sqrt(1 - nu**2)))

    diameter = 2 * 1.2196698912665045 / cutoff
    steps = (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES * cutoff
    fx, fy = np.meshgrid(steps, steps)
    kept = 4 * (np.sinc(fx) ** 2 * np.sinc(fy) ** 2 * transfer(np.hypot(fx, fy))).sum() * (cutoff / _FREQUENCIES) ** 2
    return Size(float(diameter), float(min(1.0, max(0.0, 1 - kept))))


def defocus(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the diameter of the disc, defocus / f-number on the sensor's side."""
    return _disc(abs(camera.relay.defocus_mm) * 1000 / _image_f_number(camera) / camera.sensor.pitch_um)


def tilt_defocus(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the disc at the corner towards which the mirrors tilt: m^2 s tan(tilt) out of focus on the sensor's side."""
    out_mm = _corner_mm(camera, field) * math.tan(abs(math.radians(camera.dmd.tilt_deg))) * camera.relay.magnification**2
    return _disc(out_mm * 1000 / _image_f_number(camera) / camera.sensor.pitch_um)


def tilt(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return how far the corner moves by anamorphism and keystone of tilted mirrors (theory.md (C.67))."""
    theta, m = math.radians(camera.dmd.tilt_deg), camera.relay.magnification
    corner = _corner_mm(camera, field)
    squeeze = math.cos(theta) / math.cos(math.atan(m * math.tan(theta))) if camera.relay.scheimpflug else math.cos(theta)
    nearer = corner * math.sin(abs(theta)) / camera.relay.collimator_mm
    moved = max(abs(squeeze / (1 + side * nearer) - 1) for side in (1, -1)) * corner * m * 1000 / camera.sensor.pitch_um
    return _moved(moved / math.sqrt(2), moved / math.sqrt(2))


def distortion(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return how far the corner moves, k r^3."""
    rows, columns = field
    r_mm = _corner_mm(camera, field) * camera.relay.magnification
    moved = abs(camera.relay.distortion_per_mm2) * r_mm**3 * 1000 / camera.sensor.pitch_um
    diagonal = math.hypot(rows, columns)
    return _moved(moved * columns / diagonal, moved * rows / diagonal)


def registration(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return how far the worst corner moves by offset, rotation and scale."""
    dmd, angle = camera.dmd, math.radians(camera.dmd.rotation_deg)
    half_y, half_x = (n * camera.mirror_px / 2 for n in field)
    worst = Size(0.0, 0.0)
    for x, y in ((half_x, half_y), (-half_x, half_y), (half_x, -half_y), (-half_x, -half_y)):
        u = dmd.scale * (x * math.cos(angle) - y * math.sin(angle)) - x + dmd.offset_x_px
        v = dmd.scale * (x * math.sin(angle) + y * math.cos(angle)) - y + dmd.offset_y_px
        worst = max(worst, _moved(u, v), key=lambda size: size.px)
    return worst


def converging(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the change of the spectrum's length by the lever arm; another way of tracing, so all of the light counts as wrong."""
    lever = camera.relay.focal_mm if camera.relay.prism_to_sensor_mm is None else camera.relay.prism_to_sensor_mm
    x, _, valid = camera.dispersion.position_px(np.array([bands.lower[0], bands.upper[-1]]))
    length = float(abs(x[1] - x[0])) if valid.all() else 0.0
    return Size(abs(lever / camera.relay.focal_mm - 1) * length, 1.0)


def leak(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the leak: with half of the mirrors off, the light that they add to that of the others."""
    return Size(0.0, camera.dmd.leak)


def defects(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the share of mirrors with a wrong state."""
    return Size(0.0, min(1.0, camera.dmd.dead_share + camera.dmd.stuck_share))


def edges(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return what a flank adds outside and takes inside, an eighth of its width each, over the width of the narrower end band."""
    narrowest = float(min(bands.width[0], bands.width[-1]))
    return Size(0.0, min(1.0, camera.bandpass.edge_nm / 4 / narrowest))


def crosstalk(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the charge that leaves a pixel for its four neighbours."""
    return Size(1.0, min(1.0, 4 * camera.sensor.crosstalk))


def prnu(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the relative standard deviation of the response."""
    return Size(0.0, camera.sensor.prnu)


def dsnu(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the standard deviation of the offset over the full well."""
    return Size(0.0, min(1.0, camera.sensor.dsnu_e / camera.sensor.full_well_e))


def cos4(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the loss in the corner, 1 - cos^4."""
    if camera.objective.focal_mm is None:
        return Size(0.0, 0.0)
    return Size(0.0, 1 - math.cos(math.atan(_corner_mm(camera, field) / camera.objective.focal_mm)) ** 4)


def objective(camera: CameraConfig, bands: Bands, field: tuple[int, int]) -> Size:
    """Return the full width at half maximum on the sensor, and what leaves a mirror for its neighbours."""
    sigma = camera.objective.psf_um / camera.dmd.pitch_um
    if sigma == 0:
        return Size(0.0, 0.0)
    steps = np.linspace(-6, 6, 241) * sigma
    u, v = np.meshgrid(steps, steps)
    weight = np.exp(-(u**2 + v**2) / (2 * sigma**2))
    return Size(2 * math.sqrt(2 * math.log(2)) * sigma * camera.mirror_px, misplaced(u, v, weight))


def _moved(u: float, v: float) -> Size:
    return Size(math.hypot(u, v), misplaced(np.array([u]), np.array([v])))


def _disc(diameter: float) -> Size:
    """Average over a disc by equal areas: radii at the middle of rings, angles by the golden ratio."""
    i = np.arange(_DISC)
    radius, angle = diameter / 2 * np.sqrt((i + 0.5) / _DISC), math.pi * (3 - math.sqrt(5)) * i
    return Size(diameter, misplaced(radius * np.cos(angle), radius * np.sin(angle)))


def _image_f_number(camera: CameraConfig) -> float:
    return camera.relay.f_number * camera.relay.magnification


def _corner_mm(camera: CameraConfig, field: tuple[int, int]) -> float:
    """Return the half diagonal of the mirrors."""
    return math.hypot(*field) / 2 * camera.dmd.pitch_um / 1000
