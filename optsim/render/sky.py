"""What the sky sends from each direction, relative to its radiance (theory.md (R.35)): Mitsuba's sky is constant, this makes it change."""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.render.engine import dr, mi
from scenes.lights import GradientSky
from scenes.scene import Scene


class SkyShape:
    """Weigh the light of a Mitsuba scene's constant sky by its direction.

    Args:
        scene: the scene.
        lights: indices of the lights that shine in the Mitsuba scene; at most one of them is a sky.
        engine: the Mitsuba scene.
    """

    def __init__(self, scene: Scene, lights: tuple[int, ...], engine: Any) -> None:
        skies = [scene.lights[i] for i in lights if isinstance(scene.lights[i], GradientSky)]
        self.changes = bool(skies)
        if not skies:
            return
        sky = skies[0]
        assert isinstance(sky, GradientSky)
        up = np.asarray(sky.up) / np.linalg.norm(sky.up)
        self._up = mi.Vector3f(*[dr.opaque(mi.Float, float(x)) for x in up])
        self._horizon, self._zenith = dr.opaque(mi.Float, sky.horizon), dr.opaque(mi.Float, sky.zenith)
        self._emitter = mi.EmitterPtr(engine.environment())

    def _share(self, direction: Any) -> Any:
        sine = dr.clip(dr.dot(direction, self._up), 0, 1)
        return self._horizon + (self._zenith - self._horizon) * sine

    def met(self, si: Any, direction: Any) -> Any:
        """Return the factor of the light that a ray of this direction meets: 1 on surfaces."""
        return dr.select(si.is_valid(), 1, self._share(direction)) if self.changes else 1

    def sampled(self, sample: Any) -> Any:
        """Return the factor of a direction sample of the emitters: 1 for all but the sky."""
        return dr.select(sample.emitter == self._emitter, self._share(sample.d), 1) if self.changes else 1
