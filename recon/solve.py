"""The one verb: from frames and the operator that took them back to the cube."""

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from recon import coordinates
from recon import threads as pool
from recon.adapted import Adapted, adapted
from recon.coded_aperture import CodedAperture, empty_cube
from recon.errors import InputError
from recon.field_aperture import FieldAperture
from recon.operator import LinearOperator, Operator, RowWeighted, in_precision
from recon.precision import TooCoarse, check
from recon.prior import Prior
from recon.problem import Found, OnIteration, Problem, Solver, pose
from recon.solution import Solution, Stop

if TYPE_CHECKING:
    from recon.tau import TauRule

UNEXPLAINED = 1e-3
"""Relative residual of a solver that explains the frames where it can, above which rounding is not the reason."""
REAL_NUMBER = (int, float, np.integer, np.floating)


def reconstruct(
    operator: Operator,
    frames: np.ndarray,
    *,
    prior: Prior | None = None,
    solver: Solver | None = None,
    tau: "float | TauRule | None" = None,
    noise: np.ndarray | None = None,
    nonnegative: bool = False,
    start: np.ndarray | None = None,
    threads: int | None = None,
    on_iteration: OnIteration | None = None,
) -> Solution:
    """Estimate the cube that the operator photographed into ``frames``.

    Args:
        operator: H: a ``CodedAperture``, or any object with in_shape, out_shape, forward and adjoint (see ``Operator``). Its
            dtype, without one float32, is the precision of the solve; where float32 would lose, float64 is taken and noted.
        frames: measurements of the operator's ``out_shape``, a camera's are (L, C, M, W); finite, any unit.
        prior: R; None: ``L1()``, the paper's.
        solver: a solver's configuration; None: ``BasisPursuit()``, which needs no tau, or ``Admm()`` when a tau is given.
        tau: weight of R in ``||g - H f||^2 + tau R(f)``, absolute and at least 0, or a rule that finds one without ground truth;
            None: ``AutoTau()`` for solvers with a tau. 0 is plain least squares.
        noise: variance of each measurement, broadcastable to the frames, in their squared unit: the misfit is then weighted by
            ``W = c / variance``, c such that W has mean 1 and tau keeps its meaning (theory.md (S.54)). Infinite: left out.
        nonnegative: look among cubes >= 0 only; the answer is exactly >= 0.
        start: (M, N, K) first guess in the cube's units.
        threads: threads of the kernels; None: all cores. The bytes of the answer don't depend on it.
        on_iteration: called as ``on_iteration(iteration, objective)``; what it raises ends the solve.

    Returns:
        The estimate in units of frames / response, with the reason why the solver stopped.

    Raises:
        InputError: for operator, frames, prior, tau, noise, start or threads that make no sense; the message names the field.
    """
    began = time.perf_counter()
    solver = default_solver(tau) if solver is None else solver
    check_solver(solver, on_iteration)
    check_tau(solver, tau)
    operator = adapted(operator)
    with pool.use(threads):
        problem = pose(operator, frames, prior, start=start, noise=noise, nonnegative=nonnegative)
        if problem is None:
            return _dark(operator, solver, tau, time.perf_counter() - began)
        operator, faults, sound = _examined(operator, solver)
        value, first, notes = _resolved(tau, operator, frames, prior, noise, nonnegative) if solver.needs_tau else (None, None, ())
        start = first if start is None else start

        def posed(operator: LinearOperator) -> Problem | None:
            return pose(operator, frames, prior, start=start, tau=value, noise=noise, nonnegative=nonnegative)

        try:
            problem, found = _found(posed(operator), solver, on_iteration)
        except TooCoarse as reason:
            operator = in_precision(operator, np.dtype(np.float64))
            notes += (f"solved in float64, as float32 would lose: {reason}",)
            problem, found = _found(posed(operator), solver, on_iteration)
        told = (*faults, *_notes(operator), *notes)
        return replace(_solution(problem, found if sound else _unsound(found), told, began), solver=type(solver).__name__)


def _unsound(found: Found) -> Found:
    """Return what was found with an adjoint that is none: not converged, whatever the solver says."""
    return replace(found, stop=Stop(f"{found.stop.reason}; but adjoint and forward contradict each other: mend them first", False))


def _examined(operator: LinearOperator, solver: Solver) -> tuple[LinearOperator, tuple[str, ...], bool]:
    """Return the operator to solve with, what speaks against it, and whether its adjoint is right; only those of others are in doubt."""
    from recon.admm import Admm
    from recon.basis_pursuit import BasisPursuit
    from recon.gap import Gap

    if isinstance(operator, RowWeighted):
        inner, faults, sound = _examined(operator.operator, solver)
        return operator if inner is operator.operator else RowWeighted(inner, operator.weights), faults, sound
    if isinstance(operator, Adapted):
        return operator.examined(gram=isinstance(solver, Admm | BasisPursuit | Gap))
    return operator, (), True


def _found(problem: Problem | None, solver: Solver, on_iteration: OnIteration | None) -> tuple[Problem, Found]:
    assert problem is not None
    check(problem, solver)
    return problem, coordinates.solve(problem, solver, on_iteration)


def default_solver(tau: "float | TauRule | None" = None) -> Solver:
    """Return basis pursuit, or ADMM when there is a tau."""
    if tau is None:
        from recon.basis_pursuit import BasisPursuit

        return BasisPursuit()
    from recon.admm import Admm

    return Admm()


def check_solver(solver: Solver, on_iteration: OnIteration | None) -> None:
    """Refuse names, classes and whatever else can't solve, and what can't be called back."""
    if isinstance(solver, type) or not callable(getattr(solver, "solve", None)) or not isinstance(getattr(solver, "needs_tau", None), bool):
        raise InputError("solver", solver, "a solver's configuration such as recon.Admm(), neither a name nor a class, or None")
    if on_iteration is not None and not callable(on_iteration):
        raise InputError("on_iteration", on_iteration, "a function on_iteration(iteration, objective), or None")


def check_tau(solver: Solver, tau: "float | TauRule | None") -> None:
    """Refuse a tau that is no weight and no rule, and any tau for a solver that has none."""
    if tau is None:
        return
    if not solver.needs_tau:
        raise InputError("tau", tau, f"absent with {type(solver).__name__}, which has none; Admm, Fista and Gpsr take one")
    if not isinstance(tau, np.ndarray | np.generic | type) and callable(getattr(tau, "choose", None)):
        return
    if isinstance(tau, bool) or not isinstance(tau, REAL_NUMBER) or not (math.isfinite(tau) and tau >= 0):
        allowed = "a finite number of at least 0, in squared units of the frames over units of the cube, or a rule such as AutoTau()"
        raise InputError("tau", tau, allowed)


def _resolved(
    tau: "float | TauRule | None",
    operator: LinearOperator,
    frames: np.ndarray,
    prior: Prior | None,
    noise: np.ndarray | None,
    nonnegative: bool,
) -> tuple[float, np.ndarray | None, tuple[str, ...]]:
    """Return the absolute tau and, where a rule found it, a first guess and the rule's reason."""
    from recon.tau import AutoTau, Given

    tau = AutoTau() if tau is None else tau
    if isinstance(tau, REAL_NUMBER):
        return float(tau), None, ()
    choice = tau.choose(operator, frames, Given(prior, noise, nonnegative))
    return choice.tau, choice.start, (choice.reason,)


def _solution(problem: Problem, found: Found, notes: tuple[str, ...], began: float) -> Solution:
    if problem.nonnegative:
        np.maximum(found.cube, 0, out=found.cube)
    misfit, value = problem.misfit(found.cube), found.value if found.value is not None else problem.penalty.value(found.cube)
    objective = value * problem.unit if found.tau is None else (misfit + found.tau * value) * problem.light**2
    size = float(np.vdot(problem.exact_frames, problem.exact_frames))
    residual = math.sqrt(misfit / size)
    if found.tau is None and found.stop.converged and residual > UNEXPLAINED:
        notes += (f"H explains all but {100 * residual:.2g} % of the frames: noise, or are shifts, masks or the dark level wrong?",)
    return Solution(
        cube=_scaled(found.cube, problem.unit),
        objective=objective,
        stop=found.stop,
        iterations=found.iterations,
        tau=None if found.tau is None else problem.outer_tau(found.tau),
        seconds=time.perf_counter() - began,
        residual=residual,
        tau_max=None if found.tau_max is None else problem.outer_tau(found.tau_max),
        notes=(*notes, *found.notes),
    )


def _dark(operator: LinearOperator, solver: Solver, tau: "float | TauRule | None", seconds: float) -> Solution:
    cube = empty_cube(tuple(operator.in_shape), operator.dtype)
    cube[...] = 0
    weight = (float(tau) if isinstance(tau, REAL_NUMBER) else 0.0) if solver.needs_tau else None
    stop = Stop("the frames are zero everywhere, and so is the answer", True)
    return Solution(cube, 0.0, stop, 0, weight, seconds, 0.0, None if weight is None else 0.0, _notes(operator), type(solver).__name__)


def _scaled(cube: np.ndarray, unit: float) -> np.ndarray:
    """Multiply by ``unit``; go to float64 where float32 would overflow or lose its small numbers."""
    largest = float(np.abs(cube).max()) * unit
    limits = np.finfo(cube.dtype)
    if largest < 0.1 * float(limits.max) and (largest > 1e8 * float(limits.tiny) or largest == 0) and unit < 0.1 * float(limits.max):
        return np.asarray(cube * cube.dtype.type(unit))
    return np.asarray(cube.astype(np.float64) * unit)


def _notes(operator: LinearOperator) -> tuple[str, ...]:
    if isinstance(operator, RowWeighted):
        return _notes(operator.operator)
    if not isinstance(operator, CodedAperture | FieldAperture):
        return ()
    shots, repeated = operator.out_shape[0], operator.repeated_shots()
    notes, closed = [], operator.closed_shots()
    if closed:
        notes.append(f"{len(closed)} of {shots} shots have a mask that is closed everywhere and tell nothing: {_listed(closed)}")
    if repeated:
        notes.append(f"{shots} shots share {shots - repeated} different masks: a repeated mask adds light, but the rank of H does not grow")
    if operator.masks.min() == 1:
        notes.append("all masks are fully open: the frames are not coded")
    return tuple(notes)


def _listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[:12])) + (", ..." if len(numbers) > 12 else "")
