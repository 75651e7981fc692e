"""What it costs to tell colours apart: the noise of unmixing overlapping curves (theory.md (C.54))."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optsim.camera.noise import MAX_MEAN_E
from optsim.camera.radiometry import photon_integral
from optsim.camera.sensor import Sensor
from optsim.errors import InputError
from scenes.spectrum import Spectrum

RED_GREEN_BLUE_NM = ((600.0, 670.0), (500.0, 600.0), (450.0, 500.0))
"""Lower and upper edges of three colours that share the camera's range."""


@dataclass(frozen=True, eq=False)
class Amplification:
    """Hold the noise of unmixed colours.

    Args:
        mixing: C, (curves, colours) electrons of each curve from each colour.
        covariance: (C^T S^-1 C)^-1 of the colours' amounts, each 1 in the light that was assumed.
        variance: its trace.
        disjoint_variance: the same for disjoint filters that detect as many electrons of each colour.
        ratio: variance over disjoint_variance.
    """

    mixing: np.ndarray
    covariance: np.ndarray
    variance: float
    disjoint_variance: float
    ratio: float


def noise_amplification(
    sensor: Sensor,
    light: Spectrum,
    brightest_e: float,
    read_noise_e: float = 0.0,
    colours_nm: Sequence[tuple[float, float]] = RED_GREEN_BLUE_NM,
) -> Amplification:
    """Compare the noise of a sensor's unmixed colours with that of disjoint filters of equal efficiency.

    The light has a known spectrum within each colour and unknown amounts of the colours. A curve counts S = C 1 electrons
    with variance S + read noise^2; amounts are fitted by weighted least squares, the best unbiased estimate.

    Args:
        sensor: with at least as many curves as colours; all curves are measured at every pixel.
        light: spectral radiance at the sensor, any unit.
        brightest_e: electrons of the curve that collects most, in (0, 1e15].
        read_noise_e: of each readout, in [0, 1e15] electrons.
        colours_nm: (lower, upper) of each colour, disjoint.

    Raises:
        InputError: field ``sensor`` when the curves cannot tell the colours apart; ``brightest_e``, ``read_noise_e``, ``colours_nm``.
    """
    if not 0 < brightest_e <= MAX_MEAN_E:
        raise InputError("brightest_e", brightest_e, f"in (0, {MAX_MEAN_E:g}] electrons")
    if not 0 <= read_noise_e <= MAX_MEAN_E:
        raise InputError("read_noise_e", read_noise_e, f"in [0, {MAX_MEAN_E:g}] electrons")
    if not colours_nm or any(not 0 < low < high for low, high in colours_nm):
        raise InputError("colours_nm", tuple(colours_nm), "at least one pair of lower < upper edges, above 0 nm")
    lower, upper = np.array(colours_nm, np.float64).T
    mixing = np.stack([photon_integral(curve, lower, upper, light) for curve in sensor.curves])
    counts = mixing.sum(1)
    mixing = mixing * (brightest_e / counts.max()) if counts.max() > 0 else mixing
    if np.linalg.matrix_rank(mixing, tol=1e-9 * mixing.max(initial=0.0)) < lower.size:
        raise InputError("sensor", sensor.name, f"of curves that tell the {lower.size} colours apart")
    weight = 1 / (mixing.sum(1) + read_noise_e**2)
    covariance = np.linalg.inv(mixing.T @ (weight[:, None] * mixing))
    detected = mixing.sum(0)
    disjoint = float(((detected + read_noise_e**2) / detected**2).sum())
    variance = float(np.trace(covariance))
    return Amplification(mixing, covariance, variance, disjoint, variance / disjoint)
