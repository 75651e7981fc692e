"""Junction depths and filter of a Foveon, fitted to measured curves; says what the fit cannot explain (theory.md (C.51))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optsim.camera.sensor import Foveon
from optsim.camera.silicon import FrontFilter, SiliconLayers

MAX_DEPTH_UM = 5.0
"""The whole stack is thinner than this; measured curves up to 680 nm do not say how thick its last layer is."""
_STARTS = ((0.3, 1.0), (0.6, 1.8), (1.0, 2.5))


@dataclass(frozen=True)
class LayerFit:
    """Hold the layers that explain measured curves best.

    Args:
        layers: the fit.
        rms, largest: of the differences of the curves, each normalised to maximum 1.
        by_layer_rms: for blue, green and red.
        at_bound: whether the lowest border went to the largest depth allowed, so that the curves do not say where it is.
    """

    layers: SiliconLayers
    rms: float
    largest: float
    by_layer_rms: tuple[float, float, float]
    at_bound: bool


def fit_layers(measured: Foveon, max_depth_um: float = MAX_DEPTH_UM, crosstalk: float = 0.0) -> LayerFit:
    """Fit three borders and a front filter to relative curves by least squares, each curve scaled to maximum 1.

    Args:
        measured: curves on a common grid.
        max_depth_um: largest depth of the lowest border.
        crosstalk: of the layers, held.
    """
    from scipy.optimize import least_squares

    grid = measured.blue.wavelength_nm
    target = np.stack([curve.at(grid) / curve.maximum for curve in (measured.blue, measured.green, measured.red)])

    def layers(p: np.ndarray) -> SiliconLayers:
        one = p[0] * max_depth_um
        two = one + p[1] * (max_depth_um - one)
        three = two + p[2] * (max_depth_um - two)
        front = FrontFilter(blue_nm=p[3], blue_width_nm=p[4], red_nm=p[5], red_width_nm=p[6])
        return SiliconLayers(borders_um=(one, two, three), crosstalk=crosstalk, front=front)

    def misfit(p: np.ndarray) -> np.ndarray:
        modelled = layers(p).efficiencies(grid)
        return np.asarray(modelled / modelled.max(1, keepdims=True) - target).ravel()

    low, high = np.array([1e-3, 1e-3, 1e-3, 400, 5, 600, 1]), np.array([0.999, 0.999, 1, 500, 60, 700, 20])
    fits = []
    for first, second in _STARTS:
        start = np.array([first / max_depth_um, (second - first) / (max_depth_um - first), 0.9, 450, 20, 656, 3])
        fits.append(least_squares(misfit, start, bounds=(low, high), x_scale=np.abs(start), xtol=1e-12, ftol=1e-12))
    best = min(fits, key=lambda fit: float(fit.cost))
    by_layer = np.sqrt((best.fun.reshape(3, -1) ** 2).mean(1))
    return LayerFit(
        layers(best.x),
        float(np.sqrt(np.mean(best.fun**2))),
        float(np.abs(best.fun).max()),
        (float(by_layer[0]), float(by_layer[1]), float(by_layer[2])),
        bool(best.x[2] > 0.999),
    )
