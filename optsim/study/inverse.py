"""From a frames file to recon's operator, and from its answer to a cube file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optsim import __version__
from optsim.cube import bands_of, make_cube

if TYPE_CHECKING:
    from collections.abc import Callable

    import xarray as xr

    from recon.prior import Prior
    from recon.problem import Solver
    from recon.solution import Solution
    from recon.tau import TauRule


def invert(
    frames: xr.Dataset,
    solver: Solver | None = None,
    *,
    prior: Prior | None = None,
    tau: float | TauRule | None = None,
    noise: np.ndarray | None = None,
    nonnegative: bool = False,
    start: np.ndarray | None = None,
    threads: int | None = None,
    on_iteration: Callable[[int, float], None] | None = None,
) -> Solution:
    """Reconstruct the cube from a frames file alone, in float32.

    Args:
        frames: as ``optsim measure`` writes it; its masks, responses and columns make H.
        solver: None: basis pursuit.
        prior: None: l1 in the default wavelet x DCT.
        tau: weight of the prior or a rule for it; None: the solver's default.
        noise: variance of each measurement, as :func:`optsim.camera.noise_variance` tells it; None: all weigh alike.
        nonnegative: whether radiance below 0 is ruled out.
        start: (M, N, K) first guess in the cube's units, or None.
        threads: None: all cores.
        on_iteration: called as ``on_iteration(iteration, objective)``; what it raises ends the solve.

    Raises:
        InputError: when the frames or the solver's settings make no sense.
    """
    from optsim.camera import band_model_of, signal_of
    from recon import reconstruct

    operator = band_model_of(frames).operator(np.float32)
    return reconstruct(
        operator,
        signal_of(frames),
        prior=prior,
        solver=solver,
        tau=tau,
        noise=noise,
        nonnegative=nonnegative,
        start=start,
        threads=threads,
        on_iteration=on_iteration,
    )


def estimate_of(frames: xr.Dataset, solution: Solution) -> xr.Dataset:
    """Wrap a solution as a cube in its unit (:func:`optsim.camera.cube_units_of`), with where it came from.

    Wall time is not among the attributes: the same seed gives the same bytes.
    """
    from optsim.camera import cube_units_of

    attrs = {
        "optsim_version": __version__,
        "kind": "estimate",
        **{name: frames.attrs[name] for name in ("sensor", "masks", "model", "operator", "seed") if name in frames.attrs},
        "shots": frames.sizes["shot"],
        "stop": str(solution.stop),
        "converged": int(solution.stop.converged),
        "iterations": solution.iterations,
        "relative_residual": float(solution.residual),
    }
    if solution.tau is not None:
        attrs |= {"tau": float(solution.tau)}
    return make_cube(np.ascontiguousarray(solution.cube), bands_of(frames), attrs=attrs, units=cube_units_of(frames))
