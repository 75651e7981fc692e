"""Trace rays through plane faces exactly, on NumPy or Dr.Jit arrays (theory.md (C.3), (C.4))."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from optsim.camera.arrays import Array, Ops


class Traced(NamedTuple):
    """Hold the wave vectors behind the last face.

    Args:
        kx, kz: in-plane components, in the unit of the entering ones; finite also where the ray is lost.
        valid: True where every face transmits the ray.
        met: True where the ray meets every face from its front.
    """

    kx: Array
    kz: Array
    valid: Array
    met: Array


def trace_faces(ops: Ops, kx: Array, kz: Array, norm2: Array, tilts: Sequence[tuple[Array, Array]], excess: Sequence[Array]) -> Traced:
    """Refract wave vectors at a stack of plane faces whose normals lie in the x-z plane (theory.md (C.3)).

    k' = k + (sqrt(n'^2 - n^2 + (k.N)^2) - k.N) N needs one root a face, and n^2 only. k_y is conserved and enters
    through ``norm2`` alone. A root is taken of 1 where its argument is not positive, so that gradients stay finite
    (0) at total reflection.

    Args:
        ops: the arrays' operations.
        kx: (n,) or scalar, component along the dispersion, any unit.
        kz: (n,) or scalar, component along the optical axis, in the same unit.
        norm2: |k|^2 in the first medium, which has index 1, in that unit squared.
        tilts: (sin t, cos t) of each face's normal (sin t, 0, cos t).
        excess: n^2 - 1 behind each face, as many as faces.
    """
    before: Array = 0.0
    valid = met = kz > 0
    for (s, c), after in zip(tilts, excess, strict=True):
        along = kx * s + kz * c
        radicand = (after - before) * norm2 + along * along
        met = met & (along > 0)
        valid = valid & (along > 0) & (radicand > 0)
        gain = ops.where(valid, ops.sqrt(ops.where(valid, radicand, 1.0)) - along, 0.0)
        kx, kz, before = kx + gain * s, kz + gain * c, after
    return Traced(kx, kz, valid & (kz > 0), met)


def image_point(ops: Ops, traced: Traced, ky: Array, focal: Array) -> tuple[Array, Array]:
    """Return where a lens of this focal length images the direction k: f (kx, ky) / kz, 0 for lost rays (theory.md (C.5))."""
    scale = focal / ops.where(traced.valid, traced.kz, 1.0)
    return ops.where(traced.valid, traced.kx * scale, 0.0), ops.where(traced.valid, ky * scale, 0.0)
