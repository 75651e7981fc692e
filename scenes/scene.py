"""A scene: shapes, what they are made of, lights, and the point it is looked at from. Lengths in metres."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field, InstanceOf, model_validator

from scenes.errors import InputError
from scenes.lights import LIGHTS, SKIES, AreaLight, ConstantSky, DirectionalLight, GradientSky, Light, PointLight
from scenes.materials import Conductor, Dielectric, Diffuse, Lambertian, Material, RoughPlastic
from scenes.model import Model, did_you_mean
from scenes.shapes import SHAPES, Box, Mesh, Name, Rectangle, Shape, Sphere
from scenes.textures import Textured
from scenes.viewpoint import VIEWPOINTS, Orthographic, Perspective, ThinLens, Viewpoint

__all__ = [
    "LIGHTS", "MATERIALS", "SHAPES", "VIEWPOINTS",
    "AreaLight", "Box", "Conductor", "ConstantSky", "Dielectric", "Diffuse", "DirectionalLight", "GradientSky", "Lambertian", "Light",
    "Material", "Mesh", "Orthographic", "Perspective", "PointLight", "Rectangle", "RoughPlastic", "Scene", "Shape", "Sphere", "Textured",
    "ThinLens", "Viewpoint",
]  # fmt: skip

MATERIALS: tuple[type[Material], ...] = (Diffuse, Textured, Dielectric, RoughPlastic, Conductor)
"""Every material a scene may use."""
MAX_SHAPES = 100_000
MAX_SKIES = 16


class Scene(Model):
    """Everything in front of the camera.

    Args:
        name: 1 to 100 characters.
        shapes: up to 100,000, each of a name of its own; none is a valid, empty scene.
        materials: by the name that shapes refer to.
        lights: none is a valid, black scene; at most one ConstantSky.
        viewpoint: where it is looked at from.
        description: one or two sentences for people.

    Raises:
        InputError: ``shapes.NAME.material`` for an unknown material, ``shapes.NAME`` for a name used twice, ``lights`` for a
            second sky, ``shapes.NAME.material`` for glass on an open shape or a texture on another than a rectangle.
    """

    name: Name
    shapes: Annotated[tuple[InstanceOf[Shape], ...], Field(max_length=MAX_SHAPES)]
    materials: dict[Name, InstanceOf[Material]]
    lights: tuple[InstanceOf[Light], ...]
    viewpoint: InstanceOf[Viewpoint]
    description: str = ""

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        _require_final("shapes", self.shapes, SHAPES)
        _require_final("materials", self.materials.values(), MATERIALS)
        _require_final("lights", self.lights, LIGHTS)
        _require_final("viewpoint", [self.viewpoint], VIEWPOINTS)
        seen: set[str] = set()
        for shape in self.shapes:
            if shape.name in seen:
                raise InputError(f"shapes.{shape.name}", shape.name, "a name that no other shape has")
            seen.add(shape.name)
            if shape.material not in self.materials:
                known = ", ".join(self.materials) or "(none given)"
                hint = did_you_mean(shape.material, self.materials)
                raise InputError(f"shapes.{shape.name}.material", shape.material, f"one of the scene's materials {known}{hint}")
            if isinstance(shape, Rectangle) and isinstance(self.materials[shape.material], Dielectric):
                raise InputError(
                    f"shapes.{shape.name}.material", shape.material, "opaque: glass needs a closed shape (box, sphere or mesh)"
                )
            if isinstance(self.materials[shape.material], Textured) and not isinstance(shape, Rectangle):
                raise InputError(f"shapes.{shape.name}.material", shape.material, "of one colour: a texture lies on rectangles only")
        skies = sum(isinstance(light, ConstantSky) for light in self.lights)
        if skies > 1:
            raise InputError("lights", skies, "at most one constant sky")
        if sum(isinstance(light, SKIES) for light in self.lights) > MAX_SKIES:
            raise InputError("lights", len(self.lights), f"at most {MAX_SKIES} skies")
        return self

    def material_of(self, shape: Shape) -> Material:
        """Return the material that a shape is made of."""
        return self.materials[shape.material]

    def bounds(self) -> np.ndarray | None:
        """Return the (2, 3) corners of the axis-aligned box round all shapes in metres, or None without shapes."""
        if not self.shapes:
            return None
        boxes = np.array([shape.bounds() for shape in self.shapes])
        return np.array([boxes[:, 0].min(0), boxes[:, 1].max(0)])


def _require_final(field: str, things: Any, final: tuple[type, ...]) -> None:
    for thing in things:
        if type(thing) not in final:
            raise InputError(field, type(thing).__name__, f"one of {', '.join(kind.__name__ for kind in final)}")
