"""Transport in scenes whose surfaces are all diffuse: one path for all wavelengths, reflectances from a table.

No BSDF and no texture is ever called: a [material, node] table replaces them, and light is one number for all wavelengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from optsim.render.bundle import AllNodes
from optsim.render.engine import dr, mi
from optsim.render.lights import LightSampler
from optsim.render.materials import DIFFUSE, MaterialTable
from optsim.render.sampling import FirstNumbers
from optsim.render.sky import SkyShape

ROULETTE_FROM = 4
"""Number of reflections after which paths are ended at random."""


@dataclass(frozen=True)
class LightSearch:
    """Say how paths find light (theory.md (R.26)).

    Args:
        sample: aim a ray at a light from each surface: without it a lamp is found by chance only; the sky needs no aiming.
        hit: count light that a scattered ray meets, weighted against aimed rays if there are any; pays where lights look large.
    """

    sample: bool
    hit: bool


class DiffuseTable:
    """Follow diffuse paths through a Mitsuba scene.

    Args:
        scene: Mitsuba scene of :func:`optsim.render.translate.load`, lights `uniform`.
        table: reflectances; their largest values end paths at random, so that paths do not depend on the nodes chosen.
        max_depth: emission plus at most max_depth - 1 reflections.
        search: how light is looked for.
        sky: how the sky's light depends on the direction.
    """

    def __init__(self, scene: Any, table: MaterialTable, max_depth: int, search: LightSearch, sky: SkyShape) -> None:
        self.scene, self.table, self.search, self.sky = scene, table, search, sky
        self.bundle, self.lights = AllNodes(table), LightSampler(scene)
        self.max_depth = dr.opaque(mi.UInt32, max_depth)
        self.splits, self.tallies = False, 1

    @dr.syntax
    def radiance(self, ray: Any, stream: Any, numbers: FirstNumbers, lane: Any) -> Any:
        """Trace one path per thread.

        Args:
            ray: camera rays.
            stream: PCG32.
            numbers: evenly spread numbers for the first surface.
            lane: which of the bundle's lanes each thread follows; here there is one.

        Returns:
            transport as ``groups`` spectra of four nodes each, and a list of tallies: the share of light cut off by max_depth (an upper
            bound).
        """
        scene, table, groups = self.scene, self.table, self.bundle.groups
        light = [mi.Spectrum(0) for _ in range(groups)]
        weight = [mi.Spectrum(1) for _ in range(groups)]
        bound, cut = mi.Float(1), mi.Float(0)
        depth = mi.UInt32(0)
        before = dr.zeros(mi.SurfaceInteraction3f)
        density = mi.Float(1)
        ray, active = mi.Ray3f(ray), mi.Bool(True)
        while active:
            si = scene.ray_intersect(ray, ray_flags=mi.RayFlags.Minimal, coherent=(depth == 0))
            si.sh_frame = mi.Frame3f(si.n)
            si.wi = dr.select(si.is_valid(), si.to_local(-ray.d), -ray.d)
            glow = self._glow(si, before, density, depth, active) * self.sky.met(si, ray.d)
            lit = active & si.is_valid() & (dr.dot(si.n, ray.d) < 0)
            row = table.row(si, lit)
            more = lit & (table.kind(row, lit) == DIFFUSE) & ((depth + 1) < self.max_depth)
            u, v, s, t = numbers.take(stream, depth == 0)
            direct = self._direct(si, u, v, more)
            for g in range(groups):
                light[g] = dr.fma(weight[g], glow, light[g])
                weight[g] *= table.at(row, g, more)
                light[g] = dr.fma(weight[g], direct, light[g])
            local = mi.warp.square_to_cosine_hemisphere(mi.Point2f(s, t))
            ray = si.spawn_ray(si.to_world(local))
            before, density = si, local.z * dr.inv_pi
            depth += 1
            bound *= table.largest(row, more)
            survival = dr.select(depth >= ROULETTE_FROM, dr.minimum(bound, 1), 1)
            useful = self._useful(depth)
            cut = dr.select(more & ~useful, bound, cut)
            active = more & useful & (stream.next_float32() < survival)
            share: Any = mi.Float(1) / mi.Float(survival)
            bound *= share
            for g in range(groups):
                weight[g] *= share
        return light, [cut]

    def _glow(self, si: Any, before: Any, density: Any, depth: Any, active: Any) -> Any:
        """Return the light that the surface hit sends out itself, weighted against light sampling after the first ray."""
        own = si.emitter(self.scene).eval(si, active)[0]
        if not self.search.hit:
            return dr.select(depth == 0, own, 0)
        if not self.search.sample:
            return own
        sample = mi.DirectionSample3f(self.scene, si, before)
        by_light = self.lights.density(before, sample, active & (depth > 0))
        return own * dr.select(depth == 0, 1, power_share(density, by_light))

    def _direct(self, si: Any, u: Any, v: Any, active: Any) -> Any:
        """Return light from the sampled lights, times cosine / pi; the reflectance is not in it."""
        total = mi.Float(0)
        if not self.search.sample:
            return total
        for sample, emission in self.lights.samples(si, u, v, active):
            cosine = dr.dot(si.n, sample.d)
            ok = active & (sample.pdf != 0) & (cosine > 0)
            density = cosine * dr.inv_pi
            share = dr.select(sample.delta, 1, power_share(sample.pdf, density)) if self.search.hit else 1
            total += dr.select(ok, density * emission[0] * share * self.sky.sampled(sample), 0)
        return total

    def _useful(self, depth: Any) -> Any:
        """Tell whether a ray that has been reflected ``depth`` times can still bring light home."""
        return (depth < self.max_depth) if self.search.hit else ((depth + 1) < self.max_depth)


def power_share(a: Any, b: Any) -> Any:
    """Weight density a against b by the power heuristic with exponent 2 (Veach and Guibas 1995); 0 where a is 0."""
    return dr.select(a > 0, a * a / (a * a + b * b), 0)
