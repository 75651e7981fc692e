"""Transport with any material: one path carries all wavelengths, because no direction is chosen by wavelength.

Mitsuba's BSDFs are evaluated at every node along the same path, four nodes at a time. Valid for every material here
except glass with an Abbe number, whose refraction depends on wavelength: for it the nodes are followed one by one, with the index
of each (:class:`DispersivePath`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.render.diffuse_table import ROULETTE_FROM, power_share
from optsim.render.engine import dr, mi
from optsim.render.translate import NODE_OFFSET


class SharedPath:
    """Follow paths through a Mitsuba scene whose spectra are tables over node numbers.

    Args:
        scene: Mitsuba scene of :func:`optsim.render.translate.load` with :func:`optsim.render.translate.at_nodes`, lights `uniform`.
        first: number of the first node to evaluate.
        nodes: how many nodes from there.
        max_depth: emission plus at most max_depth - 1 reflections or refractions.
    """

    def __init__(self, scene: Any, first: int, nodes: int, max_depth: int) -> None:
        self.scene = scene
        self.nodes, self.groups = nodes, (nodes + 3) // 4
        self.max_depth = dr.opaque(mi.UInt32, max_depth)
        numbers = NODE_OFFSET + first + np.minimum(np.arange(4 * self.groups), nodes - 1)
        self._numbers = [[dr.opaque(mi.Float, float(x)) for x in numbers[4 * g : 4 * g + 4]] for g in range(self.groups)]

    def prepare(self) -> None:
        """Do nothing: every node sees the same geometry."""

    @dr.syntax
    def radiance(self, ray: Any, stream: Any, u: Any, v: Any) -> Any:
        """Trace one path per thread; arguments and result as of ``DiffuseTable.radiance``."""
        scene = self.scene
        context = mi.BSDFContext()
        wavelengths = [mi.Spectrum(*four) for four in self._numbers]
        light = [mi.Spectrum(0) for _ in range(self.groups)]
        weight = [mi.Spectrum(1) for _ in range(self.groups)]
        index, cut = mi.Float(1), mi.Float(0)
        depth = mi.UInt32(0)
        before = dr.zeros(mi.SurfaceInteraction3f)
        density, sharp = mi.Float(1), mi.Bool(True)
        ray, active = mi.Ray3f(ray), mi.Bool(True)
        while active:
            si = scene.ray_intersect(ray, ray_flags=mi.RayFlags.All, coherent=(depth == 0))
            glow = self._glow(si, before, density, sharp, active)
            more = active & si.is_valid() & ((depth + 1) < self.max_depth)
            bsdf = si.bsdf(ray)
            first = depth == 0
            point = mi.Point2f(dr.select(first, u, stream.next_float32()), dr.select(first, v, stream.next_float32()))
            smooth = more & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
            sample, emission = scene.sample_emitter_direction(si, point, True, smooth)
            smooth &= sample.pdf != 0
            pick, turn = stream.next_float32(), mi.Point2f(stream.next_float32(), stream.next_float32())
            found = self._scatter(bsdf, context, si, wavelengths, sample, pick, turn, more)
            chosen = found[0][2]
            direct = dr.select(smooth, emission[0] * dr.select(sample.delta, 1, power_share(sample.pdf, found[0][1])), 0)
            for g in range(self.groups):
                light[g] = dr.fma(weight[g], glow, light[g])
                light[g] = dr.select(smooth, dr.fma(weight[g] * found[g][0], direct, light[g]), light[g])
                weight[g] = dr.select(more, weight[g] * found[g][3], weight[g])
            ray = si.spawn_ray(si.to_world(chosen.wo))
            index = dr.select(more, index * chosen.eta, index)
            before, density = si, chosen.pdf
            sharp = mi.has_flag(chosen.sampled_type, mi.BSDFFlags.Delta)
            depth += 1
            left = self._largest(weight) * index * index
            cut = dr.select(active & si.is_valid() & ~more, left, cut)
            survival = dr.select(depth >= ROULETTE_FROM, dr.minimum(left, 1), 1)
            active = more & (left > 0) & (stream.next_float32() < survival)
            for g in range(self.groups):
                weight[g] = dr.select(active, weight[g] / survival, weight[g])
        return light, cut

    def _glow(self, si: Any, before: Any, density: Any, sharp: Any, active: Any) -> Any:
        """Return the light that the surface hit sends out itself, weighted against light sampling after a smooth surface."""
        own = si.emitter(self.scene).eval(si, active)[0]
        sample = mi.DirectionSample3f(self.scene, si, before)
        by_light = self.scene.pdf_emitter_direction(before, sample, active & ~sharp)
        return own * dr.select(sharp, 1, power_share(density, by_light))

    def _scatter(self, bsdf: Any, context: Any, si: Any, wavelengths: Any, sample: Any, pick: Any, turn: Any, active: Any) -> list[Any]:
        """Evaluate and sample the BSDF at each group of nodes with the same random numbers: (value, pdf, sample, weight) each."""
        toward = si.to_local(sample.d)
        found = []
        for four in wavelengths:
            si.wavelengths = four
            found.append(bsdf.eval_pdf_sample(context, si, toward, pick, turn, active))
        return found

    def _largest(self, weight: Any) -> Any:
        most = dr.max(weight[0])
        for more in weight[1:]:
            most = dr.maximum(most, dr.max(more))
        return most


class DispersivePath(SharedPath):
    """Follow one node, with the refractive indices of that wavelength; the kernel is compiled once for all nodes.

    Args:
        scene: as above, shared by all nodes of a render.
        node: number of the node.
        indices: refractive index at this node of each dispersive glass, by Mitsuba's parameter name.
        max_depth: as above.
    """

    def __init__(self, scene: Any, node: int, indices: dict[str, float], max_depth: int) -> None:
        super().__init__(scene, node, 1, max_depth)
        self._indices = indices

    def prepare(self) -> None:
        """Set the glasses' indices in the scene."""
        parameters = mi.traverse(self.scene)
        for name, index in self._indices.items():
            parameters[name] = index
        parameters.update()
