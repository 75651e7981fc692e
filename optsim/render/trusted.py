"""Scenes in Mitsuba's own format, rendered as they are by Mitsuba's path tracer and spectral film: only for files one trusts.

Mitsuba's XML and dictionaries name plugins and files at will; nothing here checks them. No effect is decided: all that the file holds
is rendered.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from optsim.render.backend import versions
from optsim.render.canonical import canonical
from optsim.render.engine import BACKEND, mi
from optsim.render.estimate import ErrorBars, band_radiance
from optsim.render.passes import Progress, run
from optsim.render.picture import told_error
from optsim.render.reference import film_of, proven_responses
from optsim.render.replicates import Replicates
from optsim.render.sampling import seed_words
from optsim.render.settings import RenderSettings, film_size
from optsim.render.tiles import Samples, Tiles, Traced

if TYPE_CHECKING:
    import xarray as xr

SENSORS = ("perspective", "thinlens", "orthographic", "radiancemeter", "irradiancemeter", "distant", "batch")


@dataclass(frozen=True)
class OneBounceUnknown:
    """Stand where other renders know what a scene needs: nothing is known."""

    reflects_once: bool = False


class TrustedTransport:
    """Hold a Mitsuba scene with a film of our bands; a :class:`optsim.render.passes.Renderable` without a scene of ours.

    Args:
        source: an XML file, or a dictionary as of ``mitsuba.load_dict``.
        bands: K bands.
        film: (height, width) in samples.
        settings: as of the render; the scene's own sample count, film, sampler and integrator are not used.

    Raises:
        InputError: ``scene`` when it has no sensor or cannot be loaded; ``render.force`` or ``render.without`` when effects are chosen.
    """

    route = "trusted Mitsuba scene: path and specfilm"

    def __init__(self, source: Path | dict[str, Any], bands: Bands, film: tuple[int, int], settings: RenderSettings) -> None:
        if settings.force or settings.without:
            raise InputError("render.force", "an effect", "left out for a Mitsuba scene, of which all is rendered as it stands")
        self.film, self.settings, self.needs = film, settings, OneBounceUnknown()
        self.pixels, self.nodes, self.weights = film[0] * film[1], bands.center, [np.eye(bands.count)]
        self.groups = (0,)
        self.max_depth = -1 if settings.max_depth is None else settings.max_depth
        own = film_of(film, proven_responses(bands))
        self._scene = _from_file(source, own) if isinstance(source, Path) else _from_dict(source, own)
        self._integrator = mi.load_dict({"type": "path", "max_depth": self.max_depth, "rr_depth": 5})

    @property
    def tiles(self) -> Tiles:
        """Return the whole picture as one tile."""
        return Tiles(self.film, side=0)

    def empty(self, part: Tiles) -> list[Replicates]:
        """Return a fresh accumulator."""
        return [Replicates((self.nodes.size, part.pixels), self.weights[0], part)]

    def trace(self, group: int, samples: Samples, key: tuple[int, ...]) -> Traced:
        """Render one pass: (K, pixels) mean radiance."""
        count = int(samples.counts.max())
        image = mi.render(self._scene, integrator=self._integrator, spp=count, seed=mi.UInt32(seed_words(*key, 0)[0]))
        values = np.ascontiguousarray(np.array(image, np.float64).reshape(self.pixels, -1).T)
        return Traced(values, 0.0, np.zeros((0, self.pixels)))


def render_trusted(
    source: Path | dict[str, Any],
    bands: Bands,
    size: tuple[int, int],
    settings: RenderSettings | None = None,
    progress: Progress | None = None,
    checkpoint: str | Path | None = None,
) -> xr.Dataset:
    """Render a Mitsuba scene that is trusted: it may load any plugin and read any file.

    Args:
        source: an XML file, or a dictionary as of ``mitsuba.load_dict``.
        bands, size, settings, progress, checkpoint: as of :func:`optsim.render.render`; lights and surfaces are Mitsuba's, per nm. Files
            that the scene reads are not compared when a checkpoint is gone on from, only its own text.

    Returns:
        a cube as of :func:`optsim.render.render`.

    Raises:
        InputError: as :class:`TrustedTransport`; ``render.*`` for settings.
    """
    settings = RenderSettings() if settings is None else settings
    film = film_size(size, settings.oversample)
    task = TrustedTransport(source, bands, film, settings)
    text = source.read_text("utf-8") if isinstance(source, Path) else repr(source)
    attrs: dict[str, str | int | float] = {
        "title": f"radiance of {source.stem if isinstance(source, Path) else 'a Mitsuba dictionary'}",
        "scene_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "seed": settings.seed,
        "versions": json.dumps(versions(), sort_keys=True),
        "oversample": settings.oversample,
        "integrator": task.route,
        "max_depth": task.max_depth,
        "effects": "{}",
        "variant": BACKEND.variant,
    }
    told = [attrs, film, settings.model_dump(), [canonical(x) for x in (bands.lower, bands.upper, bands.center)]]
    attrs["config_digest"] = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
    file = None if checkpoint is None else Path(checkpoint)
    state = run(task, progress, file, attrs["config_digest"])  # type: ignore[arg-type]  # of what a Renderable has, run needs no scene
    radiance, stderr = band_radiance(state.groups, task.weights, state.part)
    if not np.all(np.isfinite(radiance)):
        raise RuntimeError("the scene gives radiance that is not finite")
    attrs |= {"samples_per_pixel": state.spent, "passes": state.passes}
    if stderr is not None:
        bars = ErrorBars(bands.count)
        bars.add(state.noise(task.weights), stderr, state.groups[0].counts)
        attrs |= told_error(bars.bounds())
    shape = (*film, bands.count)
    return make_cube(radiance.reshape(shape), bands, None if stderr is None else stderr.reshape(shape), attrs)


def _from_file(path: Path, film: dict[str, Any]) -> Any:
    try:
        root = ElementTree.fromstring(path.read_text("utf-8"))
    except (OSError, ElementTree.ParseError, UnicodeDecodeError) as error:
        raise InputError("scene", str(path), f"a readable XML file of Mitsuba's: {error}") from None
    sensor = root.find("sensor")
    if sensor is None:
        raise InputError("scene", str(path), "a Mitsuba scene with a <sensor> of its own")
    for child in [c for c in sensor if c.tag in ("film", "sampler")]:
        sensor.remove(child)
    sensor.append(_element("film", film))
    resolver = mi.file_resolver()  # type: ignore[operator]  # Mitsuba declares it as an object
    resolver.prepend(str(path.resolve().parent))
    try:
        return mi.load_string(ElementTree.tostring(root, encoding="unicode"))
    except RuntimeError as error:
        raise InputError("scene", str(path), f"a scene that Mitsuba loads: {str(error).strip()}") from None


def _element(tag: str, plugin: dict[str, Any], name: str = "") -> ElementTree.Element:
    """Write a plugin's dictionary as XML."""
    made = ElementTree.Element(tag, {"type": plugin["type"]} | ({"name": name} if name else {}))
    for key, value in plugin.items():
        if isinstance(value, dict):
            made.append(_element("rfilter" if key == "rfilter" else "spectrum", value, key))
        elif key != "type":
            kind = {int: "integer", float: "float", str: "string"}[type(value)]
            ElementTree.SubElement(made, kind, {"name": key, "value": str(value)})
    return made


def _from_dict(scene: dict[str, Any], film: dict[str, Any]) -> Any:
    names = [key for key, value in scene.items() if isinstance(value, dict) and value.get("type") in SENSORS]
    if not names:
        raise InputError("scene", sorted(scene), f"a Mitsuba dictionary with a sensor, one of {', '.join(SENSORS)}")
    camera = {key: value for key, value in scene[names[0]].items() if not isinstance(value, dict)}
    try:
        return mi.load_dict(scene | {names[0]: camera | {"film": film, "sampler": {"type": "independent"}}})
    except RuntimeError as error:
        raise InputError("scene", names, f"a scene that Mitsuba loads: {str(error).strip()}") from None
