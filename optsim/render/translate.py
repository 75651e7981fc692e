"""Scene -> Mitsuba: geometry in renderer units, lights of one spectral shape, every spectrum a table.

Spectra are never handed over as bare numbers or RGB: Mitsuba reads those as multiples of D65. Light is `uniform` (the illuminant's
shape is applied afterwards); where Mitsuba itself evaluates materials, wavelengths are node NUMBERS, so that its tables
are regular whatever the nodes are, and exact at each node.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from optsim.errors import InputError
from optsim.render.engine import dr, mi
from optsim.render.frame import Frame
from scenes.lights import SKIES, AreaLight, DirectionalLight, Light, PointLight
from scenes.materials import Conductor, Dielectric, Diffuse, Material, RoughPlastic
from scenes.scene import Scene
from scenes.shapes import Mesh, Shape
from scenes.spectrum import Spectrum
from scenes.textures import Textured

SpectrumDict = Callable[[Spectrum], dict[str, Any]]


def uniform(value: float) -> dict[str, Any]:
    """Return Mitsuba's spectrum that has one value at every wavelength."""
    return {"type": "uniform", "value": float(value)}


def at_nodes(nodes_nm: np.ndarray) -> SpectrumDict:
    """Return a translator of spectra to tables over node numbers 0 to n - 1 (kept away from 0 by NODE_OFFSET)."""

    def table(spectrum: Spectrum) -> dict[str, Any]:
        return regular(NODE_OFFSET, NODE_OFFSET + nodes_nm.size - 1, spectrum.at(nodes_nm))

    return table


NODE_OFFSET = 400.0
"""Node i is passed to Mitsuba as the wavelength NODE_OFFSET + i."""


def regular(low: float, high: float, values: np.ndarray) -> dict[str, Any]:
    """Return Mitsuba's table of equidistant values; an all-dark one becomes `uniform` (the table would be refused)."""
    if not np.any(values):
        return uniform(0.0)
    text = ",".join(repr(float(v)) for v in values)
    return {"type": "regular", "wavelength_min": float(low), "wavelength_max": float(high), "values": text}


def tabulated(spectrum: Spectrum) -> dict[str, Any]:
    """Return Mitsuba's table of a spectrum over true wavelengths in nm."""
    grid, value = spectrum.wavelength_nm, spectrum.value
    steps = np.diff(grid)
    if np.all(np.abs(steps - steps[0]) < 1e-6 * steps[0]):
        return regular(grid[0], grid[-1], value)
    if not np.any(value):
        return uniform(0.0)
    return {
        "type": "irregular",
        "wavelengths": ",".join(repr(float(x)) for x in grid),
        "values": ",".join(repr(float(v)) for v in value),
    }


def bsdf(material: Material, spectrum: SpectrumDict) -> dict[str, Any]:
    """Return Mitsuba's BSDF of a material.

    Raises:
        InputError: ``materials`` for glass with an Abbe number, whose index is one number to Mitsuba (see dispersive.py).
    """
    if isinstance(material, Diffuse):
        return {"type": "diffuse", "reflectance": spectrum(material.reflectance)}
    if isinstance(material, RoughPlastic):
        return {
            "type": "roughplastic",
            "distribution": "ggx",
            "alpha": material.roughness,
            "int_ior": material.index,
            "ext_ior": 1.0,
            "nonlinear": True,
            "diffuse_reflectance": spectrum(material.reflectance),
            "specular_reflectance": uniform(1.0),
        }
    if isinstance(material, Conductor):
        return {"type": "conductor", "eta": spectrum(material.eta), "k": spectrum(material.k), "specular_reflectance": uniform(1.0)}
    if isinstance(material, Dielectric):
        one = uniform(1.0)
        return {"type": "dielectric", "int_ior": material.index, "ext_ior": 1.0, "specular_reflectance": one, "specular_transmittance": one}
    raise InputError("materials", type(material).__name__, "a material that the renderer knows")


def plain(_: Material) -> dict[str, Any]:
    """Return the BSDF of a surface whose material the integrator reads from its own table."""
    return {"type": "diffuse", "reflectance": uniform(0.5)}


def load(
    scene: Scene,
    frame: Frame,
    strengths: dict[int, dict[str, Any]],
    surface: Callable[[Material], dict[str, Any]],
    sensor: dict[str, Any] | None = None,
) -> Any:
    """Build the Mitsuba scene.

    Args:
        scene: what to build.
        frame: renderer coordinates.
        strengths: emission by index of light, as Mitsuba spectra in renderer units; an area light that is missing is there, but dark.
        surface: translator of materials to Mitsuba's BSDFs.
        sensor: Mitsuba's sensor, or None.

    Returns:
        ``mi.Scene`` whose shapes' ids are ``NUMBER_...`` with NUMBER the place of the material in ``scene.materials``, or ``light_...``.
    """
    d: dict[str, Any] = {"type": "scene"}
    for number, (name, material) in enumerate(scene.materials.items()):
        own = surface(material)
        shapes = [shape for shape in scene.shapes if shape.material == name]
        if isinstance(material, Textured):
            for i, shape in enumerate(shapes):
                d[f"{number}_texture_{i}"] = _mesh([frame.to_units(batch) for batch in _faces(shape)], own)
            continue
        corners = [frame.to_units(batch) for shape in shapes for batch in _faces(shape)]
        if corners:
            d[f"{number}_flat"] = _mesh(corners, own)
        for i, shape in enumerate(s for s in shapes if s.polygons() is None):
            center, radius = frame.to_units(np.asarray(shape.center)), shape.radius / frame.unit  # type: ignore[attr-defined]
            d[f"{number}_round_{i}"] = {"type": "sphere", "center": center.tolist(), "radius": radius, "bsdf": own}
    for i, light in enumerate(scene.lights):
        translated = _light(light, i, frame, strengths.get(i))
        if translated is not None:
            d[f"light_{i}"] = translated
    if sensor is not None:
        d["sensor"] = sensor
    return mi.load_dict(d, optimize=False, parallel=False)


def _faces(shape: Shape) -> list[np.ndarray]:
    """Return the flat faces of a shape as (faces, corners, 3) arrays; none for a curved shape."""
    if isinstance(shape, Mesh):
        return [shape.vertices[shape.faces]]
    polygons = shape.polygons()
    return [] if polygons is None else [np.stack(polygons)]


def _mesh(batches: list[np.ndarray], own: dict[str, Any]) -> Any:
    """Join flat convex faces into one mesh, each face a fan of triangles with vertices of its own."""
    triangles, start = [], 0
    for batch in batches:
        count, corners, _ = batch.shape
        first = start + corners * np.arange(count)[:, None, None]
        fan = np.array([[0, i, i + 1] for i in range(1, corners - 1)])
        triangles.append((first + fan).reshape(-1, 3))
        start += count * corners
    faces = np.concatenate(triangles)
    properties = mi.Properties()
    properties["face_normals"] = True
    properties["bsdf"] = mi.load_dict(own)
    mesh = mi.Mesh("flat", start, len(faces), props=properties, has_vertex_normals=False, has_vertex_texcoords=False)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.concatenate([batch.reshape(-1) for batch in batches]).astype(np.float32)
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return mesh


def _light(light: Light, i: int, frame: Frame, emission: dict[str, Any] | None) -> Any:
    if isinstance(light, AreaLight):
        matrix = np.eye(4)
        u, v = np.asarray(light.half_u) / frame.unit, np.asarray(light.half_v) / frame.unit
        matrix[:3] = np.stack([u, v, light.normal, frame.to_units(np.asarray(light.center))], axis=1)
        rectangle = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(matrix.tolist()),
            "bsdf": {"type": "diffuse", "reflectance": uniform(0.0)},
        }
        return rectangle if emission is None else {**rectangle, "emitter": {"type": "area", "radiance": emission}}
    if emission is None:
        return None
    if isinstance(light, DirectionalLight):
        return {"type": "directional", "direction": list(light.direction), "irradiance": emission}
    if isinstance(light, PointLight):
        return {"type": "point", "position": frame.to_units(np.asarray(light.position)).tolist(), "intensity": emission}
    if isinstance(light, SKIES):  # what changes with the direction is applied by the integrators (optsim.render.sky)
        return {"type": "constant", "radiance": emission}
    raise InputError("lights", type(light).__name__, "a light that the renderer knows")


def material_number(shape: Any) -> int:
    """Return the place of a Mitsuba shape's material in the scene, or -1 for a light."""
    head = shape.id().split("_")[0]
    return int(head) if head.isdigit() else -1


def shape_handle(shape: Any) -> int:
    """Return the number by which Dr.Jit knows a shape inside a kernel."""
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])
