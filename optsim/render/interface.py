"""Smooth glass: what is reflected, what goes through, and where wavelengths part (theory.md (R.30), (R.45), (R.46))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from optsim.render.bundle import Bundle
from optsim.render.engine import dr, mi
from optsim.render.materials import MaterialTable


@dataclass
class Crossing:
    """Hold what becomes of a ray at glass.

    Args:
        direction: where it goes, in the surface's frame.
        factors: of its weight, one spectrum a group, or one for all groups.
        step: relative index that it has passed.
        parts: whether it was refracted by dispersing glass, and so keeps one node only.
        meets: whether the glass disperses.
        first: whether a camera ray follows both ways here, this one being the reflected one.
        chance: probability of the reflected one.
    """

    direction: Any
    factors: list[Any]
    step: Any
    parts: Any
    meets: Any
    first: Any
    chance: Any

    def factor(self, group: int) -> Any:
        """Return the factor of a group of nodes."""
        return self.factors[min(group, len(self.factors) - 1)]


@dataclass
class Kept:
    """Keep where a path meets glass, for what is refracted there and followed later.

    Args:
        valid: whether it has met any.
        origin: just behind the surface.
        along: direction of the ray.
        normal: of the surface.
        row: of the material.
        parts: whether the glass disperses.
        weight: of the path before, one spectrum a group.
        index: product of the relative indices passed before.
        depth: rays of the path, the one to the glass included.
        direct: whether nothing before has scattered it.
    """

    valid: mi.Bool
    origin: mi.Point3f
    along: mi.Vector3f
    normal: mi.Vector3f
    row: mi.UInt32
    parts: mi.Bool
    weight: list[Any]
    index: mi.Float
    depth: mi.UInt32
    direct: mi.Bool

    @classmethod
    def at(cls, si: Any, ray: Any, row: Any, parts: Any, weight: list[Any], index: Any, depth: Any, direct: Any) -> Kept:
        """Keep a surface point."""
        place = mi.Point3f(si.spawn_ray(ray.d).o), mi.Vector3f(ray.d), mi.Vector3f(si.sh_frame.n)
        return cls(mi.Bool(True), *place, mi.UInt32(row), mi.Bool(parts), list(weight), index, depth + 1, mi.Bool(direct))

    @classmethod
    def nothing(cls, weight: list[Any]) -> Kept:
        """Return a place without glass; ``weight`` tells the type only."""
        ray = mi.Point3f(0), mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1)
        return cls(mi.Bool(False), *ray, mi.UInt32(0), mi.Bool(False), list(weight), mi.Float(1), mi.UInt32(0), mi.Bool(True))

    def refracted(self, index: Any) -> tuple[Any, Any, Any]:
        """Return the ray that goes through for a refractive index, the weight of its radiance, and the relative index passed."""
        cosine = -dr.dot(self.along, self.normal)
        reflectance, through, step, back = mi.fresnel(cosine, index)
        direction = back * (self.along + cosine * self.normal) + through * self.normal
        return mi.Ray3f(self.origin, dr.normalize(direction)), (1 - reflectance) * back * back, step


class Interface:
    """Reflect or refract at glass.

    Args:
        table: the glasses' indices.
        bundle: what the path carries: of several nodes one is kept where they part.
        both: whether a camera ray that meets glass follows both ways: here it is then always reflected, with the weight for it.
    """

    def __init__(self, table: MaterialTable, bundle: Bundle, both: bool) -> None:
        self.table, self.bundle, self.both = table, bundle, both and table.has_glass
        self.disperses = table.has_dispersion and bundle.nodes > 1

    def cross(self, si: Any, row: Any, node: Any, alone: Any, pick: Any, first: Any, active: Any) -> Crossing:
        """Choose a way at a surface point.

        Args:
            si: the surface point.
            row: of the material.
            node: what the path follows once its nodes have parted.
            alone: whether they have.
            pick: random number in [0, 1).
            first: whether the camera ray itself has come here.
            active: whether there is glass.
        """
        if not self.table.has_glass:
            no = mi.Bool(False)
            return Crossing(mi.Vector3f(0), [mi.Float(0)], mi.Float(1), no, no, no, mi.Float(0))
        reflectance, cosine, step, back = mi.fresnel(si.wi.z, self.table.index(row, node, active))
        first = first if self.both else mi.Bool(False)
        meets, chance = mi.Bool(False), reflectance
        if self.disperses:
            ends = self.table.extremes(row, active)
            meets = active & (ends[0] != ends[1])
            together = meets & ~alone
            chance = dr.select(together, (mi.fresnel(si.wi.z, ends[0])[0] + mi.fresnel(si.wi.z, ends[1])[0]) / 2, chance)
        chance = dr.select(first, 1, chance)
        mirror = pick < chance
        direction = dr.select(mirror, mi.reflect(si.wi), mi.refract(si.wi, cosine, back))
        step = dr.select(mirror, 1, step)
        if not self.disperses:
            factor = dr.select(mirror, dr.select(first, reflectance, 1), back * back)
            return Crossing(direction, [factor], step, mi.Bool(False), meets, first, chance)
        kept = back * back * dr.select(together, self.bundle.nodes * (1 - reflectance) / (1 - chance), 1)
        factors: list[Any] = []
        for g in range(self.bundle.groups):
            shares = reflected(si.wi.z, self.table.indices(row, g, active))
            on = dr.select(together | first, shares / chance, 1)
            through = dr.select(together, self.bundle.only(node, g) * kept, kept)
            factors.append(mi.Spectrum(dr.select(mirror, on, through)))
        return Crossing(direction, factors, step, together & ~mirror, meets, first, chance)


def reflected(cosine: Any, index: Any) -> Any:
    """Return the share of unpolarised light that smooth glass reflects, at several indices at once (Fresnel).

    Args:
        cosine: of the ray's angle with the normal, negative from inside.
        index: of the glass against what lies outside, a Dr.Jit array.
    """
    inside = cosine < 0
    into = dr.select(inside, dr.rcp(index), index)
    c = dr.abs(cosine)
    passed = 1 - (1 - c * c) / (into * into)
    t = dr.sqrt(dr.maximum(passed, 0))
    across, along = (c - into * t) / (c + into * t), (t - into * c) / (t + into * c)
    share = (across * across + along * along) / 2
    return dr.select(index == 1, 0, dr.select((passed <= 0) | (c == 0), 1, share))
