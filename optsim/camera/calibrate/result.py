"""What a calibration found: the curve with its error, the registration, and what the spots could not tell."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.calibrate.calibrated_map import CalibratedMap
from optsim.camera.calibrate.identify import Combinations
from optsim.camera.calibrate.jacobian import jacobian
from optsim.camera.calibrate.levenberg import Minimum
from optsim.camera.calibrate.parameters import OFFSET_Y, REGISTRATION, ROTATION, SCALE
from optsim.camera.calibrate.prism_model import PrismModel
from optsim.camera.calibrate.spots import Spots
from optsim.camera.knowledge import Assumed

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig


class Curve(NamedTuple):
    """Hold positions with their standard errors, px, all (n,)."""

    x_px: np.ndarray
    y_px: np.ndarray
    sigma_x_px: np.ndarray
    sigma_y_px: np.ndarray


@dataclass(frozen=True, eq=False)
class Calibration:
    """Hold a fitted camera.

    Args:
        model: where spots land, and the drawing.
        camera: the drawing.
        spots: what was measured.
        values: (P,) fitted parameters.
        free: places of those that could move.
        split: combinations of the free parameters, fitted and held.
        sigma: (2n,) standard errors of the centroids, px; estimated from the misfit where the spots have none.
        misfit: (2n,) model minus measured, px: all x, then all y.
        minimum: the last descent.
        steps: derivatives taken in all descents.
    """

    model: PrismModel
    camera: CameraConfig
    spots: Spots
    values: np.ndarray
    free: np.ndarray
    split: Combinations
    sigma: np.ndarray
    misfit: np.ndarray
    minimum: Minimum
    steps: int

    @property
    def fitted(self) -> int:
        """Return how many combinations were fitted."""
        return int(self.split.determined.sum())

    @property
    def freedom(self) -> int:
        """Return measured coordinates less fitted combinations."""
        return self.misfit.size - self.fitted

    @cached_property
    def chi2(self) -> float:
        """Return the sum of squared misfits over their standard errors."""
        return float(np.sum((self.misfit / self.sigma) ** 2))

    @property
    def p_value(self) -> float | None:
        """Return how probable so large a misfit is if the model holds; None when the errors come from the misfit itself."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi2, self.freedom)) if self.spots.errors_known and self.freedom > 0 else None

    @property
    def rms_px(self) -> float:
        """Return the root mean square misfit of a coordinate, px."""
        return float(np.sqrt(np.mean(self.misfit**2)))

    @cached_property
    def covariance(self) -> np.ndarray:
        """Return (P, P): what the spots leave open, and one tolerance of each combination that is held (theory.md (C.61))."""
        p = len(self.model.parameters)
        full = np.zeros((p, p))
        inner = self.split.basis @ self.split.basis.T + self.split.held @ self.split.held.T
        full[np.ix_(self.free, self.free)] = inner
        return full

    def curve(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> Curve:
        """Return where light lands and how well that is known: (n,) each, standard errors by the covariance of all parameters.

        Raises:
            InputError: field ``wavelength_nm`` outside a glass's range.
        """
        rays = [a.ravel() for a in np.broadcast_arrays(np.asarray(wavelength_nm, float), X_mm, Y_mm)]
        at, rest = jacobian(self.model, self.values, *rays), self.map.rest_slopes(*rays)
        sigma = [np.sqrt(np.einsum("ij,jk,ik->i", d, self.covariance, d)) for d in (at.dx + rest[0], at.dy + rest[1])]
        x, y, _ = self.map.position_px(*rays)
        return Curve(x, y, *sigma)

    @cached_property
    def map(self) -> CalibratedMap:
        """Return the fitted dispersion with its registration, for reconstruction."""
        return CalibratedMap(self.model, self.values, self.camera)

    @property
    def fitted_camera(self) -> CameraConfig:
        """Return the fitted camera, to be written as a file."""
        return self.map.camera

    @property
    def knowledge(self) -> Assumed:
        """Return what a discrete model of the drawn camera may believe: the fitted curve and registration (theory.md (C.14))."""
        at = {row.name: float(value) for row, value in zip(self.model.parameters, self.values)}
        scale = at[SCALE] * self.camera.mirror_px
        return Assumed(dispersion=self.map, offset_y_px=at[OFFSET_Y], rotation_deg=at[ROTATION], scale=scale)

    def correlation(self, first: str, second: str) -> float:
        """Return the correlation of two parameters; 0 where one of them was not free."""
        i, j = self.model.index_of[first], self.model.index_of[second]
        scale = np.sqrt(self.covariance[i, i] * self.covariance[j, j])
        return float(self.covariance[i, j] / scale) if scale > 0 else 0.0

    def parameters(self) -> list[dict[str, Any]]:
        """Return one row a parameter: name, unit, drawn, fitted, sigma, tolerance, free, determined by the spots."""
        sigma = np.sqrt(np.diag(self.covariance))
        rows = []
        for k, p in enumerate(self.model.parameters):
            free = bool(k in self.free)
            rows.append(
                {
                    "name": p.name,
                    "unit": p.unit,
                    "drawn": p.value,
                    "fitted": float(self.values[k]),
                    "sigma": float(sigma[k]) if free else None,
                    "tolerance": p.tolerance,
                    "free": free,
                    "identifiable": bool(free and sigma[k] < p.tolerance),
                }
            )
        return rows

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain JSON."""
        wavelengths = np.unique(self.spots.wavelength_nm)
        curve = self.curve(wavelengths)
        places = [self.model.index_of[name] for name in REGISTRATION]
        rows = {row["name"]: row for row in self.parameters()}
        return {
            "spots": self.spots.count,
            "rms_px": self.rms_px,
            "sigma_px": float(np.sqrt(np.mean(self.sigma**2))),
            "sigma_from": "spots" if self.spots.errors_known else "misfit",
            "chi2": self.chi2,
            "degrees_of_freedom": self.freedom,
            "p_value": self.p_value,
            "converged": self.minimum.converged,
            "stop": self.minimum.reason,
            "steps": self.steps,
            "curve": {
                "wavelength_nm": wavelengths.tolist(),
                "position_px": curve.x_px.tolist(),
                "sigma_px": curve.sigma_x_px.tolist(),
            },
            "registration": {
                "names": list(REGISTRATION),
                "value": [rows[name]["fitted"] for name in REGISTRATION],
                "sigma": [rows[name]["sigma"] for name in REGISTRATION],
                "covariance": self.covariance[np.ix_(places, places)].tolist(),
            },
            "parameters": self.parameters(),
            "identifiable": [row["name"] for row in self.parameters() if row["identifiable"]],
            "combinations": self.split.describe(),
        }
