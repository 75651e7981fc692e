"""Set up the transport of a scene: nodes, light groups, depth, and the integrator that fits its materials."""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.cube import Bands
from optsim.render.choice import Physics
from optsim.render.diffuse_table import DiffuseTable, LightSearch
from optsim.render.frame import camera_rays, frame_of
from optsim.render.kernel import trace
from optsim.render.materials import MAX_TABLE_VALUES, MaterialTable, rows_of
from optsim.render.needs import explain
from optsim.render.replicates import Replicates
from optsim.render.settings import RenderSettings
from optsim.render.shared_path import Parting, SharedPath
from optsim.render.sky import SkyShape
from optsim.render.spectral import light_groups
from optsim.render.tiles import Samples, Tiles, Traced
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
        parting: what becomes of wavelengths at dispersing glass.

    Attributes:
        nodes: (n,) wavelengths of the transport in nm.
        groups: the light groups.
        weights: for each group the (K, n) matrix from transport to bands.
        route: name of the integrator, for the record.
        max_depth: emission plus this many reflections less one.
    """

    def __init__(self, scene: Scene, bands: Bands, film: tuple[int, int], settings: RenderSettings, parting: Parting | None = None) -> None:
        self.scene, self.film, self.settings = scene, film, settings
        self.pixels = film[0] * film[1]
        low, high = float(bands.lower.min()), float(bands.upper.max())
        self.needs = explain(scene, settings.tolerance, settings.choices)
        self._modelled = scene = self.needs.modelled
        self.frame = frame_of(scene)
        self.groups = light_groups(scene, low, high, self.frame.unit)
        self.nodes = self.needs.nodes_nm(bands)
        self.weights = [self.needs.weights(group, self.nodes, bands) for group in self.groups]
        self.max_depth = settings.max_depth or self.needs.max_depth
        decided = Physics.INTERREFLECTION not in settings.without and not self.needs.on(Physics.INTERREFLECTION)
        self._exact_depth = decided and self.max_depth >= 2
        self._rays = camera_rays(scene, self.frame, *film)
        self._parting = Parting() if parting is None else parting
        self.route = "diffuse table" if self.needs.all_diffuse else "shared path"
        if self.needs.on(Physics.DISPERSION):
            self.route = "path per node" if self._parting.apart else "shared path, parted at glass"
        self._integrators = [self._build(group.lights, group.strengths) for group in self.groups]

    @property
    def tiles(self) -> Tiles:
        """Return the whole picture's tiles."""
        return Tiles(self.film)

    def empty(self, part: Tiles) -> list[Replicates]:
        """Return fresh accumulators for a part of the picture, one per light group."""
        return [Replicates((self.nodes.size, part.pixels), weights, part) for weights in self.weights]

    def trace(self, group: int, samples: Samples, key: tuple[int, ...]) -> Traced:
        """Render one pass of one light group at all nodes."""
        parts = [trace(integrator, self._rays, self.film, samples, key) for integrator in self._integrators[group]]
        cut = 0.0 if self._exact_depth else max(part.cut for part in parts)
        share = [len(part.values) / self.nodes.size for part in parts]
        told = np.sum([s * part.told for s, part in zip(share, parts)], axis=0)
        return Traced(np.concatenate([part.values for part in parts]), cut, told)

    def _build(self, lights: tuple[int, ...], strengths: tuple[float, ...]) -> list[Any]:
        emission = {i: uniform(strength) for i, strength in zip(lights, strengths)}
        spectrum = at_nodes(self.nodes)

        def surface(material: Material) -> dict[str, Any]:
            return plain(material) if isinstance(material, Lambertian | Dielectric) else bsdf(material, spectrum)

        scene, aim = self._modelled, self.needs.on(Physics.EMITTER_SAMPLING)
        engine = load(scene, self.frame, emission, surface)
        sky = SkyShape(scene, lights, engine)
        longest = max(4, min(NODES_A_KERNEL, MAX_TABLE_VALUES // rows_of(scene)))
        alone = self._parting.apart and self.needs.on(Physics.DISPERSION)
        chunks = np.array_split(np.arange(self.nodes.size), 1 if alone else -(-self.nodes.size // longest))
        tables = [MaterialTable(scene, self.frame, engine, self.nodes, int(c[0]), c.size) for c in chunks]
        if not self.needs.all_diffuse:
            return [SharedPath(engine, table, self._parting, self.max_depth, sky, aim) for table in tables]
        only_sky = all(isinstance(scene.lights[i], SKIES) for i in lights)
        aim &= not only_sky or Physics.EMITTER_SAMPLING in self.needs.choices.force
        search = LightSearch(sample=aim, hit=only_sky or not aim or scattered_rays_seek_lights(scene, lights))
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
