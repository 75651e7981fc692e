"""Aim rays at lights: at each of a few, at one of many by chance (theory.md (R.36))."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from optsim.render.engine import dr, mi

MAX_EACH = 16
"""Up to so many lights are each sampled at every surface; of more, one is picked."""
GOLDEN = (0.6180339887498949, 0.7548776662466927)
"""Lights share one pair of evenly spread numbers, shifted by multiples of these."""


class LightSampler:
    """Sample the emitters of a Mitsuba scene from surface points.

    Args:
        scene: the Mitsuba scene.
        each: whether every light may be sampled on its own; False always picks one.
        aim: False aims at none: one direction sample without light is returned.
    """

    def __init__(self, scene: Any, each: bool = True, aim: bool = True) -> None:
        self._scene, self._aim = scene, aim
        self._emitters = list(scene.emitters())
        self._each = each and aim and 1 < len(self._emitters) <= MAX_EACH

    def samples(self, si: Any, u: Any, v: Any, active: Any) -> Iterator[tuple[Any, Any]]:
        """Yield (direction sample, emission / density, 0 where the light is hidden) for each light, or for one picked by chance."""
        if not self._aim:
            sample = dr.zeros(mi.DirectionSample3f)
            sample.d = si.n
            yield sample, mi.Spectrum(0)
            return
        if not self._each:
            yield self._scene.sample_emitter_direction(si, mi.Point2f(u, v), True, active)
            return
        for i, emitter in enumerate(self._emitters):
            place = [x + i * step for x, step in zip((u, v), GOLDEN)]
            sample, emission = emitter.sample_direction(si, mi.Point2f(*(x - dr.floor(x) for x in place)), active)
            lit = active & (sample.pdf != 0)
            lit &= ~self._scene.ray_test(si.spawn_ray_to(sample.p), lit)
            yield sample, dr.select(lit, emission, 0)

    def density(self, before: Any, sample: Any, active: Any) -> Any:
        """Return the density with which ``samples`` aims from a surface point at what a ray has met."""
        if not self._aim:
            return mi.Float(0)
        return self._scene.pdf_emitter_direction(before, sample, active) * (len(self._emitters) if self._each else 1)
