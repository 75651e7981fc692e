"""The four stages, each from file to file: render, measure, reconstruct, score."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from optsim.cli.words import find_scene, mask_rule, print_json, progress_bar, sensor_named, solver_named
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from optsim.camera import Exposure, Noise, Sensor

Output = Annotated[Path, Parameter(name=["--output", "-o"], help="File to write.")]
PAPER = "paper"
MATCHED, RELATIVE = "matched", "relative"


def render(
    scene: Annotated[str, Parameter(help="Name of a scene (`optsim scenes` lists them) or a scene file (.toml, .json).")],
    /,
    *,
    output: Output,
    size: Annotated[int, Parameter(help="Mirrors along each side of the square picture.")] = 256,
    bands: Annotated[str, Parameter(help="`paper` (24 bands, 452.5-668.5 nm) or START:STOP:COUNT, outer edges in nm.")] = PAPER,
    subdivide: Annotated[
        int, Parameter(help="Parts of every band; `measure --physical` wants 10. With `paper` the cube then spans 450-670 nm.")
    ] = 1,
    oversample: Annotated[int, Parameter(help="Samples along each side of a mirror; `measure --physical` wants 2.")] = 1,
    error: Annotated[float | None, Parameter(help="Relative RMS error per band at which to stop (default 0.01).")] = None,
    spp: Annotated[int | None, Parameter(help="Paths a pixel, in place of an error.")] = None,
    seed: Annotated[int, Parameter(help="0 to 4294967295; the same seed gives the same bytes.")] = 0,
) -> None:
    """Render a scene to a cube of spectral radiance in W m^-2 sr^-1 nm^-1, with its Monte Carlo standard error."""
    from optsim.cube import Bands
    from optsim.files import writable, write
    from optsim.render import RenderSettings
    from optsim.render import render as render_scene

    writable(output)
    settings = RenderSettings(oversample=oversample, error=error, samples_per_pixel=spp, seed=seed)
    table = Bands.parse(bands)
    if subdivide != 1:
        from optsim.camera import CameraConfig

        passes = CameraConfig().bandpass
        table = table.subdivide(subdivide, (passes.lower_nm, passes.upper_nm) if bands.strip() == PAPER else None)
    chosen = find_scene(scene)
    with progress_bar("rendering") as progress:
        cube = render_scene(
            chosen,
            table,
            (size, size),
            settings,
            progress=lambda share, now: progress(share, "" if now is None else f"error {now:.2g}"),
        )
    cube = cube.assign_attrs(bands=bands.strip(), subdivide=subdivide, oversample=oversample)
    write(cube, output)
    _wrote(output, cube["radiance"].shape, "(y, x, wavelength)")


def measure(
    cube: Annotated[Path, Parameter(help="Cube file, as `optsim render` writes it.")],
    /,
    *,
    output: Output,
    sensor: Annotated[Literal["mono", "bayer", "foveon"], Parameter(help="Which sensor.")],
    shots: Annotated[int, Parameter(help="Exposures L; R = L/K for mono, 3L/K for colour.")],
    masks: Annotated[Literal["distinct", "repeated"], Parameter(help="`repeated`: each three mono shots share one mask.")] = "distinct",
    physical: Annotated[
        bool, Parameter(help="Trace the prism: sub-pixel shifts, smile, band widths; frames in electrons.", negative="")
    ] = False,
    matched: Annotated[bool, Parameter(help="Apply the band model H with unit band weights: the default.", negative="")] = False,
    interpolate: Annotated[
        bool, Parameter(help="With --physical: interpolate a cube that is too coarse; the result is marked.", negative="")
    ] = False,
    camera: Annotated[Path | None, Parameter(help="With --physical: a camera as TOML.")] = None,
    noise: Annotated[
        bool,
        Parameter(
            help="Shot noise, read noise, full well and converter; frames in DN. The brightest pixel is exposed to 90 % of the full well.",
            negative="",
        ),
    ] = False,
    bits: Annotated[int | None, Parameter(help="With --noise: bits of the converter, 8 to 16 (default 12).")] = None,
    read_noise: Annotated[float | None, Parameter(help="With --noise: read noise, RMS electrons (default 10).")] = None,
    exposure: Annotated[float | None, Parameter(help="With --physical: exposure in s; automatic when absent.")] = None,
    bands: Annotated[
        str | None, Parameter(help="With --physical: bands of the model H; those that the cube was rendered for when absent.")
    ] = None,
    seed: Annotated[int, Parameter(help="Seed of masks and noise.")] = 0,
) -> None:
    """Photograph a cube through mask, prism and sensor. Masks, shifts and responses travel in the frames file."""
    from optsim.camera import Exposure, Interpolate, masks_for, measure_matched
    from optsim.files import read_cube, writable, write

    if physical and matched:
        raise InputError("--matched", "given with --physical", "given alone: data come from one model or the other")
    only_physical = {
        "--interpolate": interpolate,
        "--camera": camera,
        "--exposure": exposure is not None,
        "--bands": bands is not None,
    }
    for name, given in only_physical.items():
        if given and not physical:
            raise InputError(name, given, "given with --physical")
    for name, value in (("--bits", bits), ("--read-noise", read_noise)):
        if value is not None and not noise:
            raise InputError(name, value, "given with --noise")
    if bits is not None and not 8 <= bits <= 16:
        raise InputError("--bits", bits, "from 8 to 16")
    writable(output, source=cube)
    chosen, rule = sensor_named(sensor), mask_rule(masks)
    source = read_cube(cube)
    if physical:
        how = Exposure(
            time_s=exposure,
            noise=_noise(noise, bits, read_noise),
            interpolate=Interpolate() if interpolate else None,
            seed=seed,
            masks_name=masks,
        )
        frames = _photograph(source, chosen, shots, bands, camera, how)
    else:
        source = _band_cube(source)
        height, width = source["radiance"].shape[:2]
        drawn = masks_for(chosen, shots, rule, (height, width), seed)
        frames = measure_matched(source, chosen, drawn, masks_name=rule.name, seed=seed, noise=_noise(noise, bits, read_noise))
    write(frames, output)
    _wrote(output, frames["frames"].shape, f"(shot, channel, y, x), {frames.attrs['units']}")


def reconstruct(
    frames: Annotated[Path, Parameter(help="Frames file, as `optsim measure` writes it.")],
    /,
    *,
    output: Output,
    solver: Annotated[
        Literal["basis-pursuit", "admm", "gpsr", "fista"] | None,
        Parameter(help="How to invert; when absent: basis-pursuit for matched frames without noise, admm for all others."),
    ] = None,
    tau: Annotated[
        str | None, Parameter(help="`auto` (held-out pixels; the default) or a fraction of tau_max, for admm, gpsr and fista.")
    ] = None,
    operator: Annotated[
        Literal["camera", "unit-shift"],
        Parameter(help="`camera`: the columns in the file; `unit-shift`: band k falls exactly k pixels on."),
    ] = "camera",
    wavelet: Annotated[str, Parameter(help="Orthogonal wavelet of PyWavelets: db2, haar, db4, sym8, ...")] = "db2",
    max_iterations: Annotated[int | None, Parameter(help="Stop there at the latest.")] = None,
    debias: Annotated[bool, Parameter(help="With gpsr: refit the coefficients that are not zero.", negative="")] = False,
) -> None:
    """Recover the cube from frames; the estimate comes back in the cube's own units."""
    from optsim.camera import check_frames, with_unit_shifts
    from optsim.files import read, writable, write
    from optsim.study.inverse import estimate_of, invert
    from recon import Kronecker

    writable(output, source=frames)
    measured = read(frames)
    check_frames(measured)
    if operator == "unit-shift":
        measured = with_unit_shifts(measured)
    if solver is None:
        exact = measured.attrs["model"] == MATCHED and measured.attrs["units"] == RELATIVE and tau is None
        solver = "basis-pursuit" if exact else "admm"
        why = (
            "" if exact else ", as --tau is given" if tau is not None else ", as an exact fit would amplify noise and what H does not know"
        )
        print(f"solver: {solver}{why}", file=sys.stderr)
    basis = Kronecker.for_shape((measured.sizes["mirror_y"], measured.sizes["mirror_x"], measured.sizes["wavelength"]), wavelet=wavelet)
    chosen, start = solver_named(solver, tau, measured, max_iterations, debias, basis)
    with progress_bar(solver) as progress:
        solution = invert(
            measured,
            chosen,
            basis=basis,
            start=start,
            on_iteration=lambda iteration, value: progress(None, f"iteration {iteration}, objective {value:.5g}"),
        )
    write(estimate_of(measured, solution), output)
    print(solution, file=sys.stderr)
    _wrote(output, solution.cube.shape, "(y, x, wavelength)")


def score(
    estimate: Annotated[Path, Parameter(help="Estimate file, as `optsim reconstruct` writes it.")],
    truth: Annotated[Path, Parameter(help="The true cube.")],
    /,
    *,
    json: Annotated[bool, Parameter(help="Print one JSON object and nothing else.", negative="")] = False,
) -> None:
    """Compare an estimate with the true cube: PSNR (mean over bands; peak = the truth's maximum), SSIM, spectral angle, RMSE."""
    from optsim.cube import bands_of, require_same_bands
    from optsim.files import read_cube
    from recon.metrics import score as compare

    a = read_cube(estimate)
    b = _reduced(read_cube(truth), a)
    require_same_bands(bands_of(b), bands_of(a), "ESTIMATE")
    scores = compare(a["radiance"].values, b["radiance"].values)
    if json:
        print_json(scores.as_dict())
        return

    def figure(value: float | None, form: str, unit: str) -> str:
        return "exact" if value is None and scores.exact else "not defined" if value is None else f"{value:{form}} {unit}".strip()

    print(f"PSNR, mean over bands   {figure(scores.psnr_db, '.2f', 'dB')}   (peak {scores.data_range:.4g} {a['radiance'].attrs['units']})")
    print(f"PSNR, pooled            {figure(scores.psnr_pooled_db, '.2f', 'dB')}")
    print(f"SSIM, mean over bands   {figure(scores.ssim, '.4f', '')}")
    print(f"spectral angle, mean    {figure(scores.sam_deg, '.2f', 'deg')}")
    print(f"RMSE                    {scores.rmse:.4g} {a['radiance'].attrs['units']}")


def _photograph(
    source: xr.Dataset, sensor: Sensor, shots: int, bands: str | None, camera: Path | None, exposure: Exposure
) -> xr.Dataset:  # fmt: skip
    from optsim.camera import CameraConfig, masks_for, photograph
    from optsim.cube import Bands

    optics = CameraConfig() if camera is None else CameraConfig.from_toml(camera)
    table = Bands.parse(bands if bands is not None else str(source.attrs.get("bands", PAPER)))
    samples = int(source.attrs.get("oversample", 1))
    height, width = (side // samples for side in source["radiance"].shape[:2])
    rule = mask_rule(exposure.masks_name)
    drawn = masks_for(sensor, shots, rule, (height, width), int(exposure.seed))
    return photograph(source, table, optics, sensor, drawn, exposure)


def _noise(wanted: bool, bits: int | None, read_noise: float | None) -> Noise | None:
    from optsim.camera import Noise

    if not wanted:
        return None
    return Noise(bits=12 if bits is None else bits, read_noise_e=10.0 if read_noise is None else read_noise)


def _band_cube(source: xr.Dataset) -> xr.Dataset:
    """Average a fine cube over the mirrors and bands that it was rendered for; another cube stays as it is."""
    from optsim.cube import Bands, band_mean, block_mean

    samples, parts = int(source.attrs.get("oversample", 1)), int(source.attrs.get("subdivide", 1))
    if samples > 1:
        source = block_mean(source, samples).assign_attrs(oversample=1)
    if parts > 1:
        source = band_mean(source, Bands.parse(str(source.attrs["bands"]))).assign_attrs(subdivide=1)
    if samples > 1 or parts > 1:
        print(f"the fine cube was averaged to {' x '.join(map(str, source['radiance'].shape))} first", file=sys.stderr)
    return source


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


def _wrote(path: Path, shape: tuple[int, ...], what: str) -> None:
    print(f"{path}: {' x '.join(map(str, shape))} {what}", file=sys.stderr)
