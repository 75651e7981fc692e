"""What tolerances leave of a dispersion curve: Monte Carlo over built prisms, with intervals (theory.md (C.63))."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.camera.arrays import NUMPY
from optsim.camera.calibrate.jacobian import jacobian
from optsim.camera.calibrate.parameters import Tolerances
from optsim.camera.calibrate.prism_model import PrismModel, prism_model
from optsim.camera.prism_study import shapes_the_curve, unstretched
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.camera import CameraConfig

MAX_DRAWS = 1_000_000
BLOCK = 4096
SHARES = (0.025, 0.5, 0.975)
_STREAM = 32


def tolerance_study(
    camera: CameraConfig, wavelength_nm: np.ndarray, draws: int = 2000, seed: int = 0, tolerances: Tolerances | None = None
) -> dict[str, Any]:  # fmt: skip
    """Build prisms and lenses at random within their tolerances and tell how their axial curves differ from the drawn one.

    Indices, angles, focal length and the mount's tilt are independent and normal. Three kinds of change are told:
    ``as_built``; ``aligned``, after the sensor is shifted so that the design wavelength lands where it should; and
    ``bent``, what neither a shift nor a change of the spectrum's length (a refocus, a re-spaced relay) takes away.

    Args:
        camera: with a traced prism.
        wavelength_nm: (n,) increasing, n at least 3.
        draws: built cameras, from 100 to 1e6.
        seed: from 0 to 2^63 - 1.
        tolerances: standard deviations.

    Returns:
        ``draws``, ``seed``, ``lost`` (share of built prisms that lose one of the wavelengths; left out below),
        ``wavelength_nm``, for each kind (3, n) ``*_px`` changes that 2.5, 50 and 97.5 % of cameras stay below and its
        ``*_rms_px``; ``length_px`` of the spectrum and ``nm_per_px`` at both ends and in the middle. Each summary is
        ``{"quantile", "low", "high"}``: the quantiles and the 95 % interval that the finite number of draws leaves them.
        ``linear_ratio``: standard deviation of the aligned curve over the one that derivatives predict.

    Raises:
        InputError: ``--draws``, ``--seed``, ``camera.prism``, ``wavelength_nm``.
    """
    if not 100 <= draws <= MAX_DRAWS:
        raise InputError("--draws", draws, f"from 100 to {MAX_DRAWS} cameras")
    if not 0 <= seed < 2**63:
        raise InputError("--seed", seed, "an integer from 0 to 2^63 - 1")
    if wavelength_nm.size < 3 or np.any(np.diff(wavelength_nm) <= 0):
        raise InputError("wavelength_nm", wavelength_nm.tolist(), "at least three increasing wavelengths in nm")
    model = prism_model(camera, tolerances, registered=False)
    curves, valid = _built(model, wavelength_nm, draws, seed)
    drawn, _, _ = model.at(model.drawn, np.append(wavelength_nm, model.anchor_nm), 0.0, 0.0)
    if not valid.any():
        raise InputError("camera.prism", f"loses light in all {draws} built cameras", "a prism that passes these wavelengths")
    change = (curves - drawn)[valid]
    as_built, aligned = change[:, :-1], change[:, :-1] - change[:, -1:]
    bent = unstretched(aligned, drawn[:-1])
    curve = curves[valid][:, :-1]
    step = np.gradient(wavelength_nm) / np.gradient(curve, axis=1)
    middle = wavelength_nm.size // 2
    return {
        "draws": draws,
        "seed": seed,
        "lost": float(1 - valid.mean()),
        "wavelength_nm": wavelength_nm.tolist(),
        **{f"{name}_px": np.quantile(values, SHARES, axis=0).tolist() for name, values in _kinds(as_built, aligned, bent)},
        **{f"{name}_rms_px": summary(np.sqrt(np.mean(values**2, axis=1))) for name, values in _kinds(as_built, aligned, bent)},
        "length_px": {"drawn": float(drawn[-2] - drawn[0]), **summary(curve[:, -1] - curve[:, 0])},
        "nm_per_px": [{"wavelength_nm": float(wavelength_nm[k]), **summary(step[:, k])} for k in (0, middle, -1)],
        "linear_ratio": float(np.sqrt(np.mean(aligned.var(0)) / np.mean(_linear_variance(model, wavelength_nm)))),
    }


def summary(values: np.ndarray) -> dict[str, list[float]]:
    """Return quantiles at 2.5, 50 and 97.5 % of (d,) values and, from order statistics, their 95 % intervals."""
    from scipy.stats import binom

    ordered = np.sort(values)
    last = ordered.size - 1
    low, high = (np.clip(binom.ppf(p, ordered.size, SHARES) - edge, 0, last).astype(int) for p, edge in ((0.025, 1), (0.975, 0)))
    return {"quantile": np.quantile(ordered, SHARES).tolist(), "low": ordered[low].tolist(), "high": ordered[high].tolist()}


def _built(model: PrismModel, wavelength_nm: np.ndarray, draws: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (draws, n + 1) positions, the anchor's last, and which cameras lose no light."""
    rng = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(_STREAM,))))
    nm = model.check(np.append(wavelength_nm, model.anchor_nm))[None]
    free = np.array([shapes_the_curve(model, k) for k in range(len(model.parameters))])
    curves, valid = [], []
    for start in range(0, draws, BLOCK):
        count = min(BLOCK, draws - start)
        values = model.drawn + model.tolerance * free * rng.standard_normal((count, free.size))
        x, _, ok = model.position(NUMPY, list(values.T[:, :, None]), nm, np.zeros((1, 1)), np.zeros((1, 1)))
        curves.append(x)
        valid.append(ok.all(1))
    return np.concatenate(curves), np.concatenate(valid)


def _linear_variance(model: PrismModel, wavelength_nm: np.ndarray) -> np.ndarray:
    """Return the (n,) variance of the aligned curve that derivatives at the drawing predict."""
    nm = np.append(wavelength_nm, model.anchor_nm)
    at = jacobian(model, model.drawn, nm, np.zeros(nm.size), np.zeros(nm.size))
    free = np.array([shapes_the_curve(model, k) for k in range(len(model.parameters))])
    slope = (at.dx[:-1] - at.dx[-1]) * (model.tolerance * free)
    return np.asarray((slope**2).sum(1))


def _kinds(as_built: np.ndarray, aligned: np.ndarray, bent: np.ndarray) -> tuple[tuple[str, np.ndarray], ...]:
    return ("as_built", as_built), ("aligned", aligned), ("bent", bent)
