"""Cubes beyond memory: rendered part by part into a sink that keeps them, with the bytes of a render in one piece."""

from __future__ import annotations

import warnings
from typing import Protocol

import numpy as np

from optsim.cube import Bands
from optsim.render.apart import Apart
from optsim.render.backend import start
from optsim.render.cells import NotFlat
from optsim.render.choice import Physics
from optsim.render.estimate import ErrorBars, TileNoise, band_radiance, joined, kept_as
from optsim.render.flat import FlatPicture
from optsim.render.passes import (
    MIN_PASSES,
    Plan,
    Progress,
    Renderable,
    State,
    add_pass,
    allot,
    first_state,
    sample_plan,
    settle,
    warn_if_missed,
)
from optsim.render.picture import Attrs, config_digest, provenance, told_error, transport_of
from optsim.render.settings import RenderSettings, film_size
from optsim.render.tiles import Tiles
from scenes.scene import Scene

MEMORY_BYTES = 2**29
"""What the accumulators of one part may take."""
LIGHT_LEVELS = (1e-15, 1e30)
"""Float32 keeps cubes whose lights lie between these, in W m^-2 sr^-1 nm^-1."""


class CubeSink(Protocol):
    """Take a cube from the top, some rows at a time."""

    def begin(
        self, shape: tuple[int, int, int], bands: Bands, dtype: type[np.floating], stderr: bool, digest: str
    ) -> tuple[int, np.ndarray]:
        """Get ready for a cube of shape (height, width, K).

        Returns:
            how many rows an interrupted render of the same digest has left, and the notes given with the last of them.
        """
        ...

    def rows(self, top: int, radiance: np.ndarray, stderr: np.ndarray | None, notes: np.ndarray) -> None:
        """Keep rows from ``top`` on, (rows, width, K), and the notes in place of earlier ones."""
        ...

    def finish(self, attrs: Attrs) -> None:
        """Keep the attributes and close."""
        ...


def render_to(
    sink: CubeSink,
    scene: Scene,
    bands: Bands,
    size: tuple[int, int],
    settings: RenderSettings | None = None,
    progress: Progress | None = None,
    memory: int = MEMORY_BYTES,
) -> None:
    """Render as :func:`optsim.render.render`, but into a sink, holding only some rows in memory.

    The cube has the same bytes, but for pictures of lights below 1e-15, which are float64 here.

    Args:
        sink: takes the rows; what it kept of an interrupted render is not rendered again.
        scene, bands, size, settings, progress: as of ``render``.
        memory: bytes that the accumulators of one part may take, at least what 32 rows need; 2^20 to 2^40.

    Raises:
        InputError: as ``render``.
    """
    settings = RenderSettings() if settings is None else settings
    film = film_size(size, settings.oversample)
    try:
        _stream_flat(sink, FlatPicture(scene, bands, film, settings), bands, progress)
    except NotFlat:
        task = transport_of(scene, bands, film, settings)
        for sentence in task.needs.warnings if settings.max_depth is None else ():
            warnings.warn(sentence, RuntimeWarning, stacklevel=2)
        _stream_passes(sink, task, bands, progress, memory)


def _stream_flat(sink: CubeSink, task: FlatPicture, bands: Bands, progress: Progress | None) -> None:
    width, digest = task.film[1], config_digest(task, bands)
    sink.begin((*task.film, bands.count), bands, kept_as(task.level), True, digest)
    notes = np.zeros((2, bands.count))
    for strip in task.strips():
        notes += np.stack([np.sum(strip.error**2, 0), np.sum(strip.radiance, 0)])
        radiance, error = (a.reshape(-1, width, bands.count) for a in (strip.radiance, strip.error))
        sink.rows(strip.first_pixel // width, radiance, error, notes)
        if progress is not None:
            progress(min(1.0, (strip.first_pixel + len(strip.error)) / task.pixels), None)
    size, level = np.sqrt(notes[0] / task.pixels), notes[1] / task.pixels
    error = np.divide(size, level, out=np.zeros_like(size), where=level > 0)
    if error.max(initial=0.0) > task.settings.tolerance:
        raise NotFlat("the error asked for is not reached")
    more: Attrs = {"variant": "none", "llvm_version": "none", "samples_per_pixel": 0, "passes": 0, "cut_share": 0.0}
    sink.finish(provenance(task, bands, digest) | more | told_error(np.stack([error, 0 * error, error])))


def _stream_passes(sink: CubeSink, task: Renderable, bands: Bands, progress: Progress | None, memory: int) -> None:
    digest, shape = config_digest(task, bands), (*task.film, bands.count)
    several = task.settings.target is not None or sample_plan(task)[0] > 1
    level = max((float(weights.sum(1).max()) for weights in task.weights), default=0.0)
    dtype = np.float32 if level == 0 or LIGHT_LEVELS[0] < level < LIGHT_LEVELS[1] else np.float64
    done, notes = sink.begin(shape, bands, dtype, several, digest)
    bars, apart, spent = ErrorBars(bands.count), Apart(bands.count), np.zeros(4)  # mean and most paths a pixel, passes, share of light cut
    if done:
        told, other, spent = np.split(notes, [-8 - 2 * bands.count, -4])
        bars, apart = ErrorBars.from_notes(told, bands.count), Apart.from_notes(other, bands.count)
    parts = task.tiles.parts(max(1, memory // (_bytes_a_pixel(task, bands) * task.film[1])))
    plan, begun = _plan(task, parts, progress) if task.settings.target is not None and task.groups else (None, None)
    first = 0
    for part in parts:
        tiles, first = slice(first, first + part.count), first + part.count
        if part.top < done:
            continue
        state = begun or _complete(task, part, None if plan is None else plan.of(tiles))
        radiance, stderr = _values(task, state, bands.count, several)
        if state.groups and stderr is not None:
            bars.add(state.noise(task.weights), stderr, state.groups[0].counts)
        apart.add(task, state, stderr)
        most = int(state.spent_by_tile.max(initial=0))
        share = float(state.spent_by_tile @ part.sizes) / task.pixels
        spent = np.array([spent[0] + share, *np.maximum(spent[1:], [most, state.passes, state.cut])])
        rows = [None if a is None else a.reshape(part.rows, part.width, bands.count) for a in (radiance, stderr)]
        assert rows[0] is not None
        sink.rows(part.top, rows[0], rows[1], np.concatenate([bars.notes(), apart.notes(), spent]))
        if progress is not None:
            progress(part.bottom / task.film[0], float(bars.bounds()[0].max()) if stderr is not None else None)
    _close(sink, task, bands, digest, bars if several else None, apart, spent)


def _close(sink: CubeSink, task: Renderable, bands: Bands, digest: str, bars: ErrorBars | None, apart: Apart, spent: np.ndarray) -> None:
    backend = start()
    attrs = provenance(task, bands, digest) | {"variant": backend.variant, "llvm_version": backend.llvm.version or "none"}
    attrs |= {"samples_per_pixel": round(spent[0]), "passes": int(spent[2]), "cut_share": float(spent[3])}
    bounds = None
    if bars is not None:
        bounds = bars.bounds() if task.groups else np.zeros((3, 1))
        attrs |= told_error(bounds) | ({"samples_per_pixel_most": int(spent[1])} if task.groups else {})
        warn_if_missed(task, float(bounds[0].max()), round(spent[0]))
    sink.finish(attrs | apart.attrs(bounds, task.needs.on(Physics.DISPERSION)))


def _bytes_a_pixel(task: Renderable, bands: Bands) -> int:
    """Return about what one pixel needs while its part is rendered: means, scatter and a pass of every node, values of every band."""
    return 32 * task.nodes.size * max(1, len(task.weights)) + 32 * bands.count


def _plan(task: Renderable, parts: list[Tiles], progress: Progress | None) -> tuple[Plan | None, State | None]:
    """Render the first stage of all parts and share the work among their tiles; no plan when the first stage is enough.

    Of a picture of one part that is complete then, the state comes back; several parts render their short first stage again, as
    memory holds one of them only.
    """
    noises: list[TileNoise] = []
    spent: list[np.ndarray] = []
    for part in parts:
        state = first_state(task, part)
        while state.passes < MIN_PASSES:
            add_pass(task, state)
        noises.append(state.noise(task.weights))
        spent.append(state.spent_by_tile)
        if progress is not None:
            progress(0.0, None)
    noise = joined(noises)
    if noise.errors.max() <= (task.settings.target or 0.0):
        return None, state if len(parts) == 1 else None
    return allot(task, noise, np.concatenate(spent)), None


def _complete(task: Renderable, part: Tiles, plan: Plan | None) -> State:
    """Render one part to its end."""
    state = first_state(task, part)
    if not state.groups:
        return state
    if plan is not None:
        state.plan, state.stage = plan, 1
    passes = MIN_PASSES if task.settings.target is not None else sample_plan(task)[0]
    while state.passes < passes:
        add_pass(task, state)
    while plan is not None:
        state.going = settle(task, state, state.noise(task.weights))
        if not state.going.any():
            break
        add_pass(task, state)
    return state


def _values(task: Renderable, state: State, count: int, several: bool) -> tuple[np.ndarray, np.ndarray | None]:
    if state.groups:
        return band_radiance(state.groups, task.weights, state.part)
    dark = np.zeros((state.part.pixels, count))
    return dark, np.zeros_like(dark) if several else None
