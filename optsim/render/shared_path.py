"""Transport with any material: one path carries all wavelengths, because no direction is chosen by wavelength.

Diffuse surfaces answer from a table; Mitsuba's BSDFs of the other surfaces are evaluated at every node along the same path, four
nodes at a time. Valid for every material here except glass with an Abbe number, whose refraction depends on wavelength: for
it the nodes are followed one by one, with the index of each (:class:`DispersivePath`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.render.diffuse_table import ROULETTE_FROM, ReflectanceTable, power_share
from optsim.render.engine import dr, mi
from optsim.render.sampling import FirstNumbers
from optsim.render.translate import NODE_OFFSET


class SharedPath:
    """Follow paths through a Mitsuba scene whose spectra are tables over node numbers.

    Args:
        scene: Mitsuba scene of :func:`optsim.render.translate.load` with :func:`optsim.render.translate.at_nodes`, lights `uniform`.
        table: reflectances of the diffuse materials at the nodes to evaluate.
        first: number of the first of these nodes.
        max_depth: emission plus at most max_depth - 1 reflections or refractions.
        coloured: False when no material but the diffuse ones depends on wavelength: then one evaluation serves all nodes.
    """

    def __init__(self, scene: Any, table: ReflectanceTable, first: int, max_depth: int, coloured: bool) -> None:
        self.scene, self.table = scene, table
        self.nodes, self.groups = table.nodes, table.groups
        self.max_depth = dr.opaque(mi.UInt32, max_depth)
        numbers = NODE_OFFSET + first + np.minimum(np.arange(4 * self.groups), self.nodes - 1)
        fours = numbers.reshape(-1, 4) if coloured else numbers[None, :4]
        self._numbers = [[dr.opaque(mi.Float, float(x)) for x in four] for four in fours]

    def prepare(self) -> None:
        """Do nothing: every node sees the same geometry."""

    @dr.syntax
    def radiance(self, ray: Any, stream: Any, numbers: FirstNumbers) -> Any:
        """Trace one path per thread; arguments and result as of ``DiffuseTable.radiance``."""
        scene, table = self.scene, self.table
        context = mi.BSDFContext()
        wavelengths = [mi.Spectrum(*four) for four in self._numbers]
        light = [mi.Spectrum(0) for _ in range(self.groups)]
        weight = [mi.Spectrum(1) for _ in range(self.groups)]
        index, cut = mi.Float(1), mi.Float(0)
        depth, fresh = mi.UInt32(0), mi.Bool(True)
        before = dr.zeros(mi.SurfaceInteraction3f)
        density, sharp = mi.Float(1), mi.Bool(True)
        ray, active = mi.Ray3f(ray), mi.Bool(True)
        while active:
            si = scene.ray_intersect(ray, ray_flags=mi.RayFlags.All, coherent=(depth == 0))
            glow = self._glow(si, before, density, sharp, active)
            more = active & si.is_valid() & ((depth + 1) < self.max_depth)
            row = table.row(si, more)
            diffuse = more & table.is_diffuse(row, more) & (si.wi.z > 0)
            other = more & table.is_other(row, more)
            bsdf = si.bsdf(ray)
            smooth = diffuse | (other & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth))
            u, v, s, t = numbers.take(stream, fresh)
            fresh &= ~smooth
            sample, emission = scene.sample_emitter_direction(si, mi.Point2f(u, v), True, smooth)
            smooth &= sample.pdf != 0
            toward = si.to_local(sample.d)
            found = self._scatter(bsdf, context, si, wavelengths, toward, stream.next_float32(), mi.Point2f(s, t), other)
            chosen = found[0][2]
            lambert = dr.maximum(toward.z, 0) * dr.inv_pi
            by_scatter = dr.select(diffuse, lambert, found[0][1])
            direct = dr.select(smooth, emission[0] * dr.select(sample.delta, 1, power_share(sample.pdf, by_scatter)), 0)
            for g in range(self.groups):
                value, _, _, passed = found[min(g, len(found) - 1)]
                reflected = table.at(row, g, diffuse)
                light[g] = dr.fma(weight[g], glow + dr.select(diffuse, reflected * lambert, value) * direct, light[g])
                weight[g] *= dr.select(diffuse, reflected, passed)
            bounce = mi.warp.square_to_cosine_hemisphere(mi.Point2f(s, t))
            ray = si.spawn_ray(si.to_world(dr.select(diffuse, bounce, chosen.wo)))
            index = dr.select(other, index * chosen.eta, index)
            before, density = si, dr.select(diffuse, bounce.z * dr.inv_pi, chosen.pdf)
            sharp = other & mi.has_flag(chosen.sampled_type, mi.BSDFFlags.Delta)
            depth += 1
            left = self._largest(weight) * index * index
            cut = dr.select((diffuse | other) & (depth + 1 >= self.max_depth), left, cut)
            survival = dr.select(depth >= ROULETTE_FROM, dr.minimum(left, 1), 1)
            active = (diffuse | other) & (left > 0) & (stream.next_float32() < survival)
            for g in range(self.groups):
                weight[g] = dr.select(active, weight[g] / survival, weight[g])
        return light, cut

    def _glow(self, si: Any, before: Any, density: Any, sharp: Any, active: Any) -> Any:
        """Return the light that the surface hit sends out itself, weighted against light sampling after a smooth surface."""
        own = si.emitter(self.scene).eval(si, active)[0]
        sample = mi.DirectionSample3f(self.scene, si, before)
        by_light = self.scene.pdf_emitter_direction(before, sample, active & ~sharp)
        return own * dr.select(sharp, 1, power_share(density, by_light))

    def _scatter(self, bsdf: Any, context: Any, si: Any, wavelengths: Any, toward: Any, pick: Any, turn: Any, active: Any) -> list[Any]:
        """Evaluate and sample the BSDF at each group of nodes with the same random numbers: (value, pdf, sample, weight) each."""
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
        table: as above, of the one node.
        node: number of the node.
        max_depth: as above.
        coloured: as above.
        indices: refractive index at this node of each dispersive glass, by Mitsuba's parameter name.
    """

    def __init__(self, scene: Any, table: ReflectanceTable, node: int, max_depth: int, coloured: bool, indices: dict[str, float]) -> None:
        super().__init__(scene, table, node, max_depth, coloured)
        self._indices = indices

    def prepare(self) -> None:
        """Set the glasses' indices in the scene."""
        parameters = mi.traverse(self.scene)
        for name, index in self._indices.items():
            parameters[name] = index
        parameters.update()
