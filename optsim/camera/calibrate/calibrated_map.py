"""A calibrated camera as a dispersion: what a reconstruction may assume instead of the drawing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.calibrate.fitted_camera import fitted_camera
from optsim.camera.calibrate.parameters import SCALE
from optsim.camera.calibrate.prism_model import PrismModel, is_melt, prism_model
from optsim.camera.inverse import wavelength_at

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig


STEP = 0.1
"""Share of a tolerance over which the rest of the path is differentiated."""


@dataclass(frozen=True, eq=False)
class CalibratedMap:
    """Place light where a calibration found it: the whole path, registration included.

    What the fit does not touch (tilt of the mirrors, distortion, defocus, a converging beam) is taken from the
    drawing, at the fitted values.

    Args:
        model: prism, lenses and registration.
        values: the P fitted parameters.
        drawing: the camera's file before the fit.
    """

    model: PrismModel
    values: np.ndarray
    drawing: CameraConfig

    @cached_property
    def camera(self) -> CameraConfig:
        """Return the fitted camera as a config that can be written to a file."""
        return fitted_camera(self.model, self.values, self.drawing)

    @property
    def range_nm(self) -> tuple[float, float]:
        """Return the wavelengths at which the glasses' formulas hold."""
        return self.model.range_nm

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors, on the axis and without tilt."""
        at = dict(zip(self.model.names, self.values))
        return float(at[SCALE] * self.model.drawn_magnification * 1000 / self.model.pixel_um)

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) in sensor pixels from the 455 nm pixel as drawn, broadcast; (0, 0, False) where no light leaves.

        Raises:
            InputError: field ``wavelength_nm`` outside a glass's range.
        """
        x, y, valid = self.model.at(self.values, wavelength_nm, X_mm, Y_mm)
        if not is_plain(self.drawing):
            dx, dy, passes = self.rest(wavelength_nm, X_mm, Y_mm)
            valid = valid & passes
            x, y = np.where(valid, x + dx, 0.0), np.where(valid, y + dy, 0.0)
        return x, y, valid

    def rest(self, wavelength_nm: ArrayLike, X_mm: ArrayLike, Y_mm: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (dx, dy, valid): what the whole path adds, px, to prism, lenses and registration in collimated light."""
        x, y, valid = self.camera.optics.position_px(wavelength_nm, X_mm, Y_mm)
        plain = prism_model(self.camera)
        x0, y0, valid0 = plain.at(plain.drawn, wavelength_nm, X_mm, Y_mm)
        both = valid & valid0
        return np.where(both, x - x0, 0.0), np.where(both, y - y0, 0.0), both

    def rest_slopes(self, wavelength_nm: np.ndarray, X_mm: np.ndarray, Y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the (n, P) derivatives of :meth:`rest`, px per unit of each parameter: central differences; 0 for the glasses."""
        dx, dy = np.zeros((2, wavelength_nm.size, self.values.size))
        for k, parameter in enumerate(self.model.parameters):
            if is_plain(self.drawing) or is_melt(parameter.name):
                continue
            step = STEP * parameter.tolerance
            ends = []
            for sign in (1, -1):
                moved = self.values.copy()
                moved[k] += sign * step
                ends.append(CalibratedMap(self.model, moved, self.drawing).rest(wavelength_nm, X_mm, Y_mm))
            dx[:, k], dy[:, k] = ((ends[0][axis] - ends[1][axis]) / (2 * step) for axis in (0, 1))
        return dx, dy

    def transmission(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> np.ndarray:
        """Return the share of light that the fitted prism's faces pass, in [0, 1], broadcast."""
        return self.camera.optics.transmission(wavelength_nm, X_mm, Y_mm)

    def wavelength_at(self, position_px: ArrayLike) -> np.ndarray:
        """Return the wavelengths in nm that land at positions of the axis (X = Y = 0).

        Raises:
            InputError: field ``prism`` when the curve folds over or does not reach a position.
        """
        return wavelength_at(self, position_px, self.range_nm)


def is_plain(camera: CameraConfig) -> bool:
    """Tell whether prism, lenses and registration in collimated light are the whole path of a chief ray."""
    relay = camera.relay
    straight = not relay.converging and relay.defocus_mm == 0 and relay.distortion_per_mm2 == 0
    return straight and camera.dmd.tilt_deg == 0 and (camera.prism is None or camera.prism.field)
