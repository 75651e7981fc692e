"""Render in independent passes until the error asked for, with progress, checkpoint and resume."""

from __future__ import annotations

import hashlib
import json
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from optsim.render import replicates
from optsim.render.backend import Backend, start, versions
from optsim.render.estimate import band_radiance
from optsim.render.replicates import Replicates
from optsim.render.settings import RenderSettings, film_size
from scenes.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

    from optsim.render.transport import Transport

MIN_PASSES = 4
PILOT_SAMPLES = 8
PASSES_PLANNED = 8
MAX_PATHS_A_PASS = 2**28
"""About ten seconds of a flat scene on two cores: the grain of progress and of what an interruption loses."""
CHECKPOINT_EVERY_S = 10.0

Progress = Callable[[float, float | None], None]
"""Called after each pass with the share of the work done (0 to 1) and the error estimate (None before there is one)."""


@dataclass
class _State:
    """What a render has done so far: one Replicates per light group, and how it goes on."""

    groups: list[Replicates]
    samples: int
    stage: int = 0
    cut: float = 0.0
    spent: int = field(default=0)

    @property
    def passes(self) -> int:
        return self.groups[0].count


def render(
    scene: Scene,
    bands: Bands,
    size: tuple[int, int],
    settings: RenderSettings | None = None,
    progress: Progress | None = None,
    checkpoint: str | Path | None = None,
) -> xr.Dataset:
    """Render a scene to a cube of mean spectral radiance per band.

    Args:
        scene: what to render.
        bands: K bands; they may touch, overlap or leave gaps. The time does not depend on their number.
        size: (height, width) in mirrors; the picture has ``settings.oversample`` samples along each mirror side.
        settings: see :class:`RenderSettings`; default: RMS error 1 % of the picture's mean in every band.
        progress: called after each pass with (share done, current error estimate or None).
        checkpoint: file to save to now and then (and on Ctrl-C) and to resume from; another configuration's is overwritten.

    Returns:
        Dataset with ``radiance`` and ``stderr`` (Monte Carlo standard error of each value, an upper bound in wide bands), dims
        (y, x, wavelength), float32, W m^-2 sr^-1 nm^-1; ``stderr`` is missing with one sample a pixel. Attrs: digest, seed, versions,
        variant, samples_per_pixel, passes, error (estimated) and what the scene needed.

    Raises:
        InputError: ``render.*`` for settings, ``materials.*`` and ``lights[i]`` for spectra that do not cover the bands.
    """
    settings = RenderSettings() if settings is None else settings
    film = film_size(size, settings.oversample)
    backend = start()
    if not backend.vectorised:
        from optsim.render.reference import render_scalar

        return render_scalar(scene, bands, film, settings, progress)
    from optsim.render.transport import Transport

    transport = Transport(scene, bands, film, settings)
    digest = config_digest(scene, bands, film, settings, backend)
    state = _resume(transport, checkpoint, digest)
    if transport.groups:
        _run(transport, settings, state, progress, Path(checkpoint) if checkpoint is not None else None, digest)
    return _finish(transport, bands, film, settings, state, digest, backend)


def _run(transport: Transport, settings: RenderSettings, state: _State, progress: Progress | None, file: Path | None, digest: str) -> None:
    """Add passes to ``state`` until the goal of the settings."""
    saved = time.monotonic()
    try:
        while True:
            done, error = _advance(transport, settings, state)
            if done is not None:
                if progress is not None and state.spent:
                    progress(done, error)
                if done >= 1:
                    break
                if file is not None and time.monotonic() - saved > CHECKPOINT_EVERY_S:
                    _save(state, file, digest)
                    saved = time.monotonic()
            for group, accumulator in enumerate(state.groups):
                sample, cut = transport.trace(group, state.samples, (settings.seed, group, state.stage, state.passes))
                accumulator.add(sample)
                state.cut = max(state.cut, cut)
            state.spent += state.samples
    finally:
        if file is not None and state.passes:
            _save(state, file, digest)


def _advance(transport: Transport, settings: RenderSettings, state: _State) -> tuple[float | None, float | None]:
    """Decide what comes next: returns (share done, error); may set up the next stage in ``state``.

    With an error as goal a pilot of four short passes comes first. If that is not enough, it is set aside, and passes long
    enough to need about eight of them follow: the low-discrepancy points within a pass are worth more the longer it is.
    """
    target = settings.target
    if target is None:
        total = sample_plan(settings.samples_per_pixel or 1, transport.pixels)[0]
        return state.passes / total, transport.error(state.groups) if state.passes > 1 else None
    if state.passes < MIN_PASSES:
        return None if state.passes == 0 else 0.0, None
    error = transport.error(state.groups)
    if error <= target:
        return 1.0, error
    if state.spent >= settings.max_samples:
        warnings.warn(
            f"the render stopped at {state.spent} samples a pixel with an estimated error of {error:.3g} instead of {target:g}; "
            "raise max_samples or accept a larger error",
            RuntimeWarning,
            stacklevel=5,
        )
        return 1.0, error
    if state.stage == 0:
        needed = MIN_PASSES * state.samples * (error / target) ** 2
        longest = max(1, min(MAX_PATHS_A_PASS // transport.pixels, settings.max_samples // MIN_PASSES))
        state.samples = int(np.clip(np.ceil(needed / PASSES_PLANNED), min(PILOT_SAMPLES, longest), longest))
        state.stage, state.spent = 1, 0
        state.groups = transport.empty()
    return min(0.99, (target / error) ** 2), error


def sample_plan(samples: int, pixels: int) -> tuple[int, int]:
    """Split a number of samples a pixel into (passes, samples of a pass): at least 4 passes, none over 2^28 paths in all."""
    passes = max(min(samples, PASSES_PLANNED if samples >= 64 else MIN_PASSES), -(-samples * pixels // MAX_PATHS_A_PASS))
    passes = min(passes, samples)
    return passes, -(-samples // passes)


def _resume(transport: Transport, checkpoint: str | Path | None, digest: str) -> _State:
    settings = transport.settings
    samples = PILOT_SAMPLES if settings.target is not None else sample_plan(settings.samples_per_pixel or 1, transport.pixels)[1]
    state = _State(transport.empty(), min(samples, settings.max_samples // MIN_PASSES) if settings.target is not None else samples)
    kept = replicates.load(Path(checkpoint), digest) if checkpoint is not None else None
    if kept is None:
        return state
    state.samples, state.stage, state.spent = int(kept["samples"]), int(kept["stage"]), int(kept["spent"])
    state.cut = float(kept["cut"])
    for i, group in enumerate(state.groups):
        group.count, group.mean, group.scatter = int(kept["count"]), kept[f"mean_{i}"], kept[f"scatter_{i}"]
    return state


def _save(state: _State, file: Path, digest: str) -> None:
    """Save whole passes only: a group ahead of the others (Ctrl-C between groups) is not saved."""
    if len({group.count for group in state.groups}) > 1:
        return
    arrays = {f"mean_{i}": group.mean for i, group in enumerate(state.groups)} | {
        f"scatter_{i}": group.scatter for i, group in enumerate(state.groups)
    }
    replicates.save(
        file,
        digest,
        {"samples": state.samples, "stage": state.stage, "spent": state.spent, "cut": state.cut, "count": state.passes, **arrays},
    )


def config_digest(scene: Scene, bands: Bands, film: tuple[int, int], settings: RenderSettings, backend: Backend) -> str:
    """Return the SHA-256 of everything that decides the bytes of a render."""
    from optsim.render.canonical import canonical

    told = {
        "scene": canonical(scene),
        "bands": [canonical(x) for x in (bands.lower, bands.upper, bands.center)],
        "film": film,
        "settings": settings.model_dump(),
        "variant": backend.variant,
        "llvm": backend.llvm.version,
        "versions": {name: number for name, number in versions().items() if name in ("optsim", "mitsuba", "drjit", "numpy")},
    }
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _finish(
    transport: Transport, bands: Bands, film: tuple[int, int], settings: RenderSettings, state: _State, digest: str, backend: Backend
) -> xr.Dataset:
    radiance, stderr = band_radiance(state.groups, transport.weights, transport.pixels)
    if not transport.groups:
        radiance = np.zeros((transport.pixels, bands.count), np.float32)
        stderr = np.zeros_like(radiance)
    if not np.all(np.isfinite(radiance)) or (stderr is not None and not np.all(np.isfinite(stderr))):
        raise InputError("lights.spectrum", "radiance that overflows float32", "at most 1e30 W m^-2 sr^-1 nm^-1 in the picture")
    error = transport.error(state.groups) if state.groups and state.passes > 1 else 0.0
    attrs = {
        "title": scene_title(transport.scene),
        "config_digest": digest,
        "seed": settings.seed,
        "variant": backend.variant,
        "llvm_version": backend.llvm.version or "",
        "versions": json.dumps(versions(), sort_keys=True),
        "oversample": settings.oversample,
        "samples_per_pixel": state.passes * state.samples if state.groups else 0,
        "passes": state.passes if state.groups else 0,
        "error": float(error),
        "max_depth": transport.max_depth,
        "cut_share": float(state.cut),
        "transport_nodes": int(transport.nodes.size),
        "integrator": transport.route,
    }
    shape = (*film, bands.count)
    return make_cube(radiance.reshape(shape), bands, None if stderr is None else stderr.reshape(shape), attrs)


def scene_title(scene: Scene) -> str:
    """Return what a cube of this scene is called."""
    return f"radiance of {scene.name}"
