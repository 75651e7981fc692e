"""What the mirrors show: the patterns that a series of masks is drawn from (theory.md (C.45) to (C.47))."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from optsim.camera.void_and_cluster import void_and_cluster
from optsim.errors import InputError

MAX_FILE_PIXELS = 2**26


class Pattern(Protocol):
    """Draw the distinct masks of a series."""

    name: str

    def draw(self, streams: Sequence[np.random.Generator], size: tuple[int, int]) -> np.ndarray:
        """Return (S, M, N) masks, one for each of S random streams; the i-th stream belongs to the i-th distinct mask."""


@dataclass(frozen=True)
class Bernoulli:
    """Open each mirror with the same probability, independently: the paper's masks (theory.md (C.9)).

    Args:
        p: probability of an open mirror, in [0, 1].
    """

    p: float = 0.5
    name = "bernoulli"

    def __post_init__(self) -> None:
        _probability(self.p)

    def draw(self, streams: Sequence[np.random.Generator], size: tuple[int, int]) -> np.ndarray:
        """Return (S, M, N) uint8; mask i depends on stream i alone."""
        return np.stack([(stream.random(size) < self.p).astype(np.uint8) for stream in streams])


@dataclass(frozen=True)
class Stratified:
    """Open every mirror equally often over the series: in p S of the S masks, rounded up or down at random (theory.md (C.45)).

    Args:
        p: share of the masks in which a mirror is open, in [0, 1].
    """

    p: float = 0.5
    name = "stratified"

    def __post_init__(self) -> None:
        _probability(self.p)

    def draw(self, streams: Sequence[np.random.Generator], size: tuple[int, int]) -> np.ndarray:
        """Return (S, M, N) uint8 whose sum over S is floor(p S) or ceil(p S) everywhere and p S on average."""
        order = np.stack([stream.random(size) for stream in streams])
        times = np.floor(self.p * len(streams) + streams[0].random(size))
        return (order.argsort(0).argsort(0) < times).astype(np.uint8)


@dataclass(frozen=True)
class Complementary:
    """Show a random mask and then its complement: a pair has every mirror open once. An odd series ends with half a pair.

    Args:
        p: probability of an open mirror in the first of a pair, in [0, 1].
    """

    p: float = 0.5
    name = "complementary"

    def __post_init__(self) -> None:
        _probability(self.p)

    def draw(self, streams: Sequence[np.random.Generator], size: tuple[int, int]) -> np.ndarray:
        """Return (S, M, N) uint8; masks 2 i and 2 i + 1 add to 1 and depend on stream 2 i alone."""
        masks = np.empty((len(streams), *size), np.uint8)
        for i in range(0, len(streams), 2):
            masks[i] = streams[i].random(size) < self.p
            if i + 1 < len(streams):
                masks[i + 1] = 1 - masks[i]
        return masks


@dataclass(frozen=True)
class BlueNoise:
    """Spread the open mirrors evenly but without order: exactly p M N of them, by void and cluster (theory.md (C.46)).

    Args:
        p: share of open mirrors, in [0, 1].
        sigma: of the Gaussian that measures crowding, in [0.5, 8] mirrors.
    """

    p: float = 0.5
    sigma: float = 1.5
    name = "blue-noise"

    def __post_init__(self) -> None:
        _probability(self.p)
        if not 0.5 <= self.sigma <= 8:
            raise InputError("masks.sigma", self.sigma, "in [0.5, 8] mirrors")

    def draw(self, streams: Sequence[np.random.Generator], size: tuple[int, int]) -> np.ndarray:
        """Return (S, M, N) uint8, each with round(p M N) open mirrors; mask i depends on stream i alone."""
        count = round(self.p * size[0] * size[1])
        return np.stack([void_and_cluster(stream, size, count, self.sigma) for stream in streams])


@dataclass(frozen=True)
class FromFile:
    """Show the masks of files: one PNG a mask, or one NPY of (M, N) or (S, M, N).

    A PNG is black (closed) and white (open), of any bit depth; an NPY holds 0 and 1.

    Args:
        paths: of the files, in the order of the masks.
        gray: allow reflectances between 0 and 1 (PNG: gray over white); the masks are then float64.
    """

    paths: tuple[Path, ...]
    gray: bool = False
    name = "file"

    def draw(self, streams: Sequence[np.random.Generator], size: tuple[int, int]) -> np.ndarray:
        """Return the files' (S, M, N) masks; nothing is cropped, repeated or resized.

        Raises:
            InputError: field ``--masks`` when a file can't be read, has another size than the mirrors or grays that
                were not allowed, or when there are not exactly S masks.
        """
        masks = [mask for path in self.paths for mask in _read(Path(path))]
        for mask in masks:
            if mask.shape != tuple(size):
                raise InputError("--masks", f"{mask.shape[0]} x {mask.shape[1]}", f"of the mirrors' size {size[0]} x {size[1]}")
        if len(masks) != len(streams):
            raise InputError("--masks", f"{len(masks)} masks", f"{len(streams)} masks, one for each distinct mask of the series")
        return check_values(np.stack(masks), self.gray)


def patterns() -> tuple[Pattern, ...]:
    """Return the patterns that are drawn, with their defaults."""
    return (Bernoulli(), Stratified(), Complementary(), BlueNoise())


def check_values(values: np.ndarray, gray: bool) -> np.ndarray:
    """Return masks as uint8 if all are 0 or 1, as float64 if ``gray`` allows values between.

    Raises:
        InputError: field ``masks`` with the first bad (shot, row, column).
    """
    binary = (values == 0) | (values == 1)
    good = (values >= 0) & (values <= 1) if gray else binary
    if not good.all():
        where = tuple(int(i) for i in np.argwhere(~good)[0])
        allowed = "from 0 to 1" if gray else "0 or 1"
        raise InputError("masks", float(values[where]), f"{allowed}; first bad (shot, row, column) is {where}")
    return np.ascontiguousarray(values, np.uint8 if binary.all() else np.float64)


def _read(path: Path) -> list[np.ndarray]:
    """Return the masks of one file as float64 arrays."""
    if path.suffix.lower() not in (".png", ".npy"):
        raise InputError("--masks", str(path), "a .png or .npy file")
    try:
        values = _read_png(path) if path.suffix.lower() == ".png" else np.load(path, mmap_mode="r", allow_pickle=False)
    except InputError:
        raise
    except (OSError, ValueError, EOFError, SyntaxError) as error:
        raise InputError("--masks", str(path), f"a readable {path.suffix[1:].upper()} file ({error.__class__.__name__})") from None
    if values.ndim not in (2, 3) or 0 in values.shape or values.dtype.kind not in "buif":
        raise InputError("--masks", f"{path}: {values.dtype} {values.shape}", "numbers of shape (rows, columns) or (shots, rows, columns)")
    _check_count(values.size)
    return list(np.array(values, np.float64).reshape(-1, *values.shape[-2:]))


def _read_png(path: Path) -> np.ndarray:
    from PIL import Image

    try:
        opened = Image.open(path, formats=["PNG"])
    except Image.DecompressionBombError:
        raise InputError("--masks", str(path), f"at most {MAX_FILE_PIXELS} values in a file") from None
    with opened as image:
        _check_count(image.width * image.height)
        if image.mode.startswith("I"):  # 16 bits of gray
            return np.asarray(image, np.float64) / 65535
        colours = np.asarray(image.convert("RGB"), np.float64) / 255
    if np.any(colours != colours[..., :1]):
        raise InputError("--masks", str(path), "a picture without colours: black for closed mirrors, white for open ones")
    return np.asarray(colours[..., 0])


def _check_count(pixels: int) -> None:
    if pixels > MAX_FILE_PIXELS:
        raise InputError("--masks", f"{pixels} values in a file", f"at most {MAX_FILE_PIXELS}")


def _probability(p: float) -> None:
    if not isinstance(p, int | float | np.number) or not 0 <= p <= 1:
        raise InputError("masks.p", p, "a probability in [0, 1]")
