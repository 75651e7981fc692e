"""Where a spot lands as a function of every number of prism, lenses and registration (theory.md (C.57), (C.58))."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.arrays import NUMPY, Array, Ops
from optsim.camera.calibrate.parameters import COLLIMATOR, FOCAL, OFFSET_X, OFFSET_Y, ROTATION, SCALE, TILT, Parameter, Tolerances
from optsim.camera.glass import AIR, D_LINE_NM, Glass
from optsim.camera.stack import FIRST_BAND_NM, Prism
from optsim.camera.trace import image_point, trace_faces
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig

DEGREE = math.pi / 180


@dataclass(frozen=True, eq=False)
class PrismModel:
    """Place spots on the sensor from a vector of parameters, on NumPy or Dr.Jit arrays.

    Args:
        glasses: behind each face but the last; None is air.
        face_tilt_rad: as drawn, one more than glasses.
        parameters: what the vector holds, in its order, with drawn values and tolerances.
        anchor_nm, anchor_px: the wavelength whose axial light the drawing places, and where.
        pixel_um: the sensor's pitch.
        registered: offset and scale are those of the picture as found on the sensor: whatever prism and lenses are, axial
            light of ``anchor_nm`` lands at ``anchor_px`` + offset, and the magnification is the drawn one x scale. False: the
            optical axis stays where the drawing has it, and focal lengths change the magnification.
    """

    glasses: tuple[Glass | None, ...]
    face_tilt_rad: tuple[float, ...]
    parameters: tuple[Parameter, ...]
    anchor_nm: float
    anchor_px: float
    pixel_um: float
    registered: bool = True

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the parameters' names."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def drawn(self) -> np.ndarray:
        """Return (P,) values as drawn."""
        return np.array([p.value for p in self.parameters])

    @cached_property
    def tolerance(self) -> np.ndarray:
        """Return (P,) standard deviations of the built camera round the drawing."""
        return np.array([p.tolerance for p in self.parameters])

    @cached_property
    def index_of(self) -> Mapping[str, int]:
        """Return each parameter's place in the vector."""
        return {name: k for k, name in enumerate(self.names)}

    @property
    def range_nm(self) -> tuple[float, float]:
        """Return the wavelengths that all glasses' formulas hold in."""
        ranges = [g.range_nm for g in self.glasses if g is not None]
        return max((r[0] for r in ranges), default=1.0), min((r[1] for r in ranges), default=1e5)

    def check(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return wavelengths as float64 if every glass's formula holds there.

        Raises:
            InputError: field ``wavelength_nm``.
        """
        values = np.asarray(wavelength_nm, np.float64)
        for glass in self.glasses:
            if glass is not None:
                glass.check(values)
        return values

    def at(self, values: ArrayLike, wavelength_nm: ArrayLike, X_mm: ArrayLike, Y_mm: ArrayLike) -> tuple[np.ndarray, ...]:
        """Return (x, y, valid) in px, broadcast, for one (P,) vector of parameters, in float64."""
        vector = list(np.asarray(values, np.float64))
        x, y, valid = self.position(NUMPY, vector, self.check(wavelength_nm), np.asarray(X_mm, float), np.asarray(Y_mm, float))
        x, y, valid = np.broadcast_arrays(x, y, valid)
        return x, y, valid

    def position(self, ops: Ops, values: Sequence[Array], wavelength_nm: Array, X_mm: Array, Y_mm: Array) -> tuple[Array, Array, Array]:
        """Return (x, y, valid): px from the 455 nm pixel as drawn; (0, 0, False) where no light leaves.

        Args:
            ops: the arrays' operations.
            values: P arrays that broadcast with the wavelengths, in the order of ``parameters``.
            wavelength_nm, X_mm, Y_mm: of each ray, not checked.
        """
        p = dict(zip(self.names, values, strict=True))
        turn, size = p[ROTATION] * DEGREE, p[SCALE]
        if self.registered:
            size = size * p[COLLIMATOR] / p[FOCAL] * self.drawn_magnification
        c, s = size * ops.cos(turn), size * ops.sin(turn)
        tilts = [(ops.sin(t), ops.cos(t)) for t in self._tilts(p)]
        x_mm, y_mm, valid = self._lands(ops, p, tilts, wavelength_nm, c * X_mm - s * Y_mm, s * X_mm + c * Y_mm)
        px = 1000 / self.pixel_um
        if self.registered:
            anchor_mm, _, passes = self._lands(ops, p, tilts, 0.0 * wavelength_nm + self.anchor_nm, 0.0 * X_mm, 0.0 * Y_mm)
            x_mm, valid, origin = x_mm - anchor_mm, valid & passes, self.anchor_px
        else:
            origin = self.origin_px
        x = ops.where(valid, x_mm * px + origin + p[OFFSET_X], 0.0)
        return x, ops.where(valid, y_mm * px + p[OFFSET_Y], 0.0), valid

    @cached_property
    def drawn_magnification(self) -> float:
        """Return f2 / f1 as drawn."""
        return float(self.drawn[self.index_of[FOCAL]] / self.drawn[self.index_of[COLLIMATOR]])

    @cached_property
    def origin_px(self) -> float:
        """Return where a ray along the optical axis lands as drawn."""
        p = dict(zip(self.names, self.drawn))
        tilts = [(math.sin(t), math.cos(t)) for t in self.face_tilt_rad]
        x_mm, _, _ = self._lands(NUMPY, p, tilts, np.float64(self.anchor_nm), np.float64(0), np.float64(0))
        return self.anchor_px - float(x_mm) * 1000 / self.pixel_um

    def _lands(
        self, ops: Ops, p: Mapping[str, Array], tilts: list[tuple[Array, Array]], wavelength_nm: Array, X: Array, Y: Array
    ) -> tuple[Array, Array, Array]:
        """Return (x, y, valid) in mm from the optical axis."""
        f1 = p[COLLIMATOR]
        traced = trace_faces(ops, X, f1 + 0.0 * X, X * X + Y * Y + f1 * f1, tilts, self._excess(ops, p, wavelength_nm))
        x_mm, y_mm = image_point(ops, traced, Y, p[FOCAL])
        return x_mm, y_mm, traced.valid

    def tilts_rad(self, values: ArrayLike) -> tuple[float, ...]:
        """Return the faces' tilts for a (P,) vector."""
        return tuple(float(t) for t in self._tilts(dict(zip(self.names, np.asarray(values, float), strict=True))))

    def _tilts(self, p: Mapping[str, Array]) -> list[Array]:
        """Turn wedge angles and the mount's tilt into face tilts: half of each wedge's change on either side of it."""
        change = [(p[apex_name(k)] - self._apex_deg(k)) * (DEGREE / 2) for k in range(len(self.glasses))]
        tilts = []
        for face, drawn in enumerate(self.face_tilt_rad):
            tilt = drawn + p[TILT] * DEGREE
            for wedge, half in enumerate(change):
                tilt = tilt + half if wedge >= face else tilt - half
            tilts.append(tilt)
        return tilts

    def _apex_deg(self, wedge: int) -> float:
        return (self.face_tilt_rad[wedge] - self.face_tilt_rad[wedge + 1]) / DEGREE

    def _excess(self, ops: Ops, p: Mapping[str, Array], wavelength_nm: Array) -> list[Array]:
        squared_um = wavelength_nm * wavelength_nm * 1e-6
        known: dict[str, Array] = {}
        for glass in self.glasses:
            if glass is not None and glass.name not in known:
                index = ops.sqrt(1 + glass.rational.excess(squared_um))
                at_d = float(glass.index(D_LINE_NM))
                index = index + p[index_name(glass)] + (index - at_d) * p[dispersion_name(glass)]
                known[glass.name] = index * index - 1
        return [0.0 if glass is None else known[glass.name] for glass in self.glasses] + [0.0]


def apex_name(wedge: int) -> str:
    """Return the name of a wedge's angle, the tilt of its first face minus that of its second; wedges count from 0."""
    return f"apex_{wedge + 1}_deg"


def index_name(glass: Glass) -> str:
    """Return the name of a glass's index error."""
    return f"index_{glass.name}"


def dispersion_name(glass: Glass) -> str:
    """Return the name of the relative error of a glass's n - n_d."""
    return f"dispersion_{glass.name}"


def is_melt(name: str) -> bool:
    """Tell whether a parameter belongs to a glass."""
    return name.startswith(("index_", "dispersion_"))


def prism_model(camera: CameraConfig, tolerances: Tolerances | None = None, registered: bool = True) -> PrismModel:
    """Return the camera's prism, lenses and registration as a model with named parameters.

    Args:
        camera: the drawing.
        tolerances: how far built cameras stray from it.
        registered: see :class:`PrismModel`.

    Raises:
        InputError: field ``camera.prism`` when the camera has a table of centres instead of a prism.
    """
    t = Tolerances() if tolerances is None else tolerances
    prism = camera.dispersion
    if not isinstance(prism, Prism):
        raise InputError("camera.prism", type(prism).__name__, "a traced prism: a table of centres has no angles to fit")
    stack, place = prism.stack, prism.design_position_px
    glasses = tuple(None if medium == AIR else medium for medium in stack.glasses)
    tilts, anchor = stack.face_tilt_rad, (FIRST_BAND_NM, 0.0) if place is None else (prism.design_nm, place)
    apexes = [Parameter(apex_name(k), (tilts[k] - tilts[k + 1]) / DEGREE, t.apex_deg, "deg") for k in range(len(glasses))]
    kinds = list({glass.name: glass for glass in glasses if glass is not None}.values())
    f1, f2 = camera.relay.collimator_mm, camera.relay.focal_mm
    parameters = (
        *apexes,
        Parameter(TILT, 0.0, t.tilt_deg, "deg"),
        Parameter(COLLIMATOR, f1, t.focal * f1, "mm"),
        Parameter(FOCAL, f2, t.focal * f2, "mm"),
        *(Parameter(index_name(glass), 0.0, t.index, "") for glass in kinds),
        *(Parameter(dispersion_name(glass), 0.0, t.dispersion, "") for glass in kinds),
        Parameter(OFFSET_X, camera.dmd.offset_x_px, t.offset_px, "px"),
        Parameter(OFFSET_Y, camera.dmd.offset_y_px, t.offset_px, "px"),
        Parameter(ROTATION, camera.dmd.rotation_deg, t.rotation_deg, "deg"),
        Parameter(SCALE, camera.dmd.scale, t.scale, ""),
    )
    return PrismModel(glasses, tilts, parameters, *anchor, camera.sensor.pitch_um, registered)
