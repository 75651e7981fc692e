"""Transport with any material: one path carries all wavelengths as long as no direction depends on wavelength.

Diffuse surfaces and glass answer from a table; Mitsuba's BSDFs of the other surfaces are evaluated at every node along the same path,
four nodes at a time. A camera ray that meets glass follows both ways. Glass with an Abbe number bends every wavelength another way: what
the camera sees through it is followed for several nodes apart, spread over the range; a path that is refracted by it later goes on for
one of them, with the weight of all (theory.md R.45 to R.47).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from optsim.render.bundle import AllNodes, Bundle, OneNode
from optsim.render.diffuse_table import ROULETTE_FROM, power_share
from optsim.render.engine import dr, mi
from optsim.render.interface import Interface, Kept
from optsim.render.lights import LightSampler
from optsim.render.materials import DIFFUSE, GLASS, OTHER, MaterialTable
from optsim.render.sampling import FirstNumbers
from optsim.render.sky import SkyShape


@dataclass(frozen=True)
class Parting:
    """Say how wavelengths part at dispersing glass.

    Args:
        apart: follow every node on a path of its own from the camera on; the judge of the others.
        seen: else, nodes followed apart behind the first glass that a camera ray meets, spread evenly over the range; at most all.
        met: the same behind glass that a scattered ray meets.
    """

    apart: bool = False
    seen: int = 16
    met: int = 16


@dataclass
class _Start:
    """Where a path starts: a camera ray, or one that has come through glass."""

    ray: Any
    share: Any
    index: Any
    depth: Any
    direct: Any


class SharedPath:
    """Follow paths through a Mitsuba scene whose spectra are tables over node numbers.

    Args:
        scene: Mitsuba scene of :func:`optsim.render.translate.load` with :func:`optsim.render.translate.at_nodes`, lights `uniform`.
        table: its materials at the nodes to evaluate.
        parting: what becomes of wavelengths at dispersing glass.
        max_depth: emission plus at most max_depth - 1 reflections or refractions.
        sky: how the sky's light depends on the direction.
        aim: whether rays are aimed at lights, or find them by chance only.
    """

    def __init__(self, scene: Any, table: MaterialTable, parting: Parting, max_depth: int, sky: SkyShape, aim: bool = True) -> None:
        self.scene, self.table, self.sky = scene, table, sky
        apart = parting.apart and table.has_dispersion
        self.bundle: Bundle = OneNode(table) if apart else AllNodes(table)
        self.splits, self.tallies = table.has_dispersion and not apart, 3
        self._interface = Interface(table, self.bundle, both=not apart)
        self._one = Interface(table, OneNode(table), both=False)
        self.seen, self.met = min(parting.seen, table.nodes), min(parting.met, table.nodes)
        self.lights = LightSampler(scene, each=not table.has_other, aim=aim)  # a metal or plastic would have to answer for each
        self.max_depth = dr.opaque(mi.UInt32, max_depth)

    def radiance(self, ray: Any, stream: Any, numbers: FirstNumbers, lane: Any) -> Any:
        """Trace one path per thread, in branches; arguments and result as of ``DiffuseTable.radiance``.

        The tallies are the share of light cut off, whether dispersing glass was met before any surface that scatters, and the light (mean
        over nodes) that reached such a surface by way of glass or mirrors.
        """
        nodes = self.table.nodes
        wave = dr.minimum(mi.UInt32(numbers.wave * nodes), nodes - 1) if self.splits else lane
        start = _Start(ray, mi.Float(1), mi.Float(1), mi.UInt32(0), mi.Bool(True))
        light, tallies, kept = self._follow(self._interface, start, stream, numbers, wave)
        return self._parted(kept, light, tallies, stream, numbers, wave) if self.splits else (light, tallies)

    @dr.syntax
    def _parted(self, kept: Any, light: list[Any], tallies: list[Any], stream: Any, numbers: FirstNumbers, wave: Any) -> Any:
        """Add what comes through dispersing glass, for some nodes one after the other."""
        nodes, bundle, one = self.table.nodes, self.bundle, self._one
        cut, seen, caustic = tallies
        m = mi.UInt32(0)
        paths = dr.select(kept.direct, mi.UInt32(self.seen), self.met)
        last = dr.select(kept.valid & kept.parts, paths, 0)
        while m < last:
            node = (wave + m * nodes) // paths
            through, share, step = kept.refracted(self.table.index(kept.row, node, kept.valid))
            share *= bundle.value(kept.weight, node)
            start = _Start(through, share, kept.index * step, kept.depth, kept.direct)
            more, (lost, _, found), _ = self._follow(one, start, stream, numbers, node)
            share = mi.Float(nodes) / mi.Float(paths)
            for g in range(bundle.groups):
                light[g] += bundle.only(node, g) * (more[0] * share)
            cut += lost / mi.Float(paths)
            caustic += found / mi.Float(paths)
            m += 1
        return light, [cut, seen, caustic]

    @dr.syntax
    def _follow(self, interface: Any, start: Any, stream: Any, numbers: FirstNumbers, node: Any) -> Any:
        scene, table, bundle = self.scene, self.table, interface.bundle
        light = [bundle.dark() for _ in range(bundle.groups)]
        weight = [bundle.dark() + start.share for _ in range(bundle.groups)]
        index, cut, caustic = mi.Float(start.index), mi.Float(0), mi.Float(0)
        depth, fresh, direct = mi.UInt32(start.depth), mi.Bool(start.direct), mi.Bool(start.direct)
        alone, seen, kept = mi.Bool(False), mi.Bool(False), Kept.nothing(weight)
        before = dr.zeros(mi.SurfaceInteraction3f)
        density, sharp = mi.Float(1), mi.Bool(True)
        ray, active = mi.Ray3f(start.ray), mi.Bool(start.share > 0)
        while active:
            si = scene.ray_intersect(ray, ray_flags=mi.RayFlags.All, coherent=(depth == 0))
            glow = self._glow(si, before, density, sharp, active) * self.sky.met(si, ray.d)
            caustic += dr.select(active & sharp & ~direct, bundle.mean(weight) * glow, 0)
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
            found = self._scatter(bundle, si, ray, node, si.to_local(aimed[0][0].d), pick, mi.Point2f(s, t), other)
            first = glass & (depth == 0)
            crossing = interface.cross(si, row, node, alone, pick, first, glass)
            kept, later = self._kept(interface, kept, si, ray, row, crossing, weight, index, depth, direct)
            on_diffuse, on_other = self._lambert(si, aimed, diffuse), self._weighed(aimed[0], found[0][1], other & smooth)
            for g in range(bundle.groups):
                reflected = bundle.reflectance(row, g, node, diffuse)
                value, _, _, weighed = found[min(g, len(found) - 1)]
                light[g] = dr.fma(weight[g], glow + dr.select(diffuse, reflected * on_diffuse, value * on_other), light[g])
                weight[g] *= dr.select(diffuse, reflected, dr.select(glass, crossing.factor(g), weighed))
            bounce, chosen = mi.warp.square_to_cosine_hemisphere(mi.Point2f(s, t)), found[0][2]
            ray = si.spawn_ray(si.to_world(dr.select(diffuse, bounce, dr.select(glass, crossing.direction, chosen.wo))))
            index = dr.select(glass, index * crossing.step, index)
            alone |= glass & crossing.parts
            seen |= glass & crossing.meets & direct
            direct &= ~smooth
            before, density, depth = si, dr.select(diffuse, bounce.z * dr.inv_pi, chosen.pdf), depth + 1
            sharp = glass | (other & mi.has_flag(chosen.sampled_type, mi.BSDFFlags.Delta))
            left = bundle.largest(weight) * index * index
            going = diffuse | glass | other
            cut += dr.select(going & (depth + 1 >= self.max_depth), left / dr.select(alone, bundle.nodes, 1), 0)
            survival = dr.select(depth >= ROULETTE_FROM, dr.minimum(left, 1), 1)
            active = going & ~later & (left > 0) & (stream.next_float32() < survival)
            for g in range(bundle.groups):
                weight[g] = dr.select(active, weight[g] / survival, weight[g])
            if dr.hint(interface.both, mode="scalar"):
                again = ~active & kept.valid & ~kept.parts
                through, share, step = kept.refracted(table.index(kept.row, node, kept.valid))
                ray, index, depth = dr.select(again, through, ray), dr.select(again, step, index), dr.select(again, kept.depth, depth)
                for g in range(bundle.groups):
                    weight[g] = dr.select(again, kept.weight[g] * share, weight[g])
                fresh, direct, sharp, alone = fresh | again, direct | again, sharp | again, alone & ~again
                kept.valid &= ~again
                active |= again
        return light, [cut, dr.select(seen, mi.Float(1), 0), caustic], kept

    def _kept(self, interface: Interface, kept: Any, si: Any, ray: Any, row: Any, crossing: Any, weight: Any, *path: Any) -> Any:
        """Keep what is to be followed later; tell whether that is all of the path."""
        if not interface.both:
            return kept, mi.Bool(False)
        keep = crossing.first | (crossing.parts & ~kept.valid)
        weight = [w * dr.select(crossing.first, 1, dr.rcp(1 - crossing.chance)) for w in weight]
        return dr.select(keep, Kept.at(si, ray, row, crossing.meets, weight, *path), kept), keep & ~crossing.first

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

    def _scatter(self, bundle: Bundle, si: Any, ray: Any, lane: Any, toward: Any, pick: Any, turn: Any, active: Any) -> list[Any]:
        """Evaluate and sample Mitsuba's BSDF at each group of nodes with the same random numbers: (value, pdf, sample, weight)."""
        if not self.table.has_other:
            return [(bundle.dark(), mi.Float(0), dr.zeros(mi.BSDFSample3f), bundle.dark())]
        bsdf, context, found = si.bsdf(ray), mi.BSDFContext(), []
        for four in bundle.wavelengths(lane):
            si.wavelengths = four
            value, density, chosen, passed = bsdf.eval_pdf_sample(context, si, toward, pick, turn, active)
            found.append((bundle.own(value), density, chosen, bundle.own(passed)))
        return found
