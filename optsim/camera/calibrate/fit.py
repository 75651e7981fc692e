"""Fit prism, lenses and registration to measured spots (theory.md (C.59) to (C.63))."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from optsim.camera.calibrate import identify
from optsim.camera.calibrate.calibrated_map import CalibratedMap, is_plain
from optsim.camera.calibrate.identify import Combinations
from optsim.camera.calibrate.jacobian import Jacobian, jacobian
from optsim.camera.calibrate.levenberg import CLOSE, Minimum, least_squares
from optsim.camera.calibrate.parameters import OFFSET_X, OFFSET_Y, Tolerances
from optsim.camera.calibrate.prism_model import PrismModel, prism_model
from optsim.camera.calibrate.result import Calibration
from optsim.camera.calibrate.spots import Spots
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig

FIRST_SIGMA_PX = 0.1
"""Standard error assumed of centroids that come without one, until the first fit tells their scatter."""
ROUNDING_PX = 1e-11
BENT_PX = 1e-3
"""With tilt, distortion or a converging beam, derivatives are partly differences: combinations that need better spots are held."""
ROUNDS = 16
SHRINK = 10.0
"""Standard errors shrink by at most this factor from round to round."""
SETTLED = 1e-3
"""A round that moves the fit by less than this many standard errors is the last."""


@dataclass(frozen=True, eq=False)
class _Rest:
    """Hold what the path beyond prism, lenses and registration adds to positions: (2n,) px, and (2n, P) per parameter."""

    px: np.ndarray
    slope: np.ndarray
    at: np.ndarray

    def near(self, values: np.ndarray) -> np.ndarray:
        """Return (2n,) px at values near those it was taken at."""
        return np.asarray(self.px + self.slope @ (values - self.at))


@dataclass(frozen=True, eq=False)
class _Task:
    """Hold what stays the same during a fit: the model, the spots and which parameters may move."""

    model: PrismModel
    spots: Spots
    free: np.ndarray
    camera: CameraConfig
    last: dict[bytes, Jacobian] = field(default_factory=dict)

    def rest(self, values: np.ndarray) -> _Rest:
        """Return what tilt, distortion and the like add at these values, and how that changes."""
        rays = self.spots.wavelength_nm, self.spots.X_mm, self.spots.Y_mm
        if is_plain(self.camera):
            return _Rest(np.zeros(2 * self.spots.count), np.zeros((2 * self.spots.count, values.size)), values)
        path = CalibratedMap(self.model, values, self.camera)
        return _Rest(np.concatenate(path.rest(*rays)[:2]), np.concatenate(path.rest_slopes(*rays)), values)

    def moved(self, values: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Return values with the free ones changed."""
        moved = values.copy()
        moved[self.free] += change
        return moved

    def derivatives(self, values: np.ndarray) -> Jacobian:
        """Return positions and derivatives at parameter values; the last ones are kept."""
        key = values.tobytes()
        if key not in self.last:
            self.last.clear()
            self.last[key] = jacobian(self.model, values, self.spots.wavelength_nm, self.spots.X_mm, self.spots.Y_mm)
        return self.last[key]

    def misfit(self, at: Jacobian, rest: np.ndarray) -> np.ndarray:
        """Return (2n,) model minus measured, px."""
        return np.concatenate([at.x_px, at.y_px]) - self.measured + rest

    @property
    def measured(self) -> np.ndarray:
        """Return (2n,) centroids: all x, then all y."""
        return np.concatenate([self.spots.x_px, self.spots.y_px])

    def split(self, at: Jacobian, rest: _Rest, sigma: np.ndarray, count: int | None) -> Combinations:
        """Return what the spots say about the free parameters."""
        whitened = (np.concatenate([at.dx, at.dy]) + rest.slope)[:, self.free] / sigma[:, None]
        names = tuple(self.model.names[place] for place in self.free)
        return identify.combinations(whitened, names, self.model.tolerance[self.free], count)


def calibrate(
    camera: CameraConfig,
    spots: Spots,
    free: Sequence[str] | None = None,
    tolerances: Tolerances | None = None,
    combinations: int | None = None,
) -> Calibration:  # fmt: skip
    """Fit a camera's drawing to spots and tell how well the spots determine it.

    The fit moves along the combinations of parameters that the spots determine, in units of their standard errors;
    the others are held at the drawing. Derivatives are taken anew at the result until the combinations settle.

    Args:
        camera: the drawing; its prism must be traced, not a table.
        spots: measured centroids, at least as many coordinates as combinations.
        free: names of the parameters that may move; None: all of them.
        tolerances: how far the built camera may stray from the drawing.
        combinations: how many to fit, the best determined first; None: those that the spots place, for the camera as
            drawn, within five tolerances.

    Raises:
        InputError: ``free``, ``spots`` (a spot that the drawn prism loses, or none that moves a parameter), ``camera.prism``.
    """
    model = prism_model(camera, tolerances)
    task = _Task(model, spots, _places(model, free), camera)
    start = _aligned(task, model.drawn)
    at = task.derivatives(start)
    if not at.valid.all():
        spot = int(np.argmin(at.valid))
        raise InputError("spots.wavelength_nm", float(spots.wavelength_nm[spot]), f"light that the prism as drawn passes; spot {spot}")
    return _refine(task, start, at, combinations)


def _refine(task: _Task, values: np.ndarray, drawn: Jacobian, combinations: int | None) -> Calibration:
    """Descend in rounds whose standard errors shrink to the true ones: weak combinations join when the strong ones fit."""
    spots, total = task.spots, 0
    goal = spots.sigmas(FIRST_SIGMA_PX)
    sigma, first = np.maximum(goal, FIRST_SIGMA_PX), task.rest(values)
    rest, floor = first, 0.0 if is_plain(task.camera) else BENT_PX
    for _ in range(ROUNDS):
        count = task.split(drawn, first, np.maximum(sigma, floor), None).count if combinations is None else combinations
        split = task.split(task.derivatives(values), rest, sigma, count)
        least = _descend(task, values, split, sigma, rest)
        total += least.steps
        values = task.moved(values, split.basis @ least.at)
        rest = task.rest(values)
        if not spots.errors_known:
            goal = spots.sigmas(_scatter(task.misfit(task.derivatives(values), rest.px), count))
        following = np.maximum(goal, sigma / SHRINK)
        if np.allclose(following, sigma, rtol=1e-3, atol=0) and float(np.linalg.norm(least.at)) < SETTLED:
            break
        sigma = following
    at = task.derivatives(values)
    final = task.split(at, rest, goal, count)
    return Calibration(task.model, task.camera, spots, values, task.free, final, goal, task.misfit(at, rest.px), least, total)


def _places(model: PrismModel, free: Sequence[str] | None) -> np.ndarray:
    """Return the free parameters' places in the vector."""
    if free is None:
        return np.arange(len(model.names))
    for name in free:
        if name not in model.index_of:
            raise InputError("free", name, f"one of {', '.join(model.names)}")
    if not free:
        raise InputError("free", list(free), "at least one parameter")
    return np.array(sorted({model.index_of[name] for name in free}))


def _aligned(task: _Task, values: np.ndarray) -> np.ndarray:
    """Shift the drawing onto the spots by the median misfit, as far as the offsets are free."""
    at, moved, rest = task.derivatives(values), values.copy(), task.rest(values)
    misfit = task.misfit(at, rest.px)
    if at.valid.any():
        for name, part in zip((OFFSET_X, OFFSET_Y), np.split(misfit, 2)):
            place = task.model.index_of[name]
            if place in task.free:
                moved[place] -= float(np.median(part[at.valid]))
    return moved


def _descend(task: _Task, values: np.ndarray, split: Combinations, sigma: np.ndarray, rest: _Rest) -> Minimum:
    if split.count == 0:
        raise InputError("spots", task.spots.count, "spots that determine at least one parameter better than the drawing does")
    if split.count > sigma.size:
        raise InputError("spots", task.spots.count, f"at least {-(-split.count // 2)} spots")
    basis = split.basis

    rays = task.spots.wavelength_nm, task.spots.X_mm, task.spots.Y_mm

    def residual(coordinates: np.ndarray) -> np.ndarray | None:
        moved = task.moved(values, basis @ coordinates)
        x, y, valid = task.model.at(moved, *rays)
        return (np.concatenate([x, y]) - task.measured + rest.near(moved)) / sigma if valid.all() else None

    def derivative(coordinates: np.ndarray) -> np.ndarray:
        at = task.derivatives(task.moved(values, basis @ coordinates))
        return (np.concatenate([at.dx, at.dy]) + rest.slope)[:, task.free] @ basis / sigma[:, None]

    return least_squares(residual, derivative, np.zeros(basis.shape[1]), close=max(CLOSE, ROUNDING_PX / float(sigma.min())))


def _scatter(misfit: np.ndarray, fitted: int) -> float:
    """Return the standard error of a centroid that the misfit tells, px; no smaller than the trace's rounding."""
    return max(ROUNDING_PX, float(np.sqrt(misfit @ misfit / max(1, misfit.size - fitted))))
