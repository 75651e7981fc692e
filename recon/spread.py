"""Where a mirror's light of each band lands on the sensor, as plain arrays (theory.md (S.40))."""

from dataclasses import dataclass

import numpy as np

from recon.errors import InputError

MAX_TAPS = 2**31  # bytes of weights


@dataclass(frozen=True, eq=False)
class Spread:
    """Say where a mirror's light of each band lands: ``taps[k, m, n, s, t]`` on row ``m + first_row + s``, column ``n + first_column + t``.

    Args:
        first_row, first_column: (K, 1 or M, 1 or N) integers; (K,) for the whole field.
        taps: (K, 1 or M, 1 or N, Tr, Tc) shares, finite.

    Raises:
        InputError: fields ``first_row``, ``first_column``, ``taps``.
    """

    first_row: np.ndarray
    first_column: np.ndarray
    taps: np.ndarray

    def __post_init__(self) -> None:
        taps = np.asarray(self.taps)
        if taps.ndim != 5 or 0 in taps.shape or not np.isfinite(taps).all():
            raise InputError("taps", taps.shape, "finite, of shape (bands, 1 or rows, 1 or columns, taps down, taps across)")
        if taps.nbytes > MAX_TAPS:
            raise InputError(
                "taps", f"{taps.nbytes / 2**30:.3g} GiB", f"at most {MAX_TAPS / 2**30:g} GiB; allow a larger error or a smaller field"
            )
        object.__setattr__(self, "taps", taps if taps.dtype == np.float32 else taps.astype(np.float64, copy=False))
        for name in ("first_row", "first_column"):
            first = np.asarray(getattr(self, name))
            first = first[:, None, None] if first.ndim == 1 else first
            whole = np.issubdtype(first.dtype, np.integer) and first.ndim == 3 and first.shape[0] == taps.shape[0]
            if not whole or np.abs(first).max() > 2**30:
                raise InputError(name, first.shape, f"integers of shape ({taps.shape[0]}, 1 or rows, 1 or columns)")
            object.__setattr__(self, name, np.ascontiguousarray(first, np.int64))

    def check(self, rows: int, columns: int) -> None:
        """Refuse mirrors (M, N) that the arrays don't fit.

        Raises:
            InputError: fields ``first_row``, ``first_column``, ``taps``.
        """
        for name in ("first_row", "first_column", "taps"):
            shape = getattr(self, name).shape
            if shape[1] not in (1, rows) or shape[2] not in (1, columns):
                raise InputError(name, shape, f"of shape (bands, 1 or {rows}, 1 or {columns}, ...)")

    def meets(self, rows: int, columns: int, width: int) -> bool:
        """Tell whether some tap of some mirror (M, N) lies on the sensor (M, W)."""
        row = self.first_row + np.arange(rows)[:, None]
        column = self.first_column + np.arange(columns)
        down, across = self.taps.shape[3:]
        return bool(np.any((row < rows) & (row > -down) & (column < width) & (column > -across)))

    @property
    def in_row(self) -> bool:
        """Tell whether all light stays in its mirror's row."""
        return self.taps.shape[3] == 1 and not self.first_row.any()
