"""Any denoiser in the place of a prior's proximal map (theory.md (S.68); Venkatakrishnan et al. 2013)."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from recon.config import Config
from recon.errors import InputError

Denoiser = Callable[[np.ndarray, float], np.ndarray]
"""``denoiser(picture, sigma) -> picture``: remove Gaussian noise of standard deviation sigma from a picture of peak about 1."""


class PlugAndPlay(Config):
    """Use ``denoiser(picture, sigma)`` as proximal map: of every band, of spectral coefficient pictures, or of the whole cube.

    There is no R behind it, so values are 0 and objectives say nothing; ``Gap()`` is the solver made for it. Pictures are scaled to
    largest absolute value 1 (of the cube) before the call, whatever the frames' unit.

    Args:
        denoiser: gets (M, N) and sigma, or (M, N, K) and sigma with ``whole``; returns the same shape, finite.
        spectral: a basis along wavelength whose coefficient pictures are denoised; None: the bands.
        weights: sigma's factor for each picture, K positive numbers; None: all 1. Not with ``whole``, where there is one sigma.
        strength: sigma over the solver's weight.
        whole: hand over the cube at once, not picture by picture.
    """

    denoiser: Any
    spectral: Any = None
    weights: tuple[float, ...] | None = None
    strength: float = Field(default=1.0, gt=0, le=1e6)
    whole: bool = False

    @field_validator("denoiser")
    @classmethod
    def _callable(cls, denoiser: Any) -> Any:
        if not callable(denoiser):
            raise InputError("PlugAndPlay.denoiser", denoiser, "a function denoiser(picture, sigma) that returns a picture")
        return denoiser

    @field_validator("spectral")
    @classmethod
    def _is_basis(cls, spectral: Any) -> Any:
        if spectral is not None and not callable(getattr(spectral, "matrix", None)):
            raise InputError("PlugAndPlay.spectral", spectral, "a spectral basis, e.g. recon.learned(samples), or None")
        return spectral

    @field_validator("weights")
    @classmethod
    def _positive(cls, weights: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if weights is not None and (not weights or min(weights) <= 0):
            raise InputError("PlugAndPlay.weights", weights, "positive numbers, one for each picture")
        return weights

    @model_validator(mode="after")
    def _one_sigma(self) -> "PlugAndPlay":
        if self.whole and self.weights is not None:
            raise InputError("PlugAndPlay.weights", self.weights, "None with whole=True: a whole cube gets one sigma; take strength")
        return self

    def bind(self, shape: tuple[int, ...], dtype: Any) -> "DenoiserPenalty":
        """See ``Prior.bind``.

        Raises:
            InputError: field ``PlugAndPlay.weights`` when they are not one a band.
        """
        weights = np.ones(shape[2]) if self.weights is None else np.array(self.weights)
        if weights.size != shape[2]:
            raise InputError("PlugAndPlay.weights", weights.size, f"as many numbers as bands, {shape[2]}")
        matrix = None if self.spectral is None else self.spectral.matrix(shape[2], dtype)
        return DenoiserPenalty(self.denoiser, matrix, weights * self.strength, self.strength if self.whole else None)


class DenoiserPenalty:
    """A denoiser bound to one solve.

    Args:
        denoiser: the function.
        matrix: of the spectral basis; None: bands.
        weights: sigma of each picture over the solver's weight.
        strength: the same of the whole cube, handed over at once; None: picture by picture.
    """

    def __init__(self, denoiser: Denoiser, matrix: np.ndarray | None, weights: np.ndarray, strength: float | None) -> None:
        self._denoiser, self._matrix, self._weights, self._strength = denoiser, matrix, weights, strength

    def value(self, cube: np.ndarray) -> float:
        """Return 0: a denoiser has no value."""
        return 0.0

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """Replace the cube by what the denoiser makes of it.

        Raises:
            InputError: field ``PlugAndPlay.denoiser`` for an answer of another shape or with values that are not finite.
        """
        size = float(np.abs(cube).max())
        if size == 0 or threshold == 0:
            return 0.0
        pictures = cube if self._matrix is None else cube @ self._matrix.T
        sigma = threshold / size
        if self._strength is not None:
            pictures = self._called(pictures / cube.dtype.type(size), sigma * self._strength) * size
        else:
            bands = [self._called(pictures[:, :, k] / cube.dtype.type(size), sigma * float(w)) for k, w in enumerate(self._weights)]
            pictures = np.stack(bands, axis=2) * size
        cube[...] = pictures if self._matrix is None else pictures.astype(cube.dtype) @ self._matrix
        return 0.0

    def tau_max(self, correlation: np.ndarray) -> float | None:
        """Return None: there is no formula."""
        return None

    def _called(self, picture: np.ndarray, sigma: float) -> np.ndarray:
        given = np.ascontiguousarray(picture)
        found = np.asarray(self._denoiser(given, sigma))
        if found.shape != given.shape or not np.isfinite(found).all():
            what = found.shape if found.shape != given.shape else "values that are not finite"
            raise InputError(
                "PlugAndPlay.denoiser", what, f"a function that returns finite pictures of the shape it was given, {given.shape}"
            )
        return found
