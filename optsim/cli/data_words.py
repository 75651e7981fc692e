"""Words of the verbs import and import-measurement, turned into objects."""

from __future__ import annotations

from typing import TYPE_CHECKING

from optsim.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from optsim.cube import Bands
    from optsim.files.import_config import Axis, Crop

WAVELENGTHS = "FIRST:LAST:COUNT or a list in nm such as 450,460; or tsa-453.5, tsa-453.3 (the two lists in use for KAIST / TSA) or paper"


def centers_of(word: str) -> tuple[float, ...]:
    """Return band centres in nm, in the order given."""
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


def bands_of_words(word: str) -> tuple[Bands, np.ndarray]:
    """Return the bands by increasing wavelength, and where each stands in the user's list."""
    import numpy as np

    from optsim.cube import Bands
    from optsim.files.grids import require_nanometres

    centers = np.array(centers_of(word))
    require_nanometres("--wavelengths", centers)
    different, counts = np.unique(centers, return_counts=True)
    if different.size < 2 or counts.max() > 1:
        twice = f" ({different[counts.argmax()]:g} stands {counts.max()} times)" if counts.max() > 1 else ""
        raise InputError("--wavelengths", word, f"at least two centres in nm, all different{twice}")
    order = np.argsort(centers, kind="stable")
    return Bands.from_centers(centers[order]), order


def axes_of(word: str | None) -> tuple[Axis, Axis, Axis] | None:
    """Return the axes of a stored cube; None when nothing is said."""
    from optsim.cube import DIMS
    from optsim.files.import_config import Axis

    if word is None:
        return None
    names = [part.strip() for part in word.split(",")]
    if sorted(name.lstrip("-") for name in names) != sorted(DIMS):
        raise InputError("--axes", word, "y, x and wavelength, each once, such as y,x,wavelength")
    first, second, third = (Axis(name=name.lstrip("-"), reverse=name.startswith("-")) for name in names)
    return first, second, third


def crop_of(word: str | None) -> Crop | None:
    """Return a part of the picture; None when nothing is said."""
    from optsim.files.import_config import Crop

    if word is None:
        return None
    form = "TOP,LEFT,HEIGHT,WIDTH in whole pixels"
    numbers = _numbers("--crop", word, form)
    if len(numbers) != 4 or any(n != int(n) or n < 0 for n in numbers) or min(numbers[2:]) < 1:
        raise InputError("--crop", word, form)
    top, left, height, width = map(int, numbers)
    return Crop(top=top, left=left, height=height, width=width)


def range_of(word: str | None) -> tuple[float, float] | None:
    """Return the lowest and highest centre in nm; None when nothing is said."""
    if word is None:
        return None
    form = "LOWEST:HIGHEST in nm, such as 400:680"
    numbers = _numbers("--range", word.replace(":", ","), form)
    if len(numbers) != 2 or not 0 < numbers[0] < numbers[1]:
        raise InputError("--range", word, form)
    return numbers[0], numbers[1]


def shifts_of(word: str, count: int) -> np.ndarray:
    """Return (K,) shifts in px; a single number is the step, and the lowest shift is then 0."""
    import numpy as np

    numbers = np.array(_numbers("--shifts", word, "one number of px a band, or a list of one number a band"))
    if numbers.size == 1 and count > 1:
        shifts = numbers[0] * np.arange(count)
        return shifts - shifts.min()
    if numbers.size != count:
        raise InputError("--shifts", f"{numbers.size} numbers", f"1 (the step) or {count}, one a band")
    return numbers


def response_of(word: str | None, count: int) -> np.ndarray:
    """Return (curves, K); one curve of 1 when nothing is said."""
    import numpy as np

    if word is None:
        return np.ones((1, count))
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


def channels_of(stack: np.ndarray, curves: int | None, name: str, mosaic: bool) -> np.ndarray:
    """Return (L, C, M, W) frames, of one channel where a gray picture was stored as colours.

    Args:
        stack: (L, C, M, W).
        curves: in --response; None: not stated.
        name: of the file.
        mosaic: whether --cfa is given.

    Raises:
        InputError: ``--response``, when channels differ and nothing says what each of them sees.
    """
    count = stack.shape[1]
    if count == 1 or (not mosaic and curves == count):
        return stack
    if (stack == stack[:, :1]).all():
        return stack[:, :1]
    if mosaic:
        raise InputError("--cfa", f"{name} with {count} channels that differ", "given with frames of one channel, as read from the sensor")
    given = "no curve" if curves is None else f"{curves} curve{'s' * (curves != 1)}"
    raise InputError("--response", given, f"{count} curves apart by semicolons, one number a band, for the {count} channels of {name}")


def unit_masks(stack: np.ndarray) -> tuple[np.ndarray, float]:
    """Return (L, M, N) from 0 to 1, and the factor that the responses get for it.

    Whole numbers are divided by their maximum, as in an 8-bit picture of a mask. Measured transmissions above 1 are too, and what they
    are divided by goes into the responses, so that H stays what it was.
    """
    if stack.shape[1] != 1 and (stack != stack[:, :1]).any():
        raise InputError("--mask", f"{stack.shape[1]} channels that differ", "a picture of one channel, gray")
    masks = stack[:, 0]
    peak = float(masks.max()) if masks.size and masks.dtype.kind != "b" else 0.0
    if not 1 < peak < float("inf"):
        return masks, 1.0
    return masks / peak, 1.0 if masks.dtype.kind in "iu" else peak


def require_plausible(frames: np.ndarray, masks: np.ndarray, offset: float) -> None:
    """Refuse a frame that was given as its own mask, and an offset that leaves no light.

    Raises:
        InputError: ``--mask`` or ``--offset``.
    """
    import math

    import numpy as np

    if np.array_equal(frames, masks):
        raise InputError("--mask", "the numbers of the frames", "the mask: transmissions, another array than the frames")
    if not math.isfinite(offset):
        raise InputError("--offset", offset, "a finite number, in the frames' unit")
    brightest = float(frames.max()) if frames.size else 0.0
    if offset != 0 and brightest <= offset:
        raise InputError("--offset", offset, f"below {brightest:g}, the frames' largest value, in their unit")


def noise_of(gain: float | None, read_noise_e: float | None) -> dict[str, float | str]:
    """Return the attributes by which frames tell their noise; none when nothing is said.

    Args:
        gain: DN per electron.
        read_noise_e: RMS electrons of a pixel without light, that of its dark current included.

    Raises:
        InputError: ``--gain`` or ``--read-noise``.
    """
    for option, value, other in (("--gain", gain, read_noise_e), ("--read-noise", read_noise_e, gain)):
        if value is not None and other is None:
            raise InputError(option, value, f"given with {'--read-noise' if option == '--gain' else '--gain'}")
    if gain is None or read_noise_e is None:
        return {}
    if not 0 < gain <= 1e9:
        raise InputError("--gain", gain, "above 0 and at most 1e9 DN per electron")
    if not 0 <= read_noise_e <= 1e9:
        raise InputError("--read-noise", read_noise_e, "from 0 to 1e9 electrons")
    return {"units": "DN", "gain": gain, "read_noise_e": read_noise_e, "dark_e_per_s": 0.0}


def mosaic_of(stack: np.ndarray, curves: int) -> np.ndarray:
    """Return (y, x) whole numbers, each the index of one of so many curves.

    Raises:
        InputError: ``--cfa``, or ``--response`` when it has too few curves.
    """
    import numpy as np

    if stack.shape[:2] != (1, 1):
        raise InputError("--cfa", stack.shape[:2], "one picture of one channel: (1, 1) shots and channels")
    picture = stack[0, 0]
    bad = np.argwhere(~((picture >= 0) & (picture <= 100) & (picture == np.round(picture))))
    if len(bad):
        where = tuple(int(i) for i in bad[0])
        raise InputError("--cfa", picture[where].item(), f"whole numbers from 0 to 100; first other at (y, x) {where}")
    most = int(picture.max())
    if most >= curves:
        form = f"{most + 1} curves apart by semicolons, one number a band, as --cfa has indices from 0 to {most}"
        raise InputError("--response", f"{curves} curve{'s' * (curves != 1)}", form)
    return picture.astype(np.int8)
