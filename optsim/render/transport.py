"""Set up the transport of a scene: nodes, light groups, depth, and the integrator that fits its materials."""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.cube import Bands
from optsim.render.bundle import AllNodes, OneNode
from optsim.render.diffuse_table import DiffuseTable, LightSearch
from optsim.render.estimate import relative_errors
from optsim.render.frame import camera_rays, frame_of
from optsim.render.kernel import trace
from optsim.render.materials import MAX_TABLE_VALUES, MaterialTable, rows_of
from optsim.render.needs import explain
from optsim.render.replicates import Replicates
from optsim.render.settings import RenderSettings
from optsim.render.shared_path import SharedPath
from optsim.render.sky import SkyShape
from optsim.render.spectral import light_groups, transport_nodes
from optsim.render.translate import at_nodes, bsdf, load, plain, uniform
from scenes.lights import SKIES, AreaLight
from scenes.materials import Dielectric, Lambertian, Material
from scenes.scene import Scene

NODES_A_KERNEL = 48
"""More nodes than this are rendered in several kernels that follow the same paths."""
LARGE_LIGHT = 0.5
"""Side of a light divided by its distance from the nearest shape above which scattered rays also look for it."""


class Transport:
    """Hold one scene ready to be traced.

    Args:
        scene: what to render.
        bands: decide the range of wavelengths.
        film: (height, width) in samples.
        settings: as of the render.

    Attributes:
        nodes: (n,) wavelengths of the transport in nm.
        groups: the light groups.
        weights: for each group the (K, n) matrix from transport to bands.
        route: name of the integrator, for the record.
        max_depth: emission plus this many reflections less one.
    """

    def __init__(self, scene: Scene, bands: Bands, film: tuple[int, int], settings: RenderSettings) -> None:
        self.scene, self.film, self.settings = scene, film, settings
        self.pixels = film[0] * film[1]
        low, high = float(bands.lower.min()), float(bands.upper.max())
        self.frame = frame_of(scene)
        self.groups = light_groups(scene, low, high, self.frame.unit)
        self.needs = explain(scene, settings.tolerance)
        linear = self.needs.reflects_once and self.needs.all_diffuse
        self.nodes = transport_nodes(scene, low, high, linear)
        self.weights = [group.weights(self.nodes, bands) for group in self.groups]
        self.max_depth = settings.max_depth or self.needs.max_depth
        self._exact_depth = self.needs.reflects_once and self.max_depth >= 2
        self._rays = camera_rays(scene, self.frame, *film)
        self.route = "diffuse table" if self.needs.all_diffuse else "path per node" if self.needs.dispersive else "shared path"
        self._integrators = [self._build(group.lights, group.strengths) for group in self.groups]

    def empty(self) -> list[Replicates]:
        """Return fresh accumulators, one per light group."""
        return [Replicates((self.nodes.size, self.pixels)) for _ in self.groups]

    def error(self, groups: list[Replicates]) -> float:
        """Return the largest relative RMS error over the bands, as estimated from the scatter of the passes."""
        return float(relative_errors(groups, self.weights).max()) if groups else 0.0

    def trace(self, group: int, samples: int, key: tuple[int, ...]) -> tuple[np.ndarray, float]:
        """Render one pass of one light group: (n, pixels) transport and the share of light cut by the depth limit."""
        parts, cut = [], 0.0
        for integrator in self._integrators[group]:
            part, cut = trace(integrator, self._rays, self.film, samples, key)
            parts.append(part)
        return np.concatenate(parts), 0.0 if self._exact_depth else cut

    def _build(self, lights: tuple[int, ...], strengths: tuple[float, ...]) -> list[Any]:
        emission = {i: uniform(strength) for i, strength in zip(lights, strengths)}
        spectrum = at_nodes(self.nodes)

        def surface(material: Material) -> dict[str, Any]:
            return plain(material) if isinstance(material, Lambertian | Dielectric) else bsdf(material, spectrum)

        engine = load(self.scene, self.frame, emission, surface)
        sky = SkyShape(self.scene, lights, engine)
        if self.needs.dispersive:
            table = MaterialTable(self.scene, self.frame, engine, self.nodes, 0, self.nodes.size)
            return [SharedPath(engine, table, OneNode(table), self.max_depth, sky)]
        longest = max(4, min(NODES_A_KERNEL, MAX_TABLE_VALUES // rows_of(self.scene)))
        chunks = np.array_split(np.arange(self.nodes.size), -(-self.nodes.size // longest))
        tables = [MaterialTable(self.scene, self.frame, engine, self.nodes, int(c[0]), c.size) for c in chunks]
        if not self.needs.all_diffuse:
            table = MaterialTable(self.scene, self.frame, engine, self.nodes, 0, self.nodes.size)
            return [SharedPath(engine, table, AllNodes(table), self.max_depth, sky) for table in tables]
        only_sky = all(isinstance(self.scene.lights[i], SKIES) for i in lights)
        search = LightSearch(sample=not only_sky, hit=only_sky or scattered_rays_seek_lights(self.scene, lights))
        return [DiffuseTable(engine, table, self.max_depth, search, sky) for table in tables]


def scattered_rays_seek_lights(scene: Scene, lights: tuple[int, ...]) -> bool:
    """Tell whether some light is so large, seen from the nearest shape, that light sampling alone would be noisy."""
    box = scene.bounds()
    for i in lights:
        light = scene.lights[i]
        if isinstance(light, SKIES):
            return True
        if isinstance(light, AreaLight) and box is not None:
            corners = light.corners()
            gap = float(np.linalg.norm(np.maximum(np.maximum(box[0] - corners.max(0), corners.min(0) - box[1]), 0)))
            side = 2 * max(float(np.linalg.norm(light.half_u)), float(np.linalg.norm(light.half_v)))
            if side > LARGE_LIGHT * gap:
                return True
    return False
