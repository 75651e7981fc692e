"""The sentences of ``explain``: each effect judged from the scene's contents, with the number that decides."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from optsim.cube import Bands
from optsim.render.bounds import (
    blur_diameter,
    border_length,
    centre_error,
    colour_change,
    colour_spread,
    further_light,
    smear_error,
)
from optsim.render.depth import depth_for
from optsim.render.lamps import sky_share
from optsim.render.needs import TYPICAL_NM, Effect, Needs
from optsim.render.spectral import transport_nodes
from scenes.lights import SKIES, AreaLight, DirectionalLight, GradientSky, PointLight
from scenes.materials import Dielectric, Lambertian
from scenes.scene import Scene
from scenes.viewpoint import ThinLens
from scenes.visibility import MAX_PROOF_FACES, face_count, largest_albedo, used_materials

SPARE = 0.1
"""Share of the error asked for that leaving an effect out may cost."""
SKY_MARGIN = 100.0
"""How much more of a picture's light than of the light on the scene's middle may come from the sky: lamps may be hidden, surfaces dark."""
TYPICAL_BANDS = 24
TYPICAL_SAMPLES = 64
"""Paths a pixel for which the noise of leaving out light sampling is stated."""


def effects_of(needs: Needs) -> Iterator[Effect]:
    """Yield the effects in the order of ``EFFECTS``."""
    yield _interreflection(needs)
    yield _emitter_sampling(needs.source)
    yield _dispersion(needs)
    yield _illuminant_factoring(needs)
    yield _spectral_nodes(needs)
    yield _lens_blur(needs)
    yield _sky(needs)


def _interreflection(needs: Needs) -> Effect:
    name, rho = "interreflection", largest_albedo(needs.source)
    if needs.seen is None:
        why = "no reflecting surface can see another" if rho > 0 else "nothing reflects"
        return Effect(name, False, f"{why} (every pair of faces tested): light reflected once is all there is, depth 2 is exact", 0.0)
    bound = further_light(needs.source)
    if bound < needs.error * SPARE:
        text = (
            f"{_who_lights_whom(needs.source, *needs.seen)}, but at most {bound:.2g} of the brightest light is reflected again (by "
            "albedos, sizes and distances): less than a tenth of the error asked for"
        )
        return Effect(name, False, text, bound)
    depth = depth_for(needs.source, False, needs.error)
    beyond = f"what lies beyond is below {rho**depth:.1g}" if rho < 1 else "the albedo sets no end, chance ends paths without bias"
    text = f"{_who_lights_whom(needs.source, *needs.seen)}; {_share(needs)}; largest albedo {rho:.3g}: depth {depth}, {beyond}"
    return Effect(name, True, text, needs.covered.returned)


def _who_lights_whom(scene: Scene, a: str, b: str) -> str:
    if a == b and _is_glass(scene, a):
        return f"{a!r} lets light through"
    faces = face_count(scene)
    if faces > MAX_PROOF_FACES:
        return f"{faces} faces are too many to prove that none sees another (at most {MAX_PROOF_FACES}), so it is taken that they do"
    return f"parts of {a!r} face each other" if a == b else f"{a!r} and {b!r} face each other"


def _share(needs: Needs) -> str:
    if not needs.covered.measured:
        return f"up to {needs.covered.returned:.1%} of the light is given back (too many faces to measure)"
    lands = f"{needs.covered.mean:.0%} of the light that leaves a surface lands on another (by ray casting)"
    return f"{lands}, {needs.covered.returned:.1%} is given back"


def _is_glass(scene: Scene, name: str) -> bool:
    return any(shape.name == name and isinstance(scene.material_of(shape), Dielectric) for shape in scene.shapes)


def _emitter_sampling(scene: Scene) -> Effect:
    name = "emitter_sampling"
    shining = [light for light in scene.lights if light.spectrum.maximum > 0]
    if any(isinstance(light, DirectionalLight | PointLight) for light in shining):
        return Effect(name, True, "a directional or point light is met by no ray that is not aimed at it", 1.0)
    areas = [light for light in shining if isinstance(light, AreaLight)]
    if areas:
        share = min(_share_of_hemisphere(light, scene) for light in areas)
        noise = float(np.sqrt((1 - share) / share / TYPICAL_SAMPLES))
        text = (
            f"an area light fills about {share:.2g} of the hemisphere: paths that meet it by chance have {noise:.3g} relative noise "
            f"at {TYPICAL_SAMPLES} paths a pixel"
        )
        return Effect(name, True, text, noise)
    if shining:
        return Effect(name, False, "the only light is the sky, which every escaping ray meets", 0.0)
    return Effect(name, False, "nothing shines", 0.0)


def _share_of_hemisphere(light: AreaLight, scene: Scene) -> float:
    """Return (area / distance^2) / pi seen from the middle of the shapes, at most 1/2."""
    area = 4 * float(np.linalg.norm(np.cross(light.half_u, light.half_v)))
    box = scene.bounds()
    away = np.subtract(light.center, 0.0 if box is None else box.mean(0))
    return min(0.5, area / (np.pi * max(float(away @ away), area)))


def _dispersion(needs: Needs) -> Effect:
    name = "dispersion"
    glasses = [(key, m) for key, m in used_materials(needs.source).items() if isinstance(m, Dielectric)]
    if not glasses:
        return Effect(name, False, "there is no glass", 0.0)
    spread = {key: np.ptp(m.index_at(TYPICAL_NM)) / (m.index - 1) for key, m in glasses if m.abbe is not None and m.index > 1}
    if not needs.dispersive:
        return Effect(name, False, "the glass has one index for all wavelengths (no Abbe number is given)", 0.0)
    key = max(spread, key=lambda k: spread[k], default="")
    size = float(spread.get(key, 0.0))
    text = f"the glass {key!r} has an Abbe number: from {TYPICAL_NM[0]:g} to {TYPICAL_NM[1]:g} nm its deviation changes by {size:.2%}"
    if size == 0:
        return Effect(name, False, "the glass has the index of air", 0.0)
    return Effect(name, True, f"{text}; wavelengths take paths of their own", size)


def _typical_bands(needs: Needs) -> Bands:
    return Bands.from_edges(np.linspace(*needs.common_range_nm, TYPICAL_BANDS + 1))


def _illuminant_factoring(needs: Needs) -> Effect:
    name, count = "illuminant_factoring", needs.illuminant_count
    size = centre_error(needs.source, _typical_bands(needs))
    at = f"{TYPICAL_BANDS} bands read at their centres would be off by up to {size:.2g}"
    if count == 0:
        return Effect(name, False, "nothing shines", 0.0)
    if size < needs.error * SPARE:
        return Effect(
            name, False, f"{at}, less than a tenth of the error asked for: not required (and done all the same, at no cost)", size
        )
    if count == 1:
        return Effect(
            name,
            True,
            f"all lights share one spectral shape: transport is rendered for unit light and multiplied by it exactly; {at}",
            size,
        )
    return Effect(
        name,
        True,
        f"the lights have {count} spectral shapes: transport is rendered for each apart and multiplied by it exactly; {at}",
        size,
    )


def _spectral_nodes(needs: Needs) -> Effect:
    name = "spectral_nodes"
    low, high = needs.common_range_nm
    nodes = transport_nodes(needs.source, low, high, linear=needs.reflects_once and needs.all_diffuse)
    change = colour_change(needs.source, low, high, 1 if needs.reflects_once else depth_for(needs.source, False, needs.error) - 1)
    if change < needs.error * SPARE:
        text = f"no surface changes its colour by more than {change:.1g} over {low:g} to {high:g} nm: one wavelength tells all"
        return Effect(name, False, f"{text} (rendered at {nodes.size}, at no cost)", change)
    what = f"transport is rendered at {nodes.size} wavelengths for {low:g} to {high:g} nm, whatever the number of bands"
    size = colour_spread(needs.source, low, high)
    if needs.reflects_once and needs.all_diffuse:
        return Effect(name, True, f"{what}: exact, as it is linear between the nodes of the reflectances", size)
    size_between = node_error(needs.source, nodes, needs.covered.mean)
    limit = f"about {size_between:.1g} of the brightest surface" if size_between < 1 else "an amount that has no useful estimate here"
    return Effect(name, True, f"{what}; between them it is read as linear, off by {limit} (an estimate: a bound where light is even)", size)


def node_error(scene: Scene, nodes_nm: np.ndarray, covered: float) -> float:
    """Estimate the error of reading transport as linear between nodes, relative to the brightest surface (theory.md (R.12)).

    With step D and maximum rho of the diffuse reflectances over an interval, and a share c of the light that leaves surfaces landing on
    surfaces: D^2 c / (4 rho (1 - rho c)^3), a bound where c holds for every point. Infinite when rho c reaches 1.
    """
    curves = [s.at(nodes_nm) for m in used_materials(scene).values() if isinstance(m, Lambertian) for s in m.curves]
    if not curves:
        return 0.0
    table = np.array(curves)
    step = np.abs(np.diff(table, axis=1)).max(0)
    rho = np.maximum(table[:, 1:], table[:, :-1]).max(0)
    left = 1 - rho * covered
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.where(rho > 0, step**2 * covered / (4 * rho * left**3), 0.0)
    return float(np.max(np.where(left > 0, bound, np.where(step > 0, np.inf, 0.0)), initial=0.0))


def _lens_blur(needs: Needs) -> Effect:
    view = needs.source.viewpoint
    if not isinstance(view, ThinLens):
        kind = type(view).__name__.lower()
        return Effect("lens_blur", False, f"the scene is seen through a pinhole ({kind} view): all of it is sharp", 0.0)
    wide = blur_diameter(needs.source)
    size = smear_error(wide, border_length(needs.source))
    text = (
        f"the lens of {view.aperture_m:.3g} m radius, sharp at {view.distance_m:.3g} m, blurs by up to {wide:.2g} of the picture's height, "
        f"about {size:.2g} of the light at the borders seen (an estimate)"
    )
    if size < needs.error * SPARE:
        return Effect("lens_blur", False, f"{text}: less than a tenth of the error asked for", size)
    return Effect("lens_blur", True, f"{text}: rays start all over it", size)


def _sky(needs: Needs) -> Effect:
    skies = [light for light in needs.source.lights if isinstance(light, SKIES) and light.spectrum.maximum > 0]
    if not skies:
        return Effect("sky", False, "no light comes from outside: a ray that meets nothing is black", 0.0)
    kind = "a sky that changes with the elevation" if any(isinstance(light, GradientSky) for light in skies) else "a constant sky"
    share = sky_share(needs.source, *needs.common_range_nm)
    if share * SKY_MARGIN < needs.error * SPARE:
        text = f"{kind} sends {share:.2g} of the lamps' light to the scene's middle"
        text = f"{text}, less than a {SKY_MARGIN / SPARE:.0f}th of the error asked for (an estimate: lamps may be hidden)"
        return Effect("sky", False, text, share * SKY_MARGIN)
    return Effect("sky", True, f"{kind} shines from all directions and is what a ray sees that meets nothing", min(1.0, share))
