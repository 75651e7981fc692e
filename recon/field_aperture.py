"""The discrete operator of a camera whose light lands where the field and the optics lay it (theory.md (S.40), (S.41))."""

from typing import Any

import numpy as np

from recon import coded_aperture as simple
from recon import field_kernels as kernels
from recon import threads
from recon.coded_aperture import CodedAperture, empty_cube, mosaic_tile
from recon.errors import InputError
from recon.readout import Readout
from recon.spread import Spread


class FieldAperture:
    """H of a camera with two-dimensional, field-dependent weights, gray masks and imperfect pixels (theory.md (S.40), (S.41)).

    ``light[l,c,i,j] = sum response[c,k] taps[k,m,n,s,t] mask[l,m,n] f[m,n,k]`` over all k, m, n, s, t that land on (i, j);
    rows outside 0..M-1 and columns outside 0..W-1 are dropped; frames are ``readout`` of the light.

    Args:
        masks: (L, M, N) in [0, 1].
        response: (C, K) response of each spectral curve to each band, finite.
        spread: where each band lands.
        mosaic: (M, W) integers of 0..C-1, the curve of each sensor pixel; None when every pixel has all C channels.
        readout: gains, binned layers, crosstalk.
        width: W, sensor columns; None: the least that holds every column weight.
        dtype: float32 or float64, of the arrays that forward and adjoint return.

    Raises:
        InputError: for a wrong shape or value; field ``masks``, ``first_column`` or ``gain`` with "camera sees nothing" when H = 0.
    """

    def __init__(
        self,
        masks: np.ndarray,
        response: np.ndarray,
        spread: Spread,
        *,
        mosaic: np.ndarray | None = None,
        readout: Readout | None = None,
        width: int | None = None,
        dtype: Any = np.float32,
    ) -> None:
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        if self.dtype not in (np.dtype(np.float32), np.dtype(np.float64)):
            raise InputError("dtype", str(dtype), "float32 or float64")
        self.masks = simple.checked_masks(masks, True)
        shots, rows, columns = self.masks.shape
        self.response = simple.checked_response(response)
        curves, bands = self.response.shape
        self.spread = spread
        spread.check(rows, columns)
        if spread.taps.shape[0] != bands:
            raise InputError("taps", spread.taps.shape, f"of {bands} bands, as the response")
        reach = int(spread.first_column.max()) + spread.taps.shape[4] - 1
        self.width = simple.checked_width(columns + max(reach, 0) if width is None else width)
        self.mosaic = None if mosaic is None else simple.checked_mosaic(mosaic, (rows, self.width), curves)
        self.in_shape = (rows, columns, bands)
        self.out_shape = (shots, 1 if mosaic is not None else curves, rows, self.width)
        self.readout = Readout() if readout is None else readout
        self.readout.check(self.out_shape[1:])
        if not self.masks.any() or not self.response.any() or not spread.taps.any():
            raise InputError("masks", "no light", "such that masks, response and taps are not all 0: the camera sees nothing")
        if not spread.meets(rows, columns, self.width):
            allowed = f"such that light lands on the sensor's {rows} rows and {self.width} columns: the camera sees nothing"
            raise InputError("first_column", (int(spread.first_column.min()), int(spread.first_column.max())), allowed)
        if self.readout.gain is not None and not self.readout.gain.any():
            raise InputError("gain", 0.0, "above 0 somewhere: the camera sees nothing")
        self._arguments = self._kernel_arguments()

    @property
    def rows_couple(self) -> bool:
        """Tell whether light or charge of one row reaches another, so that H H^T falls into no blocks."""
        return not self.spread.in_row or self.readout.couples

    @property
    def reach(self) -> int:
        """Count the sensor columns over which a voxel spreads: H H^T couples columns up to reach - 1 apart."""
        return int(self.spread.taps.shape[4])

    @property
    def measurements(self) -> int:
        """Count the numbers S that one sensor pixel yields: shots times channels."""
        return self.out_shape[0] * self.out_shape[1]

    def forward(self, x: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Photograph a cube (M, N, K) into frames (L, C, M, W)."""
        cube = simple.as_array(x, self.in_shape, self.dtype, "x")
        frames = simple.result(out, self.out_shape, self.dtype)
        threads.run(kernels.forward_field, self.in_shape[0], cube.transpose(2, 0, 1), *self._arguments, frames)
        read = self.readout.apply(frames)
        if read is not frames:
            frames[...] = read
        return frames

    def adjoint(self, y: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Spread frames (L, C, M, W) back over the voxels that they saw; band-major memory unless ``out`` is given."""
        frames = self.readout.transpose(simple.as_array(y, self.out_shape, self.dtype, "y"))
        if out is None:
            out = empty_cube(self.in_shape, self.dtype)
        cube = simple.result(out, self.in_shape, self.dtype)
        threads.run(kernels.adjoint_field, self.in_shape[0], frames, *self._arguments, cube.transpose(2, 0, 1))
        return cube

    def gram(self, offset: int = 0, rows: slice = slice(None)) -> np.ndarray:
        """Return the blocks of H H^T between sensor columns j and j + offset: (rows, S, S, W) float64 (theory.md (S.42)).

        ``S = L C``, shot-major.

        Raises:
            InputError: field ``gram`` when rows couple.
        """
        if self.rows_couple:
            raise InputError("gram", "rows that couple", "of a camera whose light stays in its row")
        first, last, _ = rows.indices(self.in_shape[0])
        some = slice(first, last)
        count = max(0, last - first)
        out = np.zeros((count, self.measurements, self.measurements, self.width))
        if not (0 <= offset < self.spread.taps.shape[4] and count):
            return out
        tile, tile_of = mosaic_tile(self.response, self.mosaic, self.in_shape[0])
        column0, taps = _rows_of(self.spread.first_column, some), _rows_of(self.spread.taps, some)
        weights = np.ascontiguousarray(taps[:, :, :, 0].transpose(0, 1, 3, 2), np.float64)
        arguments = (np.ascontiguousarray(self.masks[:, some]), self.response, tile, tile_of[some], column0, weights)
        threads.run(kernels.gram_field, count, offset, *arguments, out)
        if self.readout.gain is not None:
            self._weigh(out, some, offset)
        return out

    def _weigh(self, gram: np.ndarray, rows: slice, offset: int) -> None:
        """Multiply by the gains of both pixels."""
        assert self.readout.gain is not None
        gain = np.tile(np.broadcast_to(self.readout.gain, self.out_shape[1:])[:, rows], (self.out_shape[0], 1, 1)).transpose(1, 0, 2)
        there = np.zeros_like(gain)
        there[..., : self.width - offset] = gain[..., offset:]
        gram *= gain[:, :, None] * there[:, None]

    def sparse(self) -> Any:
        """Return H as a SciPy CSR array; rows: sensor row fastest, then column, channel, shot; columns: row, column, band."""
        from scipy.sparse import coo_array

        shots, channels, rows, width = self.out_shape
        columns, bands = self.in_shape[1:]
        taps = self.spread.taps
        l, c, m, n, k, s, t = np.ogrid[:shots, :channels, :rows, :columns, :bands, : taps.shape[3], : taps.shape[4]]
        row0, column0 = (np.broadcast_to(a, (bands, rows, columns)) for a in (self.spread.first_row, self.spread.first_column))
        i, j = m + row0[k, m, n] + s, n + column0[k, m, n] + t
        inside = (i >= 0) & (i < rows) & (j >= 0) & (j < width)
        curve = c if self.mosaic is None else self.mosaic[np.clip(i, 0, rows - 1), np.clip(j, 0, width - 1)]
        full = np.broadcast_to(taps, (bands, rows, columns, *taps.shape[3:]))
        weight = self.response[curve, k] * full[k, m, n, s, t] * self.masks[l, m, n] * inside
        line = np.broadcast_to(((l * channels + c) * width + j) * rows + i, weight.shape)
        voxel = np.broadcast_to((k * columns + n) * rows + m, weight.shape)
        kept = weight != 0
        size = (shots * channels * width * rows, bands * columns * rows)
        light = coo_array((weight[kept], (line[kept], voxel[kept])), shape=size).tocsr()
        return light if self.readout.plain else (self.readout.matrix(self.out_shape) @ light).tocsr()

    def dense(self) -> np.ndarray:
        """Return H as a dense float64 matrix in the order of ``sparse``.

        Raises:
            InputError: field ``dense`` when it would pass 1 GiB.
        """
        entries = int(np.prod(self.out_shape)) * int(np.prod(self.in_shape))
        if entries > simple.DENSE_LIMIT:
            raise InputError("dense", entries, f"at most {simple.DENSE_LIMIT} entries (1 GiB); use sparse()")
        return np.asarray(self.sparse().toarray())

    def astype(self, dtype: Any) -> "FieldAperture":
        """Return the same camera computing in another precision."""
        return self.replace(dtype=dtype)

    def replace(self, **changes: Any) -> "FieldAperture":
        """Return a copy with some of the constructor's arguments changed."""
        kept = {name: getattr(self, name) for name in ("masks", "response", "spread", "mosaic", "readout", "width", "dtype")}
        return FieldAperture(**(kept | changes))

    def normalised(self) -> tuple["FieldAperture", float]:
        """Return the camera whose largest response is 1, and the factor by which this one is stronger."""
        size = float(np.abs(self.response).max())
        return self.replace(response=self.response / size), size

    def repeated_shots(self) -> int:
        """Count the shots whose mask is a copy of an earlier shot's: they add light, but no rank."""
        return self.masks.shape[0] - len({shot.tobytes() for shot in self.masks})

    def closed_shots(self) -> list[int]:
        """Return the shots whose mask is closed everywhere: their frames hold nothing."""
        return simple.closed_shots(self.masks)

    def rows_only(self, share: float = 1.0) -> CodedAperture:
        """Return the nearest camera whose rows don't couple, with the weights of the field's middle.

        Its H H^T is close to this one's and banded: conjugate gradients take it as the preconditioner (theory.md (S.43)).

        Args:
            share: of every band's light that the neighbouring columns kept must hold, in (0, 1].
        """
        taps, column0 = self.spread.taps, self.spread.first_column
        middle = taps[:, taps.shape[1] // 2, taps.shape[2] // 2].sum(1, dtype=np.float64)
        first = column0[:, column0.shape[1] // 2, column0.shape[2] // 2]
        light = np.abs(middle).cumsum(1)
        total = light[:, -1:]
        for count in range(1, middle.shape[1] + 1):
            held = light[:, count - 1 :] - np.pad(light, ((0, 0), (1, 0)))[:, : middle.shape[1] - count + 1]
            if (held.max(1) >= share * total[:, 0] * (1 - 1e-12)).all():
                break
        start = held.argmax(1)
        kept = np.take_along_axis(middle, start[:, None] + np.arange(count), axis=1)
        return CodedAperture(
            self.masks, self.response, first + start, kept, mosaic=self.mosaic, width=self.width, dtype=self.dtype, gray=True
        )

    def _kernel_arguments(self) -> tuple[np.ndarray, ...]:
        spread, real = self.spread, self.dtype
        tile, tile_of = mosaic_tile(self.response, self.mosaic, self.in_shape[0])
        reach = np.array([spread.first_row.min(), spread.first_row.max() + spread.taps.shape[3] - 1])
        taps = np.ascontiguousarray(spread.taps.transpose(0, 1, 3, 4, 2), real)
        masks, response = np.ascontiguousarray(self.masks, real), self.response.astype(real)
        return masks, response, tile.astype(real), tile_of, spread.first_row, spread.first_column, taps, reach


def _rows_of(array: np.ndarray, rows: slice) -> np.ndarray:
    return np.ascontiguousarray(array if array.shape[1] == 1 else array[:, rows])
