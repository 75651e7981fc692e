"""The verbs reconstruct and score: from frames to an estimate, and how good it is."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from optsim.cli.inputs import read_frames
from optsim.cli.words import Output, known_noise, print_json, prior_named, progress_bar, solver_named, tau_named, wrote

if TYPE_CHECKING:
    import xarray as xr

MATCHED, RELATIVE = "matched", "relative"


def reconstruct(
    frames: Annotated[Path, Parameter(help="Frames file, as `optsim measure` writes it.")],
    /,
    *,
    output: Output,
    solver: Annotated[
        Literal["basis-pursuit", "admm", "gpsr", "fista", "gap"] | None,
        Parameter(help="How to invert; when absent: basis-pursuit for matched frames without noise, admm for all others."),
    ] = None,
    prior: Annotated[
        Literal["l1", "group-l1", "tv", "quality"],
        Parameter(
            help="What cubes are like: few wavelets (the paper's), the same for all bands, few edges, or the quality mode"
            " (bands from 380 to 780 nm)."
        ),
    ] = "l1",
    tau: Annotated[
        str | None,
        Parameter(
            help="`auto` (held-out pixels; the default), `discrepancy` (known noise) or a fraction of tau_max; for admm, gpsr, fista."
        ),
    ] = None,
    weighted: Annotated[
        bool, Parameter(help="Weigh measurements by their noise, as the frames file tells it (photons, read-out).", negative="")
    ] = False,
    nonnegative: Annotated[bool, Parameter(help="Rule out radiance below 0.", negative="")] = False,
    operator: Annotated[
        Literal["camera", "unit-shift"],
        Parameter(help="`camera`: the columns in the file; `unit-shift`: band k falls exactly k pixels on."),
    ] = "camera",
    wavelet: Annotated[str, Parameter(help="Orthogonal wavelet of PyWavelets: db2, haar, db4, sym8, ...")] = "db2",
    max_iterations: Annotated[int | None, Parameter(help="Stop there at the latest.")] = None,
    debias: Annotated[bool, Parameter(help="With gpsr: refit the coefficients that are not zero.", negative="")] = False,
) -> None:
    """Recover the cube from frames; the estimate comes back in the cube's units, of a foreign measurement in frames-units over response."""
    from optsim.camera import with_unit_shifts
    from optsim.files import writable, write
    from optsim.study.inverse import estimate_of, invert

    writable(output, source=frames)
    measured = read_frames(frames)
    if operator == "unit-shift":
        measured = with_unit_shifts(measured)
    noise = known_noise(measured, frames, "--weighted" if weighted else f"--tau {tau}") if weighted or tau == "discrepancy" else None
    method = _solver_for(measured, tau) if solver is None else str(solver)
    sought = prior_named(prior, wavelet, measured)
    with progress_bar(method) as progress:
        solution = invert(
            measured,
            solver_named(method, max_iterations, debias),
            prior=sought,
            tau=tau_named(tau, method),
            noise=noise,
            nonnegative=nonnegative,
            on_iteration=lambda iteration, value: progress(None, f"iteration {iteration}, objective {value:.5g}"),
        )
    write(estimate_of(measured, solution), output)
    print(solution, file=sys.stderr)
    wrote(output, solution.cube.shape, "(y, x, wavelength)")


def _solver_for(measured: xr.Dataset, tau: str | None) -> str:
    """Name the solver that suits these frames, and say why."""
    exact = measured.attrs.get("model") == MATCHED and measured.attrs["units"] == RELATIVE and tau is None
    why = "" if exact else ", as --tau is given" if tau is not None else ", as an exact fit would amplify noise and what H does not know"
    solver = "basis-pursuit" if exact else "admm"
    print(f"solver: {solver}{why}", file=sys.stderr)
    return solver


def score(
    estimate: Annotated[Path, Parameter(help="Estimate file, as `optsim reconstruct` writes it.")],
    truth: Annotated[Path, Parameter(help="The true cube.")],
    /,
    *,
    json: Annotated[bool, Parameter(help="Print one JSON object and nothing else.", negative="")] = False,
) -> None:
    """Compare an estimate with the true cube: PSNR (mean over bands; peak = the truth's maximum), SSIM, spectral angle, RMSE."""
    from optsim.cube import UNITS, bands_of, require_same_bands
    from optsim.files import read_cube
    from optsim.report.units import cube_unit
    from recon.metrics import score as compare

    a = read_cube(estimate)
    b = _reduced(read_cube(truth), a)
    require_same_bands(bands_of(b), bands_of(a), "ESTIMATE")
    mine, true = (units if units == UNITS else cube_unit(units) for units in (str(cube["radiance"].attrs["units"]) for cube in (a, b)))
    if mine != true:
        print(f"note: the estimate is in {mine}, the truth in {true}: they are compared as numbers", file=sys.stderr)
    scores = compare(a["radiance"].values, b["radiance"].values)
    if json:
        print_json(scores.as_dict())
        return

    def figure(value: float | None, form: str, unit: str) -> str:
        return "exact" if value is None and scores.exact else "not defined" if value is None else f"{value:{form}} {unit}".strip()

    print(f"PSNR, mean over bands   {figure(scores.psnr_db, '.2f', 'dB')}   (peak {scores.data_range:.4g} {true})")
    print(f"PSNR, pooled            {figure(scores.psnr_pooled_db, '.2f', 'dB')}")
    print(f"SSIM, mean over bands   {figure(scores.ssim, '.4f', '')}")
    print(f"spectral angle, mean    {figure(scores.sam_deg, '.2f', 'deg')}")
    print(f"RMSE                    {scores.rmse:.4g} {true}")


def _reduced(truth: xr.Dataset, estimate: xr.Dataset) -> xr.Dataset:
    """Average a finer truth over the estimate's mirrors and bands, where it is finer."""
    from optsim.cube import band_mean, bands_of, block_mean

    ratio, rest = divmod(truth["radiance"].shape[0], estimate["radiance"].shape[0])
    if ratio > 1 and rest == 0:
        truth = block_mean(truth, ratio)
    bands = bands_of(estimate)
    if bands_of(truth).count > bands.count:
        truth = band_mean(truth, bands)
    return truth
