"""The verbs import, import-measurement and export: data that optsim did not make, and data for solvers that are not optsim's."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from optsim.cli.data_words import (
    WAVELENGTHS,
    axes_of,
    bands_of_words,
    centers_of,
    channels_of,
    crop_of,
    mosaic_of,
    noise_of,
    range_of,
    require_plausible,
    response_of,
    shifts_of,
    unit_masks,
)
from optsim.cli.inputs import FRAMES_ONLY, named_by, read_frames
from optsim.cli.words import Output, wrote
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

FRAME_NAMES = ("meas_real", "meas", "frame", "frames", "simulation_test", "y")
MASK_NAMES = ("mask", "masks", "Phi")
TYPED = {"masks": "--mask", "mask": "--mask", "shift_px": "--shifts", "response": "--response", "mosaic": "--cfa", "offset": "--offset"}
"""Options of import-measurement by the fields that they fill."""
Wavelengths = Annotated[str | None, Parameter(help=f"Band centres in the order of the file: {WAVELENGTHS}.")]


def import_cube(
    file: Annotated[Path, Parameter(help="ENVI (either half), MATLAB v5 to v7.3, spectral EXR, .npy, HDF5, netCDF; or a folder of PNG.")],
    /,
    *,
    output: Output,
    variable: Annotated[str | None, Parameter(help="Which array, where the file holds several.")] = None,
    axes: Annotated[
        str | None,
        Parameter(
            help="Axes of the stored array in its order: y,x,wavelength; a minus turns one round: -x,y,wavelength.",
            allow_leading_hyphen=True,
        ),
    ] = None,
    wavelengths: Wavelengths = None,
    scale: Annotated[float, Parameter(help="Factor from the file's values to W m^-2 sr^-1 nm^-1.")] = 1.0,
    crop: Annotated[str | None, Parameter(help="Part of the picture: TOP,LEFT,HEIGHT,WIDTH in pixels.")] = None,
    range_nm: Annotated[str | None, Parameter(name="--range", help="Bands to keep: LOWEST:HIGHEST centre in nm.")] = None,
) -> None:
    """Bring in a cube."""
    from optsim.files import import_cube as read
    from optsim.files import writable, write
    from optsim.files.grids import doubtful
    from optsim.files.import_config import CubeImport

    writable(output, source=file)
    if not 0 < scale < float("inf"):
        raise InputError("--scale", scale, "above 0")
    centers = None if wavelengths is None else centers_of(wavelengths)
    how = CubeImport(
        variable=variable, axes=axes_of(axes), wavelengths_nm=centers, scale=scale, crop=crop_of(crop), range_nm=range_of(range_nm)
    )
    cube = read(file, how)
    write(cube, output)
    said = cube.attrs
    stored = f"{said['source_format']}, {said['source_variable']}, axes {said['source_axes']}"
    print(f"{stored}: {said['source_values']}, times {said['scale']:g} W m^-2 sr^-1 nm^-1", file=sys.stderr)
    nm = cube["wavelength"].values
    wrote(output, cube["radiance"].shape, f"(y, x, wavelength), {nm[0]:g} to {nm[-1]:g} nm")
    for sentence in doubtful(nm):
        print(f"note: {sentence}", file=sys.stderr)


def import_measurement(
    frames: Annotated[Path, Parameter(help="Frame or stack of frames: MATLAB, .npy, HDF5 or PNG.")],
    /,
    *,
    mask: Annotated[Path, Parameter(help="Mask or masks, one a frame: transmissions, or whole numbers that count up to their maximum.")],
    shifts: Annotated[
        str,
        Parameter(
            help="Where each band falls, in px from the mask's column: a list, or one number = px a band (2 for KAIST / TSA).",
            allow_leading_hyphen=True,
        ),
    ],
    wavelengths: Annotated[str, Parameter(help=f"Band centres, in the order of the shifts: {WAVELENGTHS}.")],
    output: Output,
    variable: Annotated[str | None, Parameter(help="Which array holds the frames, where the file holds several.")] = None,
    mask_variable: Annotated[str | None, Parameter(help="Which array holds the masks.")] = None,
    axes: Annotated[
        str | None, Parameter(help="Axes of a stack, out of scene,shot,channel,y,x; if absent y,x,shot for MATLAB and shot,y,x for .npy.")
    ] = None,
    scene: Annotated[
        int | None, Parameter(help="Which scene, from 1, of an array that holds several: simulation_test, or --axes with scene.")
    ] = None,
    response: Annotated[
        str | None, Parameter(help="Response of each band, a list; 1 if absent (one channel only). Channels apart by semicolons.")
    ] = None,
    cfa: Annotated[Path | None, Parameter(help="Colour mosaic: the index (from 0) of each pixel's curve in --response.")] = None,
    offset: Annotated[float, Parameter(help="Level of the frames without light, in their own unit.")] = 0.0,
    gain: Annotated[
        float | None,
        Parameter(
            help="DN per electron, with --read-noise: the frames are then in DN as the converter gave them, and their noise is known."
        ),
    ] = None,
    read_noise: Annotated[float | None, Parameter(help="With --gain: noise of a pixel without light, RMS electrons.")] = None,
) -> None:
    """Bring in a measurement that optsim did not make: frames, mask and shifts."""
    from optsim.camera.elsewhere import frames_from
    from optsim.files import writable, write
    from optsim.files.arrays import read_pictures
    from optsim.files.reader import Reader

    writable(output, source=frames, suffixes=FRAMES_ONLY)
    bands, order = bands_of_words(wavelengths)
    shift_px = shifts_of(shifts, bands.count)[order]
    chi = response_of(response, bands.count)[:, order]
    stack_axes = None if axes is None else tuple(word.strip() for word in axes.split(","))
    with Reader() as reader:
        values = read_pictures(frames, FRAME_NAMES, variable=variable, axes=stack_axes, scene=scene, reader=reader)
        shown = read_pictures(mask, MASK_NAMES, variable=mask_variable, reader=reader, options=("--mask-variable", "--mask"))
        mosaic = (
            None if cfa is None else mosaic_of(read_pictures(cfa, ("cfa", "mosaic"), reader=reader, options=("--cfa", "--cfa")), len(chi))
        )
    values = channels_of(values, None if response is None else len(chi), frames.name, mosaic is not None)
    require_plausible(values, shown, offset)
    masks, factor = unit_masks(shown)
    attrs = {"offset": offset, **noise_of(gain, read_noise), "source_frames": frames.name, "source_mask": mask.name}
    with named_by(TYPED | {"frames": frames.name}):
        measured = frames_from(values, masks, shift_px, bands, response=factor * chi, mosaic=mosaic, attrs=attrs)
    write(measured, output)
    _tell(measured, output)


def _tell(measured: xr.Dataset, output: Path) -> None:
    """Print what was brought in, and what about it may be wrong."""
    from optsim.camera.elsewhere_doubts import doubts
    from optsim.files.grids import doubtful

    nm, px = measured["wavelength"].values, measured["shift_px"].values
    wrote(output, measured["frames"].shape, f"(shot, channel, y, x), {nm.size} bands {px[0]:g} to {px[-1]:g} px")
    for sentence in (*doubtful(nm), *doubts(measured)):
        print(f"note: {sentence}", file=sys.stderr)


def export(
    frames: Annotated[Path, Parameter(help="Frames file, as `optsim measure` or `import-measurement` writes it.")],
    /,
    *,
    layout: Annotated[Literal["tsa"], Parameter(help="`tsa`: the MATLAB files that learned solvers of the KAIST / TSA benchmark read.")],
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder to write.")],
    shot: Annotated[int, Parameter(help="Which of the shots.")] = 1,
    truth: Annotated[Path | None, Parameter(help="The true cube, if known.")] = None,
) -> None:
    """Write a measurement for solvers that are not optsim's."""
    from optsim.cube import bands_of, require_same_bands
    from optsim.files import read_cube
    from optsim.files.tsa import write_tsa

    if output.exists() and not output.is_dir():
        raise InputError("-o", str(output), "a folder")
    measured = read_frames(frames)
    cube = None if truth is None else read_cube(truth)
    if cube is not None:
        require_same_bands(bands_of(measured), bands_of(cube), "--truth")
    missed = write_tsa(measured, output, shot=shot, truth=None if cube is None else cube["radiance"].values)
    for sentence in missed:
        print(f"note: {sentence}", file=sys.stderr)
    print(f"{output}: {layout} layout", file=sys.stderr)
