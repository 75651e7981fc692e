"""Show one file as a picture: a cube or an estimate by sRGB, bands and spectra; frames shot by shot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.cube import UNITS, Bands, bands_of
from optsim.errors import InputError
from optsim.report.color import Exposure, SceneLight, exposure_of, lamps_seen, srgb
from optsim.report.data import Frames
from optsim.report.figures_more import frame_image, mark, telling_points
from optsim.report.figures_target import chosen_bands, window_box
from optsim.report.gallery import finest_window
from optsim.report.style import DPI, MUTED, new_figure, picture, styled
from optsim.report.units import cube_unit, frame_unit

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

# Tol's "bright" and one more: points are told apart by number as well.
POINT_COLORS = ("#4477AA", "#EE6677", "#228833", "#AA3377", "#CCBB44", "#66CCEE", "#000000", "#8C564B")
MAX_SIDE_PX = 1024
MAX_VOXELS = 50_000_000
MAX_SHOTS = 12


def show(data: xr.Dataset, out: Path | str, points: Sequence[tuple[int, int]] | None = None, like: xr.Dataset | None = None) -> Path:
    """Draw a cube, an estimate or frames into a PNG.

    Args:
        data: Dataset with ``radiance`` (a cube or an estimate; ``stderr`` optional) or ``frames``.
        out: the PNG to write; its folder is made when it is missing.
        points: (y, x) pixels whose spectra are drawn, at most 8; None chooses up to 6 flat places.
        like: a cube of the same size, the truth say, from which points, exposure and white are taken.

    Returns:
        ``out``.

    Raises:
        InputError: field ``file`` when the Dataset is neither, ``points`` when one lies outside, ``radiance`` or
            ``frames`` when a value is not finite, ``--points-from`` when ``like`` is no cube of the same size, ``--out`` when
            the name does not end in .png.
    """
    out = Path(out)
    if out.suffix.lower() != ".png":
        raise InputError("--out", str(out), "a file name that ends in .png")
    with styled():
        if "radiance" in data:
            figure = cube_figure(data, points, like)
        elif "frames" in data:
            figure = frames_figure(data)
        else:
            raise InputError("file", sorted(map(str, data.data_vars)), "a cube or estimate (variable radiance) or frames (variable frames)")
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=DPI, metadata={"Software": None})
    return out


def thin(data: xr.Dataset) -> tuple[xr.Dataset, int]:
    """Keep every n-th row and column of a cube too large to draw, before its values are read; return it and n."""
    height, width, count = (data.sizes[d] for d in ("y", "x", "wavelength"))
    step = max(math.ceil(max(height, width) / MAX_SIDE_PX), math.ceil(math.sqrt(height * width * count / MAX_VOXELS)), 1)
    return (data.isel(y=slice(None, None, step), x=slice(None, None, step)) if step > 1 else data), step


def checked(data: xr.Dataset, name: str) -> np.ndarray:
    """Read a variable as float64; refuse what is not finite."""
    values = np.asarray(data[name].values, np.float64)
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise InputError(name, f"{int(np.sum(~np.isfinite(values)))} values that are not finite of {values.size}", "finite and not empty")
    return values


def checked_points(points: Sequence[tuple[int, int]], shape: tuple[int, int]) -> list[tuple[int, int]]:
    """Refuse points outside the picture, or too many."""
    if not 1 <= len(points) <= len(POINT_COLORS):
        raise InputError("points", len(points), f"1 to {len(POINT_COLORS)} points")
    for y, x in points:
        if not (0 <= y < shape[0] and 0 <= x < shape[1]):
            raise InputError("points", (y, x), f"(y, x) with y in 0..{shape[0] - 1} and x in 0..{shape[1] - 1}, in pixels")
    return [(int(y), int(x)) for y, x in points]


@dataclass(frozen=True, eq=False)
class Look:
    """Hold how a cube is to be shown: points (y, x), exposure, and the radiance that is white in single bands."""

    points: list[tuple[int, int]]
    exposure: Exposure
    top: float


def looked_at(data: xr.Dataset) -> Look:
    """Choose how to show a cube by what it contains and, when a render made it, by its light."""
    small, step = thin(data)
    cube, bands = checked(small, "radiance"), bands_of(data)
    light = SceneLight.of(data.attrs.get("illuminant"), bands.count)
    lamps = lamps_seen(cube, bands, light)
    places = [(y * step, x * step) for y, x in telling_points(cube, without=lamps)]
    return Look(places, exposure_of(cube, bands, light), float(cube[~lamps].max()))


def require_same_size(data: xr.Dataset, like: xr.Dataset) -> None:
    """Refuse to take points from what is not a cube of the same height and width."""
    sizes = tuple(data.sizes[d] for d in ("y", "x"))
    if "radiance" not in like or tuple(like.sizes[d] for d in ("y", "x")) != sizes:
        raise InputError("--points-from", dict(like.sizes), f"a cube or estimate of {sizes[0]} x {sizes[1]} pixels as the file shown")


def cube_figure(data: xr.Dataset, points: Sequence[tuple[int, int]] | None, like: xr.Dataset | None = None) -> Figure:
    """Draw sRGB with numbered points, their spectra, and six bands on one scale; see ``show``."""
    if like is not None:
        require_same_size(data, like)
    shape = (data.sizes["y"], data.sizes["x"])
    wanted = None if points is None else checked_points(points, shape)
    small, step = thin(data)
    cube, bands = checked(small, "radiance"), bands_of(data)
    stderr = checked(small, "stderr") if "stderr" in small else None
    look = looked_at(data if like is None else like)
    places = look.points if wanted is None else wanted
    index = [n - 1 for n in chosen_bands(bands.count, 6)]
    tall = cube.shape[0] / cube.shape[1]
    strip = min(max(10.0 / len(index) * tall, 0.9), 3.2) if len(index) == 6 else 2.6
    figure = new_figure(10.0, 4.3 + strip + 0.5)
    top, bottom = np.ravel(figure.subfigures(2, 1, height_ratios=[4.3, strip + 0.5], squeeze=False))
    view, plot = top.subplots(1, 2, width_ratios=[1, 1.35])
    view.imshow(srgb(cube, bands, look.exposure), extent=(-0.5, shape[1] - 0.5, shape[0] - 0.5, -0.5))
    words = "sRGB under its own light" if look.exposure.white is not None else "no visible light: mean radiance as grey"
    picture(view, f"{shape[0]} × {shape[1]} × {bands.count}, {words}" + (f", one pixel in {step} each way" if step > 1 else ""))
    draw_spectra(plot, data, bands, places)
    for number, ((y, x), color) in enumerate(zip(places, POINT_COLORS), start=1):
        mark(view, y, x, number, color)
    draw_bands(bottom, cube, stderr, bands, index, look.top, label=radiance_label(data))
    return figure


def draw_spectra(plot: Axes, data: xr.Dataset, bands: Bands, places: list[tuple[int, int]]) -> None:
    """Plot the spectra of single pixels, with ±2 standard errors where they are known."""
    for number, ((y, x), color) in enumerate(zip(places, POINT_COLORS), start=1):
        spectrum = checked(data.isel(y=y, x=x), "radiance")
        plot.plot(
            bands.center, spectrum, color=color, marker="o" if bands.count <= 40 else None, markersize=3, label=f"{number}: y {y}, x {x}"
        )
        if "stderr" in data:
            error = 2 * checked(data.isel(y=y, x=x), "stderr")
            plot.fill_between(bands.center, spectrum - error, spectrum + error, color=color, alpha=0.25, linewidth=0)
    plot.set_xlabel("wavelength, nm")
    plot.set_ylabel(radiance_label(data))
    plot.set_ylim(min(0.0, plot.get_ylim()[0]), None)
    plot.set_title("spectra of single pixels" + (", ±2 standard errors" if "stderr" in data else ""), loc="left")
    plot.legend(loc="best", fontsize=7.5)


def radiance_label(data: xr.Dataset) -> str:
    """Return what a cube holds, with its own unit; a file without one is in that of every cube."""
    return f"radiance, {cube_unit(str(data['radiance'].attrs.get('units', UNITS)))}"


def draw_bands(
    panel: SubFigure, cube: np.ndarray, stderr: np.ndarray | None, bands: Bands, index: list[int], top: float, label: str
) -> None:
    """Draw bands as grey pictures on one scale up to ``top`` with a colour bar."""
    from matplotlib.colors import PowerNorm
    from matplotlib.ticker import FuncFormatter

    axes = np.ravel(panel.subplots(1, len(index), squeeze=False))
    low, high = 0.0, float(cube.max())  # an estimate may dip below zero: black
    scale = top if top > low else high if high > low else low + 1.0
    for ax, k in zip(axes, index):
        image = ax.imshow(cube[..., k], cmap="gray", norm=PowerNorm(0.5, vmin=low, vmax=scale))
        picture(ax, f"{bands.center[k]:.1f} nm")
    beyond = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[int(cube.min() < 0), int(high > scale)]
    bar = panel.colorbar(image, ax=list(axes), location="bottom", aspect=60, shrink=0.7, extend=beyond)
    bar.formatter = FuncFormatter(lambda value, _: f"{value:.3g}")  # no common factor beside the axis, where the label ends
    flat = " (all values are equal)" if float(cube.min()) == high else ""
    noise = ""
    if stderr is not None:
        noise = f"; standard error: median {np.median(stderr):.2g}, largest {stderr.max():.2g}"
    dark = ", below zero black" if cube.min() < 0 else ""
    bar.set_label(f"{label}: {cube.min():.4g} to {high:.4g}{flat}{noise}; grey by the square root{dark}")


def frames_figure(data: xr.Dataset) -> Figure:
    """Draw every shot and channel with an enlarged window, on one scale."""
    values = checked(data, "frames")
    if values.ndim != 4:
        raise InputError("frames", values.shape, "of dims (shot, channel, y, x)")
    cfa = np.asarray(data["cfa"].values) if "cfa" in data else None
    shots, channels = min(values.shape[0], MAX_SHOTS), values.shape[1]
    units = str(data.attrs.get("units", "relative"))
    frames = Frames(values, units, cfa)
    rows, columns = finest_window(values[:shots].sum((0, 1))[..., None], 0.16)
    wide = min(values.shape[3], round((rows.stop - rows.start) * values.shape[3] / values.shape[2]))
    left = min(columns.start, values.shape[3] - wide)
    window = (rows, slice(left, left + wide))
    pairs = channels if channels > 1 else min(2, shots)
    lines = -(-shots * channels // pairs)
    tall = values.shape[2] / values.shape[3]
    side = 10.0 / (2 * pairs)
    figure = new_figure(10.0, min(lines * (side * max(tall, 0.3) + 0.3) + 0.9, 60.0))
    axes = figure.subplots(lines, 2 * pairs, squeeze=False)
    low, high = min(0.0, float(values.min())), float(values.max())
    names = ("red", "green", "blue") if channels == 3 else ("",) * channels
    for i in range(lines * pairs):
        full, near = axes[i // pairs, 2 * (i % pairs)], axes[i // pairs, 2 * (i % pairs) + 1]
        if i >= shots * channels:
            full.set_axis_off()
            near.set_axis_off()
            continue
        shot, channel = divmod(i, channels)
        image = full.imshow(values[shot, channel], cmap="gray", vmin=low, vmax=high if high > low else low + 1)
        picture(full, f"shot {shot + 1}" + (f", {names[channel]}" if names[channel] else ""))
        window_box(full, window, "#FFD400")
        if cfa is not None:
            near.imshow(frame_image(frames, shot)[window])
        else:
            near.imshow(values[shot, channel][window], cmap="gray", vmin=low, vmax=high if high > low else low + 1)
        picture(near, "enlarged" + (", pixel colours" if cfa is not None else ""))
    bar = figure.colorbar(image, ax=axes, location="bottom", aspect=60, shrink=0.6)
    unit = frame_unit(units, str(data.attrs.get("model", "")))
    kind = " ".join(str(data.attrs[k]) for k in ("sensor", "masks", "model") if k in data.attrs)
    rest = f"; first {shots} of {values.shape[0]} shots" if values.shape[0] > shots else ""
    bar.set_label(f"{unit}: {values.min():.4g} to {high:.4g}{rest}")
    figure.suptitle(
        f"{kind}: {values.shape[0]} × {channels} × {values.shape[2]} × {values.shape[3]} (shot, channel, y, x)", fontsize=9, color=MUTED
    )
    return figure
