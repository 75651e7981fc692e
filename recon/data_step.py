"""The exact data step ``z -> z + H^T (H H^T + rho I)^+ (g - H z)`` (theory.md (S.10)).

rho = 0 projects on the cubes that explain the frames; rho > 0 is the proximal step of ``||g - H f||^2 / rho``. A weighted
operator ``diag(d) H`` keeps the exact step of H (theory.md (S.55)).
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from recon import aperture_kernels, threads
from recon.coded_aperture import CodedAperture, mosaic_tile, optics
from recon.field_aperture import FieldAperture
from recon.gram import CUTOFF, FAINT, LIMITED_BY, known_gram
from recon.operator import LinearOperator, RowWeighted, norm_squared
from recon.operator_step import ConjugateStep, DataStep, OperatorStep, ProjectionStep, Sums, rounding
from recon.reduce import EXACT, alike, merge_repeats, nearly_dependent, reduced, unweighted, whiten

COUPLED = 1e-3  # of H H^T's largest diagonal entry: what stands for rho = 0 where rows couple and only iterations solve
BLURRED = f"rows couple: {COUPLED:g} of H H^T's largest entry was added to project on the frames, which are explained up to the residual"
FORCING = 0.03  # a step by iterations lowers the residual that it meets to this part; the splitting goes on converging
ROWS_AT_ONCE = 16
SEEN = 200
"""Iterations of conjugate gradients that estimate a condition."""


def data_step(operator: LinearOperator, frames: np.ndarray, rho: float, *, mixed: bool = False) -> DataStep:
    """Build the exact step that fits the operator's structure: blocks a pixel, bands a row, else conjugate gradients.

    Args:
        operator: H, or ``RowWeighted`` ones.
        frames: g, float64, weighted as the operator is.
        rho: at least 0, in units of H squared.
        mixed: with rho = 0, make a sensor's channels orthonormal first: the same constraint, better conditioned and blind
            to any mix of the channels; but where frames contradict each other it weights them differently.
    """
    inner, plain, weights = unweighted(operator, frames)
    if isinstance(inner, CodedAperture) and inner.one_tap:
        return BlockStep(inner, plain, rho, mixed, weights)
    if isinstance(inner, CodedAperture | FieldAperture):
        return _banded_step(inner, plain, rho, mixed and rho == 0, weights)
    gram = known_gram(operator)
    if gram is None:
        return ConjugateStep(operator, frames, rho) if rho > 0 else ProjectionStep(operator, frames)
    inverse = gram.inverse(rho)
    return OperatorStep(operator, frames, inverse, inverse.notes)


def least_squares_step(operator: LinearOperator, frames: np.ndarray, iterations: int, late: Callable[[], bool]) -> DataStep:
    """Build the step to the nearest least-squares cube: exact by blocks or bands, else conjugate gradients down to rounding.

    Args:
        operator, frames: as for ``data_step``.
        iterations: of conjugate gradients, at most.
        late: tells that the time is over.
    """
    if has_exact_step(operator):
        return data_step(operator, frames, 0.0)
    exact = 8 * rounding(operator)
    return ProjectionStep(operator, frames, tolerance=exact, cutoff=exact**2, iterations=iterations, late=late)


def has_exact_step(operator: LinearOperator) -> bool:
    """Tell whether H H^T is known in blocks or bands, so that no step needs iterations."""
    while isinstance(operator, RowWeighted):
        operator = operator.operator
    if isinstance(operator, CodedAperture | FieldAperture):
        return isinstance(operator, CodedAperture) or not operator.rows_couple
    return known_gram(operator) is not None


def doubts(operator: LinearOperator, frames: np.ndarray, late: Callable[[], bool]) -> tuple[str, ...]:
    """Say why the unregularised least-squares cube is unsafe, for solvers that make no exact step; nothing where it is not.

    The blocks of H H^T tell; without any, what conjugate gradients see in 200 iterations on random frames (theory.md (S.35)),
    unless ``late`` tells that the time is over.
    """
    if has_exact_step(operator):
        known = (note.split(":")[0] for note in data_step(operator, frames, 0.0).notes if not note.startswith(LIMITED_BY))
        return tuple(f"{note}: at tau = 0 weak directions are not resolved; take tau > 0" for note in known)
    draw = np.random.Generator(np.random.Philox(0)).standard_normal(operator.out_shape)
    step = ProjectionStep(operator, draw, tolerance=8 * rounding(operator), cutoff=0.0, iterations=SEEN, late=late)
    project(step, np.zeros(operator.in_shape, operator.dtype))
    return step.warning()


def project(step: DataStep, cube: np.ndarray) -> np.ndarray:
    """Apply a data step to a band-major cube (M, N, K) once more and return a new one: what float32 has lost comes back."""
    z = np.ascontiguousarray(cube.transpose(2, 0, 1))
    x = z.copy()
    step.advance(z, x.copy(), x, 0.0)
    return x.transpose(1, 2, 0)


def _banded_step(
    operator: CodedAperture | FieldAperture, frames: np.ndarray, rho: float, mixed: bool, weights: np.ndarray | None
) -> DataStep:
    from recon.banded import BandedStep, RowInverse, row_strength

    notes: list[str] = []
    if rho == 0 and not mixed and operator.mosaic is None:
        nearly_dependent(np.linalg.svd(operator.response, compute_uv=False), notes)
    less, merged, weights = reduced(operator, frames, weights, notes, mixed)
    if not (isinstance(less, FieldAperture) and less.rows_couple):
        return BandedStep(less, merged, rho, tuple(notes), weights)
    if rho == 0:
        rho = COUPLED * row_strength(less)
        notes.append(BLURRED)
    whole: LinearOperator = less
    if weights is not None:
        whole, merged = RowWeighted(less, weights), merged * weights
    near = RowInverse.near(less, rho, weights)
    return ConjugateStep(whole, merged, rho, near, tuple(notes), tolerance=1e-4, iterations=60, forcing=FORCING)


class BlockStep:
    """The step of a one-tap camera: one small (pseudo-)inverse a sensor pixel, fused into one pass over each row.

    Shots that repeat a mask are first averaged, which changes neither the projection nor the objective (up to a constant)
    and keeps the blocks small.

    Args:
        operator: H.
        frames: g, without weights.
        rho: at least 0.
        mixed: see ``data_step``.
        weights: d (L, C, M, W); None: 1.
    """

    def __init__(self, operator: CodedAperture, frames: np.ndarray, rho: float, mixed: bool, weights: np.ndarray | None = None) -> None:
        from recon import step_kernels

        self._kernel = step_kernels.advance_rows
        masks, merged, weights = merge_repeats(operator.masks, frames, weights)
        response = operator.response * operator.taps[:, 0]
        notes: list[str] = []
        if mixed and alike(weights):
            response, merged = whiten(response, operator.mosaic, merged, notes)
            weights = None if weights is None else np.broadcast_to(weights[:, :1], merged.shape)
        elif rho == 0 and operator.mosaic is None:
            nearly_dependent(np.linalg.svd(response, compute_uv=False), notes)
        blocks = PixelBlocks(operator, masks, response, weights)
        inverse = blocks.inverse(rho, operator.dtype, notes)
        self.condition = blocks.condition
        self.notes = tuple(notes)
        ones = np.ones((response.shape[1], 1))
        seen = optics(operator, masks, response, ones, (blocks.tile, blocks.tile_of))
        self._arguments = (np.ascontiguousarray(merged, operator.dtype), seen, inverse)
        self._sums = np.zeros((operator.in_shape[0], 4))

    def advance(self, z: np.ndarray, w: np.ndarray, x: np.ndarray, relax: float, ratio: float = 1.0) -> Sums:
        """See ``DataStep.advance``."""
        real = z.dtype.type
        threads.run(self._kernel, z.shape[1], z, w, x, real(relax), *self._arguments, real(ratio), self._sums)
        return Sums(*(float(v) for v in self._sums.sum(0)))


class PixelBlocks:
    """H H^T of a one-tap camera, ``diag(d) H H^T diag(d)`` with weights: one S x S block a sensor pixel, made a few rows at a time."""

    def __init__(self, operator: CodedAperture, masks: np.ndarray, response: np.ndarray, weights: np.ndarray | None) -> None:
        self.tile, self.tile_of = mosaic_tile(response, operator.mosaic, operator.in_shape[0])
        self._masks, self._response, self._start = masks, response, operator.first_column
        channels = 1 if operator.mosaic is not None else response.shape[0]
        self.size, self.rows, self.width = masks.shape[0] * channels, operator.in_shape[0], operator.width
        self._weights = None if weights is None else weights.reshape(self.size, self.rows, self.width)
        self.condition = 1.0

    def some(self) -> Iterator[tuple[int, np.ndarray]]:
        """Go through the blocks: the first row and (rows, S, S, W)."""
        ones = np.ones((self._start.size, 1))
        for first in range(0, self.rows, ROWS_AT_ONCE):
            masks = np.ascontiguousarray(self._masks[:, first : first + ROWS_AT_ONCE])
            gram = np.empty((masks.shape[1], self.size, self.size, self.width))
            of = self.tile_of[first : first + ROWS_AT_ONCE]
            threads.run(aperture_kernels.gram_rows, masks.shape[1], 0, masks, self._response, self.tile, of, self._start, ones, gram)
            if (d := self._rows_of_weights(first)) is not None:
                gram *= d[:, :, None]
                gram *= d[:, None]
            yield first, gram

    def inverse(self, rho: float, dtype: Any, notes: list[str]) -> np.ndarray:
        """Return the packed blocks ``diag(d) (diag(d) H H^T diag(d) + rho I)^+ diag(d)``.

        ``condition`` becomes the root mean square of the blocks' conditions, from above, eigenvalues left out not counted.
        """
        from recon import step_kernels

        size, width = self.size, self.width
        inverse = np.empty((self.rows, size * (size + 1) // 2, width), dtype)
        trust = np.empty((self.rows, width))
        largest = 0.0 if rho > 0 else max(float(np.einsum("mssj->mj", g).max()) for _, g in self.some())
        s, q = np.tril_indices(size)
        dropped = 0
        for first, gram in self.some():
            last = first + gram.shape[0]
            blocks = gram.copy() if rho == 0 else gram
            threads.run(step_kernels.invert_blocks, last - first, blocks, rho, inverse[first:last], trust[first:last])
            if rho == 0:
                dropped += _pseudo_invert(gram, trust[first:last], largest, inverse[first:last])
            if (d := self._rows_of_weights(first)) is not None:
                inverse[first:last] *= (d[:, s] * d[:, q]).astype(dtype)
        lit = trust > 0
        self.condition = float(np.sqrt(np.mean(np.minimum(1 / trust[lit], 1 / CUTOFF) ** 2))) if lit.any() else 1.0
        if dropped:
            notes.append(f"H H^T is ill-conditioned: {dropped} directions below {CUTOFF:g} of their pixel's largest were left out")
        return inverse

    def largest(self) -> float:
        """Return the largest eigenvalue of all blocks: those of large Gershgorin bound first, until none left can exceed the best."""
        best = 0.0
        for _, gram in self.some():
            bound = np.abs(gram).sum(2).max(1)
            while (m_j := np.nonzero(bound > best))[0].size:
                order = np.argsort(bound[m_j])[::-1][:256]
                m, j = m_j[0][order], m_j[1][order]
                best = max(best, float(np.linalg.eigvalsh(gram[m, :, :, j])[:, -1].max()))
                bound[m, j] = 0
        return best

    def _rows_of_weights(self, first: int) -> np.ndarray | None:
        """Return d of some rows, (rows, S, W)."""
        return None if self._weights is None else self._weights[:, first : first + ROWS_AT_ONCE].transpose(1, 0, 2)


def _pseudo_invert(gram: np.ndarray, trust: np.ndarray, largest: float, inverse: np.ndarray) -> int:
    """Replace the blocks that may be singular by their pseudo-inverse, and ``trust`` by the true ratio of kept eigenvalues.

    Return how many small but real eigenvalues were dropped.
    """
    m, j = np.nonzero(trust < 4 * CUTOFF)
    if m.size == 0:
        return 0
    value, vector = np.linalg.eigh(gram[m, :, :, j])
    kept = value > np.maximum(CUTOFF * value[:, -1:], FAINT * largest)
    weight = np.divide(1.0, value, out=np.zeros_like(value), where=kept)
    block = np.einsum("bsi,bi,bqi->bsq", vector, weight, vector)
    s, q = np.tril_indices(gram.shape[1])
    inverse[m, :, j] = block[:, s, q]
    least = np.where(kept, value, np.inf).min(1)
    trust[m, j] = np.where(kept.any(1), least / value[:, -1], 0.0)
    return int((~kept & (value > EXACT * value[:, -1:]) & (value[:, -1:] > FAINT * largest)).sum())


def largest_eigenvalue(operator: LinearOperator) -> float:
    """Return the largest eigenvalue of H^T H: exact from blocks where there are any, else by the power method plus 5 %."""
    inner, _, weights = unweighted(operator, np.zeros(operator.out_shape))
    if isinstance(inner, CodedAperture) and inner.one_tap:
        return PixelBlocks(inner, inner.masks, inner.response * inner.taps[:, 0], weights).largest()
    return 1.05 * norm_squared(in_bands(operator))


def in_bands(operator: LinearOperator) -> LinearOperator:
    """Return the operator for cubes of bands when it is one for coefficients: its norm is the same, the power method's start better."""
    if isinstance(operator, RowWeighted):
        return RowWeighted(in_bands(operator.operator), operator.weights)
    if isinstance(operator, CodedAperture) and operator.spectral is not None:
        return operator.replace(spectral=None)
    return operator
