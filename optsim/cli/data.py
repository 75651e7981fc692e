"""The verbs import, import-measurement and export: data that optsim did not make, and data for solvers that are not optsim's."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from optsim.cli.words import Output, wrote
from optsim.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from optsim.cube import Bands
    from optsim.files.import_config import Axis, Crop

FRAME_NAMES = ("meas_real", "meas", "frame", "frames", "simulation_test", "y")
MASK_NAMES = ("mask", "masks", "Phi")
WAVELENGTHS = "FIRST:LAST:COUNT or a list in nm such as 450,460; or tsa-453.5, tsa-453.3 (the two lists in use for KAIST / TSA) or paper"
Wavelengths = Annotated[str | None, Parameter(help=f"Band centres in the order of the file: {WAVELENGTHS}.")]


def import_cube(
    file: Annotated[Path, Parameter(help="ENVI (either half), MATLAB v5 to v7.3, spectral EXR, .npy, HDF5, netCDF; or a folder of PNG.")],
    /,
    *,
    output: Output,
    variable: Annotated[str | None, Parameter(help="Which array, where the file holds several.")] = None,
    axes: Annotated[
        str | None,
        Parameter(help="Axes of the stored array in its order: --axes=y,x,wavelength; a minus turns one round: --axes=-x,y,wavelength."),
    ] = None,
    wavelengths: Wavelengths = None,
    scale: Annotated[float, Parameter(help="Factor from the file's values to W m^-2 sr^-1 nm^-1.")] = 1.0,
    crop: Annotated[str | None, Parameter(help="Part of the picture: TOP,LEFT,HEIGHT,WIDTH in pixels.")] = None,
    range_nm: Annotated[str | None, Parameter(name="--range", help="Bands to keep: LOWEST:HIGHEST centre in nm.")] = None,
) -> None:
    """Bring in a cube."""
    from optsim.files import import_cube as read
    from optsim.files import writable, write
    from optsim.files.import_config import CubeImport

    writable(output, source=file)
    if not 0 < scale < float("inf"):
        raise InputError("--scale", scale, "above 0")
    centers = None if wavelengths is None else _centers(wavelengths)
    how = CubeImport(variable=variable, axes=_axes(axes), wavelengths_nm=centers, scale=scale, crop=_crop(crop), range_nm=_range(range_nm))
    cube = read(file, how)
    write(cube, output)
    said = cube.attrs
    print(f"{said['source_format']}, {said['source_variable']}: {said['source_values']}, times {said['scale']:g}", file=sys.stderr)
    nm = cube["wavelength"].values
    wrote(output, cube["radiance"].shape, f"(y, x, wavelength), {nm[0]:g} to {nm[-1]:g} nm")


def import_measurement(
    frames: Annotated[Path, Parameter(help="Frame or stack of frames: MATLAB, .npy, HDF5 or PNG.")],
    /,
    *,
    mask: Annotated[Path, Parameter(help="Mask or stack of masks, one a frame; 0 to 1, or whole numbers that count up to their maximum.")],
    shifts: Annotated[
        str,
        Parameter(help="Where each band falls, in px from the mask's column: a list, or one number = px a band (2 for KAIST / TSA)."),
    ],
    wavelengths: Annotated[str, Parameter(help=f"Band centres, in the order of the shifts: {WAVELENGTHS}.")],
    output: Output,
    variable: Annotated[str | None, Parameter(help="Which array holds the frames, where the file holds several.")] = None,
    mask_variable: Annotated[str | None, Parameter(help="Which array holds the masks.")] = None,
    axes: Annotated[
        str | None, Parameter(help="Axes of a stack, out of shot,channel,y,x; if absent y,x,shot for MATLAB and shot,y,x for .npy.")
    ] = None,
    response: Annotated[str | None, Parameter(help="Response of each band, a list; 1 if absent. Channels apart by semicolons.")] = None,
    cfa: Annotated[Path | None, Parameter(help="Colour mosaic: the index (from 0) of each pixel's curve in --response.")] = None,
    offset: Annotated[float, Parameter(help="Level of the frames without light.")] = 0.0,
) -> None:
    """Bring in a measurement that optsim did not make: frames, mask and shifts."""
    from optsim.camera.elsewhere import frames_from
    from optsim.files import writable, write
    from optsim.files.arrays import read_pictures
    from optsim.files.reader import Reader

    writable(output, source=frames)
    bands, order = _bands(wavelengths)
    shift_px = _shifts(shifts, bands.count)[order]
    chi = None if response is None else _response(response, bands.count)[:, order]
    stack_axes = None if axes is None else tuple(word.strip() for word in axes.split(","))
    with Reader() as reader:
        values = read_pictures(frames, FRAME_NAMES, variable=variable, axes=stack_axes, reader=reader)
        masks = _unit_masks(read_pictures(mask, MASK_NAMES, variable=mask_variable, reader=reader))
        mosaic = None if cfa is None else _mosaic(read_pictures(cfa, ("cfa", "mosaic"), reader=reader))
    attrs = {"offset": offset, "source_frames": frames.name, "source_mask": mask.name}
    measured = frames_from(values, masks, shift_px, bands, response=chi, mosaic=mosaic, attrs=attrs)
    write(measured, output)
    wrote(output, measured["frames"].shape, f"(shot, channel, y, x), {bands.count} bands {shift_px[0]:g} to {shift_px[-1]:g} px")


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
    from optsim.camera import check_frames
    from optsim.cube import bands_of, require_same_bands
    from optsim.files import read, read_cube
    from optsim.files.tsa import write_tsa

    if output.exists() and not output.is_dir():
        raise InputError("-o", str(output), "a folder")
    measured = read(frames)
    check_frames(measured)
    cube = None if truth is None else read_cube(truth)
    if cube is not None:
        require_same_bands(bands_of(measured), bands_of(cube), "--truth")
    missed = write_tsa(measured, output, shot=shot, truth=None if cube is None else cube["radiance"].values)
    for sentence in missed:
        print(f"note: {sentence}", file=sys.stderr)
    print(f"{output}: {layout} layout", file=sys.stderr)


def _centers(word: str) -> tuple[float, ...]:
    from optsim.cube import PAPER_CENTERS_NM
    from optsim.files.grids import TSA_HALVES_NM, TSA_TENTHS_NM

    named = {"tsa-453.5": TSA_HALVES_NM, "tsa-453.3": TSA_TENTHS_NM, "paper": tuple(map(float, PAPER_CENTERS_NM))}
    if word in named:
        return named[word]
    if ":" not in word:
        return tuple(_numbers("--wavelengths", word, WAVELENGTHS))
    parts = word.split(":")
    first, last, count = _numbers("--wavelengths", ",".join(parts), WAVELENGTHS) if len(parts) == 3 else (0.0, 0.0, 0.0)
    if not (first > 0 and last > 0 and first != last and 2 <= count <= 10_000 and count == int(count)):
        raise InputError("--wavelengths", word, WAVELENGTHS)
    return tuple(first + (last - first) * k / (int(count) - 1) for k in range(int(count)))


def _bands(word: str) -> tuple[Bands, np.ndarray]:
    """Return the bands by increasing wavelength, and where each stands in the user's list."""
    import numpy as np

    from optsim.cube import Bands

    centers = np.array(_centers(word))
    order = np.argsort(centers, kind="stable")
    return Bands.from_centers(centers[order]), order


def _axes(word: str | None) -> tuple[Axis, Axis, Axis] | None:
    from optsim.cube import DIMS
    from optsim.files.import_config import Axis

    if word is None:
        return None
    names = [part.strip() for part in word.split(",")]
    if sorted(name.lstrip("-") for name in names) != sorted(DIMS):
        raise InputError("--axes", word, "y, x and wavelength, each once, such as y,x,wavelength")
    first, second, third = (Axis(name=name.lstrip("-"), reverse=name.startswith("-")) for name in names)
    return first, second, third


def _crop(word: str | None) -> Crop | None:
    from optsim.files.import_config import Crop

    if word is None:
        return None
    form = "TOP,LEFT,HEIGHT,WIDTH in whole pixels"
    numbers = _numbers("--crop", word, form)
    if len(numbers) != 4 or any(n != int(n) or n < 0 for n in numbers) or min(numbers[2:]) < 1:
        raise InputError("--crop", word, form)
    top, left, height, width = map(int, numbers)
    return Crop(top=top, left=left, height=height, width=width)


def _range(word: str | None) -> tuple[float, float] | None:
    if word is None:
        return None
    form = "LOWEST:HIGHEST in nm, such as 400:680"
    numbers = _numbers("--range", word.replace(":", ","), form)
    if len(numbers) != 2 or not 0 < numbers[0] < numbers[1]:
        raise InputError("--range", word, form)
    return numbers[0], numbers[1]


def _shifts(word: str, count: int) -> np.ndarray:
    """Return (K,) shifts in px; a single number is the step, and the lowest shift is then 0."""
    import numpy as np

    numbers = np.array(_numbers("--shifts", word, "one number of px a band, or a list of one number a band"))
    if numbers.size == 1 and count > 1:
        shifts = numbers[0] * np.arange(count)
        return shifts - shifts.min()
    if numbers.size != count:
        raise InputError("--shifts", f"{numbers.size} numbers", f"1 (the step) or {count}, one a band")
    return numbers


def _response(word: str, count: int) -> np.ndarray:
    import numpy as np

    rows = [_numbers("--response", part, "numbers, one a band") for part in word.split(";")]
    if any(len(row) != count for row in rows):
        raise InputError("--response", [len(row) for row in rows], f"{count} numbers a channel, one a band")
    return np.array(rows)


def _numbers(field: str, text: str, form: str) -> list[float]:
    import math

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(field, text, form) from None
    if not all(map(math.isfinite, numbers)):
        raise InputError(field, text, form)
    return numbers


def _unit_masks(stack: np.ndarray) -> np.ndarray:
    """Return (L, M, N) from 0 to 1: whole numbers are divided by their maximum, as in an 8-bit picture of a mask."""
    if stack.shape[1] != 1 and (stack != stack[:, :1]).any():
        raise InputError("--mask", stack.shape, "of one channel")
    masks = stack[:, 0]
    if masks.dtype.kind in "iu" and masks.size and masks.min() >= 0 and masks.max() > 1:
        return masks / float(masks.max())
    return masks


def _mosaic(stack: np.ndarray) -> np.ndarray:
    """Return (y, x) whole numbers."""
    import numpy as np

    if stack.shape[:2] != (1, 1) or not np.array_equal(stack, np.round(stack)) or stack.min() < 0 or stack.max() > 100:
        raise InputError("--cfa", stack.shape, "one picture of whole numbers from 0")
    return stack[0, 0].astype(np.int8)
