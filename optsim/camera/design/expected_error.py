"""The expected squared error of the best linear estimate, and its derivative by gray masks (theory.md (C.75), (C.76))."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from optsim.camera.aligned import aligned
from optsim.camera.design.band_camera import BandCamera
from optsim.camera.design.prior import GaussianPrior
from optsim.errors import InputError

if TYPE_CHECKING:
    from recon.coded_aperture import CodedAperture


class ErrorEstimate(NamedTuple):
    """Hold the expected error as a share of the expected energy, by random probes.

    Args:
        value: mean over the probes, in [0, 1] but for the probes' scatter.
        by_masks: (L, M, N) derivative.
        iterations: conjugate-gradient iterations of the last probe.
    """

    value: float
    by_masks: np.ndarray
    iterations: int


class ExpectedError:
    """tr(C - C H^T (H C H^T + s^2 I)^-1 H C) / tr C of a camera with gray masks (theory.md (C.75)).

    Args:
        aperture: the camera's H; masks are given later.
        prior: C.
        noise: s over the root mean square of the expected frames behind half-open masks, in (0, 1].
        iterations: conjugate-gradient iterations at most for each probe, from 1.
        tolerance: at which they stop, relative.
    """

    def __init__(
        self, aperture: CodedAperture, prior: GaussianPrior, noise: float = 0.01, iterations: int = 60, tolerance: float = 1e-3
    ) -> None:  # fmt: skip
        if not 0 < noise <= 1:
            raise InputError("noise", noise, "in (0, 1], relative to the frames")
        if prior.variance.shape != aperture.in_shape:
            raise InputError("prior", prior.variance.shape, f"of the camera's cube, {aperture.in_shape}")
        if iterations < 1:
            raise InputError("iterations", iterations, "at least 1")
        self.aperture, _ = aperture.astype(np.float64).normalised()
        self.prior, self.limit, self.tolerance = prior, iterations, tolerance
        self.camera = BandCamera(self.aperture)
        self.variance = (noise * self._signal()) ** 2

    def _signal(self) -> float:
        """Return the root mean square of frames of random cubes of the prior behind half-open masks."""
        half = self._with(np.full(self.aperture.masks.shape, 0.5))
        rng = np.random.Generator(np.random.Philox(0))
        root = np.sqrt(self.prior.variance)
        cubes = [self.prior.basis.synthesis(root * rng.standard_normal(root.shape)) for _ in range(4)]
        return float(np.sqrt(np.mean([np.mean(half.forward(cube) ** 2) for cube in cubes])))

    def _with(self, masks: np.ndarray) -> CodedAperture:
        return self.aperture.replace(masks=masks, gray=True)

    def solve(self, h: CodedAperture, frames: np.ndarray) -> tuple[np.ndarray, int]:
        """Return (S^-1 frames, iterations) by conjugate gradients, S = H C H^T + s^2 I."""
        u, r, p = np.zeros_like(frames), frames.copy(), frames.copy()
        old = first = float(np.vdot(r, r))
        if first == 0:
            return u, 0
        for i in range(self.limit):
            q = h.forward(self.prior.apply(h.adjoint(p))) + self.variance * p
            step = old / float(np.vdot(p, q))
            u += step * p
            r -= step * q
            new = float(np.vdot(r, r))
            if new <= self.tolerance**2 * first:
                return u, i + 1
            p = r + new / old * p
            old = new
        return u, self.limit

    def estimate(self, masks: np.ndarray, rng: np.random.Generator, probes: int = 2) -> ErrorEstimate:
        """Estimate the error and its derivative without bias, by probes of random signs (Hutchinson; theory.md (C.76)).

        Args:
            masks: (L, M, N) of [0, 1].
            rng: of the probes.
            probes: from 1.
        """
        return self.along(masks, rng.integers(0, 2, (probes, *self.aperture.in_shape)) * 2.0 - 1)

    def along(self, masks: np.ndarray, probes: np.ndarray) -> ErrorEstimate:
        """Return the mean over probes z of z^T Sigma z / tr C and its derivative, through the Dr.Jit camera.

        Args:
            masks: (L, M, N) of [0, 1].
            probes: (P, M, N, K); unit vectors times sqrt(M N K), all of them, give the exact error.
        """
        h = self._with(masks)
        dr, t = self.camera.k.dr, self.camera.k.backend
        gray = t.TensorXf64(t.Float64(aligned(masks)), np.shape(masks))
        dr.enable_grad(gray)
        value, scalar, count = 0.0, 0.0, 0
        for z in probes:
            known = self.prior.apply(z)
            back, count = self.solve(h, h.forward(known))
            left = known - self.prior.apply(h.adjoint(back))
            value += float(np.vdot(z, left))
            scalar = scalar - 2 * dr.sum(self.camera.frames(gray, left).array * t.Float64(aligned(back)))
        dr.backward(scalar)
        scale = 1 / (len(probes) * self.prior.trace)
        return ErrorEstimate(value * scale, np.array(dr.grad(gray)) * scale, count)
