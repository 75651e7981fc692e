"""Centroids of spots in calibration images, with the errors that photons and read noise leave them (theory.md (C.64))."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from optsim.camera.calibrate.spots import Spots
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from optsim.camera.camera import CameraConfig

HALF_PX = 5
SEARCH_PX = 12
FAINTEST = 20.0
"""A spot whose light is less than this many times its own error is left out."""
FINER = 4
ROUNDS = 20
STILL_PX = 1e-6
MIN_NOISE_E = 1.0
"""Background noise assumed at least, in electrons: images without noise have none."""
ONE_SIGMA = 0.841345


def find_spots(
    images: Sequence[xr.Dataset], wavelength_nm: Sequence[float], mask: np.ndarray, camera: CameraConfig, half_px: int = HALF_PX
) -> Spots:  # fmt: skip
    """Measure where the light of single open mirrors lands in monochromatic images.

    A spot is sought within 12 px of its place in the drawing, and nearer to it than to any other mirror's. The shape of a
    mirror's image, with the drawing's blur, is fitted to it in a window: light, place and background, weighted by photons
    and the image's own background noise. Without blur the centre of mass is taken.

    Args:
        images: frames of a monochrome sensor, one wavelength each, with one shot.
        wavelength_nm: of each image.
        mask: (1, M, N) with isolated open mirrors, whose images are farther apart than 2 x half_px px along rows or columns.
        camera: the drawing.
        half_px: half the window's side, from 1 to 100 px.

    Returns:
        The spots whose window lies inside the frame and that are bright enough.

    Raises:
        InputError: ``wavelength_nm``, ``images``, ``mask``, ``half_px``.
    """
    from optsim.camera.frames import signal_of

    mask = np.asarray(mask)
    if len(images) != len(wavelength_nm) or not images:
        raise InputError("wavelength_nm", len(wavelength_nm), f"one for each image, {len(images)} in all, at least 1")
    if mask.ndim != 3 or mask.shape[0] != 1 or not mask.any():
        raise InputError("mask", mask.shape, "(1, M, N) with at least one open mirror")
    if not 1 <= half_px <= 100:
        raise InputError("half_px", half_px, "from 1 to 100 px")
    rows, columns = np.nonzero(mask[0])
    reach = _reach(rows, columns, camera.mirror_px * camera.dmd.scale, half_px)
    middle = (np.array(mask.shape[1:]) - 1) / 2
    pitch_mm = camera.dmd.pitch_um / 1000
    X, Y = (columns - middle[1]) * pitch_mm, (rows - middle[0]) * pitch_mm
    found = []
    for image, nm in zip(images, wavelength_nm):
        signal = np.asarray(signal_of(image), np.float64)
        if signal.shape[:2] != (1, 1):
            raise InputError("images", signal.shape, "frames of one shot by a monochrome sensor")
        per_electron = float(image.attrs["gain"]) if image.attrs["units"] == "DN" else 1.0
        found += _in_image(signal[0, 0] / per_electron, nm, (X, Y), middle, camera, reach, half_px)
    if not found:
        raise InputError("images", len(images), "images with spots that stand out of the noise, inside the frame")
    return Spots(*(np.array(column) for column in zip(*found)))


def _reach(rows: np.ndarray, columns: np.ndarray, mirror_px: float, half_px: int) -> int:
    """Return how far from its drawn place a spot may be sought without meeting another mirror's, in px."""
    from scipy.spatial import cKDTree

    if rows.size < 2:
        return SEARCH_PX
    places = np.stack([rows, columns], axis=1)
    apart = float(cKDTree(places).query(places, k=2, p=np.inf)[0][:, 1].min()) * mirror_px
    if apart <= 2 * half_px:
        raise InputError("mask", f"open mirrors {apart:.3g} px apart", f"open mirrors farther apart than 2 x half_px = {2 * half_px} px")
    return min(SEARCH_PX, math.ceil(apart / 2) - 1)


def _in_image(
    electrons: np.ndarray,
    nm: float,
    places: tuple[np.ndarray, np.ndarray],
    middle: np.ndarray,
    camera: CameraConfig,
    reach: int,
    half_px: int,
) -> list[tuple[float, ...]]:
    background, noise = _background(electrons)
    shape = _Shape.of(camera, nm, half_px) if camera.optics.has_blur else None
    x, y, valid = camera.optics.position_px(nm, *places)
    rows: list[tuple[float, ...]] = []
    for X, Y, px, py, ok in zip(*places, x, y, valid):
        spot = _measure(electrons - background, noise, (py + middle[0], px + middle[1]), reach, half_px, shape) if ok else None
        if spot is not None:
            row, column, sigma_row, sigma_column = spot
            rows.append((nm, X, Y, column - middle[1], row - middle[0], sigma_column, sigma_row))
    return rows


def _background(electrons: np.ndarray) -> tuple[float, float]:
    """Return mean and standard deviation of the dark pixels, which are most; a converter may have cut the lower half off."""
    middle, above = np.quantile(electrons, (0.5, ONE_SIGMA))
    noise = float(above - middle)
    return float(electrons[electrons <= middle + 3 * noise].mean()), noise


class _Shape(NamedTuple):
    """Hold the spectrum of a mirror's image on pixels: mirror box x blur x pixel box, on a grid finer than pixels."""

    spectrum: np.ndarray
    fy: np.ndarray
    fx: np.ndarray
    half: int

    @classmethod
    def of(cls, camera: CameraConfig, nm: float, half: int) -> _Shape:
        """Take the blur from the camera's optics."""
        frequency = np.fft.fftfreq(4 * half * FINER, 1 / FINER)
        fy, fx = frequency[:, None], frequency[None]
        boxes = [np.sinc(f) * np.sinc(f * camera.mirror_px * camera.dmd.scale) for f in (fy, fx)]
        return cls(camera.optics.otf(nm, fy, fx) * boxes[0] * boxes[1], fy, fx, half)

    def at(self, row: float, column: float) -> np.ndarray:
        """Return (3, w, w): a spot of unit light at a place in a window's pixels, and its derivatives along row and column."""
        moved = self.spectrum * np.exp(-2j * np.pi * (self.fy * row + self.fx * column))
        side = (2 * self.half + 1) * FINER
        parts = (moved, -2j * np.pi * self.fy * moved, -2j * np.pi * self.fx * moved)
        return np.stack([np.fft.ifft2(part).real[:side:FINER, :side:FINER] * FINER**2 for part in parts])


def _measure(
    light: np.ndarray, noise: float, start: tuple[float, float], reach: int, half: int, shape: _Shape | None
) -> tuple[float, float, float, float] | None:
    """Return (row, column, their standard errors) of the brightest spot near a start; None without one inside the frame."""
    top, left = (max(0, round(c) - reach) for c in start)
    bottom, right = (max(0, round(c) + reach + 1) for c in start)
    near = light[top:bottom, left:right]
    if near.size == 0:
        return None
    peak = np.unravel_index(np.argmax(near), near.shape)
    r, c = top + int(peak[0]), left + int(peak[1])
    if max(abs(r - round(start[0])), abs(c - round(start[1]))) >= reach:
        return None  # the flank of a spot that lies farther out
    if not (half <= r < light.shape[0] - half and half <= c < light.shape[1] - half):
        return None
    window = light[r - half : r + half + 1, c - half : c + half + 1]
    variance = np.maximum(window, 0) + max(noise, MIN_NOISE_E) ** 2
    if window.sum() <= FAINTEST * np.sqrt(variance.sum()):
        return None
    found = _balance(window, variance) if shape is None else _fit(window, noise, shape)
    return None if found is None else (r - half + found[0], c - half + found[1], *found[2:])


def _balance(window: np.ndarray, variance: np.ndarray) -> tuple[float, float, float, float]:
    """Return the centre of mass: exact for a mirror's sharp image, whose box of about a pixel is summed over pixels."""
    total, axis = window.sum(), np.arange(window.shape[0], dtype=float)
    row, column = float(window.sum(1) @ axis / total), float(window.sum(0) @ axis / total)
    errors = [np.sqrt(variance.sum(1 - k) @ (axis - center) ** 2) / total for k, center in enumerate((row, column))]
    return row, column, float(errors[0]), float(errors[1])


def _fit(window: np.ndarray, noise: float, shape: _Shape) -> tuple[float, float, float, float] | None:
    """Return (row, column, their standard errors) of a blurred spot by weighted least squares; None where it runs away."""
    half = shape.half
    row, column, amount = float(half), float(half), float(window.sum())
    for _ in range(ROUNDS):
        spot = shape.at(row, column)
        terms = np.stack([spot[0], amount * spot[1], amount * spot[2], np.ones_like(window)]).reshape(4, -1)
        variance = np.maximum(amount * spot[0], 0) + max(noise, MIN_NOISE_E) ** 2
        weighted = terms / variance.ravel()
        covariance = np.linalg.inv(weighted @ terms.T)
        step = covariance @ (weighted @ (window - amount * spot[0]).ravel())
        amount, row, column = amount + step[0], row + float(np.clip(step[1], -1, 1)), column + float(np.clip(step[2], -1, 1))
        if amount <= 0 or max(abs(row - half), abs(column - half)) > 2:
            return None
        if max(abs(step[1]), abs(step[2])) < STILL_PX:
            break
    errors = np.sqrt(np.diag(covariance))
    return row, column, float(errors[1]), float(errors[2])
