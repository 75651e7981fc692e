"""Derivatives of spot positions with respect to every parameter, by forward-mode differentiation in Dr.Jit (theory.md (C.59))."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optsim.camera.aligned import aligned
from optsim.camera.arrays import NUMPY, Kernels, kernels
from optsim.camera.calibrate.prism_model import PrismModel

COMPLEX_STEP = 1e-30


class Jacobian(NamedTuple):
    """Hold positions and their derivatives.

    Args:
        x_px, y_px: (n,) positions; 0 where lost.
        valid: (n,) bool, whether the light leaves the prism.
        dx, dy: (n, P) px per unit of each parameter; 0 where lost.
    """

    x_px: np.ndarray
    y_px: np.ndarray
    valid: np.ndarray
    dx: np.ndarray
    dy: np.ndarray


def jacobian(model: PrismModel, values: np.ndarray, wavelength_nm: np.ndarray, X_mm: np.ndarray, Y_mm: np.ndarray) -> Jacobian:
    """Return positions of rays and their derivatives at a (P,) vector of parameters, in float64.

    Every tangent has its own copy of the rays, so that one kernel gives the whole matrix; values are inputs of the
    kernel, so that none is compiled for a new value. Without a usable libLLVM: complex steps in NumPy, exact as well.

    Args:
        model: where spots land.
        values: (P,) in the order of ``model.parameters``.
        wavelength_nm, X_mm, Y_mm: (n,) of each ray.

    Raises:
        InputError: field ``wavelength_nm`` outside a glass's range.
    """
    rays = model.check(wavelength_nm), np.asarray(X_mm, np.float64), np.asarray(Y_mm, np.float64)
    k = kernels()
    return complex_step_jacobian(model, values, *rays) if k is None else _forward_mode(k, model, values, *rays)


def _forward_mode(k: Kernels, model: PrismModel, values: np.ndarray, wavelength_nm: np.ndarray, X: np.ndarray, Y: np.ndarray) -> Jacobian:
    dr, Float, UInt = k.dr, k.backend.Float64, k.backend.UInt32
    count, n = len(model.parameters), wavelength_nm.size
    index, rays = dr.arange(UInt, count * n), dr.opaque(UInt, n)
    tangent = index // rays
    arrays = [dr.gather(Float, Float(aligned(a)), index - tangent * rays) for a in (wavelength_nm, X, Y)]
    parameters = []
    for place, value in enumerate(values):
        parameter = dr.gather(Float, dr.opaque(Float, float(value)), dr.zeros(UInt, count * n))
        dr.enable_grad(parameter)
        dr.set_grad(parameter, dr.select(tangent == place, Float(1), Float(0)))
        parameters.append(parameter)
    x, y, valid = model.position(k.ops, parameters, *arrays)
    dx, dy = dr.forward_to(x, y)
    x, y = dr.detach(x), dr.detach(y)
    dr.eval(x, y, valid, dx, dy)
    slopes = (np.array(d).reshape(count, n).T for d in (dx, dy))
    return Jacobian(np.array(x)[:n], np.array(y)[:n], np.array(valid)[:n], *slopes)


def complex_step_jacobian(model: PrismModel, values: np.ndarray, wavelength_nm: np.ndarray, X: np.ndarray, Y: np.ndarray) -> Jacobian:
    """Return the same as :func:`jacobian` by a step along the imaginary axis, which loses no digit."""
    columns = []
    for index in range(len(model.parameters)):
        moved = np.array(values, np.complex128)
        moved[index] += 1j * COMPLEX_STEP
        columns.append(model.position(NUMPY, list(moved), wavelength_nm, X, Y))
    dx, dy = (np.stack([np.broadcast_to(np.imag(c[axis]), np.shape(X)) for c in columns], 1) / COMPLEX_STEP for axis in (0, 1))
    x, y, valid = (np.broadcast_to(np.real(a), np.shape(X)) for a in columns[0])
    return Jacobian(x.copy(), y.copy(), valid.astype(bool), dx, dy)
