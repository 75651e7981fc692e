"""Write a measurement in the layout that learned solvers of the KAIST / TSA benchmark read (TSA-Net, MST and their heirs)."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim import __version__
from optsim.errors import InputError
from optsim.files.guard import atomic_path

if TYPE_CHECKING:
    import xarray as xr

BENCHMARK_BANDS, BENCHMARK_STEP_PX = 28, 2
TRUTH = Path("Truth") / "scene01.mat"
HEADER_TEXT = 116
"""Bytes of free text at the start of a MATLAB 5 file."""
SIGNATURE = b"MATLAB 5.0 MAT-file, written by optsim "
GUESSED = "peak of the frame x 2 / bands, which stands for the peak of the true cube: that is not known"
"""A mask that is half open lets half of the bands through to a pixel."""


def write_tsa(frames: xr.Dataset, folder: Path | str, *, shot: int = 1, truth: np.ndarray | None = None) -> list[str]:
    """Write mask, shifted masks, measurement and, if known, the true cube as MATLAB 5 files.

    ``mask.mat`` (mask), ``mask_3d_shift.mat`` (mask_3d_shift), ``Measurements/scene1.mat`` (meas_real, of peak 1),
    ``simulation_test.mat`` (simulation_test, in units of the true cube's peak; without a truth the frame's peak stands for K/2 of
    these), ``Truth/scene01.mat`` (img, of peak 1) and ``measurement.json`` (shifts, wavelengths, factors). Everywhere
    meas = sum over bands of mask_3d_shift times the shifted cube.

    Args:
        frames: a measurement of one channel whose bands fall on columns (:func:`optsim.camera.make_frames`).
        folder: is made; files of these names are replaced. Without a truth, one that an earlier export left there is removed.
        shot: which of the L shots, from 1.
        truth: (M, N, K) cube, or None.

    Returns:
        Sentences on what solvers that have the benchmark's numbers built in will miss; empty when nothing.

    Raises:
        InputError: ``frames`` of another form; ``--shot``; ``--truth`` of another shape or without light; ``-o`` with the truth of
            another program in it.
    """
    mask, weights = _masks(frames, shot)
    rows, columns = mask.shape
    bands, width = weights.shape[0], frames.sizes["x"]
    gain = float(weights.sum() / bands)
    if not gain > 0:
        raise InputError("response", gain, "of a sum above 0")
    first = frames["first_column"].values.astype(int)
    shifted = np.zeros((rows, width, bands))
    for k in range(bands):
        for t in range(weights.shape[1]):
            left, right = max(first[k] + t, 0), min(first[k] + t + columns, width)
            if left < right:
                shifted[:, left:right, k] += weights[k, t] / gain * mask[:, left - first[k] - t : right - first[k] - t]
    signal = (frames["frames"].values[shot - 1, 0].astype(np.float64) - float(frames.attrs.get("offset", 0.0))) / gain
    folder = Path(folder)
    unit = _unit(truth, (rows, columns, bands), signal)
    _clear_truth(folder, kept=truth is not None)
    peak = float(np.abs(signal).max()) or 1.0
    _write(folder / "mask.mat", mask=mask)
    _write(folder / "mask_3d_shift.mat", mask_3d_shift=shifted)
    _write(folder / "Measurements" / "scene1.mat", meas_real=signal / peak)
    _write(folder / "simulation_test.mat", simulation_test=signal[None] / unit)
    if truth is not None:
        _write(folder / TRUTH, img=np.asarray(truth, np.float64) / unit)
    notes = {
        "written_by": f"optsim {__version__}",
        "shot": shot,
        "wavelength_nm": frames["wavelength"].values.tolist(),
        "shift_px": (first + (weights @ np.arange(weights.shape[1])) / weights.sum(1)).tolist(),
        "meas_real_times": peak,
        "simulation_test_and_img_times": unit,
        "simulation_test_unit": "peak of the true cube" if truth is not None else GUESSED,
        "frame_units_per_cube_unit": gain,
    }
    with atomic_path(folder / "measurement.json") as temporary:
        temporary.write_text(json.dumps(notes, indent=1))
    return _missed(mask.shape, bands, weights, first, width)


def _masks(frames: xr.Dataset, shot: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the shot's mask (M, N), as the mirrors really send light, and each band's column weights (K, T)."""
    if frames["tap"].ndim != 2 or "cfa" in frames or "layer_bin" in frames or frames.sizes["channel"] != 1:
        raise InputError("frames", str(frames.attrs.get("sensor")), "of one channel, whose bands fall on columns: mono, and H without blur")
    if "pixel_gain" in frames or float(frames.attrs.get("crosstalk", 0.0)) != 0:
        raise InputError("frames", "pixel_gain or crosstalk", "explained by an H without them: measure with --operator camera")
    count = frames.sizes["shot"]
    if not 1 <= shot <= count:
        raise InputError("--shot", shot, f"from 1 to {count}")
    weights = frames["response"].values[0][:, None] * frames["tap"].values
    if np.any(weights.sum(1) == 0):
        raise InputError("response", 0.0, "different from 0 in every band")
    return frames["mirror" if "mirror" in frames else "mask"].values[shot - 1].astype(np.float64), weights


def _unit(truth: np.ndarray | None, shape: tuple[int, ...], signal: np.ndarray) -> float:
    """Return the cube's peak, or what stands for it."""
    if truth is None:
        return (float(np.abs(signal).max()) or 1.0) * 2 / shape[2]
    if truth.shape != shape:
        raise InputError("--truth", truth.shape, f"of shape {shape}: the mirrors' rows and columns, and the bands")
    peak = float(truth.max())
    if not peak > 0:
        raise InputError("--truth", peak, "with light somewhere")
    return peak


def _clear_truth(folder: Path, kept: bool) -> None:
    """Leave no truth of another measurement beside this one; a file that optsim did not write is never touched.

    Raises:
        InputError: ``-o``.
    """
    path = folder / TRUTH
    if kept or not path.exists():
        return
    with path.open("rb") as file:
        ours = file.read(len(SIGNATURE)) == SIGNATURE
    if not ours:
        raise InputError("-o", str(folder), f"a folder without {TRUTH}, which another program wrote, unless --truth replaces it")
    path.unlink()


def _write(path: Path, **variables: np.ndarray) -> None:
    """Write a MATLAB 5 file, atomically; the same variables always give the same bytes."""
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, variables, do_compression=True)
    text = (SIGNATURE + __version__.encode()).ljust(HEADER_TEXT)
    with atomic_path(path) as temporary:
        temporary.write_bytes(text + buffer.getvalue()[HEADER_TEXT:])


def _missed(mask: tuple[int, ...], bands: int, weights: np.ndarray, first: np.ndarray, width: int) -> list[str]:
    result = []
    if bands != BENCHMARK_BANDS:
        result.append(f"{bands} bands: published networks are trained for {BENCHMARK_BANDS}")
    only = "only solvers that take their operator from mask_3d_shift.mat are right"
    expected = mask[1] + BENCHMARK_STEP_PX * (bands - 1)
    if weights.shape[1] != 1 or not np.array_equal(first, BENCHMARK_STEP_PX * np.arange(bands)):
        result.append(f"bands do not fall on columns 0, {BENCHMARK_STEP_PX}, {2 * BENCHMARK_STEP_PX}, ...: {only}")
    elif width != expected:
        result.append(f"the frame is {width} px wide, solvers with {BENCHMARK_STEP_PX} px a band built in expect {expected}: {only}")
    elif np.ptp(weights) > 1e-9 * np.abs(weights).max():
        result.append("the response differs from band to band: it is in mask_3d_shift.mat, but not in mask.mat")
    if mask not in ((256, 256), (660, 660)):
        result.append(f"{mask[0]} x {mask[1]} pixels: the benchmark's test sets have 256 x 256 (simulated) and 660 x 660 (measured)")
    return result
