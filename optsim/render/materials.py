"""The materials of a scene as tables that kernels read: reflectances, refractive indices, and what kind each surface is."""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.render.engine import dr, mi
from optsim.render.translate import material_number, shape_handle
from scenes.materials import Dielectric, Diffuse
from scenes.scene import Scene
from scenes.visibility import used_materials

BLACK, DIFFUSE, GLASS, OTHER = 0, 1, 2, 3


class MaterialTable:
    """Hold what a kernel needs to know of each material, at some of the nodes.

    Args:
        scene: whose materials.
        engine: the Mitsuba scene made of it by :func:`optsim.render.translate.load`.
        nodes_nm: (n,) all nodes of the transport.
        first: number of the first node of this table.
        count: how many nodes from there.
    """

    def __init__(self, scene: Scene, engine: Any, nodes_nm: np.ndarray, first: int, count: int) -> None:
        self.first, self.nodes = first, count
        self.groups = (count + 3) // 4
        rows = len(scene.materials) + 1  # the last row is black: lights
        values = np.zeros((rows, 4 * self.groups))
        largest, kind = np.zeros(rows), np.full(rows, BLACK)
        index = np.ones((rows, 4 * self.groups))
        nodes = nodes_nm[first : first + count]
        used = used_materials(scene)
        for i, (name, material) in enumerate(scene.materials.items()):
            if name not in used:
                continue
            if isinstance(material, Diffuse):
                values[i, :count] = material.reflectance.at(nodes)
                largest[i] = material.reflectance.maximum
                kind[i] = DIFFUSE if largest[i] > 0 else BLACK
            elif isinstance(material, Dielectric):
                kind[i], index[i, :count] = GLASS, material.index_at(nodes)
            else:
                kind[i] = OTHER
        self.has_glass, self.has_other = GLASS in kind, OTHER in kind
        self._values = mi.Float(values.astype(np.float32).ravel())
        self._largest = mi.Float(largest.astype(np.float32))
        self._kind = mi.UInt32(kind.astype(np.uint32))
        self._index = mi.Float(index.astype(np.float32).ravel())
        self._rows = mi.UInt32(_rows_by_handle(engine, rows - 1))

    def row(self, si: Any, active: Any) -> Any:
        """Return the row of the material hit."""
        handle: Any = dr.reinterpret_array(mi.UInt32, si.shape)
        return dr.gather(mi.UInt32, self._rows, handle, active)

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


def _rows_by_handle(engine: Any, black: int) -> np.ndarray:
    """Return the row of every shape, by the number that Dr.Jit knows the shape by."""
    shapes = [(shape_handle(shape), material_number(shape)) for shape in engine.shapes()]
    rows = np.full(max((handle for handle, _ in shapes), default=0) + 1, black, np.uint32)
    for handle, number in shapes:
        if number >= 0:
            rows[handle] = number
    return rows
