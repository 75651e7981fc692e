"""Split a render into light shapes and transport nodes, so that its cost does not depend on the number of bands.

Radiance is L(lambda) = sum over illuminants g of E_g(lambda) T_g(lambda): E_g is the spectral shape that lights of the group share,
T_g the transport for light of one unit at every wavelength. T is rendered at a few nodes and linear between them (theory.md
R.22 to R.25).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optsim.cube import Bands
from optsim.errors import InputError
from scenes.lights import SKIES, Light, PointLight
from scenes.materials import Conductor, Dielectric, Diffuse, Material, RoughPlastic
from scenes.scene import Scene
from scenes.spectrum import GRID_SLACK_NM, WIDE_RANGE_NM, Spectrum
from scenes.textures import Textured

SAME_SHAPE = 1e-9
"""Two lights share an illuminant when their curves, each divided by its peak, differ by less than this."""
TWO_BOUNCE_TOLERANCE = 1e-3
"""Largest mean error of a product of two reflectances that are read as linear between nodes (theory.md (R.23))."""
SMOOTH_STEP_NM = 5.0
"""Largest node distance where transport is smooth but not linear in the material's spectra (metals, glass with an Abbe number)."""


@dataclass(frozen=True)
class LightGroup:
    """Hold the lights of one spectral shape.

    ``strengths`` are relative to ``spectrum``: light ``lights[i]`` (an index into the scene's lights) emits strengths[i] x spectrum
    in renderer units, the strongest exactly 1.
    """

    spectrum: Spectrum
    lights: tuple[int, ...]
    strengths: tuple[float, ...]

    def weights(self, nodes_nm: np.ndarray, bands: Bands) -> np.ndarray:
        """Return the (K, n) float64 matrix that takes transport at the nodes to mean radiance of the bands (theory.md (R.24))."""
        return self.spectrum.hat_weights(nodes_nm, bands.lower, bands.upper)


def light_groups(scene: Scene, low_nm: float, high_nm: float, unit_m: float) -> tuple[LightGroup, ...]:
    """Group the scene's lights by spectral shape over [low_nm, high_nm]; lights that are dark there are left out.

    A point light's intensity is divided by unit_m^2: lengths are in units of the renderer.

    Raises:
        InputError: ``lights[i].spectrum`` when a light's data do not cover the bands.
    """
    shapes: list[tuple[Spectrum, list[int], list[float]]] = []
    for i, light in enumerate(scene.lights):
        spectrum = _covering(light.spectrum, low_nm, high_nm, f"lights[{i}].{type(light).__name__}")
        x = _nodes_within([spectrum], low_nm, high_nm)
        peak = float(spectrum.at(x).max())
        if peak <= 0:
            continue
        size = _strength(light, peak, unit_m)
        for shape, members, strengths in shapes:
            both = _nodes_within([spectrum, shape], low_nm, high_nm)
            if isinstance(light, SKIES) and any(isinstance(scene.lights[j], SKIES) for j in members):
                continue  # the renderer's scene has one sky
            if np.max(np.abs(spectrum.at(both) / peak - shape.at(both))) < SAME_SHAPE:
                members.append(i)
                strengths.append(size)
                break
        else:
            shapes.append((Spectrum(spectrum.wavelength_nm, spectrum.value / peak, spectrum.name), [i], [size]))
    return tuple(
        LightGroup(shape.scaled(max(sizes)), tuple(members), tuple(size / max(sizes) for size in sizes)) for shape, members, sizes in shapes
    )


def _strength(light: Light, peak: float, unit_m: float) -> float:
    return peak / unit_m**2 if isinstance(light, PointLight) else peak


def _covering(spectrum: Spectrum, low_nm: float, high_nm: float, field: str) -> Spectrum:
    low, high = spectrum.range_nm
    if low_nm < low - GRID_SLACK_NM or high_nm > high + GRID_SLACK_NM:
        raise InputError(field, (low_nm, high_nm), f"used for bands within {low:g} to {high:g} nm, the data of {spectrum.label}")
    return spectrum


def _nodes_within(spectra: list[Spectrum], low_nm: float, high_nm: float) -> np.ndarray:
    inside = [s.wavelength_nm[(s.wavelength_nm > low_nm) & (s.wavelength_nm < high_nm)] for s in spectra]
    return np.unique(np.concatenate([[low_nm, high_nm], *inside]))


def material_spectra(material: Material) -> dict[str, Spectrum]:
    """Return the spectra that a material is made of, by field name."""
    if isinstance(material, Diffuse | RoughPlastic):
        return {"reflectance": material.reflectance}
    if isinstance(material, Textured):
        return {f"basis[{i}]": spectrum for i, spectrum in enumerate(material.basis)}
    if isinstance(material, Conductor):
        return {"eta": material.eta, "k": material.k}
    return {}


def transport_nodes(scene: Scene, low_nm: float, high_nm: float, linear: bool) -> np.ndarray:
    """Choose the wavelengths, in nm, at which transport is rendered.

    They depend on the scene alone, apart from being cut to the smallest run that covers [low_nm, high_nm]: a band's radiance does
    not depend on which other bands are rendered with it.

    Args:
        scene: its materials' nodes are always among the nodes.
        low_nm: lowest band edge.
        high_nm: highest band edge.
        linear: True when light is reflected at most once, off diffuse surfaces: then transport is exactly linear between the
            materials' nodes. Otherwise intervals in which reflectances change much are divided.

    Raises:
        InputError: ``materials.NAME.FIELD`` when a material's data do not cover the bands.
    """
    used = {shape.material for shape in scene.shapes}
    spectra, grids = [], [np.array([min(low_nm, WIDE_RANGE_NM[0]), max(high_nm, WIDE_RANGE_NM[1])])]
    smooth = False
    for name in sorted(used):
        material = scene.materials[name]
        smooth |= isinstance(material, Conductor) or (isinstance(material, Dielectric) and material.abbe is not None)
        for field, spectrum in material_spectra(material).items():
            spectra.append(_covering(spectrum, low_nm, high_nm, f"materials.{name}.{field}"))
            grids.append(spectrum.wavelength_nm)
    grid = np.unique(np.concatenate(grids))
    if smooth:
        grid = np.unique(np.concatenate([grid, np.arange(WIDE_RANGE_NM[0], WIDE_RANGE_NM[1], SMOOTH_STEP_NM)]))
    first = max(int(np.searchsorted(grid, low_nm, side="right")) - 1, 0)
    last = min(int(np.searchsorted(grid, high_nm, side="left")), grid.size - 1)
    grid = grid[first : last + 1]
    changes = [np.abs(np.diff(s.at(grid))) for s in spectra if s.maximum <= 1]
    if linear or not changes:
        return grid
    steps = np.max(changes, axis=0)
    parts = np.maximum(1, np.ceil(np.sqrt(steps**2 / 6 / TWO_BOUNCE_TOLERANCE))).astype(int)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(grid[:-1], grid[1:], parts)]
    return np.concatenate([*pieces, grid[-1:]])
