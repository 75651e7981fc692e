"""Positions over the whole field of mirrors: the exact trace, held by a polynomial a wavelength (theory.md (C.16))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optsim.camera.prism import Dispersion

TOLERANCE_PX = 1e-7
_DEGREES = ((1, 0), (2, 1), (3, 1), (4, 2), (6, 3), (8, 4), (12, 6))


@dataclass(frozen=True, eq=False)
class FieldMap:
    """Hold x = sum c[a,b] xi^a eta^2b and y = eta sum d[a,b] xi^a eta^2b for every wavelength, in px from the frame's middle.

    xi and eta run from -1 to 1 between the outer borders of the mirrors.

    Args:
        x: (n, A + 1, B + 1) coefficients c in px.
        y: (n, A + 1, B + 1) coefficients d in px.
        valid: (n,) False where the prism loses the wavelength everywhere in the field.
        error_px: largest distance from the exact trace on a check grid.
    """

    x: np.ndarray
    y: np.ndarray
    valid: np.ndarray
    error_px: float

    def at(self, xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (n, ...) of field points broadcast to one shape (...)."""
        xi, eta = np.broadcast_arrays(xi, eta)
        powers = _powers(self.x.shape[1:], xi.ravel(), eta.ravel())
        shape = (self.x.shape[0], *xi.shape)
        x, y = (c.reshape(c.shape[0], -1) @ powers for c in (self.x, self.y))
        return x.reshape(shape), (y * eta.ravel()).reshape(shape)

    def passes(self, xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
        """Tell for (n, ...) which field points' light gets through the prism: all of a wavelength's, or none."""
        shape = np.broadcast(xi, eta).shape
        return np.broadcast_to(self.valid.reshape(-1, *(1,) * len(shape)), (self.valid.size, *shape))

    def inverse(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Estimate (xi, eta) that land at (n, ...) positions: a linear guess and one correction, as the kernel does."""
        form = (slice(None), *(None,) * (x.ndim - 1))
        c0, c1, d0 = self.x[:, 0, 0][form], self.x[:, 1, 0][form], self.y[:, 0, 0][form]
        xi, eta = np.clip((x - c0) / c1, -1.1, 1.1), np.clip(y / d0, -1.1, 1.1)
        powers = _powers(self.x.shape[1:], xi.reshape(xi.shape[0], -1), eta.reshape(xi.shape[0], -1))
        gx, gy = (np.einsum("np,pnq->nq", c.reshape(c.shape[0], -1), powers).reshape(xi.shape) for c in (self.x, self.y))
        return xi - (gx - x) / c1, eta - (gy * eta - y) / d0


@dataclass(frozen=True, eq=False)
class TracedField:
    """Answer as a FieldMap by tracing every point: exact and slow.

    Args:
        dispersion: what is traced.
        wavelength_nm: (n,).
        half_x_mm, half_y_mm: half sides of the field.
        valid: (n,) False where the prism loses the wavelength everywhere in the field.
    """

    dispersion: Dispersion
    wavelength_nm: np.ndarray
    half_x_mm: float
    half_y_mm: float
    valid: np.ndarray
    error_px: float = 0.0

    def at(self, xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (n, ...) of field points broadcast to one shape (...)."""
        xi, eta = np.broadcast_arrays(xi, eta)
        wavelength = self.wavelength_nm.reshape(-1, *(1,) * xi.ndim)
        x, y, _ = self.dispersion.position_px(wavelength, xi * self.half_x_mm, eta * self.half_y_mm)
        return x, y

    def passes(self, xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
        """Tell for (n, ...) which field points' light gets through the prism."""
        wavelength = self.wavelength_nm.reshape(-1, *(1,) * np.broadcast(xi, eta).ndim)
        return self.dispersion.position_px(wavelength, xi * self.half_x_mm, eta * self.half_y_mm)[2]


def fit_field(dispersion: Dispersion, wavelength_nm: np.ndarray, half_x_mm: float, half_y_mm: float) -> FieldMap | TracedField:
    """Fit the lowest polynomial degrees that hold the trace to 1e-7 px over the field.

    Where no degree does (a very wide field), or where the prism loses part of the field (at its critical angle), the
    trace itself is returned.
    """
    grid_x, grid_y = np.meshgrid(np.linspace(-1, 1, 9), np.array([-1.0, -0.55, 0.0, 0.3, 0.8, 1.0]), indexing="ij")
    exact = dispersion.position_px(wavelength_nm[:, None, None], grid_x * half_x_mm, grid_y * half_y_mm)
    valid = np.asarray(exact[2].any((1, 2)))
    if not np.array_equal(valid, exact[2].all((1, 2))):
        return TracedField(dispersion, wavelength_nm, half_x_mm, half_y_mm, valid)
    if not valid.any():
        return FieldMap(np.zeros((valid.size, 2, 1)), np.zeros((valid.size, 2, 1)), valid, 0.0)
    for degree in _DEGREES:
        x, y = _fit(dispersion, wavelength_nm[valid], half_x_mm, half_y_mm, degree)
        fitted = FieldMap(_spread(x, valid), _spread(y, valid), valid, 0.0)
        px, py = fitted.at(grid_x, grid_y)
        error = float(max(np.abs(px - exact[0])[valid].max(), np.abs(py - exact[1])[valid].max()))
        if error <= TOLERANCE_PX:
            return FieldMap(fitted.x, fitted.y, valid, error)
    return TracedField(dispersion, wavelength_nm, half_x_mm, half_y_mm, valid)


def _fit(
    dispersion: Dispersion, wavelength_nm: np.ndarray, half_x_mm: float, half_y_mm: float, degree: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Interpolate at Chebyshev nodes, half of them in eta by symmetry."""
    a, b = degree
    xi = np.cos(np.pi * (np.arange(a + 1) + 0.5) / (a + 1))
    eta = np.cos(np.pi * (np.arange(b + 1) + 0.5) / (2 * b + 2))
    nodes_x, nodes_y = np.meshgrid(xi, eta, indexing="ij")
    x, y, _ = dispersion.position_px(wavelength_nm[:, None, None], nodes_x * half_x_mm, nodes_y * half_y_mm)
    matrix = _powers((a + 1, b + 1), nodes_x.ravel(), nodes_y.ravel()).T
    count = wavelength_nm.size
    solve = np.linalg.solve(matrix, np.concatenate([x.reshape(count, -1), (y / nodes_y).reshape(count, -1)]).T).T
    shape = (count, a + 1, b + 1)
    return solve[:count].reshape(shape), solve[count:].reshape(shape)


def _powers(shape: tuple[int, ...], xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Return xi^a eta^2b, (a b, ...)."""
    return np.stack([xi**a * eta ** (2 * b) for a in range(shape[0]) for b in range(shape[1])])


def _spread(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Place coefficients of valid wavelengths; lost ones get those of the first valid one (finite, weight 0)."""
    full = np.repeat(values[:1], valid.size, axis=0)
    full[valid] = values
    return full
