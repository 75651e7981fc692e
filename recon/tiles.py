"""Pictures too large to solve at once: overlapping strips of rows (theory.md (S.71)).

A coded-aperture camera that disperses along its rows couples no two rows: a strip of rows is a whole camera, and only the prior reaches
across. So strips need no other margin than what the prior asks for, and where two strips overlap any mean of their
answers explains the frames as well as they do: they are faded into each other.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import Field

from recon.coded_aperture import CodedAperture, empty_cube
from recon.config import Config
from recon.errors import InputError
from recon.solution import Stop
from recon.solve import reconstruct

OnStrip = Callable[[int, int], None]


class Tiling(Config):
    """How a picture is cut into strips.

    Args:
        rows: rows of its own that a strip has; more cost memory, fewer cost time: each strip also solves its overlaps.
        overlap: rows that neighbours share, at most ``rows``; 0: hard seams.
    """

    rows: int = Field(default=256, ge=1)
    overlap: int = Field(default=64, ge=0)

    def strips(self, rows: int) -> list[tuple[int, int]]:
        """Return first and last + 1 row of each strip of a picture."""
        count = max(1, round(rows / self.rows))
        if count > 1 and self.overlap > self.rows:
            raise InputError("Tiling.overlap", self.overlap, f"at most rows = {self.rows}")
        edges = [rows * i // count for i in range(count + 1)]
        before, after = self.overlap // 2, self.overlap - self.overlap // 2
        pairs = list(pairwise(edges))
        return [(max(0, a - before) if i else 0, min(rows, b + after) if i < count - 1 else rows) for i, (a, b) in enumerate(pairs)]


@dataclass(frozen=True)
class Tiled:
    """The cube of all strips.

    Args:
        cube: (M, N, K), in the caller's units.
        stops: why each strip's solver stopped.
        residual: ``||g - H f|| / ||g||`` of the whole picture.
        seam: rms difference of neighbouring strips' answers in the middle of their overlaps, in the cube's units: a step at a seam is no
            larger. 0 when there is one strip or no overlap.
        seconds: wall time.
    """

    cube: np.ndarray
    stops: tuple[Stop, ...]
    residual: float
    seam: float
    seconds: float

    @property
    def converged(self) -> bool:
        """Tell whether all strips converged."""
        return all(stop.converged for stop in self.stops)


def reconstruct_tiled(
    operator: CodedAperture,
    frames: np.ndarray,
    tiling: Tiling | None = None,
    *,
    noise: np.ndarray | None = None,
    start: np.ndarray | None = None,
    out: np.ndarray | None = None,
    on_strip: OnStrip | None = None,
    **arguments: Any,
) -> Tiled:
    """Estimate a cube strip by strip: memory is that of one strip, and the answer's.

    Args:
        operator: a camera whose rows don't couple.
        frames: (L, C, M, W).
        tiling: None: ``Tiling()``.
        noise: as for ``reconstruct``.
        start: as for ``reconstruct``.
        out: (M, N, K) array for the answer, e.g. a memory map; None: a new one of the operator's type.
        on_strip: called as ``on_strip(done, count)`` after each strip.
        arguments: prior, solver, tau (a number; the same for all strips), nonnegative, threads of ``reconstruct``.

    Raises:
        InputError: ``operator`` for a camera that couples rows; ``tau`` for a rule; and as ``reconstruct``.
    """
    began = time.perf_counter()
    if not isinstance(operator, CodedAperture):
        raise InputError("operator", type(operator).__name__, "a CodedAperture: only there a strip of rows is a camera of its own")
    if arguments.get("tau") is not None and not isinstance(arguments["tau"], int | float | np.number):
        raise InputError("tau", arguments["tau"], "a number, the same for all strips; let the rule choose it on one strip first")
    values = np.asarray(frames)
    if values.shape != operator.out_shape:
        raise InputError("frames", values.shape, f"of the operator's shape {operator.out_shape}")
    every = None if noise is None else np.broadcast_to(noise, operator.out_shape)
    strips = (Tiling() if tiling is None else tiling).strips(operator.in_shape[0])
    cube = _target(operator, out)
    stops, gaps, before = [], [], 0
    for i, (first, last) in enumerate(strips):
        rows = slice(first, last)
        solved, stop = _solve(operator, values, rows, None if every is None else every[:, :, rows], start, arguments)
        gaps += _lay(solved, cube, first, before)
        stops.append(stop)
        before = last
        if on_strip is not None:
            on_strip(i + 1, len(strips))
    seam = math.sqrt(float(np.mean(gaps))) if gaps else 0.0
    return Tiled(cube, tuple(stops), _residual(operator, cube, values, strips), seam, time.perf_counter() - began)


def strip_of(operator: CodedAperture, rows: slice) -> CodedAperture:
    """Return the camera of some rows."""
    return operator.replace(masks=operator.masks[:, rows], mosaic=None if operator.mosaic is None else operator.mosaic[rows])


def _target(operator: CodedAperture, out: np.ndarray | None) -> np.ndarray:
    if out is None:
        return empty_cube(operator.in_shape, operator.dtype)
    if out.shape != operator.in_shape or not np.issubdtype(out.dtype, np.floating):
        raise InputError("out", (out.shape, str(out.dtype)), f"of shape {operator.in_shape} and a floating type")
    return out


def _solve(
    operator: CodedAperture,
    frames: np.ndarray,
    rows: slice,
    noise: np.ndarray | None,
    start: np.ndarray | None,
    arguments: dict[str, Any],
) -> tuple[np.ndarray, Stop]:
    if not operator.masks[:, rows].any():
        shape = (rows.stop - rows.start, *operator.in_shape[1:])
        return np.zeros(shape, operator.dtype), Stop(f"all masks are closed in the rows {rows.start}..{rows.stop - 1}: zero", True)
    first = None if start is None else start[rows]
    solution = reconstruct(strip_of(operator, rows), frames[:, :, rows], noise=noise, start=first, **arguments)
    return solution.cube, solution.stop


def _lay(solved: np.ndarray, cube: np.ndarray, first: int, before: int) -> list[float]:
    """Fade a strip into the rows ``first..before`` that are there already and copy the rest; return the squared gap amid the overlap."""
    shared = max(0, before - first)
    cube[first + shared : first + solved.shape[0]] = solved[shared:]
    if shared == 0:
        return []
    share = ((np.arange(shared) + 0.5) / shared).astype(cube.dtype)[:, None, None]
    middle = slice(max(0, shared // 2 - 1), shared // 2 + 1)
    gap = solved[:shared][middle].astype(np.float64) - cube[first : first + shared][middle]
    cube[first : first + shared] += share * (solved[:shared] - cube[first : first + shared])
    return [float(np.mean(gap**2))]


def _residual(operator: CodedAperture, cube: np.ndarray, frames: np.ndarray, strips: list[tuple[int, int]]) -> float:
    missed = light = 0.0
    for first, last in _disjoint(strips):
        rows = slice(first, last)
        g = frames[:, :, rows].astype(np.float64)
        light += float(np.vdot(g, g))
        if operator.masks[:, rows].any():
            g -= strip_of(operator, rows).forward(np.asarray(cube[rows]))
        missed += float(np.vdot(g, g))
    return math.sqrt(missed / light) if light > 0 else 0.0


def _disjoint(strips: list[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    first = 0
    for _, last in strips:
        yield first, last
        first = last
