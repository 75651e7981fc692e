"""A spectrum: values on a wavelength grid, piecewise linear between the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scenes.errors import InputError

GRID_SLACK_NM = 1e-6
"""A wavelength this little outside the data counts as the end node (rounding of band edges)."""
WIDE_RANGE_NM = (200.0, 2500.0)
"""The range of spectra that are the same everywhere: wider than any glass or sensor here."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Hold a piecewise linear function of wavelength (theory.md (R.1)).

    Args:
        wavelength_nm: (n,) strictly increasing finite wavelengths above 0, in nm, n >= 2.
        value: (n,) finite values, of any unit.
        name: what to call it in messages; not part of equality.

    Raises:
        InputError: ``spectrum.wavelength_nm`` or ``spectrum.value`` with the index of the first bad entry.
    """

    wavelength_nm: np.ndarray
    value: np.ndarray
    name: str = ""

    def __post_init__(self) -> None:
        grid, value = _vector(self.wavelength_nm, "wavelength_nm"), _vector(self.value, "value")
        if grid.size < 2:
            raise InputError("spectrum.wavelength_nm", grid.tolist(), "at least 2 nodes, in nm")
        if value.size != grid.size:
            raise InputError("spectrum.value", value.size, f"as many values as the {grid.size} wavelengths")
        if grid[0] <= 0:
            raise InputError("spectrum.wavelength_nm", float(grid[0]), "above 0 nm")
        step = np.diff(grid)
        if np.any(step <= 0):
            i = int(np.argmax(step <= 0)) + 1
            what = "repeats" if step[i - 1] == 0 else "is below"
            raise InputError(
                "spectrum.wavelength_nm",
                float(grid[i]),
                f"strictly increasing, in nm; the entry at index {i} {what} the one before ({grid[i - 1]:g})",
            )
        object.__setattr__(self, "wavelength_nm", grid)
        object.__setattr__(self, "value", value)

    @classmethod
    def constant(cls, value: float, lower_nm: float = WIDE_RANGE_NM[0], upper_nm: float = WIDE_RANGE_NM[1], name: str = "") -> Spectrum:
        """Return the spectrum that has one value from lower_nm to upper_nm."""
        return cls(np.array([lower_nm, upper_nm]), np.array([value, value]), name or f"flat {value:g}")

    @property
    def range_nm(self) -> tuple[float, float]:
        """Return the first and last wavelength of the data, in nm."""
        return float(self.wavelength_nm[0]), float(self.wavelength_nm[-1])

    @property
    def maximum(self) -> float:
        """Return the largest value; a piecewise linear curve takes it at a node."""
        return float(self.value.max())

    @property
    def minimum(self) -> float:
        """Return the smallest value; a piecewise linear curve takes it at a node."""
        return float(self.value.min())

    def at(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Interpolate linearly at wavelengths in nm of any shape.

        Raises:
            InputError: field ``wavelength_nm`` for a wavelength outside the data (never zero, never held).
        """
        return np.interp(self._inside(wavelength_nm), self.wavelength_nm, self.value)

    def band_mean(self, lower_nm: ArrayLike, upper_nm: ArrayLike) -> np.ndarray:
        """Average over bands exactly: the integral of the piecewise linear curve over its width (theory.md (R.2)).

        Args:
            lower_nm: (K,) lower band edges in nm.
            upper_nm: (K,) upper band edges in nm; bands may touch, overlap or leave gaps.

        Returns:
            (K,) float64 means; a scalar pair of edges gives shape ().

        Raises:
            InputError: a band of no width, or outside the data.
        """
        bands = self._bands(lower_nm, upper_nm)
        edges = np.unique(np.concatenate([self.wavelength_nm, bands.ravel()]))
        y = np.interp(edges, self.wavelength_nm, self.value)
        pieces = np.diff(edges) * (y[:-1] / 2 + y[1:] / 2)
        width = bands[1] - bands[0]
        return (_sum_slices(pieces[:, None], edges, bands)[:, 0] / width).reshape(np.shape(lower_nm))

    def hat_weights(self, nodes_nm: ArrayLike, lower_nm: ArrayLike, upper_nm: ArrayLike) -> np.ndarray:
        """Return W with: mean over band k of (this spectrum x T) = sum over i of W[k, i] T(nodes[i]) (theory.md (R.3)).

        Exact for every T that is linear between neighbouring nodes: the product of two piecewise linear curves is
        integrated piece by piece by Simpson's rule, which has no error for quadratics.

        Args:
            nodes_nm: (n,) strictly increasing nodes of T in nm that cover all bands, n >= 2.
            lower_nm: (K,) lower band edges in nm.
            upper_nm: (K,) upper band edges in nm.

        Returns:
            (K, n) float64 weights in the unit of this spectrum; rows sum to ``band_mean``.

        Raises:
            InputError: nodes that do not cover the bands, or as ``band_mean``.
        """
        bands = self._bands(lower_nm, upper_nm)
        nodes = Spectrum(np.asarray(nodes_nm, np.float64), np.zeros(np.size(nodes_nm))).wavelength_nm
        if bands.min() < nodes[0] - GRID_SLACK_NM or bands.max() > nodes[-1] + GRID_SLACK_NM:
            raise InputError("nodes_nm", nodes[[0, -1]].tolist(), f"covering the bands {bands.min():g} to {bands.max():g} nm")
        edges = np.unique(np.concatenate([self.wavelength_nm, nodes, bands.ravel()]))
        low, high = edges[:-1], edges[1:]
        left = np.clip(np.searchsorted(nodes, low, side="right") - 1, 0, nodes.size - 2)
        gap = nodes[left + 1] - nodes[left]
        weights = np.zeros((low.size, nodes.size))
        for x, simpson in ((low, 1 / 6), ((low + high) / 2, 4 / 6), (high, 1 / 6)):
            amount = simpson * (high - low) * np.interp(x, self.wavelength_nm, self.value)
            rise = np.clip((x - nodes[left]) / gap, 0.0, 1.0)
            weights[np.arange(low.size), left] += amount * (1 - rise)
            weights[np.arange(low.size), left + 1] += amount * rise
        return _sum_slices(weights, edges, bands) / (bands[1] - bands[0])[:, None]

    def scaled(self, factor: float) -> Spectrum:
        """Return the spectrum times a finite factor."""
        if not np.isfinite(factor):
            raise InputError("factor", factor, "finite")
        return Spectrum(self.wavelength_nm, self.value * factor, self.name)

    def peak_normalised(self) -> Spectrum:
        """Return the spectrum divided by its maximum, so that the largest value is exactly 1.

        Raises:
            InputError: when no value is above 0.
        """
        if self.maximum <= 0:
            raise InputError("spectrum.value", self.maximum, f"above 0 somewhere to be peak-normalised ({self.label})")
        return Spectrum(self.wavelength_nm, self.value / self.maximum, self.name)

    @property
    def label(self) -> str:
        """Return the name for messages, or the range when it has none."""
        return repr(self.name) if self.name else f"unnamed spectrum over {self.wavelength_nm[0]:g}-{self.wavelength_nm[-1]:g} nm"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Spectrum):
            return NotImplemented
        return np.array_equal(self.wavelength_nm, other.wavelength_nm) and np.array_equal(self.value, other.value)

    def __hash__(self) -> int:
        return hash((self.wavelength_nm.tobytes(), self.value.tobytes()))

    def _inside(self, wavelength_nm: ArrayLike) -> np.ndarray:
        x = np.asarray(wavelength_nm, np.float64)
        low, high = self.range_nm
        bad = ~((x >= low - GRID_SLACK_NM) & (x <= high + GRID_SLACK_NM))
        if np.any(bad):
            raise InputError("wavelength_nm", float(x[bad].flat[0]), f"from {low:g} to {high:g} nm, the range of {self.label}")
        return np.clip(x, low, high)

    def _bands(self, lower_nm: ArrayLike, upper_nm: ArrayLike) -> np.ndarray:
        lower, upper = np.atleast_1d(self._inside(lower_nm)), np.atleast_1d(self._inside(upper_nm))
        if lower.shape != upper.shape or lower.ndim != 1:
            raise InputError("bands", (lower.shape, upper.shape), "as many lower as upper edges, in nm")
        if np.any(upper <= lower):
            k = int(np.argmax(upper <= lower))
            raise InputError("bands.width", float(upper[k] - lower[k]), f"above 0 nm (band {k})")
        return np.stack([lower, upper])


def _vector(values: ArrayLike, name: str) -> np.ndarray:
    try:
        array = np.array(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"spectrum.{name}", values, "a list of numbers") from None
    if array.ndim != 1:
        raise InputError(f"spectrum.{name}", array.shape, "a list of numbers (one dimension)")
    bad = ~np.isfinite(array)
    if np.any(bad):
        i = int(np.argmax(bad))
        raise InputError(f"spectrum.{name}", float(array[i]), f"finite; the first bad entry is at index {i}")
    array.setflags(write=False)
    return array


def _sum_slices(pieces: np.ndarray, edges: np.ndarray, bands: np.ndarray) -> np.ndarray:
    """Sum the (pieces, n) contributions between consecutive edges over each band, without cumulative cancellation."""
    padded = np.concatenate([pieces, np.zeros((1, pieces.shape[1]))])
    index = np.searchsorted(edges, bands).T.ravel()
    return np.add.reduceat(padded, index, axis=0)[::2]
