"""Which texel of which texture a ray has hit; and a textured scene taken apart into plain rectangles, for the judge."""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.errors import InputError
from optsim.render.engine import dr, mi
from optsim.render.frame import Frame
from optsim.render.translate import material_number, shape_handle
from scenes.materials import Diffuse, Material
from scenes.scene import Scene
from scenes.shapes import Rectangle, Shape
from scenes.spectrum import Spectrum
from scenes.textures import Textured

MAX_PLAIN_TEXELS = 4096
"""More texels than this are not taken apart into rectangles."""


class TextureFrames:
    """Find texels: every textured rectangle's corner and sides, by the number that Dr.Jit knows the rectangle by.

    Args:
        scene: the scene.
        frame: renderer coordinates.
        engine: the Mitsuba scene, whose textured rectangles are shapes of their own (``NUMBER_texture_i``).
        texels: number of a material in the scene -> table row of its first texel.
    """

    def __init__(self, scene: Scene, frame: Frame, engine: Any, texels: dict[int, int]) -> None:
        handles = {shape.id(): shape_handle(shape) for shape in engine.shapes() if material_number(shape) in texels}
        size = max(handles.values()) + 1
        corner, along_u, along_v = (np.zeros((size, 3)) for _ in range(3))
        first, rows, columns = (np.zeros(size, np.uint32) for _ in range(3))
        for number, (name, material) in enumerate(scene.materials.items()):
            if number not in texels:
                continue
            assert isinstance(material, Textured)
            for i, shape in enumerate(s for s in scene.shapes if s.material == name):
                assert isinstance(shape, Rectangle)
                at = handles[f"{number}_texture_{i}"]
                u, v = np.asarray(shape.half_u), np.asarray(shape.half_v)
                corner[at] = frame.to_units(np.asarray(shape.center) - u - v)
                along_u[at], along_v[at] = u * frame.unit / (2 * u @ u), v * frame.unit / (2 * v @ v)
                first[at], rows[at], columns[at] = texels[number], *material.size
        self._corner, self._along_u, self._along_v = (mi.Float(t.astype(np.float32).ravel()) for t in (corner, along_u, along_v))
        self._first, self._rows, self._columns = (mi.UInt32(t) for t in (first, rows, columns))
        self._last = dr.opaque(mi.UInt32, size - 1)

    def row(self, si: Any, handle: Any, plain: Any, active: Any) -> Any:
        """Return the table's row of the texel hit, or ``plain`` where no texture is hit."""
        known = active & (handle <= self._last)
        rows, columns = (dr.gather(mi.UInt32, t, handle, known) for t in (self._rows, self._columns))
        textured = known & (rows > 0)
        corner, along_u, along_v = (dr.gather(mi.Vector3f, t, handle, textured) for t in (self._corner, self._along_u, self._along_v))
        away = mi.Vector3f(si.p) - corner
        u, v = dr.dot(away, along_u), 1 - dr.dot(away, along_v)
        i = mi.UInt32(dr.clip(v * mi.Float(rows), 0, mi.Float(rows) - 1))
        j = mi.UInt32(dr.clip(u * mi.Float(columns), 0, mi.Float(columns) - 1))
        return dr.select(textured, dr.gather(mi.UInt32, self._first, handle, textured) + i * columns + j, plain)


def taken_apart(scene: Scene) -> Scene:
    """Return the same scene with a diffuse rectangle in place of each texel.

    Raises:
        InputError: ``materials`` for more than 4096 texels.
    """
    textures = {name: m for name, m in scene.materials.items() if isinstance(m, Textured)}
    if not textures:
        return scene
    count = sum(np.prod(textures[s.material].size) for s in scene.shapes if s.material in textures)
    if count > MAX_PLAIN_TEXELS:
        raise InputError(
            "materials", int(count), f"textures of at most {MAX_PLAIN_TEXELS} texels in all for Mitsuba's film; or install LLVM"
        )
    shapes: list[Shape] = []
    materials: dict[str, Material] = {name: m for name, m in scene.materials.items() if name not in textures}
    for shape in scene.shapes:
        if shape.material not in textures:
            shapes.append(shape)
            continue
        assert isinstance(shape, Rectangle)
        texture = textures[shape.material]
        (rows, columns), nodes = texture.size, texture.mean().wavelength_nm
        center, u, v = (np.asarray(x) for x in (shape.center, shape.half_u, shape.half_v))
        values = np.clip(texture.weights.astype(np.float64) @ texture.table(nodes), 0, 1)
        for i, j in np.ndindex(rows, columns):
            name = f"{shape.name} {i} {j}"
            middle = center + u * ((2 * j + 1) / columns - 1) - v * ((2 * i + 1) / rows - 1)
            materials[name] = Diffuse(reflectance=Spectrum(nodes, values[i, j]))
            shapes.append(Rectangle(name=name, material=name, center=middle, half_u=u / columns, half_v=v / rows))
    return scene.model_copy(update={"shapes": tuple(shapes), "materials": materials})
