"""Maps beside curves: the paraxial wedge formula, a polynomial over the field, whole-pixel steps (theory.md (C.24) to (C.26))."""

from __future__ import annotations

import functools
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.arrays import NUMPY, Ops
from optsim.camera.center_table import CenterTable
from optsim.camera.glass import Glass
from optsim.camera.inverse import wavelength_at
from optsim.camera.mappings import (
    AxialMap,
    AxialTransmission,
    CauchyMap,
    LinearMap,
    PolynomialMap,
    SplineMap,
    axial_samples,
    check_range,
    powers,
    shared,
)
from optsim.camera.model import Model, ranged
from optsim.camera.prism import Dispersion
from optsim.camera.stack import FIRST_BAND_NM, Prism, field_points
from optsim.errors import InputError

X_TERMS = ((0, 0), (1, 0), (2, 0), (0, 2), (1, 2), (3, 0))
"""Powers (of X, of Y) in x: offset, magnification, distortion, smile and their first changes over the field."""
Y_TERMS = ((0, 1), (1, 1), (2, 1), (0, 3))


class ParaxialMap(AxialMap):
    """Deviate by the thin wedges' sum of index steps times face tilts, with one fitted scale (theory.md (C.24)).

    Args:
        glasses, face_tilt_rad: of the prism.
        anchor_nm, anchor_px: a wavelength that lands where the exact trace has it.
        scale_px: px per rad; a thin prism's would be f2 / pitch.
    """

    glasses: tuple[Glass, ...]
    face_tilt_rad: tuple[float, ...]
    anchor_nm: float
    anchor_px: float
    scale_px: float

    @classmethod
    def fit(cls, dispersion: Prism, range_nm: tuple[float, float]) -> ParaxialMap:
        """Fit the scale by least squares, with the wavelength that fixes the prism's position in its exact place.

        Raises:
            InputError: ``range_nm``; ``prism`` where the prism loses light, or is none.
        """
        if not isinstance(dispersion, Prism):
            raise InputError("prism", type(dispersion).__name__, "a prism: the wedge formula needs glasses and angles")
        wavelength, x = axial_samples(dispersion, range_nm)
        anchor = FIRST_BAND_NM if dispersion.design_position_px is None else dispersion.design_nm
        anchor_px = float(dispersion.position_px(anchor)[0])
        stack = dispersion.stack
        unscaled = cls(
            glasses=stack.glasses,
            face_tilt_rad=stack.face_tilt_rad,
            anchor_nm=anchor,
            anchor_px=0.0,
            scale_px=1.0,
            **shared(dispersion, range_nm),
        )
        bend = unscaled.along(wavelength)
        power = float(bend @ bend)
        scale = float(bend @ (x - anchor_px)) / power if power > 0 else 0.0
        return unscaled.model_copy(update={"anchor_px": anchor_px, "scale_px": scale})

    def along(self, wavelength_nm: Any) -> Any:
        """Return positions in px; NumPy arrays."""
        return self.formula(NUMPY, wavelength_nm)

    def formula(self, ops: Ops, wavelength_nm: Any) -> Any:
        """Return positions in px, on NumPy or Dr.Jit arrays."""
        bend = _bend(ops, self.glasses, self.face_tilt_rad, wavelength_nm)
        return self.anchor_px + self.scale_px * (bend - self._anchor_bend)

    @functools.cached_property
    def _anchor_bend(self) -> float:
        return float(_bend(NUMPY, self.glasses, self.face_tilt_rad, np.float64(self.anchor_nm)))


class FieldPolynomial(Model):
    """Polynomials in wavelength that multiply six powers of the field in x, four in y (theory.md (C.25)).

    Args:
        range_nm: (low, high); others are refused.
        half_mm: half side of the square field fitted; points beyond 1.05 times it are refused.
        x_px: (6, degree + 1) coefficients of powers of u, lowest first, for each power of the field in units of half_mm.
        y_px: (4, degree + 1).
        magnification_px: sensor pixels per mm at the mirrors.
        passes: transmission on the axis.
    """

    place: ClassVar[str] = "mapping"
    range_nm: tuple[float, float]
    half_mm: Annotated[float, ranged(0, 1e6, "mm", "(]")]
    x_px: tuple[tuple[float, ...], ...]
    y_px: tuple[tuple[float, ...], ...]
    magnification_px: float
    passes: AxialTransmission

    @classmethod
    def fit(cls, dispersion: Dispersion, range_nm: tuple[float, float], half_mm: float = 3.5, degree: int = 5) -> FieldPolynomial:
        """Fit by least squares over wavelengths and a 9 x 9 field.

        Raises:
            InputError: ``degree``, ``range_nm``, or ``prism`` where the dispersion loses light.
        """
        if not 1 <= degree <= 12:
            raise InputError("degree", degree, "from 1 to 12")
        wavelength, _ = axial_samples(dispersion, range_nm, 4 * degree + 9)
        xi, eta = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9), indexing="ij")
        x, y, valid = dispersion.position_px(wavelength[:, None, None], xi * half_mm, eta * half_mm)
        if not np.all(valid):
            raise InputError("prism", "one that loses part of the field", f"a dispersion that passes +-{half_mm:g} mm")
        u = 2 * (wavelength - range_nm[0]) / (range_nm[1] - range_nm[0]) - 1
        spectral = np.polynomial.chebyshev.chebvander(u, degree)
        tables = []
        for terms, values in ((X_TERMS, x), (Y_TERMS, y)):
            space = np.stack([(xi**a * eta**b).ravel() for a, b in terms], axis=1)
            solved = np.linalg.pinv(spectral) @ values.reshape(u.size, -1) @ np.linalg.pinv(space).T
            tables.append(tuple(tuple(np.polynomial.chebyshev.cheb2poly(column).tolist()) for column in solved.T))
        return cls(half_mm=half_mm, x_px=tables[0], y_px=tables[1], **shared(dispersion, range_nm))

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) in sensor pixels; see :meth:`optsim.camera.stack.Prism.position_px`.

        Raises:
            InputError: field ``wavelength_nm`` outside ``range_nm``, ``X_mm`` or ``Y_mm`` outside the field.
        """
        wavelength = check_range(wavelength_nm, self.range_nm)
        X, Y = self._field(X_mm, "X_mm"), self._field(Y_mm, "Y_mm")
        x, y = self.formula(wavelength, X, Y)
        x, y = np.broadcast_arrays(x, y)
        return x, y, np.ones(x.shape, bool)

    def formula(self, wavelength_nm: Any, X_mm: Any, Y_mm: Any) -> tuple[Any, Any]:
        """Return (x, y) in px, on any arrays; nothing is checked."""
        low, high = self.range_nm
        u = (wavelength_nm - (low + high) / 2) * (2 / (high - low))
        X, Y = X_mm * (1 / self.half_mm), Y_mm * (1 / self.half_mm)
        c = [powers(row, u) for row in self.x_px]
        d = [powers(row, u) for row in self.y_px]
        Y2 = Y * Y
        x = c[0] + c[3] * Y2 + X * (c[1] + c[4] * Y2 + X * (c[2] + c[5] * X))
        return x, Y * (d[0] + d[3] * Y2 + X * (d[1] + d[2] * X))

    def transmission(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> np.ndarray:
        """Return the share of light that passes on the axis, broadcast."""
        return self.passes.at(wavelength_nm, X_mm, Y_mm)

    def wavelength_at(self, position_px: ArrayLike) -> np.ndarray:
        """Return the wavelengths in nm that land at positions of the axis; see :func:`optsim.camera.inverse.wavelength_at`."""
        return wavelength_at(self, position_px, self.range_nm)

    def _field(self, value: ArrayLike, name: str) -> np.ndarray:
        array = field_points(value, name)
        if np.any(np.abs(array) > 1.05 * self.half_mm):
            raise InputError(
                name, float(np.abs(array).max()), f"within +-{1.05 * self.half_mm:g} mm, the field that the mapping was fitted in"
            )
        return array


class WholePixel(Model):
    """Round another dispersion's axial positions to whole pixels, as codes that shift bands by whole columns do (theory.md (C.26)).

    Args:
        of: the dispersion; the field keeps its magnification.
    """

    place: ClassVar[str] = "mapping"
    of: Any

    @classmethod
    def fit(cls, dispersion: Dispersion, range_nm: tuple[float, float]) -> WholePixel:
        """Return the whole-pixel steps of a dispersion; the range is not needed."""
        return cls(of=dispersion)

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors."""
        return float(self.of.magnification_px)

    def position_px(
        self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (x, y, valid) in sensor pixels; halves are rounded towards red."""
        x, _, valid = self.of.position_px(wavelength_nm)
        scale = self.magnification_px
        step = np.floor(x + 0.5) + scale * field_points(X_mm, "X_mm")
        step, y, valid = np.broadcast_arrays(step, scale * field_points(Y_mm, "Y_mm"), valid)
        return np.where(valid, step, 0.0), np.where(valid, y, 0.0), valid

    def transmission(self, wavelength_nm: ArrayLike, X_mm: ArrayLike = 0.0, Y_mm: ArrayLike = 0.0) -> np.ndarray:
        """Return that of the dispersion."""
        return np.asarray(self.of.transmission(wavelength_nm, X_mm, Y_mm))

    def wavelength_at(self, position_px: ArrayLike) -> np.ndarray:
        """Return that of the dispersion: the middle wavelength of a whole pixel's step."""
        return np.asarray(self.of.wavelength_at(position_px))


def _bend(ops: Ops, glasses: tuple[Glass, ...], tilts: tuple[float, ...], wavelength_nm: Any) -> Any:
    """Return the thin prism's deviation in rad: the sum over faces of (n' - n) t."""
    squared_um = wavelength_nm * wavelength_nm * 1e-6
    known = {medium: ops.sqrt(1 + medium.rational.excess(squared_um, ops)) for medium in dict.fromkeys(glasses)}
    total: Any = -tilts[-1] * (known[glasses[-1]] - 1)
    before: Any = 1.0
    for medium, tilt in zip(glasses, tilts):
        total, before = total + tilt * (known[medium] - before), known[medium]
    return total


MAPPINGS = (LinearMap, PolynomialMap, CauchyMap, SplineMap, ParaxialMap, FieldPolynomial, CenterTable, WholePixel)
"""Every way to map wavelengths to the sensor beside the exact trace; each has ``.fit(dispersion, range_nm)``."""
