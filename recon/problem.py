"""The checked and normalised problem that a solver gets, and what it hands back.

Solvers work on frames whose largest value is 1 and on an operator whose largest weight is 1, so that no square
overflows and every tolerance means the same for 1e-12 and for 1e30. Primes below mark the normalised quantities:
``g = light g'``, ``H = strength H'``, ``f = unit f'`` with ``unit = light / strength`` (theory.md (S.8)).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from recon.basis import Basis
from recon.coded_aperture import CodedAperture, empty_cube
from recon.errors import InputError
from recon.field_aperture import FieldAperture
from recon.operator import LinearOperator
from recon.solution import Stop

OnIteration = Callable[[int, float], None]
LARGEST = 1e100  # a frame value whose square is still far from overflow


@dataclass(frozen=True)
class Problem:
    """Estimate f' from g' = H' f' (+ noise), sparse in ``basis``.

    Args:
        operator: H', largest weight 1.
        basis: Psi.
        frames: g', of the operator's type, largest absolute value 1.
        exact_frames: g' in float64.
        light: g / g'.
        unit: f / f'.
        start: first guess of f' (M, N, K), or None for zero.
    """

    operator: LinearOperator
    basis: Basis
    frames: np.ndarray
    exact_frames: np.ndarray
    light: float
    unit: float
    start: np.ndarray | None = None

    def inner_tau(self, tau: float) -> float:
        """Turn an absolute tau of the caller's units into that of the normalised problem."""
        return tau * self.unit / self.light**2

    def outer_tau(self, tau: float) -> float:
        """Turn a tau of the normalised problem into the caller's units."""
        return tau * self.light**2 / self.unit

    def tau_max(self) -> float:
        """Return ``2 max |Psi^T H'^T g'|``, the least normalised tau whose answer is zero (theory.md (S.9))."""
        return 2 * float(np.abs(self.basis.analysis(self.operator.adjoint(self.frames))).max())

    def misfit(self, cube: np.ndarray) -> float:
        """Return ``||g' - H' f'||^2``, summed in float64."""
        gap = self.exact_frames - self.operator.forward(cube)
        return float(np.vdot(gap, gap))

    def l1(self, cube: np.ndarray) -> float:
        """Return ``||Psi^T f'||_1``, summed in float64."""
        return float(np.abs(self.basis.analysis(cube)).sum(dtype=np.float64))

    def eq4(self, cube: np.ndarray, tau: float) -> float:
        """Return the normalised objective ``||g' - H' f'||^2 + tau ||Psi^T f'||_1`` (theory.md (S.4)); ``tau`` normalised."""
        return self.misfit(cube) + tau * self.l1(cube)


@dataclass(frozen=True)
class Found:
    """A solver's answer in the units of its ``Problem``: cube f', iterations, stop, and the normalised tau (None: no tau)."""

    cube: np.ndarray
    iterations: int
    stop: Stop
    tau: float | None = None
    tau_max: float | None = None
    notes: tuple[str, ...] = ()


class Solver(Protocol):
    """A frozen configuration that can solve a ``Problem``."""

    def solve(self, problem: Problem, on_iteration: OnIteration | None = None) -> Found:
        """Solve; call ``on_iteration(iteration, objective)`` after every iteration, the objective in the caller's units."""
        ...


def prepare(operator: LinearOperator, frames: np.ndarray, basis: Basis, start: np.ndarray | None = None) -> Problem | None:
    """Check and normalise; None when the frames are zero everywhere.

    Raises:
        InputError: ``frames`` for a wrong shape or for values that are not finite, with their count and the first place;
            ``start`` likewise; ``basis.*`` when the basis doesn't fit the cube.
    """
    values = checked_frames(frames, operator.out_shape)
    light = float(np.abs(values).max())
    if light == 0:
        return None
    inner, strength = operator.normalised() if isinstance(operator, CodedAperture | FieldAperture) else (operator, 1.0)
    unit = light / strength
    if not (math.isfinite(unit) and unit > 0):
        raise InputError("frames", light, f"such that frames / response is a finite number; the operator's largest weight is {strength:g}")
    first = None
    if start is not None:
        guess = np.asarray(start, np.float64)
        if guess.shape != tuple(operator.in_shape) or not np.isfinite(guess).all():
            raise InputError("start", guess.shape, f"a finite cube of shape {tuple(operator.in_shape)}")
        first = (guess / unit).astype(operator.dtype)
    exact = np.ascontiguousarray(values / light)
    return Problem(inner, basis, exact.astype(operator.dtype), exact, light, unit, first)


def checked_frames(frames: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return frames as float64 after refusing a wrong shape and values that are not finite.

    Raises:
        InputError: field ``frames``, with the count and the first bad (shot, channel, row, column).
    """
    values = np.asarray(frames)
    if values.shape != tuple(shape):
        raise InputError("frames", values.shape, f"of the operator's shape (shots, channels, rows, columns) = {tuple(shape)}")
    if not (np.issubdtype(values.dtype, np.floating) or np.issubdtype(values.dtype, np.integer)):
        raise InputError("frames", str(values.dtype), "real numbers")
    values = values.astype(np.float64)
    bad = ~np.isfinite(values)
    if bad.any():
        where: tuple[Any, ...] = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            "frames", float(values[where]), f"finite; {int(bad.sum())} values are not, first (shot, channel, row, column) is {where}"
        )
    if np.abs(values).max(initial=0.0) > LARGEST:
        raise InputError("frames", float(np.abs(values).max()), f"at most {LARGEST:g} in absolute value")
    return values


def edge_cases(problem: Problem, tau: float, tau_max: float, max_iterations: int) -> Found | None:
    """Answer Eq. 4 where no iteration is needed: no iterations allowed, or tau at or above tau_max; else None."""
    if max_iterations == 0:
        return first_guess(problem, tau, tau_max)
    if tau >= tau_max:
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
