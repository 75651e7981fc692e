"""Study of a prism: smile over the field, what each number of the drawing does, and what tolerances leave (theory.md (C.57) to (C.63))."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.calibrate.identify import combinations
from optsim.camera.calibrate.jacobian import jacobian
from optsim.camera.calibrate.parameters import Tolerances
from optsim.camera.calibrate.prism_model import PrismModel, prism_model
from optsim.camera.calibrate.simulate import spot_grid
from optsim.camera.effects import effect_named, reduced
from optsim.camera.glass import AIR
from optsim.camera.stack import Prism

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig
    from optsim.camera.optics import Optics

SPOT_SIGMA_PX = 0.1
SPOT_WAVELENGTHS = 24
FIELD = (256, 256)


def beam_path(camera: CameraConfig) -> Optics:
    """Return the prism in the beam in which it stands; registration, tilt, defocus and distortion are left out."""
    kept = [effect_named(name) for name in ("smile", "fresnel", "converging")]
    return reduced(camera, [effect for effect in kept if effect.present(camera)]).optics


def smile(camera: CameraConfig, wavelength_nm: np.ndarray, size: tuple[int, int] = FIELD) -> dict[str, Any]:
    """Tell how the dispersion changes over the field, against the axial curve and the magnification.

    Args:
        camera: its prism or table alone, see :func:`beam_path`.
        wavelength_nm: (n,) wavelengths.
        size: (rows, columns) of mirrors; the field's edges are half of them away from its middle.

    Returns:
        ``X_mm`` and ``Y_mm`` (half the field), and (n,) lists: ``smile_px`` (x at the upper edge less x in the middle; the
        lower edge's is the same), ``keystone_px`` (y at the upper edge less magnification x Y), ``left_px`` and ``right_px``
        (x at the left and right edge less the middle's and magnification x X). Lost light gives None.
    """
    dispersion = beam_path(camera)
    half_y, half_x = (count / 2 * camera.dmd.pitch_um / 1000 for count in size)
    scale = dispersion.magnification_px
    x0, _, ok0 = dispersion.position_px(wavelength_nm)

    def against_axis(X: float, Y: float) -> tuple[list[float | None], list[float | None]]:
        x, y, ok = dispersion.position_px(wavelength_nm, X, Y)
        both = ok & ok0
        return _listed(x - x0 - scale * X, both), _listed(y - scale * Y, both)

    top, keystone = against_axis(0.0, half_y)
    return {
        "wavelength_nm": wavelength_nm.tolist(),
        "X_mm": half_x,
        "Y_mm": half_y,
        "smile_px": top,
        "keystone_px": keystone,
        "left_px": against_axis(-half_x, 0.0)[0],
        "right_px": against_axis(half_x, 0.0)[0],
    }


def sensitivity(camera: CameraConfig, wavelength_nm: np.ndarray, tolerances: Tolerances | None = None) -> dict[str, Any]:
    """Return the derivatives of the axial curve with respect to every number of prism and lenses.

    Args:
        camera: with a traced prism.
        wavelength_nm: (n,) wavelengths.
        tolerances: standard deviations of the built numbers.

    Returns:
        ``names``, ``unit``, ``tolerance`` (P,), ``px_per_unit`` (P, n); and per tolerance, in px, (P,): ``shift_px`` (mean
        over the wavelengths), ``stretch_px`` (change of the spectrum's length), ``bend_px`` (rms of what neither a shift
        nor a stretch explains).

    Raises:
        InputError: field ``camera.prism`` for a table, ``wavelength_nm`` outside a glass's range.
    """
    model = prism_model(camera, tolerances, registered=False)
    zero = np.zeros(wavelength_nm.size)
    at = jacobian(model, model.drawn, wavelength_nm, zero, zero)
    rows = [k for k, p in enumerate(model.parameters) if shapes_the_curve(model, k)]
    per_tolerance = at.dx[:, rows] * model.tolerance[rows]
    return {
        "names": [model.names[k] for k in rows],
        "unit": [model.parameters[k].unit for k in rows],
        "tolerance": [model.parameters[k].tolerance for k in rows],
        "wavelength_nm": wavelength_nm.tolist(),
        "px_per_unit": at.dx[:, rows].T.tolist(),
        "shift_px": per_tolerance.mean(0).tolist(),
        "stretch_px": (per_tolerance[-1] - per_tolerance[0]).tolist(),
        "bend_px": np.sqrt(np.mean(unstretched(per_tolerance.T, at.x_px) ** 2, axis=1)).tolist(),
    }


def told_apart(camera: CameraConfig, sigma_px: float = SPOT_SIGMA_PX, tolerances: Tolerances | None = None) -> dict[str, Any]:
    """Tell which combinations of parameters spots of a given error would determine: 24 wavelengths at 3 x 3 places.

    Args:
        camera: with a traced prism.
        sigma_px: standard error of a centroid, above 0.
        tolerances: how far built cameras stray from the drawing.

    Returns:
        ``sigma_px``, ``spots``, and ``combinations`` from best to worst determined, as
        :meth:`optsim.camera.calibrate.identify.Combinations.describe` tells them.
    """
    model = prism_model(camera, tolerances)
    at = jacobian(model, model.drawn, *spot_grid(camera, SPOT_WAVELENGTHS, FIELD))
    whitened = np.concatenate([at.dx, at.dy]) / sigma_px
    split = combinations(whitened, model.names, model.tolerance)
    return {"sigma_px": sigma_px, "spots": int(at.valid.sum()), "combinations": split.describe()}


def study(camera: CameraConfig, draws: int = 2000, seed: int = 0) -> dict[str, Any]:
    """Return smile, sensitivities, identifiable combinations and tolerances.

    The last three hold in collimated light: they are None for a table, without glass and in a converging beam.

    Raises:
        InputError: ``--draws``, ``--seed``, or ``wavelength_nm`` when the band-pass leaves a glass's range.
    """
    from optsim.camera.prism_tolerance import tolerance_study

    nm = np.linspace(camera.bandpass.lower_nm, camera.bandpass.upper_nm, 45)
    report: dict[str, Any] = {"smile": smile(camera, nm), "jacobian": None, "identifiability": None, "tolerance": None}
    prism = camera.dispersion
    if isinstance(prism, Prism) and not camera.relay.converging and any(medium != AIR for medium in prism.media):
        report["jacobian"] = sensitivity(camera, nm)
        report["identifiability"] = told_apart(camera)
        report["tolerance"] = tolerance_study(camera, nm, draws, seed)
    return report


def shapes_the_curve(model: PrismModel, place: int) -> bool:
    """Tell whether a parameter belongs to prism or lenses and moves the axial curve; the collimator and registration do not."""
    from optsim.camera.calibrate.parameters import COLLIMATOR, is_registration

    name = model.names[place]
    return not is_registration(name) and name != COLLIMATOR


def unstretched(change: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return changes (d, n) of a curve (n,) less their best shift and stretch along the curve."""
    terms = np.stack([np.ones_like(position), position - position.mean()], axis=1)
    return np.asarray(change - (change @ np.linalg.pinv(terms).T) @ terms.T)


def _listed(values: np.ndarray, valid: np.ndarray) -> list[float | None]:
    return [float(v) if ok else None for v, ok in zip(values, valid)]
