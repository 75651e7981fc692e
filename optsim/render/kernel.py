"""Launch an integrator over a picture: one thread a pixel, the sample loop inside the kernel, no film.

The pixel is sampled uniformly: an exact box filter, as a sensor pixel or a mirror integrates over its area (theory.md (R.25)). Nothing is
scattered with atomics, so repeats agree bit by bit.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from optsim.render.bundle import Bundle
from optsim.render.engine import dr, mi
from optsim.render.frame import CameraRays
from optsim.render.sampling import FirstNumbers, PathSampler, seed_words
from optsim.render.tiles import Samples, Traced

SAMPLES_A_LAUNCH = 4096
"""Float32 sums inside a kernel stay this short; launches are added in float64."""
VALUES_A_TILE = 2**26
"""Largest number of pixels x nodes of one launch: 256 MiB of results."""


class Integrator(Protocol):
    """Trace one path per thread; see :class:`optsim.render.diffuse_table.DiffuseTable`."""

    bundle: Bundle
    splits: bool
    tallies: int

    def radiance(self, ray: Any, stream: Any, numbers: FirstNumbers, lane: Any) -> Any:
        """Return transport as ``groups`` spectra and ``tallies`` floats, the first the share of light cut off."""
        ...


def trace(integrator: Integrator, rays: CameraRays, size: tuple[int, int], samples: Samples, key: tuple[int, ...]) -> Traced:
    """Render one independent pass.

    Args:
        integrator: what to trace.
        rays: the camera.
        size: picture (height, width).
        samples: paths of each pixel, 0 or more.
        key: whole numbers that name the pass: seed, light group, pass. Other keys give independent noise.

    Returns:
        mean transport, 0 without paths, and what the paths tell of themselves.
    """
    width, pixels = size[1], samples.counts.size
    bundle = integrator.bundle
    total = np.zeros((bundle.lanes * bundle.nodes, pixels))
    told = np.zeros((integrator.tallies, pixels))
    step = max(1, VALUES_A_TILE // (width * len(total))) * width
    shift = seed_words(*key, 0)
    once = dr.scoped_set_flag(dr.JitFlag.OptimizeLoops, False)  # loops inside loops are else traced 2, 4, 8 times: half of a short pass
    with dr.suspend_grad(), once:
        for first in range(0, pixels, step):
            here = slice(first, min(first + step, pixels))
            counts = samples.counts[here]
            for launch, start in enumerate(range(0, int(counts.max(initial=0)), SAMPLES_A_LAUNCH)):
                stop = np.minimum(counts, start + SAMPLES_A_LAUNCH).astype(np.uint32)
                words = seed_words(*key, launch + 1)
                sums, tallies = _launch(integrator, rays, size, samples.first + first, (start, stop), shift, words)
                for n in range(bundle.nodes):
                    total[n :: bundle.nodes, here] += np.array(sums[n]).reshape(bundle.lanes, -1)
                for row, tally in zip(told, tallies):
                    row[here] += np.array(tally).reshape(bundle.lanes, -1).mean(0, dtype=np.float64)
    paths = np.maximum(samples.counts, 1)
    cut = float(told[0].sum()) / max(1, int(samples.counts.sum(dtype=np.int64)))
    return Traced(total / paths, cut, told[1:] / paths)


class _Lens:
    """Displace and turn rays by their place on the camera's lens."""

    def __init__(self, rays: CameraRays) -> None:
        self._has_lens = rays.has_lens
        self._axes = [
            mi.Vector3f(*[dr.opaque(mi.Float, float(x)) for x in (factor or 0.0) * axis])
            for factor in (rays.start_lens, rays.turn_lens)
            for axis in (rays.right, rays.up)
        ]

    def moves(self, place: list[Any]) -> tuple[Any, Any]:
        """Return what to add to origin and direction, for two numbers in [0, 1); nothing for a pinhole."""
        if not self._has_lens:
            return mi.Vector3f(0), mi.Vector3f(0)
        disc = mi.warp.square_to_uniform_disk_concentric(mi.Point2f(place[0], place[1]))
        right, up, turn_right, turn_up = self._axes
        return disc.x * right + disc.y * up, disc.x * turn_right + disc.y * turn_up


@dr.syntax
def _launch(
    integrator: Any, rays: Any, size: Any, first: int, samples: tuple[int, np.ndarray], shift: tuple[int, int], words: tuple[int, int]
) -> Any:
    bundle = integrator.bundle
    height, width = (dr.opaque(mi.UInt32, side) for side in size)
    start_at, stop_at = samples
    count = stop_at.size
    thread = dr.arange(mi.UInt32, bundle.lanes * count)
    lane = thread // dr.opaque(mi.UInt32, count)
    own = thread - lane * dr.opaque(mi.UInt32, count)
    pixel = own + dr.opaque(mi.UInt32, first)
    column, row = mi.Float(pixel % width), mi.Float(pixel // width)
    sampler = PathSampler(pixel, shift, words, rays.has_lens, integrator.splits)
    stream = sampler.stream
    start, start_a, start_b, forward, turn_a, turn_b = (
        mi.Vector3f(*[dr.opaque(mi.Float, float(x)) for x in getattr(rays, name)])
        for name in ("start", "start_a", "start_b", "forward", "turn_a", "turn_b")
    )
    lens = _Lens(rays)
    sums = [bundle.dark() for _ in range(bundle.groups)]
    tallies = [mi.Float(0) for _ in range(integrator.tallies)]
    index = dr.opaque(mi.UInt32, start_at)
    stop = dr.gather(mi.UInt32, mi.UInt32(stop_at), own)
    while index < stop:
        x, y, numbers, place = sampler.first(index)
        a = 2 * (column + x) / mi.Float(width) - 1
        b = 2 * (row + y) / mi.Float(height) - 1
        from_lens, turned = lens.moves(place)
        origin, toward = start + a * start_a + b * start_b + from_lens, forward + a * turn_a + b * turn_b + turned
        ray = mi.Ray3f(mi.Point3f(origin), dr.normalize(toward))
        light, told = integrator.radiance(ray, stream, numbers, lane)
        for g in range(bundle.groups):
            sums[g] += light[g]
        for i in range(integrator.tallies):
            tallies[i] += told[i]
        index += 1
    flat = bundle.split(sums)
    dr.eval(flat, tallies)
    return flat, tallies
