"""The checked and normalised problem that a solver gets, and what it hands back.

Solvers work on frames whose largest value is 1 and on an operator whose largest weight is 1, so that no square
overflows and every tolerance means the same for 1e-12 and for 1e30. Primes below mark the normalised quantities:
``g = light g'``, ``H = strength H'``, ``f = unit f'`` with ``unit = light / strength`` (theory.md (S.8)).
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from recon.adapted import Adapted, adapted
from recon.arrays import as_double, real_array, require
from recon.coded_aperture import CodedAperture, empty_cube
from recon.errors import InputError
from recon.field_aperture import FieldAperture
from recon.l1 import L1
from recon.nonnegative import NonNegative
from recon.operator import LinearOperator, Operator, RowWeighted, frame_axes
from recon.prior import Penalty, Prior
from recon.solution import Stop

OnIteration = Callable[[int, float], None]
LARGEST = 1e100  # a frame value whose square is still far from overflow
LEFT_OUT = "; fill them and say noise=inf there to leave them out"
CUBE_AXES = " (row, column, band)"
SMALLEST, LARGEST_NUMBER = sys.float_info.min, sys.float_info.max
PROBE = 4099  # random numbers that tell whether an operator is 0


@dataclass(frozen=True)
class Problem:
    """Estimate f' from g' = H' f' (+ noise) under a prior.

    Args:
        operator: H', largest weight 1; with known noise W^(1/2) H' as a ``RowWeighted`` (theory.md (S.54)).
        penalty: the prior R, bound to this solve.
        frames: g' (with known noise W^(1/2) g'), of the operator's type, largest absolute value 1.
        exact_frames: g' in float64.
        light: g / g'.
        unit: f / f'.
        start: first guess of f' (M, N, K), or None for zero.
        tau: normalised weight of R; None for solvers without one.
        nonnegative: the penalty contains f >= 0.
        prior_name: what the caller knows the penalty as.
    """

    operator: LinearOperator
    penalty: Penalty
    frames: np.ndarray
    exact_frames: np.ndarray
    light: float
    unit: float
    start: np.ndarray | None = None
    tau: float | None = None
    nonnegative: bool = False
    prior_name: str = "L1"

    @property
    def weight(self) -> float:
        """Return the normalised tau of a solver that has one."""
        assert self.tau is not None
        return self.tau

    def inner_tau(self, tau: float) -> float:
        """Turn an absolute tau of the caller's units into that of the normalised problem; finite, as large as numbers get at most."""
        square = self.light**2
        turned = tau * self.unit / square if square >= SMALLEST else (tau / self.light) * (self.unit / self.light)
        return min(turned, LARGEST_NUMBER)

    def outer_tau(self, tau: float) -> float:
        """Turn a tau of the normalised problem into the caller's units; finite, as large as numbers get at most."""
        square = self.light**2
        turned = tau * square / self.unit if square >= SMALLEST else tau * self.light * (self.light / self.unit)
        return min(turned, LARGEST_NUMBER)

    def tau_max(self) -> float | None:
        """Return the least normalised tau whose answer is zero (theory.md (S.9)); None where the prior has no formula for it."""
        return self.penalty.tau_max(self.operator.adjoint(self.frames))

    def reference_tau(self) -> float:
        """Return what fractions of tau refer to: ``tau_max``, or ``2 max |H'^T g'|`` where the prior has none."""
        correlation = self.operator.adjoint(self.frames)
        known = self.penalty.tau_max(correlation)
        return 2 * float(np.abs(correlation).max()) if known is None else known

    def counting(self) -> np.ndarray:
        """Tell which measurements count: bool of the frames' shape, False where a weight of 0 leaves one out."""
        counts, operator = np.ones(self.exact_frames.shape, bool), self.operator
        while isinstance(operator, RowWeighted):
            counts &= operator.weights > 0
            operator = operator.operator
        return counts

    def photographed(self, cube: np.ndarray) -> np.ndarray:
        """Return H' f' in float64 for a cube in the caller's units: what ``exact_frames`` are compared with."""
        normal = (cube.astype(np.float64) / self.unit).astype(self.operator.dtype)
        return np.asarray(self.operator.forward(normal), np.float64)

    def misfit(self, cube: np.ndarray) -> float:
        """Return ``||g' - H' f'||^2``, summed in float64."""
        gap = self.exact_frames - self.operator.forward(cube)
        return float(np.vdot(gap, gap))

    def eq4(self, cube: np.ndarray, tau: float) -> float:
        """Return the normalised objective ``||g' - H' f'||^2 + tau R(f')`` (theory.md (S.4)); ``tau`` normalised."""
        return self.misfit(cube) + tau * self.penalty.value(cube)


@dataclass(frozen=True)
class Found:
    """A solver's answer in the units of its ``Problem``: cube f', iterations, stop, and the normalised tau (None: no tau).

    ``value`` is R(f') where the solver knows it better than the penalty, as with coefficients beyond a padded picture's edge.
    """

    cube: np.ndarray
    iterations: int
    stop: Stop
    tau: float | None = None
    tau_max: float | None = None
    notes: tuple[str, ...] = ()
    value: float | None = None


class Solver(Protocol):
    """A frozen configuration that can solve a ``Problem``; ``needs_tau`` tells whether it minimises ``misfit + tau R``."""

    needs_tau: ClassVar[bool]

    def solve(self, problem: Problem, on_iteration: OnIteration | None = None) -> Found:
        """Solve; call ``on_iteration(iteration, objective)`` after every iteration, the objective in the caller's units."""
        ...


def pose(
    operator: Operator,
    frames: np.ndarray,
    prior: Prior | None = None,
    *,
    start: np.ndarray | None = None,
    tau: float | None = None,
    noise: np.ndarray | None = None,
    nonnegative: bool = False,
) -> Problem | None:
    """Check, bind the prior, normalise; None when the frames are zero everywhere.

    Args:
        operator: H.
        frames: g.
        prior: R; None: ``L1()``.
        start: first guess (M, N, K) in the caller's units.
        tau: weight of R in the caller's units; None: none yet.
        noise: variance of each measurement; None: all alike.
        nonnegative: add f >= 0 to the prior.

    Raises:
        InputError: ``frames`` for a wrong shape or for values that are not finite, with their count and the first place;
            ``start`` and ``noise`` likewise; ``operator`` for one that can't be used; what the prior refuses.
    """
    own = adapted(operator)
    asked = L1() if prior is None else checked_prior(prior)
    if not isinstance(nonnegative, bool | np.bool_):
        raise InputError("nonnegative", nonnegative, "True or False")
    penalty = asked.bind(own.in_shape, own.dtype)
    problem = prepare(own, frames, NonNegative(penalty) if nonnegative else penalty, start, noise)
    if problem is None:
        return None
    return replace(problem, tau=None if tau is None else problem.inner_tau(tau), prior_name=type(asked).__name__)


def checked_prior(prior: Prior) -> Prior:
    """Refuse names, classes, arrays and bases in place of a prior."""
    if isinstance(prior, type) or not callable(getattr(prior, "bind", None)):
        allowed = "a prior such as recon.L1() or recon.TotalVariation(), neither a name nor a class; a basis goes into L1(basis=...)"
        raise InputError("prior", prior, allowed)
    return prior


def prepare(
    operator: LinearOperator, frames: np.ndarray, penalty: Penalty, start: np.ndarray | None = None, noise: np.ndarray | None = None
) -> Problem | None:
    """Check and normalise, as ``pose``, with a penalty that is bound already to the operator's shape and type."""
    values = checked_frames(frames, operator.out_shape)
    root = None if noise is None else root_weights(noise, operator.out_shape)
    if not values.any():
        return None
    inner, strength = normalised(operator)
    if root is not None:
        inner = RowWeighted(inner, root)
        values *= root
    _require_light(inner, root)
    light = float(np.abs(values).max())
    if light == 0:
        return None
    unit = light / strength if strength > 0 else math.inf
    if not (math.isfinite(unit) and unit > 0):
        raise InputError("frames", light, f"such that frames / response is a finite number; the operator's largest weight is {strength:g}")
    first = None
    if start is not None:
        first = (_checked_start(start, tuple(operator.in_shape)) / unit).astype(operator.dtype)
    exact = np.ascontiguousarray(values / light)
    return Problem(inner, penalty, exact.astype(operator.dtype), exact, light, unit, first, nonnegative=isinstance(penalty, NonNegative))


def normalised(operator: LinearOperator) -> tuple[LinearOperator, float]:
    """Return the operator with largest weight 1, and what that was; operators of others stay as they are."""
    if isinstance(operator, RowWeighted):
        inner, strength = normalised(operator.operator)
        return RowWeighted(inner, operator.weights), strength
    return operator.normalised() if isinstance(operator, CodedAperture | FieldAperture | Adapted) else (operator, 1.0)


def _require_light(operator: LinearOperator, root: np.ndarray | None) -> None:
    """Refuse a weighted or field-dependent operator that is 0; a ``CodedAperture`` and ``Adapted`` tell by themselves.

    Random numbers cancel nowhere. A short series of them repeated costs no time; before a refusal all are drawn.
    """
    if isinstance(operator, CodedAperture | Adapted):
        return
    draw, size = np.random.Generator(np.random.Philox(0)), int(np.prod(operator.in_shape))
    for length in (min(size, PROBE), size):
        probe = np.resize(draw.standard_normal(length), operator.in_shape).astype(operator.dtype)
        if operator.forward(probe).any():
            return
    if root is None:
        raise InputError("operator", 0.0, "different from 0 on the sensor: the camera sees nothing")
    allowed = "finite at measurements that see light: the camera sees nothing at those that count"
    raise InputError("noise", f"finite at {int((root > 0).sum())} of {root.size} measurements", allowed)


def root_weights(noise: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return W^(1/2) from the variances: W = c / variance, of mean 1 over the measurements that count (theory.md (S.54)).

    Raises:
        InputError: field ``noise`` for variances that are not positive (infinite leaves a measurement out) or don't fit the frames.
    """
    variance = as_double(real_array("noise", noise, axes=frame_axes(getattr(noise, "shape", ())), instead=LEFT_OUT))
    allowed = "positive variances in squared units of the frames (inf leaves a measurement out)"
    require("noise", variance, variance > 0, allowed, frame_axes(variance.shape))
    if not np.isfinite(variance).any():
        raise InputError("noise", "no finite value", f"{allowed}, some finite")
    try:
        full = np.broadcast_to(variance, shape)
    except ValueError:
        raise InputError("noise", variance.shape, f"broadcastable to the frames, {tuple(shape)}") from None
    weight = full.min() / full
    return np.asarray(np.sqrt(weight / weight[weight > 0].mean()))


def checked_frames(frames: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return frames as float64 after refusing a wrong shape and values that are not finite.

    Raises:
        InputError: field ``frames``, with the count and the first bad (shot, channel, row, column).
    """
    values = real_array("frames", frames, axes=frame_axes(shape), instead=LEFT_OUT)
    if values.shape != tuple(shape):
        raise InputError("frames", values.shape, f"of the operator's shape{frame_axes(shape)} {tuple(shape)}")
    values = as_double(values)
    require("frames", values, np.isfinite(values), "finite", frame_axes(shape))
    require("frames", values, np.abs(values) <= LARGEST, f"at most {LARGEST:g} in absolute value", frame_axes(shape))
    return values


def _checked_start(start: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    guess = as_double(real_array("start", start, axes=CUBE_AXES))
    if guess.shape != shape:
        raise InputError("start", guess.shape, f"a finite cube of shape {shape}")
    require("start", guess, np.isfinite(guess), "a finite cube", CUBE_AXES)
    return guess


def edge_cases(problem: Problem, tau: float, tau_max: float | None, max_iterations: int) -> Found | None:
    """Answer Eq. 4 where no iteration is needed: no iterations allowed, or tau at or above tau_max to rounding; else None."""
    if max_iterations == 0:
        return first_guess(problem, tau, tau_max)
    if tau_max is not None and tau >= tau_max * (1 - 4 * float(np.finfo(problem.operator.dtype).eps)):
        above = f"tau = {problem.outer_tau(tau):.4g} is at or above tau_max = {problem.outer_tau(tau_max):.4g}: the answer is exactly zero"
        return Found(blank(problem), 0, Stop(above + "; lower tau to see something", True), tau, tau_max)
    return None


def first_guess(problem: Problem, tau: float | None, tau_max: float | None) -> Found:
    """Return the start (or zero) for ``max_iterations = 0``."""
    cube = blank(problem)
    if problem.start is not None:
        cube[...] = problem.start
    return Found(cube, 0, Stop("max_iterations = 0: this is the first guess; raise max_iterations", False), tau, tau_max)


def blank(problem: Problem) -> np.ndarray:
    """Return a band-major cube of zeros."""
    cube = empty_cube(tuple(problem.operator.in_shape), problem.operator.dtype)
    cube[...] = 0
    return cube
