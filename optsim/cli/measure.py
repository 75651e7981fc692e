"""The verb measure: from a cube to frames."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from optsim.cli.modelled import budget_plan, modelled_camera, pattern_named, warn_of_ratio
from optsim.cli.words import PAPER, Output, knowledge_named, mask_rule, sensor_named, wrote
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from optsim.camera import Noise


def measure(
    cube: Annotated[Path, Parameter(help="Cube file, as `optsim render` writes it.")],
    /,
    *,
    output: Output,
    sensor: Annotated[
        Literal["mono", "bayer", "foveon", "mono-silicon", "foveon-physical", "quattro"],
        Parameter(help="Measured curves (mono: flat), or modelled from silicon: mono-silicon, foveon-physical, quattro."),
    ],
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
    error: Annotated[
        float | None,
        Parameter(help="With --physical: leave out effects of the camera that together change frames by less, relative; 0: none (0.001)."),
    ] = None,
    force: Annotated[tuple[str, ...], Parameter(help="With --physical: an effect to model even if --error does not require it.")] = (),
    without: Annotated[
        tuple[str, ...], Parameter(help="With --physical: an effect to leave out; `optsim explain --camera` lists them.")
    ] = (),
    pattern: Annotated[
        str, Parameter(help="What the masks show: bernoulli, stratified, complementary, blue-noise, or a PNG or NPY file.")
    ] = "bernoulli",
    curves: Annotated[
        Path | None, Parameter(help="Sensor curves of your own: a CSV with wavelength_nm and mono, or red, green, blue.")
    ] = None,
    knows: Annotated[
        Literal["exact", "camera", "unit-shift"],
        Parameter(help="With --physical: what H in the file knows: all that is modelled, the columns of each band, or nothing."),
    ] = "exact",
    truth: Annotated[
        Path | None, Parameter(help="With --physical: also write the cube at the mirrors, behind the camera's objective; score against it.")
    ] = None,
    budget: Annotated[
        str | None,
        Parameter(help="With --physical: light budget A to F; --shots then counts colour shots, --exposure is a colour shot's."),
    ] = None,
    seed: Annotated[int, Parameter(help="Seed of masks and noise.")] = 0,
) -> None:
    """Photograph a cube through mask, prism and sensor. Masks, shifts and responses travel in the frames file."""
    from optsim.camera import CameraConfig, Exposure, Interpolate, masks_for, measure_matched, photograph
    from optsim.camera.objective import through_objective
    from optsim.cube import Bands
    from optsim.files import read_cube, writable, write

    if physical and matched:
        raise InputError("--matched", "given with --physical", "given alone: data come from one model or the other")
    only_physical = {
        "--interpolate": interpolate,
        "--camera": camera,
        "--exposure": exposure is not None,
        "--bands": bands is not None,
        "--error": error is not None,
        "--force": bool(force),
        "--without": bool(without),
        "--budget": budget is not None,
        "--knows": knows != "exact",
        "--truth": truth is not None,
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
    if truth is not None:
        writable(truth, source=cube)
    chosen, rule, shown = sensor_named(sensor, curves), mask_rule(masks), pattern_named(pattern)
    source = read_cube(cube)
    if physical:
        how = Exposure(
            time_s=exposure,
            noise=_noise(noise, bits, read_noise),
            interpolate=Interpolate() if interpolate else None,
            seed=seed,
            masks_name=masks,
            shifts=knowledge_named(knows),
        )
        if budget is not None:
            plan = budget_plan(budget, chosen, shots, exposure)
            shots, how = plan.shots, how.model_copy(update={"time_s": plan.exposure_s, "fill": plan.fill, "masks_name": plan.rule.name})
        optics = CameraConfig() if camera is None else CameraConfig.from_toml(camera)
        table = Bands.parse(bands if bands is not None else str(source.attrs.get("bands", PAPER)))
        samples = int(source.attrs.get("oversample", 1))
        size = (source.sizes["y"] // samples, source.sizes["x"] // samples)
        optics = modelled_camera(optics, table, size, 1e-3 if error is None else error, force, without)
        source = through_objective(source, optics, samples)
        if truth is not None:
            write(source, truth)
            wrote(truth, source["radiance"].shape, "(y, x, wavelength), at the mirrors")
        drawn = masks_for(chosen, shots, mask_rule(how.masks_name), size, seed, shown)
        warn_of_ratio(chosen, shots, table.count)
        frames = photograph(source, table, optics, chosen, drawn, how)
    else:
        source = _band_cube(source)
        height, width = source["radiance"].shape[:2]
        drawn = masks_for(chosen, shots, rule, (height, width), seed, shown)
        warn_of_ratio(chosen, shots, source.sizes["wavelength"])
        frames = measure_matched(source, chosen, drawn, masks_name=rule.name, seed=seed, noise=_noise(noise, bits, read_noise))
    write(frames, output)
    wrote(output, frames["frames"].shape, f"(shot, channel, y, x), {frames.attrs['units']}")


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
