"""The exact data step ``z -> z + H^T (H H^T + rho I)^+ (g - H z)`` (theory.md (S.10)).

rho = 0 projects on the cubes that explain the frames; rho > 0 is the proximal step of ``||g - H f||^2 / rho``.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from recon import aperture_kernels, threads
from recon.coded_aperture import CodedAperture, mosaic_tile
from recon.field_aperture import FieldAperture
from recon.operator import LinearOperator, norm_squared

CUTOFF = 1e-6  # eigenvalues of a block below this part of its largest count as 0 when rho = 0
EXACT = 1e-12  # below this part of the largest an eigenvalue is a zero with rounding
FAINT = 1e-12  # and below this part of the largest of all blocks
COUPLED = 1e-3  # of H H^T's largest diagonal entry: what stands for rho = 0 where rows couple and only iterations solve
FORCING = 0.03  # a step by iterations lowers the residual that it meets to this part; the splitting goes on converging
ROWS_AT_ONCE = 16


class Sums(NamedTuple):
    """Squared norms of an iteration: of w - x before it, of x's change, of x, and of x - z."""

    gap: float
    change: float
    size: float
    moved: float


class DataStep(Protocol):
    """The data half of a splitting iteration, on band-major arrays (K, M, N).

    ``notes`` are sentences about the conditioning that a user should read.
    """

    notes: tuple[str, ...]

    def advance(self, z: np.ndarray, w: np.ndarray, x: np.ndarray, relax: float, ratio: float = 1.0) -> Sums:
        """Set ``z += relax (w - x)``, ``x = step(z)``, ``z = x + ratio (z - x)`` and ``w = 2 x - z``."""
        ...


def data_step(operator: LinearOperator, frames: np.ndarray, rho: float, *, mixed: bool = False) -> DataStep:
    """Build the exact step that fits the operator's structure: blocks a pixel, bands a row, else conjugate gradients.

    Args:
        operator: H.
        frames: g, float64.
        rho: at least 0, in units of H squared.
        mixed: with rho = 0, make a sensor's channels orthonormal first: the same constraint, better conditioned and blind
            to any mix of the channels; but where frames contradict each other it weights them differently.
    """
    if isinstance(operator, CodedAperture) and operator.one_tap:
        return BlockStep(operator, frames, rho, mixed)
    if not isinstance(operator, CodedAperture | FieldAperture):
        return ConjugateStep(operator, frames, rho)
    from recon.banded import BandedStep, RowInverse, row_strength

    notes: list[str] = []
    less, merged = reduced(operator, frames, rho, mixed, notes)
    if isinstance(less, FieldAperture) and less.rows_couple:
        rho = rho if rho > 0 else COUPLED * row_strength(less)
        return ConjugateStep(less, merged, rho, RowInverse.near(less, rho), tuple(notes), tolerance=1e-4, iterations=60, forcing=FORCING)
    return BandedStep(less, merged, rho, tuple(notes))


class BlockStep:
    """The step of a one-tap camera: one small (pseudo-)inverse a sensor pixel, fused into one pass over each row.

    Shots that repeat a mask are first averaged with the weight sqrt(count), which changes neither the projection nor
    the objective (up to a constant) and keeps the blocks small.
    """

    def __init__(self, operator: CodedAperture, frames: np.ndarray, rho: float, mixed: bool) -> None:
        from recon import step_kernels

        self._kernel = step_kernels.advance_rows
        masks, merged = merge_repeats(operator.masks, frames)
        response = operator.response * operator.taps[:, 0]
        notes: list[str] = []
        if mixed:
            response, merged = whiten(response, operator.mosaic, merged, notes)
        tile, tile_of = mosaic_tile(response, operator.mosaic, operator.in_shape[0])
        inverse = _inverse_blocks((masks, response, tile, tile_of, operator.first_column), merged.shape, rho, operator.dtype, notes)
        self.notes = tuple(notes)
        arrays = (np.ascontiguousarray(a, operator.dtype) for a in (merged, masks, response, tile))
        self._arguments = (*arrays, tile_of, operator.first_column, inverse)
        self._sums = np.zeros((operator.in_shape[0], 4))

    def advance(self, z: np.ndarray, w: np.ndarray, x: np.ndarray, relax: float, ratio: float = 1.0) -> Sums:
        """See ``DataStep.advance``."""
        real = z.dtype.type
        threads.run(self._kernel, z.shape[1], z, w, x, real(relax), *self._arguments, real(ratio), self._sums)
        return Sums(*(float(v) for v in self._sums.sum(0)))


class ConjugateStep:
    """The step of any operator, by conjugate gradients on ``(H H^T + rho I) y = g - H z``, each started from the last y.

    Args:
        operator: H.
        frames: g.
        rho: at least 0.
        near: an approximate inverse of ``H H^T + rho I`` that speeds it up (theory.md (S.43)); None: none.
        notes: passed on.
        tolerance: of the residual, relative to the right side.
        iterations: at most, a step.
        forcing: a relaxed step may also stop at this part of the residual that it began with: later steps take up the rest.
    """

    def __init__(
        self,
        operator: LinearOperator,
        frames: np.ndarray,
        rho: float,
        near: Callable[[np.ndarray], np.ndarray] | None = None,
        notes: tuple[str, ...] = (),
        tolerance: float = 1e-6,
        iterations: int = 200,
        forcing: float = 0.0,
    ) -> None:
        from recon import step_kernels

        self._relax, self._finish = step_kernels.relax_rows, step_kernels.finish_rows
        self.notes = notes
        self._operator, self._rho, self._near = operator, rho, near
        self._tolerance, self._iterations, self._forcing = tolerance, iterations, forcing
        self._frames = frames.astype(operator.dtype)
        self._y = np.zeros(operator.out_shape, operator.dtype)
        self._sums = np.zeros((operator.in_shape[0], 4))

    def advance(self, z: np.ndarray, w: np.ndarray, x: np.ndarray, relax: float, ratio: float = 1.0) -> Sums:
        """See ``DataStep.advance``."""
        real, rows = z.dtype.type, z.shape[1]
        threads.run(self._relax, rows, z, w, x, real(relax), self._sums)
        self._solve(self._frames - self._operator.forward(z.transpose(1, 2, 0)), self._forcing if relax else 0.0)
        step = np.ascontiguousarray(self._operator.adjoint(self._y).transpose(2, 0, 1))
        threads.run(self._finish, rows, z, step, x, w, real(ratio), self._sums)
        return Sums(*(float(v) for v in self._sums.sum(0)))

    def _normal(self, y: np.ndarray) -> np.ndarray:
        result = self._operator.forward(self._operator.adjoint(y))
        result += y.dtype.type(self._rho) * y
        return result

    def _solve(self, right: np.ndarray, forcing: float) -> None:
        y = self._y
        left = right - self._normal(y)
        target = self._tolerance**2 * max(float(np.vdot(right, right)), np.finfo(y.dtype).tiny)
        target = max(target, forcing**2 * float(np.vdot(left, left)))
        turned = left if self._near is None else self._near(left)
        direction, size = turned.copy(), float(np.vdot(left, turned))
        for _ in range(self._iterations):
            if float(np.vdot(left, left)) <= target:
                break
            image = self._normal(direction)
            curvature = float(np.vdot(direction, image))
            if curvature <= 0 or size <= 0:
                break
            step = y.dtype.type(size / curvature)
            y += step * direction
            left -= step * image
            turned = left if self._near is None else self._near(left)
            size, before = float(np.vdot(left, turned)), size
            direction = turned + y.dtype.type(size / before) * direction


def reduced(
    operator: CodedAperture | FieldAperture, frames: np.ndarray, rho: float, mixed: bool, notes: list[str]
) -> tuple[CodedAperture | FieldAperture, np.ndarray]:
    """Return an operator and frames of the same data step with fewer rows and, when ``mixed``, with better conditioned ones.

    Shots that repeat a mask are merged. With ``mixed`` and rho = 0, where rows may be scaled and mixed freely, the pixels' gains
    are divided out (pixels with gain 0 stay out) and the channels made orthonormal.
    """
    changes: dict[str, Any] = {"gray": True} if isinstance(operator, CodedAperture) else {}
    masks, merged = merge_repeats(operator.masks, frames)
    most = masks.max()
    response = operator.response * most
    free = mixed and rho == 0
    if isinstance(operator, FieldAperture) and free:
        gain, plain = operator.readout.gain, not operator.readout.couples
        if gain is not None:
            merged = np.divide(merged, gain, out=np.zeros_like(merged), where=np.broadcast_to(gain > 0, merged.shape))
            left = (gain > 0).astype(np.float64)
            changes["readout"] = replace(operator.readout, gain=None if left.all() else left)
            free = bool(left.all()) or gain.ndim < 3 or gain.shape[0] == 1
        free = free and (plain or operator.readout.bins is None)
    if free:
        response, merged = whiten(response, operator.mosaic, merged, notes)
    return operator.replace(masks=masks / most, response=response, **changes), merged


def merge_repeats(masks: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average the frames of shots that share a mask, weighted by sqrt(count): the same normal equations in fewer rows."""
    groups: dict[bytes, list[int]] = {}
    for l, mask in enumerate(masks):
        groups.setdefault(mask.tobytes(), []).append(l)
    weight = [np.sqrt(len(shots)) for shots in groups.values()]
    kept = np.stack([w * masks[shots[0]] for w, shots in zip(weight, groups.values())])
    return kept, np.stack([w * frames[shots].mean(0) for w, shots in zip(weight, groups.values())])


def whiten(response: np.ndarray, mosaic: np.ndarray | None, frames: np.ndarray, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Make the channels orthonormal along wavelength (a mosaic's curves: of norm 1); mixes below the cutoff are left out."""
    if mosaic is not None:
        size = np.linalg.norm(response, axis=1)
        size[size == 0] = 1
        return response / size[:, None], frames / size[mosaic]
    u, s, vt = np.linalg.svd(response, full_matrices=False)
    rank = int((s > CUTOFF * s[0]).sum())
    if s[rank - 1] > 0 and rank < s.size and s[rank] > EXACT * s[0]:
        notes.append(
            f"the {s.size} response curves are nearly dependent (condition {s[0] / s[-1]:.1e}): only {rank} mixes of them were used"
        )
    mix = u[:, :rank].T / s[:rank, None]
    return np.ascontiguousarray(vt[:rank]), np.einsum("pc,lcmj->lpmj", mix, frames)


def _inverse_blocks(exact: tuple[np.ndarray, ...], shape: tuple[int, ...], rho: float, dtype: Any, notes: list[str]) -> np.ndarray:
    from recon import step_kernels

    shots, channels, rows, width = shape
    size = shots * channels
    inverse = np.empty((rows, size * (size + 1) // 2, width), dtype)
    trust = np.empty((rows, width))
    largest = 0.0 if rho > 0 else max(float(np.einsum("mssj->mj", g).max()) for _, g in _grams(exact, size, width))
    dropped = 0
    for first, gram in _grams(exact, size, width):
        last = first + gram.shape[0]
        blocks = gram.copy() if rho == 0 else gram
        threads.run(step_kernels.invert_blocks, last - first, blocks, rho, inverse[first:last], trust[first:last])
        if rho == 0:
            dropped += _pseudo_invert(gram, trust[first:last], largest, inverse[first:last])
    if dropped:
        notes.append(f"H H^T is ill-conditioned: {dropped} directions below {CUTOFF:g} of their pixel's largest eigenvalue were left out")
    return inverse


def _grams(exact: tuple[np.ndarray, ...], size: int, width: int) -> Iterator[tuple[int, np.ndarray]]:
    masks, response, tile, tile_of, start = exact
    ones = np.ones((start.size, 1))
    for first in range(0, masks.shape[1], ROWS_AT_ONCE):
        rows = np.ascontiguousarray(masks[:, first : first + ROWS_AT_ONCE])
        gram = np.empty((rows.shape[1], size, size, width))
        of = tile_of[first : first + ROWS_AT_ONCE]
        threads.run(aperture_kernels.gram_rows, rows.shape[1], 0, rows, response, tile, of, start, ones, gram)
        yield first, gram


def _pseudo_invert(gram: np.ndarray, trust: np.ndarray, largest: float, inverse: np.ndarray) -> int:
    """Replace the blocks that may be singular by their pseudo-inverse; return how many small but real eigenvalues were dropped."""
    m, j = np.nonzero(trust < 4 * CUTOFF)
    if m.size == 0:
        return 0
    value, vector = np.linalg.eigh(gram[m, :, :, j])
    kept = value > np.maximum(CUTOFF * value[:, -1:], FAINT * largest)
    weight = np.divide(1.0, value, out=np.zeros_like(value), where=kept)
    block = np.einsum("bsi,bi,bqi->bsq", vector, weight, vector)
    s, q = np.tril_indices(gram.shape[1])
    inverse[m, :, j] = block[:, s, q]
    return int((~kept & (value > EXACT * value[:, -1:]) & (value[:, -1:] > FAINT * largest)).sum())


def largest_eigenvalue(operator: LinearOperator) -> float:
    """Return the largest eigenvalue of H^T H: exact from the pixel blocks, else by the power method plus 5 %."""
    if not (isinstance(operator, CodedAperture) and operator.one_tap):
        return 1.05 * norm_squared(operator)
    shots, channels, rows, width = operator.out_shape
    response = operator.response * operator.taps[:, 0]
    tile, tile_of = mosaic_tile(response, operator.mosaic, rows)
    best = 0.0
    for _, gram in _grams((operator.masks, response, tile, tile_of, operator.first_column), shots * channels, width):
        bound = np.abs(gram).sum(2).max(1)
        while (m_j := np.nonzero(bound > best))[0].size:
            order = np.argsort(bound[m_j])[::-1][:256]
            m, j = m_j[0][order], m_j[1][order]
            best = max(best, float(np.linalg.eigvalsh(gram[m, :, :, j])[:, -1].max()))
            bound[m, j] = 0
    return best
