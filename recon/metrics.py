"""How close an estimate comes to the true cube: PSNR, SSIM, spectral angle, RMSE, ERGAS (theory.md M).

Cubes are (y, x, wavelength), any strides, any float type; everything is computed in float64. An infinite
figure never leaves: an exact band has PSNR ``inf`` in the functions and ``None`` in :class:`Scores`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np

from recon.arrays import real_array, require
from recon.errors import InputError

SSIM_WINDOW = 7
"""Side of the uniform window of the structural similarity, in pixels (Wang et al. 2004 as scikit-image has it)."""


AXES = " (y, x, band)"


@dataclass(frozen=True)
class Scores:
    """Hold the figures of one estimate against its truth; ``None`` where a figure does not exist.

    Args:
        psnr_db: mean over bands of the band PSNR (M.2), dB; exact bands are left out; None when all are exact.
        psnr_pooled_db: PSNR of all samples together (M.3), dB; None when exact.
        ssim: mean over bands of the structural similarity (M.4), -1 to 1; None below 7 x 7 pixels.
        sam_deg: mean over pixels of the spectral angle (M.5), 0 to 180 degrees; None when every pixel is excluded.
        rmse: root mean square error over all samples, in the cube's unit.
        data_range: the peak that PSNR and SSIM refer to, in the cube's unit.
        band_psnr_db: PSNR of each band, dB; None for an exact band.
        exact: whether the cubes are identical.
        exact_bands: number of identical bands.
        excluded_pixels: pixels without a spectral angle: an all-zero spectrum has no direction.
        ergas: relative error (M.6) at ratio 1; None when every band is excluded.
        ergas_excluded_bands: bands whose true mean is zero.
    """

    psnr_db: float | None
    psnr_pooled_db: float | None
    ssim: float | None
    sam_deg: float | None
    rmse: float
    data_range: float
    band_psnr_db: tuple[float | None, ...]
    exact: bool
    exact_bands: int
    excluded_pixels: int
    ergas: float | None
    ergas_excluded_bands: int

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values, the bands as a list."""
        return {**asdict(self), "band_psnr_db": list(self.band_psnr_db)}


class SpectralAngle(NamedTuple):
    """Mean spectral angle in degrees (None when no pixel has one) and the number of pixels left out."""

    mean_deg: float | None
    excluded: int


class Ergas(NamedTuple):
    """ERGAS (None when no band has a non-zero mean) and the number of bands left out."""

    value: float | None
    excluded: int


def score(estimate: np.ndarray, truth: np.ndarray, data_range: float | None = None) -> Scores:
    """Compare an estimate with the true radiance by every figure at once.

    Args:
        estimate: (y, x, wavelength), finite.
        truth: same shape, finite and nowhere negative.
        data_range: peak in the cube's unit, above 0; None takes the maximum of the true cube.

    Raises:
        InputError: ``estimate`` or ``truth`` with the first bad place, or ``data_range``.
    """
    estimate, truth = _pair(estimate, truth)
    if truth.min() < 0:
        where = tuple(int(i) for i in np.unravel_index(int(np.argmin(truth)), truth.shape))
        raise InputError("truth", float(truth.min()), f"nowhere negative: it is a radiance; lowest at (y, x, band) {where}")
    peak = _peak(truth, data_range)
    bands = band_rmse(estimate, truth)
    exact = bands == 0
    levels = tuple(None if e else _decibel(peak, float(r)) for e, r in zip(exact, bands))
    pooled = rmse(estimate, truth)
    angle, relative = spectral_angle(estimate, truth), ergas(estimate, truth)
    return Scores(
        psnr_db=None if exact.all() else float(np.mean([level for level in levels if level is not None])),
        psnr_pooled_db=None if exact.all() else _decibel(peak, pooled),
        ssim=ssim(estimate, truth, peak),
        sam_deg=angle.mean_deg,
        rmse=pooled,
        data_range=peak,
        band_psnr_db=levels,
        exact=bool(exact.all()),
        exact_bands=int(exact.sum()),
        excluded_pixels=angle.excluded,
        ergas=relative.value,
        ergas_excluded_bands=relative.excluded,
    )


def psnr(estimate: np.ndarray, truth: np.ndarray, data_range: float | None = None) -> float:
    """Return the mean over bands of the band PSNR in dB (M.2); ``inf`` when every band is exact.

    A band that is exact while others are not is left out of the mean, so that it never lifts the figure.

    Args:
        estimate: (y, x, wavelength), finite.
        truth: same shape, finite.
        data_range: peak in the cube's unit, above 0; None takes the maximum of the true cube.

    Raises:
        InputError: ``estimate``, ``truth`` or ``data_range``.
    """
    levels = band_psnr(estimate, truth, data_range)
    finite = np.isfinite(levels)
    return float(levels[finite].mean()) if finite.any() else float("inf")


def band_psnr(estimate: np.ndarray, truth: np.ndarray, data_range: float | None = None) -> np.ndarray:
    """Return the (K,) PSNR of each band in dB, all against one peak (M.1); ``inf`` for an exact band."""
    estimate, truth = _pair(estimate, truth)
    peak = _peak(truth, data_range)
    return np.array([_decibel(peak, float(r)) if r > 0 else np.inf for r in band_rmse(estimate, truth)])


def pooled_psnr(estimate: np.ndarray, truth: np.ndarray, data_range: float | None = None) -> float:
    """Return the PSNR of all samples pooled, in dB (M.3); ``inf`` for identical cubes."""
    estimate, truth = _pair(estimate, truth)
    peak, error = _peak(truth, data_range), rmse(estimate, truth)
    return _decibel(peak, error) if error > 0 else float("inf")


def rmse(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Return the root mean square error over all samples, in the cube's unit."""
    bands = band_rmse(estimate, truth)
    largest = float(bands.max())
    return largest * float(np.sqrt(np.mean((bands / largest) ** 2))) if largest > 0 else 0.0


def band_rmse(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the (K,) root mean square error of each band, in the cube's unit."""
    estimate, truth = _pair(estimate, truth)
    return np.array([_rms(_band(estimate, k) - _band(truth, k)) for k in range(truth.shape[2])])


def ssim(estimate: np.ndarray, truth: np.ndarray, data_range: float | None = None) -> float | None:
    """Return the mean over bands of the structural similarity, -1 to 1 (M.4); None below 7 x 7 pixels.

    The numbers are scikit-image's ``structural_similarity`` (uniform window, sample covariance, windows inside
    the picture), but the local covariances are taken after centring, so that a large offset costs no digits.

    Args:
        estimate: (y, x, wavelength), finite.
        truth: same shape, finite.
        data_range: peak in the cube's unit, above 0; None takes the maximum of the true cube.

    Raises:
        InputError: ``estimate``, ``truth`` or ``data_range``.
    """
    estimate, truth = _pair(estimate, truth)
    peak = _peak(truth, data_range)
    if min(truth.shape[:2]) < SSIM_WINDOW:
        return None
    return float(np.mean([_band_ssim(_band(estimate, k) / peak, _band(truth, k) / peak) for k in range(truth.shape[2])]))


def spectral_angle(estimate: np.ndarray, truth: np.ndarray) -> SpectralAngle:
    """Return the mean over pixels of the angle between spectra in degrees (M.5) and the pixels left out.

    The half-angle form keeps small angles that ``arccos`` of a rounded cosine loses (Kahan 2006). A pixel
    whose estimated or true spectrum is all zero has no angle: it is left out and counted.

    Raises:
        InputError: ``estimate`` or ``truth``.
    """
    estimate, truth = _pair(estimate, truth)
    a, a_exists = _directions(estimate)
    b, b_exists = _directions(truth)
    exists = a_exists & b_exists
    angle = 2 * np.arctan2(np.linalg.norm(a - b, axis=2), np.linalg.norm(a + b, axis=2))
    excluded = int(exists.size - exists.sum())
    return SpectralAngle(float(np.rad2deg(angle[exists].mean())) if exists.any() else None, excluded)


def ergas(estimate: np.ndarray, truth: np.ndarray, ratio: float = 1.0) -> Ergas:
    """Return the relative global error 100 ratio sqrt(mean over bands of (rmse / mean)^2) (M.6; Wald 2000).

    Args:
        estimate: (y, x, wavelength), finite.
        truth: same shape, finite.
        ratio: pixel side of the fine picture over that of the coarse one, above 0; 1 where both are alike.

    Raises:
        InputError: ``estimate``, ``truth`` or ``ratio``.
    """
    if not (np.isfinite(ratio) and ratio > 0):
        raise InputError("ratio", ratio, "above 0, fine pixel side over coarse pixel side")
    estimate, truth = _pair(estimate, truth)
    means = np.array([float(_band(truth, k).mean()) for k in range(truth.shape[2])])
    exists = means != 0
    if not exists.any():
        return Ergas(None, int(means.size))
    relative = band_rmse(estimate, truth)[exists] / np.abs(means[exists])
    return Ergas(100 * float(ratio) * _rms(relative), int((~exists).sum()))


def _pair(estimate: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    estimate, truth = real_array("estimate", estimate, axes=AXES), real_array("truth", truth, axes=AXES)
    if truth.ndim != 3 or 0 in truth.shape:
        raise InputError("truth", truth.shape, "of shape (y, x, wavelength), none of them 0")
    if estimate.shape != truth.shape:
        raise InputError("estimate", estimate.shape, f"of the truth's shape {truth.shape}")
    for name, cube in (("estimate", estimate), ("truth", truth)):
        require(name, cube, np.isfinite(cube), "finite everywhere", AXES)
    return estimate, truth


def _peak(truth: np.ndarray, data_range: float | None) -> float:
    if data_range is not None and not isinstance(data_range, int | float | np.integer | np.floating):
        raise InputError("data_range", data_range, "one real number above 0 in the cube's unit, or None for the maximum of the true cube")
    peak = float(truth.max()) if data_range is None else float(data_range)
    if not (np.isfinite(peak) and peak > 0):
        source = "the maximum of the true cube" if data_range is None else "the peak asked for"
        raise InputError("data_range", peak, f"finite and above 0 in the cube's unit ({source})")
    return peak


def _band(cube: np.ndarray, k: int) -> np.ndarray:
    return np.ascontiguousarray(cube[:, :, k], np.float64)


def _rms(values: np.ndarray) -> float:
    """Root mean square without overflow: squares are taken relative to the largest value."""
    largest = float(np.abs(values).max())
    return largest * float(np.sqrt(np.mean((values / largest) ** 2))) if largest > 0 else 0.0


def _decibel(peak: float, error: float) -> float:
    return 20 * float(np.log10(peak) - np.log10(error))


def _band_ssim(x: np.ndarray, y: np.ndarray) -> float:
    """Structural similarity of two pictures whose peak is 1 (M.4)."""
    from scipy.ndimage import uniform_filter

    inside = (slice(SSIM_WINDOW // 2, -(SSIM_WINDOW // 2)),) * 2
    samples = SSIM_WINDOW**2
    x_level, y_level = float(x.mean()), float(y.mean())
    x, y = x - x_level, y - y_level

    def local_mean(picture: np.ndarray) -> np.ndarray:
        return uniform_filter(picture, SSIM_WINDOW)[inside]

    x_mean, y_mean = local_mean(x), local_mean(y)
    unbias = samples / (samples - 1)
    x_var = unbias * (local_mean(x * x) - x_mean * x_mean)
    y_var = unbias * (local_mean(y * y) - y_mean * y_mean)
    covariance = unbias * (local_mean(x * y) - x_mean * y_mean)
    x_mean, y_mean = x_mean + x_level, y_mean + y_level
    luminance_floor, contrast_floor = 0.01**2, 0.03**2
    luminance = (2 * x_mean * y_mean + luminance_floor) / (x_mean**2 + y_mean**2 + luminance_floor)
    structure = (2 * covariance + contrast_floor) / (x_var + y_var + contrast_floor)
    return float(np.mean(luminance * structure))


def _directions(cube: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit spectra (zero stays zero) and where they exist; scaled first so that nothing over- or underflows."""
    values = cube.astype(np.float64)
    largest = np.abs(values).max(axis=2, keepdims=True)
    exists = largest > 0
    values = np.divide(values, largest, out=np.zeros_like(values), where=exists)
    length = np.linalg.norm(values, axis=2, keepdims=True)
    return np.divide(values, length, out=values, where=exists), exists[:, :, 0]
