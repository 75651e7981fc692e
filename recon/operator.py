"""What a solver needs of a camera: a linear map and its exact adjoint."""

from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from recon.arrays import REAL, real_array, require
from recon.errors import InputError


@runtime_checkable
class Operator(Protocol):
    """What a solve needs at least: shapes, forward and adjoint. Without a ``dtype`` it is called with float32.

    The arrays that forward and adjoint get are the solver's own and can't be written: copy what you change.
    With a method ``gram_blocks()`` (``recon.GramBlocks`` or ``recon.GramBands``) it gets exact data steps, else conjugate gradients.
    """

    @property
    def in_shape(self) -> tuple[int, ...]:
        """Shape of a cube (rows, columns, bands)."""
        ...

    @property
    def out_shape(self) -> tuple[int, ...]:
        """Shape of the frames, of any rank."""
        ...

    def forward(self, x: np.ndarray, /) -> np.ndarray:
        """Apply H."""
        ...

    def adjoint(self, y: np.ndarray, /) -> np.ndarray:
        """Apply H^T."""
        ...


@runtime_checkable
class LinearOperator(Protocol):
    """A linear map from cubes (M, N, K) to frames (those of a camera: (L, C, M, W)), as numpy arrays of any strides.

    ``forward`` and ``adjoint`` write into ``out`` when it is given and return it. :func:`recon.reconstruct` asks less of the
    operators it is given: see ``Operator``.
    """

    @property
    def in_shape(self) -> tuple[int, ...]:
        """Shape of a cube."""
        ...

    @property
    def out_shape(self) -> tuple[int, ...]:
        """Shape of the frames."""
        ...

    @property
    def dtype(self) -> np.dtype[Any]:
        """float32 or float64."""
        ...

    def forward(self, x: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply H."""
        ...

    def adjoint(self, y: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply H^T."""
        ...


class RowWeighted:
    """The operator ``diag(weights) H``: weight 0 leaves a measurement out, 1/sigma whitens noise.

    Args:
        operator: H.
        weights: broadcastable to the frames (L, C, M, W), finite and not negative.

    Raises:
        InputError: field ``weights``.
    """

    def __init__(self, operator: LinearOperator, weights: np.ndarray) -> None:
        from recon.adapted import adapted

        operator = adapted(operator)
        given = real_array("weights", weights, kinds=REAL + "b")
        with np.errstate(over="ignore"):
            values = given.astype(operator.dtype)
        require("weights", values, np.isfinite(values) & (values >= 0), "finite and at least 0", frame_axes(values.shape))
        try:
            self.weights = np.ascontiguousarray(np.broadcast_to(values, operator.out_shape))
        except ValueError:
            raise InputError("weights", values.shape, f"broadcastable to {operator.out_shape}") from None
        self.operator = operator
        self.in_shape = operator.in_shape
        self.out_shape = operator.out_shape
        self.dtype = operator.dtype

    def astype(self, dtype: Any) -> "RowWeighted":
        """Return the same operator computing in another precision."""
        return RowWeighted(in_precision(self.operator, dtype), self.weights)

    def forward(self, x: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply diag(weights) H."""
        result = self.operator.forward(x, out)
        result *= self.weights
        return result

    def adjoint(self, y: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply H^T diag(weights)."""
        return self.operator.adjoint(y * self.weights, out)


def frame_axes(shape: tuple[int, ...]) -> str:
    """Name the axes of a camera's frames for errors."""
    return " (shot, channel, row, column)" if len(shape) == 4 else ""


def in_precision(operator: LinearOperator, dtype: Any) -> LinearOperator:
    """Return the same operator computing in another precision."""
    change: Any = operator
    return operator if operator.dtype == dtype else cast(LinearOperator, change.astype(dtype))


def adjoint_error(operator: Operator, seed: int = 0) -> float:
    """Measure ``|<Hx, y> - <x, H^T y>| / (||Hx|| ||y||)`` on one pair of Gaussian arrays (theory.md (S.3))."""
    from recon.adapted import adapted

    operator = adapted(operator)
    draw = np.random.Generator(np.random.Philox(seed))
    x = draw.standard_normal(operator.in_shape).astype(operator.dtype)
    y = draw.standard_normal(operator.out_shape).astype(operator.dtype)
    forward = np.asarray(operator.forward(x), np.float64)
    gap = abs(np.vdot(forward, y.astype(np.float64)) - np.vdot(x.astype(np.float64), np.asarray(operator.adjoint(y), np.float64)))
    size = float(np.linalg.norm(forward) * np.linalg.norm(y.astype(np.float64)))
    return float(gap / size) if size > 0 else float(gap)


def norm_squared(operator: Operator, iterations: int = 40, seed: int = 0) -> float:
    """Estimate the largest eigenvalue of H^T H by the power method, from below; callers add a margin (5 %)."""
    from recon.adapted import adapted

    operator = adapted(operator)
    draw = np.random.Generator(np.random.Philox(seed))
    x = np.abs(draw.standard_normal(operator.in_shape)).astype(operator.dtype)
    value = 0.0
    for _ in range(iterations):
        size = float(np.linalg.norm(x.ravel()))
        if size == 0 or not np.isfinite(size):
            return 0.0
        x = operator.adjoint(operator.forward(x / operator.dtype.type(size)))
        before, value = value, float(np.linalg.norm(x.ravel()))
        if abs(value - before) <= 1e-4 * value:
            break
    return value
