"""Operators of others: anything with in_shape, out_shape, forward and adjoint becomes a ``LinearOperator`` (theory.md (S.56))."""

from typing import Any

import numpy as np

from recon.coded_aperture import CodedAperture
from recon.errors import InputError
from recon.field_aperture import FieldAperture
from recon.gram import GramBands, GramBlocks, KnowsGram, checked_gram
from recon.operator import LinearOperator, RowWeighted

PARTS = ("in_shape", "out_shape", "forward", "adjoint")
FLOATS = (np.dtype(np.float32), np.dtype(np.float64))
EXPLAINED = {"float32": 1e-3, "float64": 1e-5}
"""Relative differences that rounding may make; operators of float64 may well compute in float32 inside."""


class Adapted:
    """An operator of others behind the full protocol: types and shapes checked, results of its dtype, largest response near 1.

    Args:
        operator: has ``in_shape`` (M, N, K), ``out_shape`` (any), ``forward(cube)``, ``adjoint(frames)``; optionally ``dtype``
            (float32 or float64; without one, float32) and ``gram_blocks()``.
        dtype: instead of the operator's own.

    Raises:
        InputError: field ``operator``.
    """

    def __init__(self, operator: Any, dtype: Any = None) -> None:
        missing = [name for name in PARTS if not hasattr(operator, name)]
        if missing:
            raise InputError("operator", type(operator).__name__, f"an object with {', '.join(PARTS)}; {', '.join(missing)} missing")
        self.operator = operator
        self.in_shape = _shape("operator.in_shape", operator.in_shape)
        self.out_shape = _shape("operator.out_shape", operator.out_shape)
        if len(self.in_shape) != 3:
            raise InputError("operator.in_shape", self.in_shape, "three sides: rows, columns, bands")
        own = np.dtype(dtype if dtype is not None else getattr(operator, "dtype", None) or np.float32)
        self.dtype: np.dtype[Any] = own if own in FLOATS else FLOATS[0]
        self.strength = 1.0
        self.takes_gram = True

    def normalised(self) -> tuple["Adapted", float]:
        """Return the operator divided by its largest response to a cube of random signs, and what that was.

        Raises:
            InputError: field ``operator`` when it sees nothing or gives values that are not finite.
        """
        draw = np.random.Generator(np.random.Philox(0))
        seen = self.forward(draw.choice(np.array([-1, 1], self.dtype), self.in_shape))
        size = float(np.abs(seen).max())
        if size == 0:  # signs may cancel in a tiny operator, as +1 and -1 do in f[0] + f[1]; normal numbers do not
            size = float(np.abs(self.forward(draw.standard_normal(self.in_shape).astype(self.dtype))).max())
        if not np.isfinite(size):
            raise InputError("operator.forward", size, "finite for a cube of +1 and -1")
        if size == 0:
            raise InputError("operator", 0.0, "different from 0: the camera sees nothing of a cube of random numbers")
        inner = self.astype(self.dtype)
        inner.strength = self.strength * size
        return inner, size

    def examined(self, gram: bool = True) -> tuple["Adapted", tuple[str, ...], bool]:
        """Hold the operator's parts against each other at one random x: ``|H x|^2 = <x, H^T H x>`` and ``<H x, G H x> = |H^T H x|^2``.

        Args:
            gram: look at G of ``gram_blocks`` too, which the solvers with exact data steps use.

        Returns:
            The operator to solve with, without a G that is not H H^T; a sentence for each part that is wrong by more than rounding
            explains; whether the adjoint is right.
        """
        inner, _ = self.normalised()
        x = np.random.Generator(np.random.Philox(1)).standard_normal(self.in_shape).astype(self.dtype)
        seen = inner.forward(x)
        back = inner.adjoint(seen)
        turned, square = _dot(x, back), _dot(seen, seen)
        if not abs(turned - square) <= EXPLAINED[self.dtype.name] * square:
            ratio = f"<x, H^T H x> / |H x|^2 = {turned / square:.6g}, must be 1"
            return self, (f"adjoint is not the transpose of forward: {ratio}; the answer is unsafe",), False
        known = inner.gram_blocks() if gram else None
        if known is None:
            return self, (), True
        told, square = _quadratic(known, seen.reshape(-1).astype(np.float64)), _dot(back, back)
        if abs(told - square) <= EXPLAINED[self.dtype.name] * square:
            return self, (), True
        plain = self.astype(self.dtype)
        plain.takes_gram = False
        ratio = f"<H x, G H x> / |H^T H x|^2 = {told / square:.6g}, must be 1"
        return plain, (f"gram_blocks is not H H^T of forward and adjoint: {ratio}; conjugate gradients took its place",), True

    def astype(self, dtype: Any) -> "Adapted":
        """Return the same operator giving another type."""
        other = Adapted(self.operator, dtype)
        other.strength, other.takes_gram = self.strength, self.takes_gram
        return other

    def forward(self, x: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply H."""
        return self._into(self.operator.forward(_read_only(x, self.dtype)), self.out_shape, out, "operator.forward")

    def adjoint(self, y: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply H^T."""
        return self._into(self.operator.adjoint(_read_only(y, self.dtype)), self.in_shape, out, "operator.adjoint")

    def gram_blocks(self) -> GramBlocks | GramBands | None:
        """Return the operator's own H H^T, or None when it knows none or a wrong one."""
        if not (self.takes_gram and isinstance(self.operator, KnowsGram)):
            return None
        gram = checked_gram(self.operator.gram_blocks(), self.out_shape)
        return gram if gram is None or self.strength == 1 else gram.scaled(np.full(int(np.prod(self.out_shape)), 1 / self.strength))

    def _into(self, value: Any, shape: tuple[int, ...], out: np.ndarray | None, field: str) -> np.ndarray:
        array = np.asarray(value)
        if array.shape != shape or np.iscomplexobj(array):
            raise InputError(field, (array.shape, str(array.dtype)), f"a real array of shape {shape}")
        result = np.empty(shape, self.dtype) if out is None else out
        np.divide(array, self.strength, out=result, casting="same_kind")
        return result


def adapted(operator: Any) -> LinearOperator:
    """Return the operator itself where it is one of this package's, else ``Adapted``."""
    if isinstance(operator, CodedAperture | FieldAperture | Adapted):
        return operator
    if isinstance(operator, RowWeighted):
        inner = adapted(operator.operator)
        return operator if inner is operator.operator else RowWeighted(inner, operator.weights)
    return Adapted(operator)


def _dot(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.vdot(a.astype(np.float64), b.astype(np.float64)))


def _quadratic(gram: GramBlocks | GramBands, y: np.ndarray) -> float:
    """Return ``<y, G y>`` of flat y."""
    part = y[gram.index]
    if isinstance(gram, GramBlocks):
        return float(np.einsum("bs,bsq,bq->", part, gram.matrix, part, optimize=True))
    total = float((gram.bands[:, :, 0] * part**2).sum())
    for offset in range(1, min(gram.bands.shape[2:] + part.shape[1:])):
        total += 2 * float((gram.bands[:, offset:, offset] * part[:, offset:] * part[:, :-offset]).sum())
    return total


def _read_only(array: np.ndarray, dtype: np.dtype[Any]) -> np.ndarray:
    """Return a view that can't be written: a forward that works in place would spoil the solver's own iterate."""
    view = np.asarray(array, dtype).view()
    view.flags.writeable = False
    return view


def _shape(field: str, value: Any) -> tuple[int, ...]:
    try:
        sides = tuple(int(side) for side in value)
    except (TypeError, ValueError):
        raise InputError(field, value, "a tuple of integers of at least 1") from None
    if not sides or min(sides) < 1:
        raise InputError(field, sides, "a tuple of integers of at least 1")
    return sides
