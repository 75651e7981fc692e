"""How many reflections a scene's light needs."""

from __future__ import annotations

import math

from scenes.materials import Lambertian
from scenes.scene import Scene

MAX_DEPTH = 1024


def depth_for(scene: Scene, once: bool, tolerance: float) -> int:
    """Return max_depth: 2 where light is reflected once at most, else so many that what is cut off stays below tolerance / 10.

    In a closed room of reflectance rho the share beyond depth d is rho^d (theory.md (R.29)): the bound used here.
    """
    if once:
        return 2
    largest = max((m.largest for m in scene.materials.values() if isinstance(m, Lambertian)), default=1.0)
    if largest <= 0:
        return 2
    if largest >= 1 or not all(isinstance(scene.material_of(shape), Lambertian) for shape in scene.shapes):
        return MAX_DEPTH
    return int(min(MAX_DEPTH, max(3, math.ceil(math.log(tolerance / 10) / math.log(largest)))))
