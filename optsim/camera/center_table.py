"""Dispersion by a table of measured band centres instead of a prism."""

from __future__ import annotations

import functools
import math
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import field_validator

from optsim.camera.inverse import wavelength_at
from optsim.camera.mappings import AxialTransmission
from optsim.camera.model import Model, ranged
from optsim.camera.prism import Dispersion
from optsim.camera.relay import Relay
from optsim.camera.stack import DEFAULT_PIXEL_UM, field_points
from optsim.cube import PAPER_CENTERS_NM
from optsim.errors import InputError


class CenterTable(Model):
    """Place the k-th wavelength of a table exactly at position k px, the others by monotone PCHIP (theory.md (C.7)).

    Beyond its ends the curve goes on straight. The field is distortion-free: no smile, no keystone.

    Args:
        centers_nm: strictly increasing wavelengths in nm, at least 2; default: the paper's 24.
        relay: the lenses (for the magnification).
        pixel_um: the sensor's pitch, in (0, 1e4] um.
        passes: transmission on the axis; None: 1.
    """

    place: ClassVar[str] = "table"
    centers_nm: tuple[float, ...] = PAPER_CENTERS_NM
    relay: Relay = Relay()
    pixel_um: Annotated[float, ranged(0, 1e4, "um", "(]")] = DEFAULT_PIXEL_UM

    passes: AxialTransmission | None = None

    @field_validator("centers_nm")
    @classmethod
    def _increasing(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) < 2 or value[0] <= 0 or any(np.diff(value) <= 0):
            raise InputError("", value, "at least two strictly increasing wavelengths above 0 nm")
        return value

    @classmethod
    def fit(cls, dispersion: Dispersion, range_nm: tuple[float, float]) -> CenterTable:
        """Tabulate the wavelengths at the centres of the pixels that a dispersion covers from end to end of a range.

        Raises:
            InputError: ``prism`` when the dispersion folds over, loses light or covers fewer than two pixels' centres.
        """
        ends = [float(dispersion.position_px(end)[0]) for end in range_nm]
        pixels = np.arange(math.ceil(ends[0]), math.floor(ends[1]) + 1)
        if pixels.size < 2 or pixels[0] > 0:
            raise InputError("prism", tuple(ends), "a dispersion that covers pixels 0 and 1, red at larger x, within the range")
        centers = dispersion.wavelength_at(pixels[pixels >= 0])
        relay = Relay(collimator_mm=100.0, focal_mm=dispersion.magnification_px * DEFAULT_PIXEL_UM / 10)
        passes = AxialTransmission.of(dispersion, range_nm)
        return cls(centers_nm=tuple(centers.tolist()), relay=relay, pixel_um=DEFAULT_PIXEL_UM, passes=passes)

    @functools.cached_property
    def _curve(self) -> tuple[np.ndarray, Any, Any]:
        """Return the knots, the curve through them and its slope."""
        from scipy.interpolate import PchipInterpolator

        knots = np.array(self.centers_nm)
        curve = PchipInterpolator(knots, np.arange(knots.size, dtype=np.float64))
        return knots, curve, curve.derivative()

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors."""
        return self.relay.magnification * 1000 / self.pixel_um

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) in sensor pixels; see :meth:`optsim.camera.stack.Prism.position_px`."""
        wavelength = np.asarray(wavelength_nm, np.float64)
        if not np.all(np.isfinite(wavelength)) or np.any(wavelength <= 0):
            raise InputError("wavelength_nm", wavelength_nm, "finite and above 0 nm")
        knots, curve, slope = self._curve
        inside = np.clip(wavelength, knots[0], knots[-1])
        end = np.where(wavelength < knots[0], slope(knots[0]), slope(knots[-1]))
        along = curve(inside) + (wavelength - inside) * end
        scale = self.magnification_px
        x, y = np.broadcast_arrays(along + scale * field_points(X_mm, "X_mm"), scale * field_points(Y_mm, "Y_mm"))
        return x, y, np.ones(x.shape, bool)

    def transmission(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> np.ndarray:
        """Return the share of light that passes on the axis, broadcast: 1 where the table says nothing of losses."""
        if self.passes is not None:
            return self.passes.at(wavelength_nm, X_mm, Y_mm)
        return np.ones(np.broadcast_shapes(*(np.shape(v) for v in (wavelength_nm, X_mm, Y_mm))))

    def wavelength_at(self, position_px: ArrayLike) -> np.ndarray:
        """Return the wavelengths in nm that land at positions of the axis; see :func:`optsim.camera.inverse.wavelength_at`."""
        return wavelength_at(self, position_px)
