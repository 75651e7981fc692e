"""Prisms for a wanted dispersion: a search over pairs of glasses, then derivatives by the faces' angles (theory.md (C.73), (C.78))."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from optsim.camera.aligned import aligned
from optsim.camera.arrays import NUMPY, kernels
from optsim.camera.design.levenberg import fit
from optsim.camera.design.wanted import WantedDispersion
from optsim.camera.differentiable_optics import DifferentiableOptics, OpticsValues
from optsim.camera.glass import Glass
from optsim.camera.model import Model, ranged
from optsim.camera.relay import Relay
from optsim.camera.stack import DEFAULT_PIXEL_UM, PrismStack
from optsim.camera.trace import image_point, trace_faces
from optsim.errors import InputError

AMICI = np.array([[1.0, -0.5], [0.0, -0.5], [0.0, 0.5], [-1.0, 0.5]])
"""Tilts of a symmetric double Amici prism's faces by its apex angles A1, A2."""
OnPair = Callable[[int, int, "PrismResult"], None]
"""Called after every refined pair with its number, how many there are, and what was found."""


@dataclass(frozen=True, eq=False)
class PrismResult:
    """Hold one designed prism.

    Args:
        glasses: of its three wedges.
        face_tilt_rad: (4,) of its faces.
        thin_rms_px: position error that the thin formula promised for the pair, rms over the spectrum, free of its mean.
        start_rms_px: that of the thin formula's angles, traced exactly.
        rms_px, worst_px: those of the designed prism, traced exactly, over the spectrum and the field.
        axis_rms_px: that of the middle of the field alone, free of its own mean.
        deviation_deg: of the design wavelength against the axis.
        steps: of the fit.
    """

    glasses: tuple[Glass, ...]
    face_tilt_rad: np.ndarray
    thin_rms_px: float
    start_rms_px: float
    rms_px: float
    worst_px: float
    axis_rms_px: float
    deviation_deg: float
    steps: int

    def stack(self, relay: Relay | None = None, pixel_um: float = DEFAULT_PIXEL_UM) -> PrismStack:
        """Return the prism between the lenses of a relay."""
        return PrismStack(
            glasses=self.glasses, face_tilt_rad=tuple(map(float, self.face_tilt_rad)), relay=relay or Relay(), pixel_um=pixel_um
        )

    def to_toml(self) -> str:
        """Return the [prism] table of a camera file."""
        names = ", ".join(f'"{g.name}"' for g in self.glasses)
        tilts = ", ".join(f"{math.degrees(t):.6f}" for t in self.face_tilt_rad)
        return f"[prism]\nglasses = [{names}]\nface_tilt_deg = [{tilts}]\n"


class PrismDesign(Model):
    """Design prisms of three cemented wedges, outer - inner - outer glass, for a wanted dispersion.

    Args:
        relay: the lenses.
        pixel_um: the sensor's pitch, in (0, 1e4] um.
        design_nm: the wavelength that shall leave along the axis, in [100, 1e4] nm.
        per_degree_px: how many px of error one degree of that wavelength's deviation counts as, in [0, 1e3].
        field_mm: half the mirrors' field along the dispersion, whose ends count as much as its middle: they shall land as far apart as
            the lenses alone would lay them; 0: the axis alone, and the prism may stretch the picture. In [0, 1e3] mm.
        limit_deg: largest tilt of a face and half the largest apex angle, in (0, 85] deg.
        symmetric: whether the two outer wedges stay alike; else all four faces are free.
        refine: how many of the best pairs are refined by derivatives, from 1 to 10000.
    """

    place: ClassVar[str] = "prism design"
    relay: Relay = Relay()
    pixel_um: Annotated[float, ranged(0, 1e4, "um", "(]")] = DEFAULT_PIXEL_UM
    design_nm: Annotated[float, ranged(100, 1e4, "nm")] = 550.0
    per_degree_px: Annotated[float, ranged(0, 1e3, "px")] = 1.0
    field_mm: Annotated[float, ranged(0, 1e3, "mm")] = 1.75
    limit_deg: Annotated[float, ranged(0, 85, "deg", "(]")] = 60.0
    symmetric: bool = False
    refine: Annotated[int, ranged(1, 10_000, "pairs")] = 12

    def run(self, wanted: WantedDispersion, glasses: Sequence[Glass], on_pair: OnPair | None = None) -> list[PrismResult]:
        """Return refined prisms, the best first.

        Args:
            wanted: the dispersion.
            glasses: the catalogue; those whose range does not hold the spectrum are passed over.
            on_pair: told of every refined pair.

        Raises:
            InputError: field ``glasses`` when fewer than two are left.
        """
        able = [g for g in glasses if g.range_nm[0] <= wanted.wavelength_nm[0] and g.range_nm[1] >= wanted.wavelength_nm[-1]]
        if len(able) < 2:
            low, high = wanted.wavelength_nm[[0, -1]]
            raise InputError("glasses", [g.name for g in glasses], f"at least two whose range holds {low:g}-{high:g} nm")
        pairs = [(self.thin(outer, inner, wanted), outer, inner) for outer, inner in itertools.permutations(able, 2)]
        best = sorted(pairs, key=lambda pair: pair[0][1])[: self.refine]
        found = []
        for i, ((apexes, rms), outer, inner) in enumerate(best):
            result = self.refined((outer, inner, outer), AMICI @ apexes, wanted, rms)
            if result is not None:
                found.append(result)
                if on_pair is not None:
                    on_pair(i, len(best), result)
        return sorted(found, key=lambda r: r.rms_px)

    def thin(self, outer: Glass, inner: Glass, wanted: WantedDispersion) -> tuple[np.ndarray, float]:
        """Return (A1, A2) in rad and the rms error in px of the thin formula's best double Amici prism (theory.md (C.73))."""
        from scipy.optimize import lsq_linear

        reach = self.relay.focal_mm * 1000 / self.pixel_um
        columns = np.stack([2 * (outer.index(wanted.wavelength_nm) - 1), -(inner.index(wanted.wavelength_nm) - 1)], 1) * reach
        centred = columns - columns.mean(0)
        aim = wanted.position_px - wanted.position_px.mean()
        straight = np.array([2 * (float(outer.index(self.design_nm)) - 1), -(float(inner.index(self.design_nm)) - 1)])
        weight = math.sqrt(aim.size) * self.per_degree_px * math.degrees(1)
        limit = 2 * math.radians(self.limit_deg)
        solution = lsq_linear(np.vstack([centred, weight * straight]), np.append(aim, 0.0), (-limit, limit)).x
        return solution, float(np.sqrt(np.mean((centred @ solution - aim) ** 2)))

    def refined(
        self, glasses: tuple[Glass, ...], tilts: np.ndarray, wanted: WantedDispersion, thin_rms_px: float = math.nan
    ) -> PrismResult | None:  # fmt: skip
        """Fit the faces' tilts by the exact trace and its forward-mode derivatives; None when no shrunken start passes light."""
        optics = self._optics(glasses)
        modes = AMICI if self.symmetric else np.eye(len(tilts))
        residuals = _Residuals(self, optics, wanted, modes)
        limit = math.radians(self.limit_deg) * (2 if self.symmetric else 1)
        aim = np.clip(np.linalg.lstsq(modes, tilts, rcond=None)[0], -limit, limit)
        for share in (1.0, 0.7, 0.5, 0.3, 0.1):
            first = residuals(share * aim)
            if first is not None:
                break
        else:
            return None
        parameters, steps = share * aim, 0
        for weight in (0.05, 0.3, 1.0):  # straightness is asked for little by little: asked for at once it ends in worse places
            residuals.straightness = weight * self.per_degree_px
            fitted = fit(residuals, parameters, limit)
            assert fitted is not None
            parameters, steps = fitted.parameters, steps + fitted.steps
        start_rms_px = float(np.linalg.norm(first[0][:-1]))
        return self._result(glasses, modes @ parameters, residuals, (thin_rms_px, start_rms_px, steps))

    def _result(
        self, glasses: tuple[Glass, ...], tilts: np.ndarray, residuals: _Residuals, before: tuple[float, float, int]
    ) -> PrismResult:  # fmt: skip
        x, _, _ = residuals.optics.position_px(residuals.values(tilts), residuals.wavelength, residuals.X)
        error = residuals.errors(x)
        on_axis = error[: residuals.wanted.wavelength_nm.size]
        thin, start, steps = before
        return PrismResult(
            glasses=glasses,
            face_tilt_rad=tilts,
            thin_rms_px=thin,
            start_rms_px=start,
            rms_px=float(np.sqrt(np.mean(error**2))),
            worst_px=float(np.abs(error).max()),
            axis_rms_px=float(on_axis.std()),
            deviation_deg=math.degrees(math.atan(float(x[-1]) / residuals.reach)),
            steps=steps,
        )

    def _optics(self, glasses: tuple[Glass, ...]) -> DifferentiableOptics:
        values = OpticsValues((0.0,) * (len(glasses) + 1), (0.0,) * len(glasses), self.relay.collimator_mm, self.relay.focal_mm)
        return DifferentiableOptics(glasses, values, self.pixel_um, 0.0)


class _Residuals:
    """Position errors of a prism over its spectrum, free of their mean, and the design wavelength's deviation (theory.md (C.78))."""

    def __init__(self, design: PrismDesign, optics: DifferentiableOptics, wanted: WantedDispersion, modes: np.ndarray) -> None:
        self.design, self.optics, self.wanted, self.modes = design, optics, wanted, modes
        self.straightness = design.per_degree_px
        field = np.array([0.0, -1.0, 1.0]) * design.field_mm if design.field_mm else np.zeros(1)
        self.wavelength = np.append(np.tile(wanted.wavelength_nm, field.size), design.design_nm)
        self.X = np.append(np.repeat(field, wanted.wavelength_nm.size), 0.0)
        scale = design.relay.magnification * 1000 / design.pixel_um
        ideal = np.tile(wanted.position_px, field.size) + self.X[:-1] * scale
        self.ideal = ideal - ideal.mean()
        self.excess = [medium.index(self.wavelength) ** 2 - 1 for medium in optics.media]
        self.reach = design.relay.focal_mm * 1000 / design.pixel_um

    def __call__(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        traced = self._traced(self.modes @ parameters)
        if traced is None:
            return None
        x, by_tilt = traced
        slope, root = by_tilt @ self.modes, math.sqrt(self.ideal.size)
        weight = self.straightness * math.degrees(1) / self.reach
        r = np.append(self.errors(x) / root, weight * x[-1])
        return r, np.vstack([(slope[:-1] - slope[:-1].mean(0)) / root, weight * slope[-1]])

    def errors(self, x: np.ndarray) -> np.ndarray:
        """Return how far positions lie from the ideal ones, free of a common shift; on the axis first."""
        return x[:-1] - x[:-1].mean() - self.ideal

    def values(self, tilts: np.ndarray) -> OpticsValues:
        """Return the optics' numbers with these tilts."""
        return self.optics.values._replace(face_tilt_rad=tuple(map(float, tilts)))

    def _traced(self, tilts: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Return positions (n,) px and their derivatives (n, F) px per rad; None when a wavelength is lost."""
        k, values = kernels(), self.values(tilts)
        if k is None:
            return self._stepped(values)
        dr, t, faces, count = k.dr, k.backend, len(values.face_tilt_rad), self.wavelength.size
        leaves = [t.Float64(aligned(np.full(faces * count, angle))) for angle in values.face_tilt_rad]
        for i, tilt in enumerate(leaves):  # lanes i n .. (i + 1) n carry the derivative by tilt i
            dr.enable_grad(tilt)
            dr.set_grad(tilt, t.Float64(aligned(np.repeat(np.eye(faces)[i], count))))
        excess = [t.Float64(aligned(np.tile(known, faces))) for known in self.excess]  # not formulas: one kernel serves all glasses
        f1 = k.opaque(t.Float64, values.collimator_mm)
        sides = [(dr.sin(tilt), dr.cos(tilt)) for tilt in leaves]
        X = t.Float64(aligned(np.tile(self.X, faces)))
        traced = trace_faces(k.ops, X, f1, X * X + f1 * f1, sides, (*excess, 0.0))
        x, _ = image_point(k.ops, traced, t.Float64(0), k.opaque(t.Float64, self.reach))
        slopes = dr.forward_to(x)
        dr.eval(x, slopes, traced.valid)
        if not np.all(np.array(traced.valid)):
            return None
        return np.array(x)[:count], np.array(slopes).reshape(faces, count).T

    def _stepped(self, values: OpticsValues) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the same by complex steps in NumPy, where Dr.Jit cannot run."""
        x, _, valid = self.optics.trace(NUMPY, values, self.wavelength, self.X, 0.0)
        if not np.all(valid):
            return None
        columns: list[np.ndarray] = []
        for i in range(len(values.face_tilt_rad)):
            turned = tuple(t + 1e-30j * (i == j) for j, t in enumerate(values.face_tilt_rad))
            moved, _, _ = self.optics.trace(NUMPY, values._replace(face_tilt_rad=turned), self.wavelength.astype(complex), self.X, 0.0)
            columns.append(np.imag(moved) / 1e-30)
        return np.asarray(x), np.stack(columns, 1)
