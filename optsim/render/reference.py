"""Mitsuba's own spectral film and path tracer: the judge of the integrators here, and the way out without LLVM.

The film samples four wavelengths a ray over all bands, so K bands have about K / 4 times the variance of a shared path. Its
table of wavelengths goes wrong when touching bands of equal height leave nodes that differ by rounding only (Mitsuba 3.9.1: bands
off by -58 % to +53 %); bands widened by 1e-3 to 0.1 nm avoid that, and every use starts with a test against radiance 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.cube import Bands
from optsim.errors import InputError
from optsim.render.choice import Physics
from optsim.render.engine import BACKEND, mi
from optsim.render.frame import Frame, camera_rays, frame_of
from optsim.render.needs import explain
from optsim.render.replicates import Replicates
from optsim.render.sampling import seed_words
from optsim.render.settings import RenderSettings
from optsim.render.spectral import light_groups
from optsim.render.textures import taken_apart
from optsim.render.tiles import Samples, Tiles, Traced
from optsim.render.translate import bsdf, load, tabulated, uniform
from scenes.lights import GradientSky, PointLight
from scenes.materials import Material
from scenes.scene import Scene
from scenes.spectrum import Spectrum
from scenes.viewpoint import Orthographic, Perspective, ThinLens

WIDENED_NM = (1e-3, 3e-2, 1e-1)
"""Widenings of the bands that are tried in turn; which of them avoids the film's fault depends on the rounding of the bands' edges."""
SELF_TEST_SIDE, SELF_TEST_SAMPLES = 64, 256
SELF_TEST_TOLERANCE = 0.01
MAX_PATHS_A_CALL = 2**32 - 1


class FilmTransport:
    """Render with Mitsuba's ``path`` and ``specfilm``; same interface as :class:`optsim.render.transport.Transport`.

    As judge the film's bands are the bands asked for, and all lights shine together with their own spectra. As substitute
    (``through_nodes``) each light group shines with unit light on cells round the transport nodes, so that the time does not depend on
    the number of bands; cell means give node values exactly where transport is linear between nodes (theory.md (R.31)).

    Args:
        scene: what to render.
        bands: K bands.
        film: (height, width) in samples.
        settings: as of the render.
        through_nodes: see above.

    Raises:
        InputError: ``materials`` for glass with an Abbe number, which Mitsuba cannot disperse; as ``Transport`` for spectra that do not
            cover the bands; ``bands`` when the film fails its self-test.
    """

    def __init__(self, scene: Scene, bands: Bands, film: tuple[int, int], settings: RenderSettings, through_nodes: bool = False) -> None:
        if any(isinstance(light, GradientSky) for light in scene.lights):
            raise InputError("lights", "a gradient sky", "a constant sky for Mitsuba's film; or install LLVM")
        scene = taken_apart(scene)
        self.scene, self.film, self.settings = scene, film, settings
        self.pixels = film[0] * film[1]
        self.needs = explain(scene, settings.tolerance, settings.choices)
        scene = self.needs.modelled
        if self.needs.on(Physics.DISPERSION):
            allowed = (
                f"of glass without an Abbe number: Mitsuba's film ({BACKEND.variant}) does not disperse; set abbe to None or install LLVM"
            )
            raise InputError("materials", "glass with an Abbe number", allowed)
        self.max_depth = settings.max_depth or self.needs.max_depth
        low, high = float(bands.lower.min()), float(bands.upper.max())
        frame = frame_of(scene)
        nodes = self.needs.nodes_nm(bands)
        self.groups = light_groups(scene, low, high, frame.unit)
        emissions, own = [], bands
        if through_nodes:
            own, to_nodes = node_cells(nodes)
            self.weights = [self.needs.weights(group, nodes, bands) @ to_nodes for group in self.groups]
            emissions = [{i: uniform(s) for i, s in zip(g.lights, g.strengths)} for g in self.groups]
        elif self.groups:
            scale = max(group.spectrum.maximum for group in self.groups)
            self.weights, self.groups = [scale * np.eye(bands.count)], self.groups[:1]
            emissions = [_emission(scene, frame, scale)]
        else:
            self.weights = []
        self.nodes = own.center
        self.route = "Mitsuba path and specfilm" + (" at nodes" if through_nodes else "")
        responses = proven_responses(own) if emissions else {}

        def surface(material: Material) -> dict[str, Any]:
            return bsdf(material, tabulated)

        self._scenes = [load(scene, frame, emission, surface, sensor(scene, frame, film, responses)) for emission in emissions]
        self._integrator = mi.load_dict({"type": "path", "max_depth": self.max_depth, "rr_depth": 5})

    @property
    def tiles(self) -> Tiles:
        """Return the whole picture as one tile: the film renders no parts."""
        return Tiles(self.film, side=0)

    def empty(self, part: Tiles) -> list[Replicates]:
        """Return fresh accumulators."""
        return [Replicates((self.nodes.size, part.pixels), weights, part) for weights in self.weights]

    def trace(self, group: int, samples: Samples, key: tuple[int, ...]) -> Traced:
        """Render one pass of a group: (film bands, pixels) mean radiance; calls of over 2^32 paths are split."""
        longest, wanted = max(1, MAX_PATHS_A_CALL // self.pixels), int(samples.counts.max())
        total = np.zeros((self.pixels, self.nodes.size))
        for part, start in enumerate(range(0, wanted, longest)):
            count = min(longest, wanted - start)
            image = mi.render(self._scenes[group], integrator=self._integrator, spp=count, seed=mi.UInt32(seed_words(*key, part)[0]))
            total += np.array(image, np.float64).reshape(total.shape) * count
        return Traced(np.ascontiguousarray(total.T) / wanted, 0.0, np.zeros((0, self.pixels)))


def node_cells(nodes_nm: np.ndarray) -> tuple[Bands, np.ndarray]:
    """Return touching cells round the nodes and the (n, n) matrix that takes cell means to node values (theory.md (R.31))."""
    edges = np.concatenate([nodes_nm[:1], (nodes_nm[1:] + nodes_nm[:-1]) / 2, nodes_nm[-1:]])
    cells = Bands(edges[:-1], edges[1:], (edges[:-1] + edges[1:]) / 2)
    means = Spectrum.constant(1.0, float(nodes_nm[0]), float(nodes_nm[-1])).hat_weights(nodes_nm, cells.lower, cells.upper)
    return cells, np.linalg.inv(means)


def _emission(scene: Scene, frame: Frame, scale: float) -> dict[int, dict[str, Any]]:
    found = {}
    for i, light in enumerate(scene.lights):
        unit = frame.unit**2 if isinstance(light, PointLight) else 1.0
        if light.spectrum.maximum > 0:
            found[i] = tabulated(light.spectrum.scaled(1 / scale / unit))
    return found


def proven_responses(bands: Bands) -> dict[str, dict[str, Any]]:
    """Return box responses that pass the self-test, widened as little as it takes.

    Raises:
        InputError: ``bands`` when none passes.
    """
    allowed = [w for w in WIDENED_NM if w == WIDENED_NM[0] or w <= 0.05 * bands.width.min()]
    for widened in allowed:
        responses = box_responses(bands, widened)
        try:
            self_test(responses)
            return responses
        except InputError:
            if widened == allowed[-1]:
                raise
    raise AssertionError("unreachable: the last widening returns or raises")


def box_responses(bands: Bands, widened_nm: float) -> dict[str, dict[str, Any]]:
    """Return one box response per band, widened by so much in all, of integral 1: a pixel is then the mean over the band."""
    responses = {}
    for k, (low, high) in enumerate(zip(bands.lower, bands.upper)):
        low, high = low - widened_nm / 2, high + widened_nm / 2
        height = repr(float(1 / (high - low)))
        box = {"type": "regular", "wavelength_min": float(low), "wavelength_max": float(high), "values": f"{height},{height}"}
        responses[f"band{k:05d}"] = box
    return responses


def film_of(size: tuple[int, int], responses: dict[str, Any]) -> dict[str, Any]:
    """Return Mitsuba's spectral film of (height, width) pixels with an exact box filter."""
    box = {"type": "box"}
    return {"type": "specfilm", "height": size[0], "width": size[1], "component_format": "float32", "rfilter": box, **responses}


def sensor(scene: Scene, frame: Frame, size: tuple[int, int], responses: dict[str, Any]) -> dict[str, Any]:
    """Return Mitsuba's camera for the scene's viewpoint, its clip planes set by the scene."""
    view = scene.viewpoint
    rays = camera_rays(scene, frame, *size)
    eye = frame.to_units(np.asarray(view.origin))
    corners = scene.bounds()
    far = 1e4 if corners is None else 4 * float(np.abs(frame.to_units(corners) - eye).max()) + 4
    shift = float(np.linalg.norm(rays.start - eye))
    common = {
        "near_clip": max(1e-4, shift / 2),
        "far_clip": max(far, 10.0),
        "film": film_of(size, responses),
        "sampler": {"type": "independent"},
    }
    target = eye + view.axes()[2]
    aim = mi.ScalarTransform4f().look_at(eye.tolist(), target.tolist(), list(view.up))
    if isinstance(view, Orthographic):
        half_width = view.half_height / frame.unit * size[1] / size[0]
        start = mi.ScalarTransform4f().look_at(rays.start.tolist(), (rays.start + view.axes()[2]).tolist(), list(view.up))
        scale = mi.ScalarTransform4f().scale([half_width, half_width, 1])
        return {"type": "orthographic", "to_world": start @ scale, **common, "near_clip": 1e-4}
    assert isinstance(view, Perspective | ThinLens)
    if isinstance(view, ThinLens):
        lens = {"aperture_radius": view.aperture_m / frame.unit, "focus_distance": view.distance_m / frame.unit}
        return {"type": "thinlens", "to_world": aim, "fov": view.fov_deg, "fov_axis": "y", **lens, **common}
    return {"type": "perspective", "to_world": aim, "fov": view.fov_deg, "fov_axis": "y", **common}


def self_test(responses: dict[str, Any]) -> None:
    """Render a sky of radiance 1 and check every band.

    Raises:
        InputError: ``bands`` when a band is off by more than 1 % and 5 standard errors.
    """
    side, samples = SELF_TEST_SIDE, SELF_TEST_SAMPLES
    camera = {"type": "orthographic", "film": film_of((side, side), responses), "sampler": {"type": "independent"}}
    engine = mi.load_dict({"type": "scene", "sky": {"type": "constant", "radiance": uniform(1.0)}, "sensor": camera})
    image = np.array(mi.render(engine, integrator=mi.load_dict({"type": "path", "max_depth": 1}), spp=samples), np.float64)
    values = image.reshape(side * side, -1)
    mean, stderr = values.mean(0), values.std(0, ddof=1) / side
    wrong = np.abs(mean - 1) > np.maximum(SELF_TEST_TOLERANCE, 5 * stderr)
    if np.any(wrong):
        k = int(np.argmax(wrong))
        raise InputError("bands", mean.tolist(), f"rendered as radiance 1 within 1 % by Mitsuba's spectral film; band {k} is not")
