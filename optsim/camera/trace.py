"""Trace rays through plane faces exactly, on NumPy or Dr.Jit arrays (theory.md (C.3), (C.4), (C.19))."""

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


class _Face(NamedTuple):
    """Hold the ray behind a face, and the parts of the wave vector along the normal before (a) and behind (r) it."""

    kx: Array
    kz: Array
    valid: Array
    met: Array
    along: Array
    root: Array


def trace_faces(ops: Ops, kx: Array, kz: Array, norm2: Array, tilts: Sequence[tuple[Array, Array]], excess: Sequence[Array]) -> Traced:
    """Refract wave vectors at a stack of plane faces whose normals lie in the x-z plane (theory.md (C.3)).

    k' = k + (sqrt(n'^2 - n^2 + (k.N)^2) - k.N) N needs one root a face, and n^2 only. k_y is conserved and enters
    through ``norm2`` alone. A root is taken of 1 where its argument is not positive, so that gradients stay finite
    (0) at total reflection; what follows such a root is finite, and masked at the end.

    Args:
        ops: the arrays' operations.
        kx: (n,) or scalar, component along the dispersion, any unit.
        kz: (n,) or scalar, component along the optical axis, in the same unit.
        norm2: |k|^2 in the first medium, which has index 1, in that unit squared.
        tilts: (sin t, cos t) of each face's normal (sin t, 0, cos t).
        excess: n^2 - 1 behind each face, as many as faces.
    """
    return trace_steps(ops, kx, kz, tilts, [e * norm2 for e in excess])


def trace_steps(ops: Ops, kx: Array, kz: Array, tilts: Sequence[tuple[Array, Array]], steps: Sequence[Array]) -> Traced:
    """Trace as :func:`trace_faces`, with ``steps`` = (n^2 - 1) k_0^2 behind each face, k_0^2 = ``norm2``."""
    before: Array = 0.0
    ray = _start(kx, kz)
    for tilt, after in zip(tilts, steps, strict=True):
        ray, before = _refract(ops, ray, tilt, after - before), after
    return Traced(ray.kx, ray.kz, ray.valid & (ray.kz > 0), ray.met)


def transmit_faces(
    ops: Ops, kx: Array, kz: Array, norm2: Array, tilts: Sequence[tuple[Array, Array]], excess: Sequence[Array]
) -> Array:  # fmt: skip
    """Return the share of unpolarised light that passes a stack of faces; arguments as :func:`trace_faces` (theory.md (C.19))."""
    return transmit_steps(ops, kx, kz, norm2, tilts, [e * norm2 for e in excess])


def transmit_steps(
    ops: Ops, kx: Array, kz: Array, norm2: Array, tilts: Sequence[tuple[Array, Array]], steps: Sequence[Array]
) -> Array:  # fmt: skip
    """Return the share of unpolarised light that passes, (n,) in [0, 1], 0 for lost rays; ``steps`` = (n^2 - 1) ``norm2`` behind each face.

    Fresnel's formulas for each polarisation, multiplied over the faces, averaged at the end; light that is reflected
    twice and goes on is stray light and not counted. s and p do not mix as long as the ray stays near the x-z plane.
    """
    before: Array = 0.0
    ray = _start(kx, kz)
    s: Array = 1.0
    p: Array = 1.0
    for tilt, after in zip(tilts, steps, strict=True):
        ray = _refract(ops, ray, tilt, after - before)
        a, r = ops.where(ray.valid, ray.along, 1.0), ops.where(ray.valid, ray.root, 1.0)
        a_p, r_p = (norm2 + after) * a, (norm2 + before) * r
        s = s * (4 * a * r / ((a + r) * (a + r)))
        p = p * (4 * a_p * r_p / ((a_p + r_p) * (a_p + r_p)))
        before = after
    return ops.where(ray.valid & (ray.kz > 0), (s + p) / 2, 0.0)


def _start(kx: Array, kz: Array) -> _Face:
    forward = kz > 0
    return _Face(kx, kz, forward, forward, kz, kz)


def _refract(ops: Ops, ray: _Face, tilt: tuple[Array, Array], step: Array) -> _Face:
    """Refract at one face; ``step`` is (n'^2 - n^2) k_0^2."""
    s, c = tilt
    along = ops.fma(ray.kx, s, ray.kz * c)
    radicand = ops.fma(along, along, step)
    passes, front = radicand > 0, along > 0
    root = ops.sqrt(ops.where(passes, radicand, 1.0))
    gain = root - along
    met = ops.where(ray.valid, ray.met & front, ray.met)  # what a lost ray meets later does not count
    return _Face(ops.fma(gain, s, ray.kx), ops.fma(gain, c, ray.kz), ray.valid & front & passes, met, along, root)


def image_point(ops: Ops, traced: Traced, ky: Array, focal: Array) -> tuple[Array, Array]:
    """Return where a lens of this focal length images the direction k: f (kx, ky) / kz, 0 for lost rays (theory.md (C.5))."""
    scale = ops.where(traced.valid, focal / ops.where(traced.valid, traced.kz, 1.0), 0.0)
    return traced.kx * scale, ky * scale
