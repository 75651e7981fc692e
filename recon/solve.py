"""The one verb: from frames and the operator that took them back to the cube."""

import math
import time
from typing import Any

import numpy as np

from recon import threads as pool
from recon.basis import Basis, Kronecker
from recon.coded_aperture import CodedAperture, empty_cube
from recon.field_aperture import FieldAperture
from recon.operator import LinearOperator
from recon.problem import Found, OnIteration, Problem, Solver, prepare
from recon.solution import Solution, Stop


def reconstruct(
    operator: LinearOperator,
    frames: np.ndarray,
    *,
    basis: Basis | None = None,
    solver: Solver | None = None,
    start: np.ndarray | None = None,
    threads: int | None = None,
    on_iteration: OnIteration | None = None,
) -> Solution:
    """Estimate the cube that the operator photographed into ``frames``.

    Args:
        operator: H, usually a ``CodedAperture``; its dtype is the precision of the solve (float32 is enough: theory.md S).
        frames: (L, C, M, W) measurements, finite, any unit.
        basis: Psi; None: ``Kronecker.for_shape`` of the cube.
        solver: a solver's configuration; None: ``BasisPursuit()``, which needs no tau.
        start: (M, N, K) first guess in the cube's units.
        threads: threads of the kernels; None: all cores. The bytes of the answer don't depend on it.
        on_iteration: called as ``on_iteration(iteration, objective)``; what it raises ends the solve.

    Returns:
        The estimate in units of frames / response, with the reason why the solver stopped.

    Raises:
        InputError: for frames, start, basis, threads or tau that make no sense; the message names the field.
    """
    began = time.perf_counter()
    if solver is None:
        from recon.basis_pursuit import BasisPursuit

        solver = BasisPursuit()
    if basis is None:
        basis = Kronecker.for_shape(operator.in_shape)
    if isinstance(basis, Kronecker):
        basis.require(operator.in_shape)
    with pool.use(threads):
        problem = prepare(operator, frames, basis, start)
        if problem is None:
            return _dark(operator, solver, time.perf_counter() - began)
        found = solver.solve(problem, on_iteration)
        return _solution(operator, problem, found, began)


def warm_up(dtype: Any = np.float32) -> None:
    """Compile the kernels of all solvers on a cube of 8 x 8 x 2, so that the first real solve starts at once.

    numba keeps what it compiles on disk; on a fresh checkout this takes some ten seconds, which a caller can spend in a
    thread of its own while something else runs.
    """
    from recon.admm import Admm
    from recon.tuning import tune

    masks = np.indices((1, 8, 8)).sum(0) % 2
    for spread in (1, 2):
        camera = CodedAperture(masks, np.ones((1, 2)), np.arange(2), np.ones((2, spread)), dtype=dtype)
        camera.astype(np.float64).forward(np.ones(camera.in_shape))
        frames = camera.forward(np.ones(camera.in_shape, dtype))
        reconstruct(camera, frames, threads=1)
        tune(camera, frames, refine=Admm(tau=0), threads=1)


def _solution(operator: LinearOperator, problem: Problem, found: Found, began: float) -> Solution:
    misfit, l1 = problem.misfit(found.cube), problem.l1(found.cube)
    objective = l1 * problem.unit if found.tau is None else (misfit + found.tau * l1) * problem.light**2
    size = float(np.vdot(problem.exact_frames, problem.exact_frames))
    return Solution(
        cube=_scaled(found.cube, problem.unit),
        objective=objective,
        stop=found.stop,
        iterations=found.iterations,
        tau=None if found.tau is None else problem.outer_tau(found.tau),
        seconds=time.perf_counter() - began,
        residual=math.sqrt(misfit / size),
        tau_max=None if found.tau_max is None else problem.outer_tau(found.tau_max),
        notes=(*_notes(operator), *found.notes),
    )


def _dark(operator: LinearOperator, solver: Solver, seconds: float) -> Solution:
    cube = empty_cube(tuple(operator.in_shape), operator.dtype)
    cube[...] = 0
    tau = getattr(solver, "tau", None)
    stop = Stop("the frames are zero everywhere, and so is the answer", True)
    return Solution(cube, 0.0, stop, 0, tau, seconds, 0.0, None if tau is None else 0.0, _notes(operator))


def _scaled(cube: np.ndarray, unit: float) -> np.ndarray:
    """Multiply by ``unit``; go to float64 where float32 would overflow or lose its small numbers."""
    largest = float(np.abs(cube).max()) * unit
    limits = np.finfo(cube.dtype)
    if largest < 0.1 * float(limits.max) and (largest > 1e8 * float(limits.tiny) or largest == 0) and unit < 0.1 * float(limits.max):
        return np.asarray(cube * cube.dtype.type(unit))
    return np.asarray(cube.astype(np.float64) * unit)


def _notes(operator: LinearOperator) -> tuple[str, ...]:
    if not isinstance(operator, CodedAperture | FieldAperture):
        return ()
    shots, repeated = operator.out_shape[0], operator.repeated_shots()
    notes = []
    if repeated:
        notes.append(f"{shots} shots share {shots - repeated} different masks: a repeated mask adds light, but the rank of H does not grow")
    if operator.masks.min() == 1:
        notes.append("all masks are fully open: the frames are not coded")
    return tuple(notes)
