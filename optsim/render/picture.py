"""The verb: scene and bands to a radiance cube with its standard error and its provenance."""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.cube import Bands, make_cube
from optsim.render.apart import Apart
from optsim.render.backend import start, versions
from optsim.render.canonical import canonical
from optsim.render.cells import NotFlat
from optsim.render.choice import Physics
from optsim.render.estimate import ErrorBars, band_radiance, kept_as, relative_bound
from optsim.render.flat import FlatPicture
from optsim.render.lamps import light_of
from optsim.render.passes import Progress, Renderable, State, run
from optsim.render.settings import RenderSettings, film_size
from scenes.scene import Scene

if TYPE_CHECKING:
    import xarray as xr


Attrs = dict[str, str | int | float]
"""Attributes of a cube."""


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
        Dataset with ``radiance`` and ``stderr`` (Monte Carlo standard error of each value, an upper bound in wide bands; of flat
        scenes rendered without samples a bound of the error), dims (y, x, wavelength), W m^-2 sr^-1 nm^-1, float32 (float64 where
        float32 has no such numbers); ``stderr`` is missing with one sample a pixel. Attrs: config_digest, seed, versions, variant,
        integrator, max_depth, cut_share (upper bound of the share of light cut off there), transport_nodes; samples_per_pixel (mean over
        the picture, 0 without samples), samples_per_pixel_most, passes; error (relative RMS error in the worst band), error_low and
        error_high (95 % interval of the error made), error_by_band (JSON): the errors are missing with one sample a pixel. With glass,
        metal or plastic caustic_share (of the light: came to a surface that scatters by way of glass or mirrors; its noise is told by
        the error only as far as samples have met it); with dispersing glass dispersed_share (of the pixels: show it), error_dispersed and
        error_elsewhere (RMS over these and over the other pixels, relative to the whole picture's mean).

    Raises:
        InputError: ``render.*`` for settings, ``materials.*`` and ``lights[i]`` for spectra that do not cover the bands.
    """
    flat = _without_samples(scene, bands, size, settings, progress)
    if flat is not None:
        return flat
    return picture(transport_of, scene, bands, size, settings, progress, checkpoint)


def transport_of(scene: Scene, bands: Bands, film: tuple[int, int], settings: RenderSettings) -> Renderable:
    """Set up a scene for the renderer that this machine has."""
    if start().vectorised:
        from optsim.render.transport import Transport

        return Transport(scene, bands, film, settings)
    from optsim.render.reference import FilmTransport

    return FilmTransport(scene, bands, film, settings, through_nodes=True)


def _without_samples(
    scene: Scene, bands: Bands, size: tuple[int, int], settings: RenderSettings | None, progress: Progress | None
) -> xr.Dataset | None:
    """Render a flat diffuse scene in closed form; None when the scene, or what is asked of it, needs samples."""
    settings = RenderSettings() if settings is None else settings
    film = film_size(size, settings.oversample)
    try:
        task = FlatPicture(scene, bands, film, settings)
        dtype = kept_as(task.level)
        radiance, bound = np.empty((task.pixels, bands.count), dtype), np.empty((task.pixels, bands.count), dtype)
        for strip in task.strips():
            here = slice(strip.first_pixel, strip.first_pixel + len(strip.radiance))
            radiance[here], bound[here] = strip.radiance, strip.error
            if progress is not None:
                progress(here.stop / task.pixels, None)
    except NotFlat:
        return None
    error = relative_bound(radiance, bound)
    if error.max(initial=0.0) > settings.tolerance:
        return None
    attrs = provenance(task, bands, config_digest(task, bands)) | {"variant": "none", "llvm_version": "none"}
    attrs |= {"samples_per_pixel": 0, "passes": 0, "cut_share": 0.0} | told_error(np.stack([error, 0 * error, error]))
    return _checked(task, bands, radiance, bound, attrs)


def render_with_film(
    scene: Scene,
    bands: Bands,
    size: tuple[int, int],
    settings: RenderSettings | None = None,
    progress: Progress | None = None,
    checkpoint: str | Path | None = None,
) -> xr.Dataset:
    """Render with Mitsuba's own path tracer and spectral film, band by band as they are asked for: the judge of :func:`render`.

    Arguments, result and errors as of :func:`render`; glass with an Abbe number is refused.
    """
    from optsim.render.reference import FilmTransport

    return picture(FilmTransport, scene, bands, size, settings, progress, checkpoint)


def picture(
    route: Callable[[Scene, Bands, tuple[int, int], RenderSettings], Renderable],
    scene: Scene,
    bands: Bands,
    size: tuple[int, int],
    settings: RenderSettings | None,
    progress: Progress | None,
    checkpoint: str | Path | None,
) -> xr.Dataset:
    """Render by a given route; see :func:`render`."""
    settings = RenderSettings() if settings is None else settings
    film = film_size(size, settings.oversample)
    task = route(scene, bands, film, settings)
    for sentence in task.needs.warnings if settings.max_depth is None else task.needs.material_warnings:
        warnings.warn(sentence, RuntimeWarning, stacklevel=3)
    digest = config_digest(task, bands)
    state = run(task, progress, Path(checkpoint) if checkpoint is not None else None, digest)
    if settings.max_depth is None and Physics.INTERREFLECTION not in settings.without and state.cut > settings.tolerance / 10:
        warnings.warn(
            f"up to {state.cut:.2g} of the light was cut off after {task.max_depth} emissions; set max_depth to follow paths further",
            RuntimeWarning,
            stacklevel=3,
        )
    return _cube(task, bands, state, digest)


def config_digest(task: Renderable | FlatPicture, bands: Bands) -> str:
    """Return the SHA-256 of everything that decides the bytes of a render."""
    told = {
        "scene": canonical(task.scene),
        "bands": [canonical(x) for x in (bands.lower, bands.upper, bands.center)],
        "film": task.film,
        "settings": task.settings.model_dump(),
        "route": task.route,
        "versions": {name: number for name, number in versions().items() if name in ("optsim", "mitsuba", "drjit", "numpy")},
    }
    if not isinstance(task, FlatPicture):
        backend = start()
        told |= {"variant": backend.variant, "llvm": backend.llvm.version}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def provenance(task: Renderable | FlatPicture, bands: Bands, digest: str) -> Attrs:
    """Return the attributes that tell where a cube comes from."""
    return {
        "title": f"radiance of {task.scene.name}",
        "config_digest": digest,
        "seed": task.settings.seed,
        "versions": json.dumps(versions(), sort_keys=True),
        "oversample": task.settings.oversample,
        "integrator": task.route,
        "max_depth": task.max_depth,
        "transport_nodes": int(task.nodes.size),
        "effects": json.dumps({row.pop("name"): row for row in task.needs.as_dict()["effects"]}),
        "illuminant": json.dumps(light_of(task.needs.modelled, bands, task.film[1] / task.film[0])),
    }


def _cube(task: Renderable, bands: Bands, state: State, digest: str) -> xr.Dataset:
    backend = start()
    attrs = provenance(task, bands, digest) | {
        "variant": backend.variant,
        "llvm_version": backend.llvm.version or "none",
        "samples_per_pixel": state.spent,
        "passes": state.passes,
        "cut_share": float(state.cut),
    }
    shape = (task.pixels, bands.count)
    if not state.groups:
        return _checked(task, bands, np.zeros(shape, np.float32), np.zeros(shape, np.float32), attrs | told_error(np.zeros((3, 1))))
    radiance, stderr = band_radiance(state.groups, task.weights, state.part)
    bounds = None
    if stderr is not None:
        bars = ErrorBars(bands.count)
        bars.add(state.noise(task.weights), stderr, state.groups[0].counts)
        bounds = bars.bounds()
        attrs |= told_error(bounds) | {"samples_per_pixel_most": int(state.spent_by_tile.max())}
    apart = Apart(bands.count)
    apart.add(task, state, stderr)
    attrs |= apart.attrs(bounds, task.needs.on(Physics.DISPERSION))
    dtype = kept_as(float(radiance.mean(0).max()))
    return _checked(task, bands, radiance.astype(dtype), None if stderr is None else stderr.astype(dtype), attrs)


def told_error(bounds: np.ndarray) -> Attrs:
    """Return the attributes that tell the error: of the worst band, with its 95 % interval, and of every band as JSON.

    Args:
        bounds: (3, K) error and ends of its interval, each relative to the band's mean.
    """
    worst = int(np.argmax(bounds[0]))
    error, low, high = (float(x) for x in bounds[:, worst])
    rows = {name: [float(f"{x:.4g}") for x in row] for name, row in zip(("error", "low", "high"), bounds)}
    return {"error": error, "error_low": low, "error_high": high, "error_by_band": json.dumps(rows)}


def _checked(task: Renderable | FlatPicture, bands: Bands, radiance: np.ndarray, stderr: np.ndarray | None, attrs: Attrs) -> xr.Dataset:
    for values in (radiance, stderr):
        if values is not None and not np.all(np.isfinite(values)):
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(values))[0])
            raise RuntimeError(f"the renderer made a value that is not finite, first at (pixel, band) {where}: a fault of the renderer")
    shape = (*task.film, bands.count)
    return make_cube(radiance.reshape(shape), bands, None if stderr is None else stderr.reshape(shape), attrs)
