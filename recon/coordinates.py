"""Solve for spectral coefficients in place of bands, where that is faster (theory.md (S.70)).

The basis is a wavelet along the picture times a matrix C along wavelength, and the two commute. So with u = C f

    ||g - H f||^2 + tau ||(W x C) f||_1  =  ||g - (H C^T) u||^2 + tau ||W u||_1

is the same problem, norms and all, but its threshold needs one band at a time, in one pass that never leaves the cache,
and C is applied by the camera's kernels to a row that is in the cache anyway.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from recon.basis import Kronecker
from recon.coded_aperture import CodedAperture, empty_cube
from recon.l1 import L1Penalty, Margin
from recon.operator import LinearOperator, RowWeighted
from recon.problem import Found, OnIteration, Problem, Solver
from recon.turning import turn


def solve(problem: Problem, solver: Solver, on_iteration: OnIteration | None = None) -> Found:
    """Solve a problem, in spectral coordinates where solver, prior and operator allow it."""
    matrix = shared_matrix(problem)
    if matrix is None or not _takes_any_penalty(solver):
        return solver.solve(problem, on_iteration)
    posed = turned(problem, matrix)
    found = solver.solve(posed, on_iteration)
    return replace(found, cube=_turned_cube(matrix.T, found.cube), value=posed.penalty.value(found.cube))


def shared_matrix(problem: Problem) -> np.ndarray | None:
    """Return the spectral matrix of a problem whose prior is l1 in a Kronecker basis and whose operator can take it in; else None."""
    penalty, bands = problem.penalty, problem.operator.in_shape[-1]
    if not isinstance(penalty, L1Penalty) or not isinstance(penalty.basis, Kronecker) or bands < 2:
        return None
    if _turned_operator(problem.operator, None) is None:
        return None
    return np.asarray(penalty.basis.spectral.matrix(bands, problem.operator.dtype))


def turned(problem: Problem, matrix: np.ndarray) -> Problem:
    """Return the same problem for ``u = matrix f`` at every pixel."""
    assert isinstance(problem.penalty, L1Penalty)
    operator = _turned_operator(problem.operator, matrix)
    assert operator is not None
    start = None if problem.start is None else _turned_cube(matrix, problem.start)
    return replace(problem, operator=operator, penalty=BandPenalty(problem.penalty, operator.in_shape, operator.dtype), start=start)


class BandPenalty:
    """``sum of weight |W u|`` of a cube of spectral coefficients: the l1 norm of ``whole`` for the bands that u stands for."""

    def __init__(self, whole: L1Penalty, shape: tuple[int, ...], dtype: Any) -> None:
        assert isinstance(whole.basis, Kronecker)
        self._whole, self._basis = whole, whole.basis
        self._weights = whole.weights
        self._margin = Margin(whole.basis, shape, dtype)

    def value(self, cube: np.ndarray) -> float:
        """See ``Penalty.value``."""
        around = self._margin.around(cube)
        copy = np.array(around.transpose(2, 0, 1), order="C")
        return self._basis.shrink_bands(copy, 0.0, self._weights)

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """See ``Penalty.shrink``."""
        around = self._margin.around(cube)
        value = self._basis.shrink_bands(around.transpose(2, 0, 1), threshold, self._weights)
        self._margin.cut(cube)
        return value

    def tau_max(self, correlation: np.ndarray) -> float | None:
        """See ``Penalty.tau_max``; ``correlation`` holds coefficients too."""
        matrix = self._basis.spectral.matrix(correlation.shape[2], correlation.dtype)
        return self._whole.tau_max(_turned_cube(matrix.T, correlation))


def _takes_any_penalty(solver: Solver) -> bool:
    from recon.admm import Admm
    from recon.basis_pursuit import BasisPursuit
    from recon.fista import Fista

    return isinstance(solver, Admm | BasisPursuit | Fista)


def _turned_operator(operator: LinearOperator, matrix: np.ndarray | None) -> LinearOperator | None:
    """Return the operator for coefficients; None when it knows no such thing. Without a matrix: itself."""
    if isinstance(operator, RowWeighted):
        inner = _turned_operator(operator.operator, matrix)
        return None if inner is None else RowWeighted(inner, operator.weights)
    if not isinstance(operator, CodedAperture) or operator.spectral is not None:
        return None
    return operator if matrix is None else operator.replace(spectral=matrix)


def _turned_cube(matrix: np.ndarray, cube: np.ndarray) -> np.ndarray:
    out = empty_cube(cube.shape, cube.dtype)
    turn(matrix.astype(cube.dtype), np.ascontiguousarray(cube.transpose(2, 0, 1)), out.transpose(2, 0, 1))
    return out
