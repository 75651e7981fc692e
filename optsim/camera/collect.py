"""Collect the light of a photograph: every ray of the pupil laid on the grid, blurred, binned to pixels, and accounted for."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from optsim.camera.account import Moments, account, powers_of_xi
from optsim.camera.arrays import kernels
from optsim.camera.convolve import Blurred, Kernels, kernels_for
from optsim.camera.field import Field, FieldMap, Light, fit_field
from optsim.camera.fine import FineCube
from optsim.camera.gather import Gather, Plan
from optsim.camera.layout import Account, Grid, Layout, Weights
from optsim.camera.scatter import Scatter, scatter_account

if TYPE_CHECKING:
    from optsim.camera.optics import Optics

PLANE_BYTES = 2**28


@dataclass(frozen=True, eq=False)
class Collected:
    """Hold the light of one second on the frame.

    Args:
        light: (L, C, M, W) electrons that each spectral curve would give on each pixel.
        detected: (L,) photons that the frame's pixels receive.
        account: of all photons, in which ``missed`` holds what the blur takes off the frame too.
        error_px: largest distance of the polynomials from the exact path.
        step_px: largest step between neighbouring wavelengths in the middle of the field.
        rays: of the pupil.
        reach_px: of the blur; 0 without.
    """

    light: np.ndarray
    detected: np.ndarray
    account: Account
    error_px: float
    step_px: float
    rays: int
    reach_px: int


@dataclass(frozen=True, eq=False)
class Ray:
    """One point of the pupil as an optical path of its own.

    Args:
        optics: the whole path.
        point: (2,) of the unit disc.
    """

    optics: Optics
    point: np.ndarray

    @property
    def magnification_px(self) -> float:
        """Return sensor pixels per mm at the mirrors."""
        return self.optics.magnification_px

    def position_px(
        self, wavelength_nm: np.ndarray, X_mm: np.ndarray, Y_mm: np.ndarray, /
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Return where the ray of each field point through this point of the pupil lands."""
        return self.optics.position_px(wavelength_nm, X_mm, Y_mm, pupil=self.point)

    def transmission(self, wavelength_nm: np.ndarray, X_mm: np.ndarray, Y_mm: np.ndarray, /) -> np.ndarray:
        """Return the chief ray's share of light: the pupil's is taken as one."""
        return self.optics.transmission(wavelength_nm, X_mm, Y_mm)


@dataclass(frozen=True, eq=False)
class Scene:
    """Hold what is photographed.

    Args:
        fine: the cube.
        states: (L, M, N) float64 of the mirrors.
        half_mm: half sides of the field of mirrors along (x, y).
        place_nm: (n,) wavelengths at which the fine bands are laid.
        frame: (rows, columns) of the sensor.
    """

    fine: FineCube
    states: np.ndarray
    half_mm: tuple[float, float]
    place_nm: np.ndarray
    frame: tuple[int, int]


def collect(optics: Optics, scene: Scene, weights: Weights, sub: int) -> Collected:
    """Follow all light of a scene to the pixels of the frame.

    Args:
        optics: the path.
        scene: cube, mirrors and frame.
        weights: of each fine wavelength, for one second.
        sub: cells along a pixel's side, used where the optics blur.
    """
    rays, shares = _rays(optics)
    maps = [fit_field(ray, scene.place_nm, *scene.half_mm) for ray in rays]
    if optics.has_blur:
        low, high = float(scene.place_nm.min()), float(scene.place_nm.max())
        blur = kernels_for(optics, low, high, sub, max(scene.frame) + 8)
        grid = _grid(maps, scene, blur.reach_px, sub)
    else:
        blur, grid = None, Grid((0, 0), scene.frame)
    mirrors = (scene.states.shape[1], scene.states.shape[2])
    layouts = [Layout.of(field, mirrors, scene.fine.samples, grid) for field in maps]
    light, detected, laid = _laid(layouts, shares, scene, weights) if blur is None else _blurred(layouts, shares, scene, weights, blur)
    counts = _accounts(layouts, shares, scene, weights)
    counts = replace(counts, missed=counts.missed + (laid - detected))
    error, step = max(f.error_px for f in maps), max(_step(f) for f in maps)
    return Collected(light, detected, counts, error, step, len(rays), 0 if blur is None else blur.reach_px)


def _rays(optics: Optics) -> tuple[list[Light], np.ndarray]:
    pupil = optics.pupil()
    if pupil is None:
        return [optics], np.ones(1)
    return [Ray(optics, point) for point in pupil.points], pupil.weights


def _grid(maps: list[Field], scene: Scene, reach_px: int, sub: int) -> Grid:
    """Return the grid that holds the frame and all light that the blur can bring onto it."""
    xi, eta = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9), indexing="ij")
    rows, columns = [0.0, scene.frame[0] - 1.0], [0.0, scene.frame[1] - 1.0]
    for field in maps:
        if field.valid.any():
            x, y = (p[field.valid] for p in field.at(xi, eta))
            rows += [float(y.min()) + (scene.states.shape[1] - 1) / 2, float(y.max()) + (scene.states.shape[1] - 1) / 2]
            columns += [float(x.min()) + (scene.states.shape[2] - 1) / 2, float(x.max()) + (scene.states.shape[2] - 1) / 2]
    first, last = [], []
    for places, size in ((rows, scene.frame[0]), (columns, scene.frame[1])):
        first.append(int(np.floor(max(min(places) - 0.5, -reach_px)) if min(places) < 0 else 0))
        last.append(int(np.ceil(min(max(places) + 0.5, size - 1 + reach_px)) if max(places) > size - 1 else size - 1))
    return Grid((first[0], first[1]), (last[0] - first[0] + 1, last[1] - first[1] + 1), sub)


def _engine(layout: Layout, weights: np.ndarray, scene: Scene, wavelengths: slice, plan: Plan | None) -> Gather | Scatter:
    part = layout.part(wavelengths)
    if plan is None:
        return Scatter(part, weights, scene.states, scene.fine.rows, wavelengths)
    return Gather(plan, part, weights, scene.states, scene.fine.rows, wavelengths)


def _plan(layout: Layout) -> Plan | None:
    """Return how Dr.Jit lays this layout; None where it cannot."""
    k = kernels()
    return None if k is None or not isinstance(layout.field, FieldMap) or not layout.field.valid.any() else Plan.of(k, layout)


def _laid(
    layouts: list[Layout], shares: np.ndarray, scene: Scene, weights: Weights
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return light on the frame's pixels without blur, and photons detected and laid."""
    planes = np.concatenate([weights.curves, weights.arriving[None]])
    total = np.zeros((len(scene.states), len(planes), *scene.frame))
    everything = slice(0, weights.arriving.size)
    for layout, share in zip(layouts, shares):
        if layout.field.valid.any():
            total += _engine(layout, planes * share, scene, everything, _plan(layout)).sums()
    photons = total[:, -1].sum((1, 2))
    return total[:, :-1], photons, photons


def _blurred(
    layouts: list[Layout], shares: np.ndarray, scene: Scene, weights: Weights, blur: Kernels
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return light on the frame's pixels, blurred, and photons detected and laid, a few shots at a time."""
    curves, grid = len(weights.curves), layouts[0].grid
    each = 16 * (curves + 1) * grid.cells[0] * grid.cells[1]
    together = max(1, PLANE_BYTES // (2 * each))
    parts = [
        _blurred_shots(layouts, shares, replace(scene, states=scene.states[l : l + together]), weights, blur)
        for l in range(0, len(scene.states), together)
    ]
    light, detected, laid = (np.concatenate(p) for p in zip(*parts))
    return light, detected, laid


def _blurred_shots(
    layouts: list[Layout], shares: np.ndarray, scene: Scene, weights: Weights, blur: Kernels
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lay the light between two nodes of wavelengths, split it between their kernels, go on to the next two."""
    planes = np.concatenate([weights.curves, weights.arriving[None]])
    count, shots, grid = len(planes), len(scene.states), layouts[0].grid
    blurred = Blurred(blur, grid, scene.frame, (shots, count - 1))
    lower, upper = blur.between(scene.place_nm)
    plans = [_plan(layout) for layout in layouts]
    detected, laid = np.zeros(shots), np.zeros(shots)

    def finish(node: int, light: np.ndarray) -> None:
        nonlocal detected, laid
        blurred.add(node, light[:, :-1])
        detected = detected + np.einsum("lij,ij->l", light[:, -1], blurred.inside(node))
        laid = laid + light[:, -1].sum((1, 2))

    carried = np.zeros((shots, count, *grid.cells))
    for node in range(blur.nodes_nm.size):
        there = np.flatnonzero(lower == node)
        following = np.zeros_like(carried)
        if there.size:
            chosen = slice(int(there[0]), int(there[-1]) + 1)
            split = np.concatenate([planes[:, chosen] * (1 - upper[chosen]), planes[:, chosen] * upper[chosen]])
            for layout, share, plan in zip(layouts, shares, plans):
                if layout.field.valid[chosen].any():
                    both = _engine(layout, split * share, scene, chosen, plan).sums()
                    carried += both[:, :count]
                    following += both[:, count:]
        finish(node, carried)
        carried = following
    return blurred.frames(), detected, laid


def _accounts(layouts: list[Layout], shares: np.ndarray, scene: Scene, weights: Weights) -> Account:
    k = kernels()
    maps = [layout.field for layout in layouts if isinstance(layout.field, FieldMap)]
    moments = None
    if k is not None and maps:
        powers, samples = powers_of_xi(maps), scene.fine.samples
        moments = Moments(scene.states, samples, powers, scene.fine.rows, weights.arriving.size)
    total = np.zeros((len(fields(Account)), len(scene.states)))
    for layout, share in zip(layouts, shares):
        if k is not None and moments is not None and isinstance(layout.field, FieldMap):
            one = account(k, layout, weights, scene.states, moments, scene.fine.rows)
        else:
            one = scatter_account(layout, weights, scene.states, scene.fine.rows)
        total += share * np.stack([getattr(one, f.name) for f in fields(Account)])
    return Account(*total)


def _step(field: Field) -> float:
    """Return the largest step between neighbouring fine wavelengths in the middle of the field, in px."""
    x, y = field.at(np.zeros(1), np.zeros(1))
    both = field.valid[1:] & field.valid[:-1]
    return float(np.hypot(np.diff(x[:, 0]), np.diff(y[:, 0]))[both].max(initial=0.0))
