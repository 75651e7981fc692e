"""The verb measure: from a cube to frames."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from cyclopts import Parameter

from optsim.cli.inputs import FRAMES_ONLY
from optsim.cli.modelled import budget_plan, modelled_camera, pattern_named, warn_of_ratio
from optsim.cli.words import PAPER, Output, knowledge_named, mask_rule, sensor_named, wrote
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from optsim.camera import CameraConfig, Exposure, Noise, Sensor
    from optsim.camera.dmd import MaskRule
    from optsim.camera.patterns import Pattern
    from optsim.cube import Bands


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
    electronics = _noise(noise, bits, read_noise)
    writable(output, source=cube, suffixes=FRAMES_ONLY)
    if truth is not None:
        writable(truth, source=cube)
    chosen, shown = sensor_named(sensor, curves), pattern_named(pattern)
    source = read_cube(cube)
    if not physical:
        frames = _matched(source, chosen, shots, mask_rule(masks), shown, seed, electronics)
    else:
        from optsim.camera import Exposure, Interpolate

        how = Exposure(
            time_s=exposure,
            noise=electronics,
            interpolate=Interpolate() if interpolate else None,
            seed=seed,
            masks_name=masks,
            shifts=knowledge_named(knows),
        )
        if budget is not None:
            plan = budget_plan(budget, chosen, shots, exposure)
            shots, how = plan.shots, how.model_copy(update={"time_s": plan.exposure_s, "fill": plan.fill, "masks_name": plan.rule.name})
        view = _view(source, camera, bands)
        optics = modelled_camera(view.camera, view.bands, view.size, 1e-3 if error is None else error, force, without)
        frames, mirrors = _photographed(source, view, optics, chosen, shots, shown, how)
        if truth is not None:
            write(mirrors, truth)
            wrote(truth, mirrors["radiance"].shape, "(y, x, wavelength), at the mirrors")
    write(frames, output)
    wrote(output, frames["frames"].shape, f"(shot, channel, y, x), {frames.attrs['units']}")


class _View(NamedTuple):
    """What a camera makes of a cube: the camera as its file states it, the bands of H, mirrors (rows, columns), samples a mirror's side."""

    camera: CameraConfig
    bands: Bands
    size: tuple[int, int]
    samples: int


def _view(source: xr.Dataset, camera: Path | None, bands: str | None) -> _View:
    from optsim.camera import CameraConfig
    from optsim.cube import Bands

    samples = int(source.attrs.get("oversample", 1))
    return _View(
        CameraConfig() if camera is None else CameraConfig.from_toml(camera),
        Bands.parse(bands if bands is not None else str(source.attrs.get("bands", PAPER))),
        (source.sizes["y"] // samples, source.sizes["x"] // samples),
        samples,
    )


def _photographed(
    source: xr.Dataset, view: _View, optics: CameraConfig, sensor: Sensor, shots: int, pattern: Pattern, how: Exposure
) -> tuple[xr.Dataset, xr.Dataset]:
    """Return the frames, and the cube at the mirrors that they are of."""
    from optsim.camera import masks_for, photograph
    from optsim.camera.objective import through_objective

    source = through_objective(source, optics, view.samples)
    drawn = masks_for(sensor, shots, mask_rule(how.masks_name), view.size, how.seed, pattern)
    warn_of_ratio(sensor, shots, view.bands.count)
    return photograph(source, view.bands, optics, sensor, drawn, how), source


def _matched(
    source: xr.Dataset, sensor: Sensor, shots: int, rule: MaskRule, pattern: Pattern, seed: int, noise: Noise | None
) -> xr.Dataset:
    from optsim.camera import masks_for, measure_matched

    source = _band_cube(source)
    height, width = source["radiance"].shape[:2]
    drawn = masks_for(sensor, shots, rule, (height, width), seed, pattern)
    warn_of_ratio(sensor, shots, source.sizes["wavelength"])
    return measure_matched(source, sensor, drawn, masks_name=rule.name, seed=seed, noise=noise)


def _noise(wanted: bool, bits: int | None, read_noise: float | None) -> Noise | None:
    from optsim.camera import Noise

    for name, value in (("--bits", bits), ("--read-noise", read_noise)):
        if value is not None and not wanted:
            raise InputError(name, value, "given with --noise")
    if bits is not None and not 8 <= bits <= 16:
        raise InputError("--bits", bits, "from 8 to 16")
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
