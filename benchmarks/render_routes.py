"""The ways to render that ``benchmarks.render`` compares: ours, and what Mitsuba's own pieces give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from optsim.cube import Bands
from optsim.render import RenderSettings
from optsim.render.engine import mi
from optsim.render.flat import FlatPicture
from optsim.render.frame import frame_of
from optsim.render.passes import run
from optsim.render.reference import proven_responses, sensor
from optsim.render.shared_path import Parting
from optsim.render.translate import bsdf, load, tabulated
from optsim.render.transport import Transport
from scenes.lights import PointLight
from scenes.materials import Dielectric, Material
from scenes.scene import Scene
from scenes.shapes import Sphere

Render = Callable[[int], np.ndarray]
"""From a seed to (K, pixels) band radiance."""


@dataclass(frozen=True)
class Case:
    """Say what is rendered: scene, bands, (height, width), and the emissions that a path counts."""

    scene: Scene
    bands: Bands
    film: tuple[int, int]
    max_depth: int


def own(case: Case, samples: int, parting: Parting | None = None) -> Render:
    """Render with the sampled route that the scene requires."""
    settings = RenderSettings(samples_per_pixel=samples, max_depth=case.max_depth)
    task = Transport(case.scene, case.bands, case.film, settings, parting)

    def render(seed: int) -> np.ndarray:
        task.settings = settings.model_copy(update={"seed": seed})
        state = run(task, None, None, "")
        return np.asarray(sum(weights @ group.mean for weights, group in zip(task.weights, state.groups)))

    return render


def flat(case: Case) -> Render:
    """Render a flat scene without samples, everything included but reading the scene; there is nothing random."""
    settings = RenderSettings(error=1e-4)

    def render(_: int) -> np.ndarray:
        strips = FlatPicture(case.scene, case.bands, case.film, settings).strips()
        return np.concatenate([strip.radiance for strip in strips]).T

    return render


def film(case: Case, samples: int) -> Render:
    """Render all bands at once with Mitsuba's ``path``, ``specfilm`` and its best sampler, ``multijitter``."""
    engine, camera = _engine(case), _camera(case, case.bands)
    integrator = _integrator(case)

    def render(seed: int) -> np.ndarray:
        return _values(mi.render(engine, integrator=integrator, sensor=camera, spp=samples, seed=mi.UInt32(seed)), case)

    return render


def band_by_band(case: Case, samples: int) -> Render:
    """Render every band with a film of its own, glass with the index of the band's centre: one kernel, made once."""
    engine, integrator = _engine(case), _integrator(case)
    bands = [Bands(*(np.array([x[k]]) for x in (case.bands.lower, case.bands.upper, case.bands.center))) for k in range(case.bands.count)]
    cameras = [_camera(case, band) for band in bands]
    parameters = mi.traverse(engine)
    glasses = [(key, case.scene.materials[_material(case, key)]) for key, _ in parameters if key.endswith("bsdf.eta") and "_" in key]
    glasses = [(key, glass) for key, glass in glasses if isinstance(glass, Dielectric)]

    def render(seed: int) -> np.ndarray:
        found = []
        for k, camera in enumerate(cameras):
            for key, glass in glasses:
                parameters[key] = float(glass.index_at(case.bands.center[k]))
            if glasses:
                parameters.update()
            image = mi.render(engine, integrator=integrator, sensor=camera, spp=samples, seed=mi.UInt32(seed * len(cameras) + k))
            found.append(_values(image, case))
        return np.concatenate(found)

    return render


def with_hidden_glass(scene: Scene) -> Scene:
    """Add a speck of glass where nothing sees it: the scene takes the general route, its picture stays."""
    view = scene.viewpoint
    behind = np.asarray(view.origin) - 10 * view.axes()[2]
    speck = Sphere(name="speck", material="speck", center=tuple(behind), radius=1e-6)
    return scene.model_copy(update={"shapes": (*scene.shapes, speck), "materials": scene.materials | {"speck": Dielectric(index=1.5)}})


def _engine(case: Case) -> Any:
    frame = frame_of(case.scene)
    lights = enumerate(case.scene.lights)
    emission = {i: tabulated(x.spectrum.scaled(1 / frame.unit**2 if isinstance(x, PointLight) else 1.0)) for i, x in lights}

    def surface(material: Material) -> dict[str, Any]:
        return bsdf(material, tabulated)

    return load(case.scene, frame, emission, surface)


def _camera(case: Case, bands: Bands) -> Any:
    made = sensor(case.scene, frame_of(case.scene), case.film, proven_responses(bands))
    return mi.load_dict(made | {"sampler": {"type": "multijitter"}})


def _integrator(case: Case) -> Any:
    return mi.load_dict({"type": "path", "max_depth": case.max_depth, "rr_depth": 5})


def _material(case: Case, key: str) -> str:
    return list(case.scene.materials)[int(key.split("_")[0])]


def _values(image: Any, case: Case) -> np.ndarray:
    return np.ascontiguousarray(np.array(image, np.float64).reshape(case.film[0] * case.film[1], -1).T)
