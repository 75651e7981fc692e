"""What a scene's lights send to its middle: which of them matter, and how a picture is to be exposed."""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.cube import Bands
from scenes.lights import SKIES, AreaLight, Light, PointLight
from scenes.scene import Scene
from scenes.viewpoint import Orthographic, Perspective, ThinLens


def sky_share(scene: Scene, low_nm: float, high_nm: float) -> float:
    """Estimate the sky's irradiance on the scene's middle, nothing in between, relative to the lamps'; infinite without lamps.

    Compared at the wavelength that suits the sky best.
    """
    middle = middle_of(scene)
    x = np.linspace(low_nm, high_nm, 257)
    sky, lamps = np.zeros(x.size), np.zeros(x.size)
    for light in scene.lights:
        value = light.spectrum.at(x) * irradiance_factor(light, middle)
        if isinstance(light, SKIES):
            sky += value
        else:
            lamps += value
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(sky > 0, sky / lamps, 0.0)
    return float(share.max())


def middle_of(scene: Scene) -> np.ndarray:
    """Return the middle of the box round all shapes, or the origin."""
    box = scene.bounds()
    return np.zeros(3) if box is None else box.mean(0)


def irradiance_factor(light: Light, point: np.ndarray) -> float:
    """Return about the irradiance at a point, on a plane that faces the light, nothing in between, over the light's own unit."""
    if isinstance(light, SKIES):
        return float(np.pi)
    if isinstance(light, PointLight):
        return 1 / max(float(np.sum((np.asarray(light.position) - point) ** 2)), 1e-300)
    if isinstance(light, AreaLight):
        away = point - np.asarray(light.center)
        area = 4 * float(np.linalg.norm(np.cross(light.half_u, light.half_v)))
        return area * max(0.0, float(light.normal @ away)) / max(float(away @ away), area / np.pi) ** 1.5
    return 1.0


def in_view(scene: Scene, light: AreaLight, aspect: float) -> bool:
    """Tell whether a part of a lamp's glowing side lies in the picture, whatever stands between; tried on 9 x 9 points.

    Args:
        aspect: width / height of the picture.
    """
    view = scene.viewpoint
    right, up, forward = view.axes()
    steps = np.linspace(-1, 1, 9)
    u, v = (grid.ravel()[:, None] for grid in np.meshgrid(steps, steps))
    points = np.asarray(light.center) + u * np.asarray(light.half_u) + v * np.asarray(light.half_v)
    away = points - np.asarray(view.origin)
    ahead = away @ forward
    if isinstance(view, Orthographic):
        half, facing = np.full(len(points), view.half_height), float(light.normal @ forward) < 0
    else:
        assert isinstance(view, Perspective | ThinLens)
        half, facing = ahead * np.tan(np.deg2rad(view.fov_deg) / 2), float(light.normal @ away[0]) < 0
    inside = (ahead > 0) & (np.abs(away @ right) < half * aspect) & (np.abs(away @ up) < half)
    return facing and bool(inside.any())


def light_of(scene: Scene, bands: Bands, aspect: float) -> dict[str, list[Any]]:
    """Return what a picture's light looks like in its bands, W m^-2 sr^-1 nm^-1, as plain data.

    ``white``: radiance of a white diffuse surface in the scene's middle that faces every light; ``lamps``: the radiance of each
    area light that lies in the picture.
    """
    middle, white, lamps = middle_of(scene), np.zeros(bands.count), []
    for light in scene.lights:
        value = light.spectrum.band_mean(bands.lower, bands.upper)
        white = white + value * irradiance_factor(light, middle) / np.pi
        if isinstance(light, AreaLight) and in_view(scene, light, aspect):
            lamps.append([float(f"{v:.6g}") for v in value])
    return {"white": [float(f"{v:.6g}") for v in white], "lamps": lamps}
