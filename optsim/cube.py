"""The radiance cube and its spectral bands: the contract that every stage reads and writes.

A cube is an ``xarray.Dataset`` with ``radiance`` (and, from a render, ``stderr``), dims exactly
``("y", "x", "wavelength")``, in W m^-2 sr^-1 nm^-1; an estimate from a measurement that optsim did not make in
the unit that this says of itself (``FRAME_UNITS``). A value is the MEAN of the spectral radiance over its
band, not the integral. Row 0 is the top. Coordinates: ``wavelength`` (band centres, nm, strictly
increasing), ``band_lower`` and ``band_upper`` (nm).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

DIMS = ("y", "x", "wavelength")
UNITS = "W m-2 sr-1 nm-1"
FRAME_UNITS = ("relative", "electron", "DN")
"""Units of frames."""
FOREIGN = "foreign"
"""Attribute ``model`` of frames that optsim did not make: how they came about is not ours to say."""
OVER_RESPONSE = " / response"
CUBE_UNITS = (UNITS, *FRAME_UNITS, *(unit + OVER_RESPONSE for unit in FRAME_UNITS))
GRID_TOLERANCE_NM = 1e-3
"""Two wavelength grids closer than this are the same grid; farther apart they are refused."""
MIN_BAND_WIDTH_NM = 1e-3
"""Below this float32 wavelengths inside a renderer merge silently (their step at 550 nm is 6e-5 nm)."""

PAPER_CENTERS_NM = (
    455, 460, 465, 470, 476, 482, 488, 494, 500, 506, 512, 519, 527, 536, 545, 555, 565, 576, 587, 599, 612, 626, 643, 660,
)  # fmt: skip
"""Band centres of Rueda, Lau, Arce 2015, section 4, in nm."""


class Invertible(Protocol):
    """Say which wavelengths in nm land at given positions in px (a prism or any other dispersion)."""

    def wavelength_at(self, position_px: Any, /) -> np.ndarray:
        """Return wavelengths of the shape of the positions."""


@dataclass(frozen=True, eq=False)
class Bands:
    """Hold K spectral bands by their edges and centres.

    Args:
        lower: (K,) lower edges in nm.
        upper: (K,) upper edges in nm, each above its lower edge by at least 1e-3 nm.
        center: (K,) strictly increasing nominal wavelengths in nm, inside their bands.

    Raises:
        InputError: naming the field when edges or centres are not finite, not positive, or out of order.
    """

    lower: np.ndarray
    upper: np.ndarray
    center: np.ndarray

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "center"):
            array = np.array(getattr(self, name), np.float64, ndmin=1)
            if array.ndim != 1 or array.size == 0 or not np.all(np.isfinite(array)) or np.any(array <= 0):
                raise InputError(f"bands.{name}", getattr(self, name), "at least one finite wavelength above 0 nm")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if not self.lower.shape == self.upper.shape == self.center.shape:
            raise InputError("bands", (self.lower.size, self.upper.size, self.center.size), "as many edges as centres")
        if np.any(self.upper - self.lower < MIN_BAND_WIDTH_NM * (1 - 1e-9)):
            raise InputError("bands.width", float(np.min(self.upper - self.lower)), f"at least {MIN_BAND_WIDTH_NM} nm")
        if np.any(np.diff(self.center) <= 0):
            raise InputError("wavelength_nm", self.center.tolist(), "strictly increasing, in nm")
        if np.any(self.center < self.lower) or np.any(self.center > self.upper):
            raise InputError("bands.center", self.center.tolist(), "inside its own band, in nm")

    @classmethod
    def from_edges(cls, edges_nm: np.ndarray | list[float]) -> Bands:
        """Build K touching bands from K + 1 increasing edges in nm; centres at mid-band."""
        edges = np.asarray(edges_nm, np.float64)
        if edges.ndim != 1 or edges.size < 2:
            raise InputError("bands.edges", edges_nm, "at least two edges, in nm")
        return cls(edges[:-1], edges[1:], (edges[:-1] + edges[1:]) / 2)

    @classmethod
    def from_centers(cls, centers_nm: np.ndarray | list[float] | tuple[float, ...]) -> Bands:
        """Build touching bands round given centres in nm: edges at mid-points, the two ends mirrored."""
        c = np.asarray(centers_nm, np.float64)
        if c.ndim != 1 or c.size < 2:
            raise InputError("bands.centers", centers_nm, "at least two centres, in nm")
        mid = (c[:-1] + c[1:]) / 2
        edges = np.concatenate([[2 * c[0] - mid[0]], mid, [2 * c[-1] - mid[-1]]])
        return cls(edges[:-1], edges[1:], c)

    @classmethod
    def paper(cls) -> Bands:
        """Return the 24 bands of Rueda, Lau, Arce 2015: edges 452.5 to 668.5 nm."""
        return cls.from_centers(PAPER_CENTERS_NM)

    @classmethod
    def from_prism(cls, prism: Invertible, pixels: int = 24, first_px: float = 0.0) -> Bands:
        """Cut the spectrum where a prism advances by one pixel: edges on pixel borders, centres on pixel centres, in nm.

        The bands run from ``first_px`` (the 455 nm pixel is 0) towards the red, whichever way the prism lays it.

        Args:
            prism: any dispersion of the camera.
            pixels: K, from 1 to 10000.
            first_px: position of the first band's centre.

        Raises:
            InputError: ``pixels``, or ``prism`` when the dispersion folds or does not reach so far.
        """
        if not isinstance(pixels, int | np.integer) or not 1 <= pixels <= 10_000:
            raise InputError("pixels", pixels, "a whole number from 1 to 10000")
        below, above = prism.wavelength_at(first_px + np.array([-0.5, 0.5]))
        direction = 1.0 if above > below else -1.0
        edges = prism.wavelength_at(first_px + direction * (np.arange(pixels + 1) - 0.5))
        return cls(edges[:-1], edges[1:], prism.wavelength_at(first_px + direction * np.arange(pixels)))

    @classmethod
    def parse(cls, text: str) -> Bands:
        """Read ``paper`` or ``START:STOP:COUNT`` (outer edges in nm, equal widths).

        Raises:
            InputError: field ``--bands`` when the text is of neither form.
        """
        form = "paper or START:STOP:COUNT with 0 < START < STOP in nm and COUNT from 1 to 10000"
        if text.strip() == "paper":
            return cls.paper()
        try:
            start, stop, count = text.split(":")
            lo, hi, n = float(start), float(stop), int(count)
        except ValueError:
            raise InputError("--bands", text, form) from None
        if not (np.isfinite(lo) and np.isfinite(hi) and 0 < lo < hi and 1 <= n <= 10_000):
            raise InputError("--bands", text, form)
        return cls.from_edges(np.linspace(lo, hi, n + 1))

    @property
    def count(self) -> int:
        """Return K, the number of bands."""
        return int(self.center.size)

    @property
    def width(self) -> np.ndarray:
        """Return the (K,) widths in nm."""
        return self.upper - self.lower

    @property
    def contiguous(self) -> bool:
        """Tell whether each band ends where the next begins (to 1e-3 nm)."""
        return bool(np.all(np.abs(self.upper[:-1] - self.lower[1:]) <= GRID_TOLERANCE_NM))

    def subdivide(self, n: int, cover: tuple[float, float] | None = None) -> Bands:
        """Cut every band into n equal parts; optionally extend to ``cover`` = (low, high) nm.

        The extension continues with parts of about the end band's width, so that light outside the bands but
        inside a camera's band-pass filter is present in the fine cube.

        Args:
            n: parts per band, 1 to 1000.
            cover: wavelengths in nm that the fine bands must reach; None adds nothing.
        """
        if not 1 <= n <= 1000:
            raise InputError("--subdivide", n, "from 1 to 1000 parts per band")
        steps = np.arange(n + 1) / n
        lower = (self.lower[:, None] + self.width[:, None] * steps[:-1]).ravel()
        upper = (self.lower[:, None] + self.width[:, None] * steps[1:]).ravel()
        if cover is not None:
            low, high = cover
            if low < lower[0] - GRID_TOLERANCE_NM:
                edges = np.linspace(low, lower[0], max(1, round((lower[0] - low) / (self.width[0] / n))) + 1)
                lower, upper = np.concatenate([edges[:-1], lower]), np.concatenate([edges[1:], upper])
            if high > upper[-1] + GRID_TOLERANCE_NM:
                edges = np.linspace(upper[-1], high, max(1, round((high - upper[-1]) / (self.width[-1] / n))) + 1)
                lower, upper = np.concatenate([lower, edges[:-1]]), np.concatenate([upper, edges[1:]])
        return Bands(lower, upper, (lower + upper) / 2)

    def same_as(self, other: Bands) -> bool:
        """Tell whether two band tables agree to 1e-3 nm in centres and edges."""
        return self.count == other.count and all(
            bool(np.all(np.abs(getattr(self, a) - getattr(other, a)) <= GRID_TOLERANCE_NM)) for a in ("lower", "upper", "center")
        )


def make_cube(
    radiance: np.ndarray, bands: Bands, stderr: np.ndarray | None = None, attrs: Mapping[str, Any] | None = None, units: str = UNITS
) -> xr.Dataset:
    """Wrap arrays as a cube Dataset and check it.

    Args:
        radiance: (y, x, wavelength) float32 or float64, in ``units``, finite.
        bands: the K bands of the last axis.
        stderr: Monte Carlo standard error of the same shape, or None.
        attrs: provenance (config digest, seed, versions, variant); values str, int or float.
        units: one of ``CUBE_UNITS``.

    Raises:
        InputError: see :func:`check_cube`.
    """
    import xarray as xr

    def array(values: np.ndarray, name: str) -> xr.DataArray:
        values = np.ascontiguousarray(values)
        if values.dtype not in (np.float32, np.float64):
            values = values.astype(np.float64)
        return xr.DataArray(values, dims=DIMS, name=name, attrs={"units": units})

    data = {"radiance": array(radiance, "radiance")}
    if stderr is not None:
        data["stderr"] = array(stderr, "stderr")
    if np.shape(radiance)[-1:] != (bands.count,):
        raise InputError("radiance", np.shape(radiance), f"of shape (y, x, {bands.count}) for {bands.count} bands")
    coords = {
        "wavelength": ("wavelength", bands.center.copy(), {"units": "nm", "standard_name": "radiation_wavelength"}),
        "band_lower": ("wavelength", bands.lower.copy(), {"units": "nm"}),
        "band_upper": ("wavelength", bands.upper.copy(), {"units": "nm"}),
    }
    cube = xr.Dataset(data, coords=coords, attrs=dict(attrs or {}))
    check_cube(cube)
    return cube


def check_cube(cube: xr.Dataset) -> None:
    """Refuse a Dataset that is not a cube: wrong dims, units or grid, or non-finite values.

    Raises:
        InputError: naming ``radiance``, ``wavelength`` or ``stderr`` and the first offending place.
    """
    if "radiance" not in cube:
        raise InputError("radiance", sorted(map(str, cube.data_vars)), "a variable of the file")
    radiance = cube["radiance"]
    if radiance.dims != DIMS:
        raise InputError("radiance.dims", radiance.dims, f"exactly {DIMS}")
    if 0 in radiance.shape:
        raise InputError("radiance.shape", radiance.shape, "at least one pixel and one band")
    if radiance.attrs.get("units") not in CUBE_UNITS:
        raise InputError("radiance.units", radiance.attrs.get("units"), " or ".join(map(repr, CUBE_UNITS)))
    if radiance.dtype not in (np.float32, np.float64):
        raise InputError("radiance.dtype", str(radiance.dtype), "float32 or float64")
    bands_of(cube)
    for name in ("radiance", "stderr"):
        if name in cube:
            finite = np.isfinite(cube[name].values)
            if not finite.all():
                where = tuple(int(i) for i in np.argwhere(~finite)[0])
                raise InputError(name, float(cube[name].values[where]), f"finite everywhere; first bad (y, x, band) is {where}")


def require_watts(cube: xr.Dataset) -> None:
    """Refuse a cube that is not in W m^-2 sr^-1 nm^-1, where photons are to be counted.

    Raises:
        InputError: field ``radiance.units``.
    """
    units = cube["radiance"].attrs["units"]
    if units != UNITS:
        raise InputError("radiance.units", units, f"{UNITS!r}, as a physical camera counts photons (the matched model takes any unit)")


def bands_of(cube: xr.Dataset | xr.DataArray) -> Bands:
    """Read the bands from a cube's coordinates.

    Raises:
        InputError: when ``wavelength``, ``band_lower`` or ``band_upper`` is missing or invalid.
    """
    for name in ("wavelength", "band_lower", "band_upper"):
        if name not in cube.coords:
            raise InputError(name, sorted(map(str, cube.coords)), "a coordinate on the dimension wavelength, in nm")
    return Bands(cube["band_lower"].values, cube["band_upper"].values, cube["wavelength"].values)


def require_same_bands(a: Bands, b: Bands, what: str) -> None:
    """Refuse two band tables that differ by more than 1e-3 nm, showing both grids."""
    if not a.same_as(b):
        raise InputError(
            what, np.round(b.center, 4).tolist(), f"on the wavelength grid {np.round(a.center, 4).tolist()} nm (to {GRID_TOLERANCE_NM} nm)"
        )


def block_mean(cube: xr.Dataset, n: int) -> xr.Dataset:
    """Average n x n pixels into one: from samples of a mirror to mirrors.

    Standard errors of different pixels are independent and add in squares.

    Raises:
        InputError: when the picture's sides are not divisible by n.
    """
    height, width, count = cube["radiance"].shape
    if n < 1 or height % n or width % n:
        raise InputError("--oversample", n, f"a divisor of both sides of the {height} x {width} picture")

    def blocks(name: str, power: int) -> np.ndarray:
        values = cube[name].values.astype(np.float64) ** power
        return values.reshape(height // n, n, width // n, n, count).mean((1, 3))

    stderr = np.sqrt(blocks("stderr", 2)) / n if "stderr" in cube else None
    return make_cube(blocks("radiance", 1), bands_of(cube), stderr, cube.attrs, cube["radiance"].attrs["units"])


def band_mean(cube: xr.Dataset, bands: Bands) -> xr.Dataset:
    """Average a fine cube over coarser bands, weighting each fine band by its overlap in nm.

    The path noise of neighbouring wavelengths is almost fully correlated (one path carries them all), so the
    standard error of a mean is taken as the mean of the standard errors: an upper bound.

    Raises:
        InputError: field ``bands`` when the fine bands do not cover a coarse one.
    """
    fine = bands_of(cube)
    overlap = np.minimum(fine.upper[:, None], bands.upper) - np.maximum(fine.lower[:, None], bands.lower)
    overlap = np.clip(overlap, 0, None)
    covered = overlap.sum(0)
    if np.any(np.abs(covered - bands.width) > GRID_TOLERANCE_NM):
        k = int(np.argmax(np.abs(covered - bands.width)))
        raise InputError(
            "bands",
            (float(bands.lower[k]), float(bands.upper[k])),
            f"covered by the cube's {fine.lower[0]:g}-{fine.upper[-1]:g} nm without gaps",
        )
    weights = overlap / covered
    stderr = cube["stderr"].values.astype(np.float64) @ weights if "stderr" in cube else None
    units = cube["radiance"].attrs["units"]
    return make_cube(cube["radiance"].values.astype(np.float64) @ weights, bands, stderr, cube.attrs, units)
