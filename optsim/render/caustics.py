"""Light that no path can find: from a point or one direction, by way of polished glass or metal, to a surface."""

from __future__ import annotations

from scenes.lights import DirectionalLight, PointLight
from scenes.materials import Conductor, Dielectric
from scenes.scene import Scene
from scenes.visibility import used_materials

POLISHED = (Dielectric, Conductor)
"""Materials that send a ray on in single directions, so that none can be aimed at a light through them."""


def missing_caustics(scene: Scene) -> tuple[str, ...]:
    """Return a sentence on the lights whose way through glass, or off a mirror, is left out; empty when there are none."""
    lights = [f"lights[{i}]" for i, light in enumerate(scene.lights) if isinstance(light, PointLight | DirectionalLight)]
    materials = [repr(name) for name, material in used_materials(scene).items() if isinstance(material, POLISHED)]
    if not (lights and materials):
        return ()
    return (
        f"{', '.join(lights)}: light of no size; what it sends to a surface by way of {', '.join(materials)} (caustics, the light in a "
        "glass's shadow) is missing, as no path can meet it by chance, and the error told does not know of it; an area light has a size",
    )
