"""The materials of a scene as tables that kernels read: reflectances, refractive indices, and what kind each surface is."""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.render.engine import dr, mi
from optsim.render.frame import Frame
from optsim.render.textures import TextureFrames
from optsim.render.translate import material_number, shape_handle
from scenes.materials import Dielectric, Diffuse
from scenes.scene import Scene
from scenes.textures import Textured
from scenes.visibility import used_materials

BLACK, DIFFUSE, GLASS, OTHER = 0, 1, 2, 3
MAX_TABLE_VALUES = 2**28
"""Texels x nodes of one kernel's table: 1 GiB in float32."""


def rows_of(scene: Scene) -> int:
    """Return the rows of a scene's table: one a material, one a texel, and a black one."""
    textures = [m for m in used_materials(scene).values() if isinstance(m, Textured)]
    return len(scene.materials) + 1 + sum(m.size[0] * m.size[1] for m in textures)


class MaterialTable:
    """Hold what a kernel needs to know of each material, at some of the nodes; a texel counts as a material of its own.

    Args:
        scene: whose materials.
        frame: renderer coordinates.
        engine: the Mitsuba scene made of it by :func:`optsim.render.translate.load`.
        nodes_nm: (n,) all nodes of the transport.
        first: number of the first node of this table.
        count: how many nodes from there.
    """

    def __init__(self, scene: Scene, frame: Frame, engine: Any, nodes_nm: np.ndarray, first: int, count: int) -> None:
        self.first, self.nodes = first, count
        self.groups = (count + 3) // 4
        black, rows = len(scene.materials), rows_of(scene)  # after the materials a black row, for lights; then the texels
        values = np.zeros((rows, 4 * self.groups), np.float32)
        largest, kind = np.zeros(rows, np.float32), np.full(rows, BLACK, np.uint32)
        index = np.ones((black + 1, 4 * self.groups), np.float32)
        nodes = nodes_nm[first : first + count]
        used = used_materials(scene)
        texels: dict[int, int] = {}
        after = black + 1
        for i, (name, material) in enumerate(scene.materials.items()):
            if name not in used:
                continue
            if isinstance(material, Diffuse):
                values[i, :count] = material.reflectance.at(nodes)
                largest[i] = material.largest
                kind[i] = DIFFUSE if largest[i] > 0 else BLACK
            elif isinstance(material, Textured):
                texels[i] = after
                own = slice(after, after := after + material.size[0] * material.size[1])
                weights = material.weights.reshape(-1, len(material.basis)).astype(np.float64)
                values[own, :count] = np.clip(weights @ material.table(nodes), 0, 1)
                largest[own] = np.minimum(weights @ np.array([s.maximum for s in material.basis]), 1)
                kind[own] = np.where(largest[own] > 0, DIFFUSE, BLACK)
            elif isinstance(material, Dielectric):
                kind[i], index[i, :count] = GLASS, material.index_at(nodes)
            else:
                kind[i] = OTHER
        self.has_glass, self.has_other = GLASS in kind, OTHER in kind
        ends = index[:, [0, max(count - 1, 0)]]
        self.has_dispersion = bool(np.any(ends[:, 0] != ends[:, 1]))
        self._values = mi.Float(values.ravel())
        self._largest = mi.Float(largest)
        self._kind = mi.UInt32(kind)
        self._index = mi.Float(index.ravel())
        self._rows = mi.UInt32(_rows_by_handle(engine, black))
        self._textures = TextureFrames(scene, frame, engine, texels) if texels else None

    def row(self, si: Any, active: Any) -> Any:
        """Return the row of the material, or of the texel, hit."""
        handle: Any = dr.reinterpret_array(mi.UInt32, si.shape)
        row = dr.gather(mi.UInt32, self._rows, handle, active)
        return row if self._textures is None else self._textures.row(si, handle, row, active)

    def kind(self, row: Any, active: Any) -> Any:
        """Return BLACK, DIFFUSE, GLASS or OTHER (BLACK where inactive)."""
        return dr.gather(mi.UInt32, self._kind, row, active)

    def largest(self, row: Any, active: Any) -> Any:
        """Return the material's largest reflectance at any wavelength."""
        return dr.gather(mi.Float, self._largest, row, active)

    def at(self, row: Any, group: int, active: Any) -> Any:
        """Return the material's reflectance at the four nodes of a group."""
        return dr.gather(mi.Spectrum, self._values, row * self.groups + group, active)

    def at_node(self, row: Any, node: Any, active: Any) -> Any:
        """Return the material's reflectance at one node of this table."""
        return dr.gather(mi.Float, self._values, row * (4 * self.groups) + node, active)

    def index(self, row: Any, node: Any, active: Any) -> Any:
        """Return the material's refractive index at one node of this table (1 where inactive)."""
        found = dr.gather(mi.Float, self._index, row * (4 * self.groups) + node, active)
        return dr.select(active, found, 1)

    def indices(self, row: Any, group: int, active: Any) -> Any:
        """Return the material's refractive index at the four nodes of a group (1 where inactive)."""
        found = dr.gather(mi.Spectrum, self._index, row * self.groups + group, active)
        return dr.select(active, found, 1)

    def extremes(self, row: Any, active: Any) -> tuple[Any, Any]:
        """Return the refractive index at the first and the last node: between them it runs one way."""
        return self.index(row, 0, active), self.index(row, self.nodes - 1, active)


def _rows_by_handle(engine: Any, black: int) -> np.ndarray:
    """Return the row of every shape, by the number that Dr.Jit knows the shape by."""
    shapes = [(shape_handle(shape), material_number(shape)) for shape in engine.shapes()]
    rows = np.full(max((handle for handle, _ in shapes), default=0) + 1, black, np.uint32)
    for handle, number in shapes:
        if number >= 0:
            rows[handle] = number
    return rows
