"""How many reflections a scene's light needs."""

from __future__ import annotations

import math

import numpy as np

from scenes.materials import Diffuse
from scenes.scene import Scene

MAX_DEPTH = 1024
DEEP = 1e-3
COPLANAR = 1e-3
"""Shapes within a slab this thin, relative to their extent, cannot light each other noticeably."""


def reflects_once(scene: Scene) -> bool:
    """Tell whether light is reflected at most once: every shape is diffuse and flat, and all lie in one plane."""
    if not scene.shapes:
        return True
    if not all(isinstance(scene.material_of(shape), Diffuse) for shape in scene.shapes):
        return False
    faces = [shape.polygons() for shape in scene.shapes]
    if any(face is None for face in faces):
        return False
    points = np.concatenate([np.concatenate(face) for face in faces if face is not None])
    middle = points - points.mean(0)
    thickness = (
        np.linalg.svd(middle, full_matrices=False)[1] if len(points) < 4000 else np.sqrt(np.linalg.eigvalsh(middle.T @ middle))[::-1]
    )
    return bool(thickness[-1] <= COPLANAR * thickness[0])


def depth_for(scene: Scene, once: bool, tolerance: float) -> int:
    """Return max_depth: 2 where light is reflected once at most, else so many that what is cut off stays below tolerance / 10.

    In a closed room of reflectance rho the share beyond depth d is rho^d (theory.md R.29): the bound used here.
    """
    if once:
        return 2
    largest = max((m.reflectance.maximum for m in scene.materials.values() if isinstance(m, Diffuse)), default=1.0)
    if largest <= 0:
        return 2
    if largest >= 1 or not all(isinstance(scene.material_of(shape), Diffuse) for shape in scene.shapes):
        return MAX_DEPTH
    return int(min(MAX_DEPTH, max(3, math.ceil(math.log(tolerance / 10) / math.log(largest)))))
