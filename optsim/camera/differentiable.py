"""The measurement as a Dr.Jit function: gradients by prism, relay, registration and gray masks (theory.md (C.71), (C.72))."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from optsim.camera.aligned import aligned
from optsim.camera.arrays import NUMPY, Array, Kernels, Ops, kernels
from optsim.camera.band_model import frame_width
from optsim.camera.bandpass import passed_photons, support_nm
from optsim.camera.camera import CameraConfig
from optsim.camera.differentiable_optics import DifferentiableOptics, OpticsValues
from optsim.camera.sensor import Sensor
from optsim.cube import Bands
from optsim.errors import InputError

STEP = 0.1
"""Of the half field, for differences at its middle."""
MAX_LANES = 2**26
"""Pixels x wavelengths x samples of one measurement: an array of float64 takes 512 MiB."""

Loss = Callable[[Any], Any]
"""Takes frames, a TensorXf64 (L, C', M, W), and returns a Dr.Jit scalar."""


class Gradient(NamedTuple):
    """Hold the derivatives of a scalar of the frames.

    Args:
        value: the scalar.
        optics: by every number of the optics, per rad, per mm, per px or per unit index.
        masks: (L, M, N) by every mirror.
    """

    value: float
    optics: OpticsValues
    masks: np.ndarray


class _Reach(NamedTuple):
    """Hold where the samples that touch a pixel are sought: estimate = affine (n, 2, 3) of (1, x, y), and the range round it."""

    affine: np.ndarray
    reach: tuple[float, float]
    candidates: tuple[int, int]


@dataclass(frozen=True, eq=False)
class DifferentiableMeasurement:
    """Photograph fine cubes as a differentiable function, in gather form and float64 (theory.md (C.72)).

    Every pixel adds up the samples that touch it, each laid by area as in (C.17) at its exactly traced place. What it
    models: the prism over the whole field with its Fresnel losses, both lenses, band-pass, registration, and masks of any
    value in [0, 1] (leak is ``leak + (1 - leak) mask``). It leaves out blur, defects, noise and the pixels' patterns:
    ``left_out`` names those of them that the camera states.

    Args:
        camera: the optics.
        sensor: spectral curves and mosaic.
        bands: the n fine bands of the cubes.
        mirrors: (M, N).
        samples: s, samples along a mirror's side, from 1.
        width: W; None: the width that the camera's photographs have.
    """

    camera: CameraConfig
    sensor: Sensor
    bands: Bands
    mirrors: tuple[int, int]
    samples: int = 1
    width: int | None = None

    def __post_init__(self) -> None:
        if self.samples < 1 or min(self.mirrors) < 1:
            raise InputError("samples", (self.samples, self.mirrors), "at least 1 sample a mirror and 1 x 1 mirrors")
        if set(self.sensor.layer_bins) != {1}:
            raise InputError("sensor", self.sensor.name, "a sensor whose layers all have pixels of one size")
        if self.width is None:
            low, high = support_nm(self.camera.bandpass)
            edges = np.clip(self.bands.lower, low, high), np.clip(self.bands.upper, low, high)
            object.__setattr__(self, "width", frame_width(self.camera.dispersion, *edges, self.mirrors[1]))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Name the facts that the camera states and this measurement does not model."""
        relay, dmd, pixels = self.camera.relay, self.camera.dmd, self.camera.sensor
        facts = {
            "relay.diffraction": relay.diffraction,
            "relay.defocus_mm": relay.defocus_mm != 0,
            "dmd.dead_share": dmd.dead_share != 0,
            "dmd.stuck_share": dmd.stuck_share != 0,
            "sensor.prnu": pixels.prnu != 0,
            "sensor.crosstalk": pixels.crosstalk != 0,
        }
        return tuple(name for name, stated in facts.items() if stated)

    @functools.cached_property
    def optics(self) -> DifferentiableOptics:
        """Return the trace with the camera's numbers."""
        return DifferentiableOptics.of(self.camera)

    @functools.cached_property
    def wavelength_nm(self) -> np.ndarray:
        """Return (n,) the wavelength at which each fine band is traced: the middle of what can pass the filter."""
        low, high = support_nm(self.camera.bandpass)
        return (np.clip(self.bands.lower, low, high) + np.clip(self.bands.upper, low, high)) / 2

    @functools.cached_property
    def curves(self) -> np.ndarray:
        """Return (C, n) electrons per second and unit radiance of one open mirror, before the prism's losses."""
        lower, upper, bandpass = self.bands.lower, self.bands.upper, self.camera.bandpass
        low, high = support_nm(bandpass)
        self.sensor.check_range(float(np.clip(lower, low, high).min()), float(np.clip(upper, low, high).max()))
        return self.camera.throughput_m2_sr * np.stack([passed_photons(bandpass, lower, upper, curve) for curve in self.sensor.curves])

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return (C', M, W): channels, rows and columns of a frame."""
        assert self.width is not None
        return self.sensor.channels, self.mirrors[0], self.width

    def frames(self, cube: Array, masks: Array, values: OpticsValues | None = None) -> Any:
        """Return frames (L, C', M, W) for one second as a Dr.Jit TensorXf64; gradients flow from every argument that carries them.

        Args:
            cube: (M s, N s, n) radiance, NumPy, or a flat Dr.Jit Float64 of that order.
            masks: (L, M, N) of [0, 1], NumPy, or a Dr.Jit TensorXf64.
            values: the optics' numbers, floats or from ``optics.inputs``; None: the camera's.

        Raises:
            InputError: ``libLLVM``, ``cube``, ``masks``, or ``lanes`` where the measurement is too large.
        """
        k = self._kernels()
        t = k.backend
        values = self.optics.inputs(k, values) if values is None or isinstance(values.scale, float | int) else values
        light = t.Float64(aligned(cube)) if isinstance(cube, np.ndarray) else cube
        tensor = t.TensorXf64(t.Float64(aligned(masks)), np.shape(masks)) if isinstance(masks, np.ndarray) else masks
        fine = (self.mirrors[0] * self.samples, self.mirrors[1] * self.samples, self.bands.count)
        if len(light) != math.prod(fine):
            raise InputError("cube", len(light), f"{fine[0]} x {fine[1]} x {fine[2]} values")
        if tensor.shape[1:] != tuple(self.mirrors):
            raise InputError("masks", tuple(tensor.shape), f"of shape (shots, {self.mirrors[0]}, {self.mirrors[1]})")
        return self._measure(k, light, tensor, values)

    def gradient(self, loss: Loss, cube: np.ndarray, masks: np.ndarray, values: OpticsValues | None = None) -> Gradient:
        """Return a scalar of the frames and its derivatives by all optics and all mirrors, in reverse mode.

        Args:
            loss: of the frames.
            cube: (M s, N s, n) radiance.
            masks: (L, M, N) of [0, 1].
            values: the optics' numbers, floats; None: the camera's.
        """
        k = self._kernels()
        dr, t = k.dr, k.backend
        inputs, gray = self.optics.inputs(k, values), t.TensorXf64(t.Float64(aligned(masks)), np.shape(masks))
        leaves = inputs.leaves()
        dr.enable_grad(gray, *leaves)
        value = loss(self.frames(cube, gray, inputs))
        dr.backward(value)
        by_optics = inputs.with_leaves([float(dr.grad(leaf)[0]) for leaf in leaves])
        return Gradient(float(value.array[0] if hasattr(value, "array") else value[0]), by_optics, np.array(dr.grad(gray)))

    def _kernels(self) -> Kernels:
        k = kernels()
        if k is None:
            raise InputError("libLLVM", None, "usable: gradients are Dr.Jit's (optsim doctor says what is missing)")
        return k

    def _measure(self, k: Kernels, cube: Array, masks: Array, values: OpticsValues) -> Any:
        """Lay every sample on its pixels; one lane a (pixel, wavelength, candidate sample), added up in a fixed order."""
        t, dr = k.backend, k.dr
        channels, rows, width = self.shape
        found = self._reach(values.numbers())
        block = self.bands.count * found.candidates[0] * found.candidates[1]
        if rows * width * block > MAX_LANES:
            raise InputError("lanes", rows * width * block, f"at most {MAX_LANES}: fewer mirrors, wavelengths or samples")
        lane = _Lanes(k, self, found)
        wavelength = t.Float64(aligned(self.wavelength_nm))
        sides = self.sides_px(k.ops, self.optics.gathered(k, values, wavelength), wavelength)
        weight = lane.weight(self.optics.gathered(k, values, lane.wavelength), sides)
        weight = weight * dr.gather(t.Float64, cube, lane.voxel, lane.active)
        leak = self.camera.dmd.leak
        shots = masks.shape[0]
        chi = self._chi(k, lane, width)
        parts = []
        for l in range(shots):
            gray = dr.gather(t.Float64, masks.array, lane.mirror + l * self.mirrors[0] * self.mirrors[1], lane.active)
            parts += [weight * (leak + (1 - leak) * gray) * c for c in chi]
        dr.eval(parts)
        sums = [dr.block_sum(part, block, mode="evaluated") for part in parts]
        return t.TensorXf64(dr.concat(sums) if len(sums) > 1 else sums[0], (shots, channels, rows, width))

    def _chi(self, k: Kernels, lane: _Lanes, width: int) -> list[Array]:
        """Return the response of each channel to a lane's wavelength."""
        t, dr, count = k.backend, k.dr, self.bands.count
        table = t.Float64(aligned(self.curves))
        mosaic = self.sensor.mosaic(self.mirrors[0], width)
        if mosaic is None:
            return [dr.gather(t.Float64, table, lane.wave + c * count) for c in range(len(self.curves))]
        curve = dr.gather(t.UInt32, t.UInt32(aligned(mosaic, np.uint32)), lane.pixel)
        return [dr.gather(t.Float64, table, curve * count + lane.wave)]

    def _reach(self, values: OpticsValues) -> _Reach:
        """Fit the field's inverse by an affine map a wavelength, and measure how far from it a sample can be."""
        half_x, half_y = self.half_mm
        xi, eta = (v.ravel() for v in np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7)))
        wavelength = self.wavelength_nm[:, None]
        x, y, valid = self.optics.position_px(values, wavelength, xi * half_x, eta * half_y)
        pitch = np.array([self.mirrors[1], self.mirrors[0]]) * self.samples / 2
        place = np.stack([xi, eta], 1) * pitch  # in samples from the middle
        wide, high = self.sides_px(NUMPY, values, self.wavelength_nm)
        affine, reach = np.zeros((len(x), 2, 3)), np.zeros(2)
        for n in range(len(x)):
            ok = valid[n]
            if ok.sum() < 6:
                continue
            design = np.stack([np.ones(ok.sum()), x[n, ok], y[n, ok]], 1)
            solution = np.linalg.lstsq(design, place[ok], rcond=None)[0]
            affine[n] = solution.T
            touching = (1 + np.array([wide[n], high[n]])) / 2 @ np.abs(solution[1:])
            reach = np.maximum(reach, touching + 1.5 * np.abs(design @ solution - place[ok]).max(0) + 1e-6)
        across, down = map(float, reach)
        return _Reach(affine, (down, across), (math.floor(2 * down) + 1, math.floor(2 * across) + 1))

    @property
    def half_mm(self) -> tuple[float, float]:
        """Return half the sides of the field of mirrors along x and y, mm."""
        half = self.camera.dmd.pitch_um / 2000
        return self.mirrors[1] * half, self.mirrors[0] * half

    def sides_px(self, ops: Ops, values: OpticsValues, wavelength_nm: Array) -> tuple[Array, Array]:
        """Return the sides along x and y of a sample's image at the middle of the field, in px (theory.md (C.39)); nominal where lost."""
        pitch_mm, half = self.camera.dmd.pitch_um / 1000 / self.samples, self.half_mm
        zero = wavelength_nm * 0.0
        ends = []
        for X, Y in ((half[0], 0.0), (-half[0], 0.0), (0.0, half[1]), (0.0, -half[1])):
            ends.append(self.optics.trace(ops, values, wavelength_nm, zero + STEP * X, zero + STEP * Y))
        valid = ends[0][2] & ends[1][2] & ends[2][2] & ends[3][2]
        nominal = values.focal_mm / values.collimator_mm * values.scale * (pitch_mm * 1000 / self.optics.pixel_um)
        sides = []
        for axis in (0, 1):
            by_x = (ends[0][axis] - ends[1][axis]) * (pitch_mm / (2 * STEP * half[0]))
            by_y = (ends[2][axis] - ends[3][axis]) * (pitch_mm / (2 * STEP * half[1]))
            sides.append(ops.sqrt(ops.where(valid, by_x * by_x + by_y * by_y, nominal * nominal)))
        return sides[0], sides[1]


class _Lanes:
    """Number the lanes of one measurement: pixel, wavelength, candidate row, candidate column, the last fastest."""

    def __init__(self, k: Kernels, m: DifferentiableMeasurement, found: _Reach) -> None:
        t, dr = k.backend, k.dr
        self.k, self.m = k, m
        _, rows, width = m.shape
        (down, across), waves = found.candidates, m.bands.count
        lane = dr.arange(t.UInt32, rows * width * waves * down * across)
        q, rest = lane % across, lane // across
        p, rest = rest % down, rest // down
        self.wave, self.pixel = rest % waves, rest // waves
        row, column = self.pixel // width, self.pixel % width
        self.y, self.x = t.Float64(row) - (m.mirrors[0] - 1) / 2, t.Float64(column) - (m.mirrors[1] - 1) / 2
        fine_rows, fine_columns = m.mirrors[0] * m.samples, m.mirrors[1] * m.samples
        v = self._first(found, 1, fine_rows) + t.Int32(p)
        u = self._first(found, 0, fine_columns) + t.Int32(q)
        self.active = (v >= 0) & (v < fine_rows) & (u >= 0) & (u < fine_columns)
        self.mirror = t.UInt32(v // m.samples) * m.mirrors[1] + t.UInt32(u // m.samples)
        self.voxel = (t.UInt32(v) * fine_columns + t.UInt32(u)) * waves + self.wave
        self.xi, self.eta = (t.Float64(u) + 0.5) / (fine_columns / 2) - 1, (t.Float64(v) + 0.5) / (fine_rows / 2) - 1
        self.wavelength = dr.gather(t.Float64, t.Float64(aligned(m.wavelength_nm)), self.wave)

    def _first(self, found: _Reach, axis: int, count: int) -> Array:
        """Return the first sample along an axis (0 columns, 1 rows) that can touch the pixel."""
        k, t, dr = self.k, self.k.backend, self.k.dr
        c = [dr.gather(t.Float64, t.Float64(aligned(found.affine[:, axis, i])), self.wave) for i in range(3)]
        reach = k.opaque(t.Float64, found.reach[1 - axis])
        place = c[0] + c[1] * self.x + c[2] * self.y + (count - 1) / 2
        return t.Int32(dr.ceil(dr.clip(place - reach, -count - 64.0, 2 * count + 64.0)))

    def weight(self, values: OpticsValues, sides: tuple[Array, Array]) -> Array:
        """Return the share of each lane's sample that falls on its pixel, times 1/s^2; gradients flow from the values."""
        dr, m = self.k.dr, self.m
        half_x, half_y = m.half_mm
        point = (self.k.ops, values, self.wavelength, self.xi * half_x, self.eta * half_y)
        x, y, valid = m.optics.trace(*point)
        wide, high = (dr.gather(self.k.backend.Float64, side, self.wave) for side in sides)
        share = self._overlap(x - self.x, wide) * self._overlap(y - self.y, high) / (wide * high) * m.optics.transmitted(*point)
        return dr.select(valid & self.active, share, 0.0) / m.samples**2

    def _overlap(self, distance: Array, side: Array) -> Array:
        dr = self.k.dr
        return dr.clip((1 + side) / 2 - dr.abs(distance), 0.0, dr.minimum(side, 1.0))
