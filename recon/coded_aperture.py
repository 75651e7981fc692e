"""The discrete operator of a coded-aperture camera, from plain arrays: no optics in it (theory.md (S.1))."""

from typing import Any

import numpy as np

from recon import aperture_kernels as kernels
from recon import threads
from recon.arrays import REAL, as_double, real_array, require
from recon.errors import InputError
from recon.turning import packed_halves

DENSE_LIMIT = 2**27  # entries of a dense H: 1 GiB of float64
KEPT = ("masks", "response", "first_column", "taps", "mosaic", "width", "dtype", "gray", "spectral")
ON_OFF = REAL + "b"  # kinds of types where True and False mean 1 and 0
LINE = 64  # bytes of a cache line


def shift_taps(shift_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn positions of the bands on the sensor into first columns and linear-interpolation weights.

    Args:
        shift_px: (K,) position of each band relative to its mirror's column, in sensor pixels; finite.

    Returns:
        ``first_column`` (K,) int and ``taps`` (K, T) float64: T = 1 when all shifts are integers, else 2 with
        weights ``[1 - fraction, fraction]``.

    Raises:
        InputError: field ``shift_px``.
    """
    shift = np.atleast_1d(as_double(real_array("shift_px", shift_px, axes=" (band)")))
    if shift.ndim != 1 or shift.size == 0:
        raise InputError("shift_px", shift_px, "a list of finite positions in px, one a band")
    require("shift_px", shift, np.abs(shift) <= 2**30, "a list of finite positions in px, one a band, of -2^30..2^30", " (band)")
    first = np.floor(shift)
    fraction = shift - first
    if not fraction.any():
        return first.astype(np.int64), np.ones((shift.size, 1))
    return first.astype(np.int64), np.stack([1 - fraction, fraction], axis=1)


class CodedAperture:
    """H of one camera and L shots (theory.md (S.1), after Rueda et al. 2015, Eq. 2-3).

    ``g[l,c,m,j] = sum_k sum_t response[c,k] taps[k,t] mask[l,m,n] f[m,n,k]`` with ``n = j - first_column[k] - t``;
    columns j outside 0..W-1 are dropped. With a mosaic, frames have one channel and ``c = mosaic[m,j]``.

    Args:
        masks: (L, M, N) of 0 and 1; with ``gray`` any value of [0, 1].
        response: (C, K) response of each spectral curve to each band, finite.
        first_column: (K,) integers, the sensor column of mirror column 0 for the band's first tap.
        taps: (K, T) column weights, finite; kept as (K, 1) when every band has one that is not 0.
        mosaic: (M, W) integers of 0..C-1, the curve of each sensor pixel; None when every pixel has all C channels.
        width: W, sensor columns; None: the least that holds every band, N + K - 1 in the paper's model.
        dtype: float32 or float64, of the arrays that forward and adjoint return.
        gray: allow masks between 0 and 1.
        spectral: orthonormal (K, K): cubes then hold the coefficients ``spectral f`` of every pixel's spectrum in place of its
            bands, and H is ``H (I x spectral^T)`` (theory.md (S.70)); None: bands.

    Raises:
        InputError: for a wrong shape or value; fields ``masks``, ``response`` or ``first_column`` with "camera sees nothing" when H = 0.
    """

    def __init__(
        self,
        masks: np.ndarray,
        response: np.ndarray,
        first_column: np.ndarray,
        taps: np.ndarray,
        *,
        mosaic: np.ndarray | None = None,
        width: int | None = None,
        dtype: Any = np.float32,
        gray: bool = False,
        spectral: np.ndarray | None = None,
    ) -> None:
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        if self.dtype not in (np.dtype(np.float32), np.dtype(np.float64)):
            raise InputError("dtype", str(dtype), "float32 or float64")
        self.gray = gray
        self.masks = checked_masks(masks, gray)
        self.response, self.first_column, self.taps = _checked_bands(response, first_column, taps)
        shots, rows, columns = self.masks.shape
        curves, bands = self.response.shape
        reach = int(self.first_column.max()) + self.taps.shape[1] - 1
        self.width = checked_width(columns + max(reach, 0) if width is None else width)
        self.mosaic = None if mosaic is None else checked_mosaic(mosaic, (rows, self.width), curves)
        self.in_shape = (rows, columns, bands)
        self.out_shape = (shots, 1 if mosaic is not None else curves, rows, self.width)
        self._require_light()
        self.spectral = None if spectral is None else _checked_spectral(spectral, self.in_shape[2])
        self._optics = optics(self, self.masks, self.response, self.taps)

    @property
    def one_tap(self) -> bool:
        """Tell whether every voxel lands on one sensor column only, so that H H^T is block diagonal by pixel."""
        return self.taps.shape[1] == 1

    @property
    def reach(self) -> int:
        """Count the sensor columns over which a voxel spreads: H H^T couples columns up to reach - 1 apart."""
        return self.taps.shape[1]

    @property
    def measurements(self) -> int:
        """Count the numbers S that one sensor pixel yields: shots times channels."""
        return self.out_shape[0] * self.out_shape[1]

    def forward(self, x: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Photograph a cube (M, N, K) into frames (L, C, M, W)."""
        cube = by_band(as_array(x, self.in_shape, self.dtype, "x"))
        frames = result(out, self.out_shape, self.dtype)
        target = np.ascontiguousarray(frames)
        threads.run(kernels.forward_rows, self.in_shape[0], cube, self._optics, target)
        if target is not frames:
            frames[...] = target
        return frames

    def adjoint(self, y: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Spread frames (L, C, M, W) back over the voxels that they saw; band-major memory unless ``out`` is given."""
        frames = np.ascontiguousarray(as_array(y, self.out_shape, self.dtype, "y"))
        if out is None:
            out = empty_cube(self.in_shape, self.dtype)
        cube = result(out, self.in_shape, self.dtype)
        target = by_band(cube)
        threads.run(kernels.adjoint_rows, self.in_shape[0], frames, self._optics, target)
        if not np.shares_memory(target, cube):
            cube[...] = target.transpose(1, 2, 0)
        return cube

    def descend(self, x: np.ndarray, old: np.ndarray, seen_old: np.ndarray, beta: float, step: float, frames: np.ndarray) -> float:
        """Take FISTA's gradient step in one pass over the rows of band-major cubes.

        Sets ``old = y + step H^T (g - H y)`` with ``y = x + beta (x - old)``, ``seen_old = H x``, and returns ``||g - H x||^2``.
        """
        real, sums = self.dtype.type, np.zeros(self.in_shape[0])
        cubes = (x.transpose(2, 0, 1), old.transpose(2, 0, 1))
        arguments = (*cubes, seen_old, real(beta), real(step), frames, self._optics, sums)
        threads.run(kernels.descend_rows, self.in_shape[0], *arguments)
        return float(sums.sum())

    def optics(self) -> kernels.Optics:
        """Return what kernels need of this camera."""
        return self._optics

    def gram(self, offset: int = 0, rows: slice = slice(None)) -> np.ndarray:
        """Return the blocks of H H^T between sensor columns j and j + offset: (rows, S, S, W) float64 (theory.md (S.5)).

        ``S = L C``, shot-major. Offsets beyond T - 1 give zeros: different rows never couple.
        """
        first, last, _ = rows.indices(self.in_shape[0])
        count = max(0, last - first)
        out = np.zeros((count, self.measurements, self.measurements, self.width))
        if 0 <= offset < self.taps.shape[1] and count:
            tile, tile_of = mosaic_tile(self.response, self.mosaic, self.in_shape[0])
            masks = np.ascontiguousarray(self.masks[:, rows])
            rest = (self.response, tile, tile_of[rows], self.first_column, self.taps)
            threads.run(kernels.gram_rows, count, offset, masks, *rest, out)
        return out

    def sparse(self) -> Any:
        """Return H as a SciPy CSR array; rows: sensor row fastest, then column, channel, shot; columns: row, column, band."""
        from scipy.sparse import coo_array

        if self.spectral is not None:
            raise InputError("sparse", "spectral coefficients", "of cubes that hold bands (spectral=None)")
        shots, channels, rows, width = self.out_shape
        columns, bands = self.in_shape[1:]
        l, c, m, n, k, t = np.ogrid[:shots, :channels, :rows, :columns, :bands, : self.taps.shape[1]]
        j = n + self.first_column[k] + t
        inside = (j >= 0) & (j < width)
        curve = c if self.mosaic is None else self.mosaic[m, np.clip(j, 0, width - 1)]
        weight = self.response[curve, k] * self.taps[k, t] * self.masks[l, m, n] * inside
        shape = weight.shape
        line = np.broadcast_to(((l * channels + c) * width + j) * rows + m, shape)
        voxel = np.broadcast_to((k * columns + n) * rows + m, shape)
        kept = weight != 0
        size = (shots * channels * width * rows, bands * columns * rows)
        return coo_array((weight[kept], (line[kept], voxel[kept])), shape=size).tocsr()

    def dense(self) -> np.ndarray:
        """Return H as a dense float64 matrix in the order of ``sparse``.

        Raises:
            InputError: field ``dense`` when it would pass 1 GiB.
        """
        entries = int(np.prod(self.out_shape)) * int(np.prod(self.in_shape))
        if entries > DENSE_LIMIT:
            raise InputError("dense", entries, f"at most {DENSE_LIMIT} entries (1 GiB); use sparse()")
        return np.asarray(self.sparse().toarray())

    def astype(self, dtype: Any) -> "CodedAperture":
        """Return the same camera computing in another precision."""
        return self.replace(dtype=dtype)

    def replace(self, **changes: Any) -> "CodedAperture":
        """Return a copy with some of the constructor's arguments changed."""
        kept = {name: getattr(self, name) for name in KEPT}
        return CodedAperture(**(kept | changes))

    def normalised(self) -> tuple["CodedAperture", float]:
        """Return the camera whose largest weight is 1, and the factor by which this one is stronger."""
        size = float(np.abs(self.response).max() * np.abs(self.taps).max())
        return self.replace(response=self.response / np.abs(self.response).max(), taps=self.taps / np.abs(self.taps).max()), size

    def repeated_shots(self) -> int:
        """Count the shots whose mask is a copy of an earlier shot's: they add light, but no rank."""
        different = len({shot.tobytes() for shot in self.masks})
        return self.masks.shape[0] - different

    def closed_shots(self) -> list[int]:
        """Return the shots whose mask is closed everywhere: their frames hold nothing."""
        return closed_shots(self.masks)

    def _require_light(self) -> None:
        blind = self.closed_shots()
        n = np.arange(self.in_shape[1])
        column = n + self.first_column[:, None, None] + np.arange(self.taps.shape[1])[:, None]
        lands = ((column >= 0) & (column < self.width)).any(-1) & (self.taps != 0)
        if len(blind) == self.masks.shape[0]:
            raise InputError("masks", f"all closed (shots {blind})", "open somewhere: the camera sees nothing")
        if not self.response.any() or not self.taps.any():
            raise InputError("response", 0.0, "different from 0 somewhere: the camera sees nothing")
        if not lands.any():
            raise InputError(
                "first_column",
                self.first_column.tolist(),
                f"such that a band lands on the sensor's columns 0..{self.width - 1}: the camera sees nothing",
            )
        if not self._sees():
            allowed = (
                f"such that an open mirror's light lands on columns 0..{self.width - 1} where the sensor responds: the camera sees nothing"
            )
            raise InputError("masks", f"{int(self.masks.any(0).sum())} mirrors that open in vain", allowed)

    def _sees(self) -> bool:
        """Tell whether H has an element that is not 0: masks, response, taps, columns and mosaic together."""
        lit, columns = np.asarray(self.masks.any(0)), self.in_shape[1]
        for k, t in np.argwhere(self.taps != 0):
            shift = int(self.first_column[k] + t)
            first, last = max(0, -shift), min(columns, self.width - shift)
            responds = self.response[:, k] != 0
            if first >= last or not responds.any():
                continue
            here = lit[:, first:last]
            if self.mosaic is not None:
                here = here & responds[self.mosaic[:, first + shift : last + shift]]
            if here.any():
                return True
        return False


def empty_cube(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Allocate a cube of logical shape (M, N, K) in band-major memory (K, M, N) that begins at a cache line."""
    rows, columns, bands = shape
    kind = np.dtype(dtype)
    memory = np.empty(bands * rows * columns * kind.itemsize + LINE, np.uint8)
    first = -memory.ctypes.data % LINE
    whole = memory[first : first + bands * rows * columns * kind.itemsize].view(kind)
    return whole.reshape(bands, rows, columns).transpose(1, 2, 0)


def by_band(cube: np.ndarray) -> np.ndarray:
    """Return a cube (M, N, K) as (K, M, N) with contiguous rows: a view where it can be, else a copy."""
    bands = cube.transpose(2, 0, 1)
    return bands if bands.strides[2] == bands.itemsize or bands.shape[2] == 1 else np.ascontiguousarray(bands)


def optics(
    camera: "CodedAperture", masks: np.ndarray, response: np.ndarray, taps: np.ndarray, tiles: tuple[np.ndarray, np.ndarray] | None = None
) -> kernels.Optics:
    """Return what the kernels need of a camera, in its type, with other masks, response and taps perhaps.

    ``tiles``: ``mosaic_tile`` of that response; None: made here.
    """
    tile, tile_of = mosaic_tile(response, camera.mosaic, camera.in_shape[0]) if tiles is None else tiles
    real, around = camera.dtype, kernels.BLOCK
    if tile.size:
        behind = kernels.row_step(camera.width) - camera.width + around
        tile = np.pad(tile, ((0, 0), (0, 0), (around, behind)))
    band, tap = np.nonzero(taps)
    strength = np.atleast_2d(taps[band, tap]) * (1 if tile.size else response[:, band])
    first = np.searchsorted(band, np.arange(taps.shape[0] + 1))
    masks, strength, tile = (np.ascontiguousarray(a, real) for a in (masks, strength, tile))
    even, odd, even_back, odd_back = packed_halves(camera.spectral, real)
    return kernels.Optics(masks, strength, tile, tile_of, band, camera.first_column[band] + tap, first, even, odd, even_back, odd_back)


def mosaic_tile(response: np.ndarray, mosaic: np.ndarray | None, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Tabulate the response of each different row of the mosaic: (R, K, W), and which of them each sensor row is."""
    if mosaic is None:
        return np.zeros((0, 0, 0)), np.zeros(rows, np.int64)
    different, tile_of = np.unique(mosaic, axis=0, return_inverse=True)
    return np.ascontiguousarray(response[different].transpose(0, 2, 1)), tile_of.reshape(-1).astype(np.int64)


def as_array(value: np.ndarray, shape: tuple[int, ...], dtype: np.dtype[Any], name: str) -> np.ndarray:
    """Return an input as an array of the operator's shape and type."""
    array = np.asarray(value)
    if array.shape != shape:
        raise InputError(name, array.shape, f"an array of shape {shape}")
    return array if array.dtype == dtype else array.astype(dtype)


def result(out: np.ndarray | None, shape: tuple[int, ...], dtype: np.dtype[Any]) -> np.ndarray:
    """Return ``out``, checked, or a new array."""
    if out is None:
        return np.empty(shape, dtype)
    if out.shape != shape or out.dtype != dtype:
        raise InputError("out", (out.shape, str(out.dtype)), f"of shape {shape} and type {dtype}")
    return out


def checked_masks(masks: np.ndarray, gray: bool) -> np.ndarray:
    """Return masks (L, M, N) in float64."""
    axes = " (shot, row, column)"
    values = real_array("masks", masks, axes=axes, kinds=ON_OFF)
    if values.ndim != 3 or 0 in values.shape:
        raise InputError("masks", values.shape, "of shape (shots, rows, columns), each at least 1")
    values = as_double(values)
    good = (values >= 0) & (values <= 1) if gray else (values == 0) | (values == 1)
    require("masks", values, good, "in [0, 1]" if gray else "0 or 1 (values between need gray=True)", axes)
    return np.ascontiguousarray(values)


def closed_shots(masks: np.ndarray) -> list[int]:
    """Return the shots of masks (L, M, N) that are 0 everywhere."""
    return [l for l, mask in enumerate(masks) if not mask.any()]


def checked_response(response: np.ndarray) -> np.ndarray:
    """Return a finite response (C, K) in float64."""
    chi = real_array("response", response, axes=" (curve, band)", kinds=ON_OFF)
    if chi.ndim != 2 or 0 in chi.shape:
        raise InputError("response", chi.shape, "finite, of shape (curves, bands)")
    chi = np.ascontiguousarray(as_double(chi))
    require("response", chi, np.isfinite(chi), "finite", " (curve, band)")
    return chi


def _checked_bands(response: np.ndarray, first_column: np.ndarray, taps: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    chi = checked_response(response)
    first = np.asarray(first_column)
    if first.shape != (chi.shape[1],) or not np.issubdtype(first.dtype, np.integer) or np.abs(first).max() > 2**30:
        raise InputError("first_column", first.tolist() if first.size < 100 else first.shape, f"{chi.shape[1]} integers, one a band")
    weights = real_array("taps", taps, axes=" (band, tap)", kinds=ON_OFF)
    if weights.ndim != 2 or weights.shape[0] != chi.shape[1] or weights.shape[1] == 0:
        raise InputError("taps", weights.shape, f"finite, of shape ({chi.shape[1]}, taps)")
    weights = np.ascontiguousarray(as_double(weights))
    require("taps", weights, np.isfinite(weights), "finite", " (band, tap)")
    first = np.ascontiguousarray(first, np.int64)
    if weights.shape[1] > 1 and (np.count_nonzero(weights, axis=1) == 1).all():
        used = np.argmax(weights != 0, axis=1)
        return chi, first + used, np.take_along_axis(weights, used[:, None], axis=1)
    return chi, first, weights


def _checked_spectral(matrix: np.ndarray, bands: int) -> np.ndarray:
    values = np.ascontiguousarray(matrix, np.float64)
    if values.shape != (bands, bands) or not np.abs(values @ values.T - np.eye(bands)).max() < 1e-5:
        raise InputError("spectral", values.shape, f"an orthonormal matrix of shape {(bands, bands)}")
    return values


def checked_width(width: int) -> int:
    """Return W as an int."""
    if isinstance(width, bool) or int(width) != width or not 1 <= width <= 2**24:
        raise InputError("width", width, "an integer of 1..2^24 sensor columns")
    return int(width)


def checked_mosaic(mosaic: np.ndarray, shape: tuple[int, int], curves: int) -> np.ndarray:
    """Return the mosaic (M, W) as int64."""
    values = np.asarray(mosaic)
    if values.shape != shape:
        raise InputError("mosaic", values.shape, f"of the sensor's shape {shape}")
    if not np.issubdtype(values.dtype, np.integer) or values.min() < 0 or values.max() >= curves:
        raise InputError("mosaic", (str(values.dtype), values.min(), values.max()), f"integers of 0..{curves - 1}, rows of response")
    return np.ascontiguousarray(values, np.int64)
