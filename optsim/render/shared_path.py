"""Transport with any material: one path carries all wavelengths as long as no direction depends on wavelength.

Diffuse surfaces and glass answer from a table; Mitsuba's BSDFs of the other surfaces are evaluated at every node along the same path,
four nodes at a time. Glass with an Abbe number bends every wavelength another way: then each node follows paths of its own
(:class:`optsim.render.bundle.OneNode`), by the same rules and with the same random numbers.
"""

from __future__ import annotations

from typing import Any

from optsim.render.bundle import Bundle
from optsim.render.diffuse_table import ROULETTE_FROM, power_share
from optsim.render.engine import dr, mi
from optsim.render.lights import LightSampler
from optsim.render.materials import DIFFUSE, GLASS, OTHER, MaterialTable
from optsim.render.sampling import FirstNumbers
from optsim.render.sky import SkyShape


class SharedPath:
    """Follow paths through a Mitsuba scene whose spectra are tables over node numbers.

    Args:
        scene: Mitsuba scene of :func:`optsim.render.translate.load` with :func:`optsim.render.translate.at_nodes`, lights `uniform`.
        table: its materials at the nodes to evaluate.
        bundle: what a path carries: all nodes, or one where glass disperses.
        max_depth: emission plus at most max_depth - 1 reflections or refractions.
        sky: how the sky's light depends on the direction.
        aim: whether rays are aimed at lights, or find them by chance only.
    """

    def __init__(self, scene: Any, table: MaterialTable, bundle: Bundle, max_depth: int, sky: SkyShape, aim: bool = True) -> None:
        self.scene, self.table, self.bundle, self.sky = scene, table, bundle, sky
        self.lights = LightSampler(scene, each=not table.has_other, aim=aim)  # a metal or plastic would have to answer for each
        self.max_depth = dr.opaque(mi.UInt32, max_depth)

    @dr.syntax
    def radiance(self, ray: Any, stream: Any, numbers: FirstNumbers, lane: Any) -> Any:
        """Trace one path per thread; arguments and result as of ``DiffuseTable.radiance``."""
        scene, table, bundle = self.scene, self.table, self.bundle
        light = [bundle.dark() for _ in range(bundle.groups)]
        weight = [bundle.dark() + 1 for _ in range(bundle.groups)]
        index, cut = mi.Float(1), mi.Float(0)
        depth, fresh = mi.UInt32(0), mi.Bool(True)
        before = dr.zeros(mi.SurfaceInteraction3f)
        density, sharp = mi.Float(1), mi.Bool(True)
        ray, active = mi.Ray3f(ray), mi.Bool(True)
        while active:
            si = scene.ray_intersect(ray, ray_flags=mi.RayFlags.All, coherent=(depth == 0))
            glow = self._glow(si, before, density, sharp, active) * self.sky.met(si, ray.d)
            hit = active & si.is_valid() & ((depth + 1) < self.max_depth)
            row = table.row(si, hit)
            kind = table.kind(row, hit)
            diffuse = hit & (kind == DIFFUSE) & (si.wi.z > 0)
            glass, other = hit & (kind == GLASS), hit & (kind == OTHER)
            smooth = diffuse | self._smooth(si, ray, other)
            u, v, s, t = numbers.take(stream, fresh)
            fresh &= ~smooth
            pick = stream.next_float32()
            aimed = list(self.lights.samples(si, u, v, smooth))
            found = self._scatter(si, ray, lane, si.to_local(aimed[0][0].d), pick, mi.Point2f(s, t), other)
            bent, passed, step = self._refract(si, table.index(row, lane, glass), pick)
            on_diffuse, on_other = self._lambert(si, aimed, diffuse), self._weighed(aimed[0], found[0][1], other & smooth)
            for g in range(bundle.groups):
                reflected = bundle.reflectance(row, g, lane, diffuse)
                value, _, _, weighed = found[min(g, len(found) - 1)]
                light[g] = dr.fma(weight[g], glow + dr.select(diffuse, reflected * on_diffuse, value * on_other), light[g])
                weight[g] *= dr.select(diffuse, reflected, dr.select(glass, passed, weighed))
            bounce = mi.warp.square_to_cosine_hemisphere(mi.Point2f(s, t))
            chosen = found[0][2]
            ray = si.spawn_ray(si.to_world(dr.select(diffuse, bounce, dr.select(glass, bent, chosen.wo))))
            index = dr.select(glass, index * step, index)
            before, density = si, dr.select(diffuse, bounce.z * dr.inv_pi, chosen.pdf)
            sharp = glass | (other & mi.has_flag(chosen.sampled_type, mi.BSDFFlags.Delta))
            depth += 1
            left = bundle.largest(weight) * index * index
            going = diffuse | glass | other
            cut = dr.select(going & (depth + 1 >= self.max_depth), left, cut)
            survival = dr.select(depth >= ROULETTE_FROM, dr.minimum(left, 1), 1)
            active = going & (left > 0) & (stream.next_float32() < survival)
            for g in range(bundle.groups):
                weight[g] = dr.select(active, weight[g] / survival, weight[g])
        return light, cut

    def _glow(self, si: Any, before: Any, density: Any, sharp: Any, active: Any) -> Any:
        """Return the light that the surface hit sends out itself, weighted against light sampling after a smooth surface."""
        own = si.emitter(self.scene).eval(si, active)[0]
        sample = mi.DirectionSample3f(self.scene, si, before)
        by_light = self.lights.density(before, sample, active & ~sharp)
        return own * dr.select(sharp, 1, power_share(density, by_light))

    def _lambert(self, si: Any, aimed: list[Any], active: Any) -> Any:
        """Return the light of all aimed rays on a diffuse surface, times cosine / pi."""
        total = mi.Float(0)
        for sample, emission in aimed:
            lambert = dr.maximum(dr.dot(si.sh_frame.n, sample.d), 0) * dr.inv_pi
            total += lambert * self._weighed((sample, emission), lambert, active)
        return total

    def _weighed(self, aimed: tuple[Any, Any], by_scatter: Any, active: Any) -> Any:
        """Return the light of an aimed ray, weighted against a scattered ray that meets it by chance."""
        sample, emission = aimed
        lit = emission[0] * self.sky.sampled(sample) * dr.select(sample.delta, 1, power_share(sample.pdf, by_scatter))
        return dr.select(active & (sample.pdf != 0), lit, 0)

    def _smooth(self, si: Any, ray: Any, other: Any) -> Any:
        """Tell whether the surface scatters light into more than single directions."""
        if not self.table.has_other:
            return mi.Bool(False)
        return other & mi.has_flag(si.bsdf(ray).flags(), mi.BSDFFlags.Smooth)

    def _scatter(self, si: Any, ray: Any, lane: Any, toward: Any, pick: Any, turn: Any, active: Any) -> list[Any]:
        """Evaluate and sample Mitsuba's BSDF at each group of nodes with the same random numbers: (value, pdf, sample, weight)."""
        if not self.table.has_other:
            return [(self.bundle.dark(), mi.Float(0), dr.zeros(mi.BSDFSample3f), self.bundle.dark())]
        bsdf, context, found = si.bsdf(ray), mi.BSDFContext(), []
        for four in self.bundle.wavelengths(lane):
            si.wavelengths = four
            value, density, chosen, passed = bsdf.eval_pdf_sample(context, si, toward, pick, turn, active)
            found.append((self.bundle.own(value), density, chosen, self.bundle.own(passed)))
        return found

    def _refract(self, si: Any, index: Any, pick: Any) -> Any:
        """Reflect or refract at smooth glass (theory.md (R.30)): direction, weight of the radiance, relative index passed."""
        if not self.table.has_glass:
            return mi.Vector3f(0), mi.Float(0), mi.Float(1)
        reflectance, cosine, step, back = mi.fresnel(si.wi.z, index)
        mirror = pick < reflectance
        bent = mi.refract(si.wi, cosine, back)
        direction = dr.select(mirror, mi.reflect(si.wi), bent)
        return direction, dr.select(mirror, 1, back * back), dr.select(mirror, 1, step)
