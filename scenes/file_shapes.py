"""Meshes that scene files describe by what they are: a cylinder, a cone, a ring or a faceted ball, made by trimesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from scenes.errors import InputError
from scenes.file_spectra import require_keys
from scenes.meshes import cone, cylinder, icosphere, torus
from scenes.model import vector
from scenes.shapes import Mesh

COMMON = ("name", "material", "center", "axis")
FORMS: dict[str, tuple[str, ...]] = {
    "cylinder": ("radius", "height", "sections"),
    "cone": ("radius", "height", "sections"),
    "torus": ("ring", "tube", "sections"),
    "icosphere": ("radius", "subdivisions"),
}
"""The fields of each form beside its name, material, center and axis (default: z)."""
PLACEMENT = ("rotation_deg", "position")
"""The fields that place a mesh from a file."""


def procedural_mesh(kind: str, fields: dict[str, Any], place: str) -> Mesh:
    """Build the mesh that a scene file's shape table describes; lengths in metres, the middle at ``center``.

    Raises:
        InputError: naming the offending place.
    """
    require_keys(fields, (*COMMON, *FORMS[kind]), place)
    for name in ("name", "material"):
        if not isinstance(fields.get(name), str):
            raise InputError(f"{place}.{name}", fields.get(name), "a name")
    placed = _placed(fields, place)

    def number(name: str, default: float | None = None) -> float:
        value = fields.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise InputError(f"{place}.{name}", value, "a finite number")
        return float(value)

    def whole(name: str, default: int) -> int:
        value = fields.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputError(f"{place}.{name}", value, "a whole number")
        return value

    makers: dict[str, Callable[[], Mesh]] = {
        "cylinder": lambda: cylinder(*named, (number("radius"), number("height")), placed, whole("sections", 32)),
        "cone": lambda: cone(*named, (number("radius"), number("height")), placed, whole("sections", 32)),
        "torus": lambda: torus(*named, (number("ring"), number("tube")), placed, whole("sections", 32)),
        "icosphere": lambda: icosphere(*named, number("radius"), placed, whole("subdivisions", 3)),
    }
    named = (fields["name"], fields["material"])
    return makers[kind]()


def turned_and_moved(fields: dict[str, Any], place: str) -> np.ndarray:
    """Return the rigid (4, 4) transform of a mesh from a file: ``rotation_deg`` about x, then y, then z, then to ``position``.

    Raises:
        InputError: naming the offending place.
    """
    turns, position = (_vector(fields, name, (0.0, 0.0, 0.0), place) for name in PLACEMENT)
    matrix = np.eye(4)
    for axis, angle in enumerate(np.deg2rad(turns)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[j, i] = np.sin(angle)
        turn[i, j] = -turn[j, i]
        matrix[:3, :3] = turn @ matrix[:3, :3]
    matrix[:3, 3] = position
    return matrix


def _vector(fields: dict[str, Any], name: str, default: tuple[float, float, float] | None, place: str) -> np.ndarray:
    try:
        return np.array(vector(fields.get(name, default)))
    except InputError as error:
        raise InputError(f"{place}.{name}", error.value, error.allowed) from None


def _placed(fields: dict[str, Any], place: str) -> np.ndarray:
    """Return the rigid (4, 4) transform that takes z to the axis and the origin to the center."""
    center, axis = _vector(fields, "center", None, place), _vector(fields, "axis", (0.0, 0.0, 1.0), place)
    length = float(np.linalg.norm(axis))
    if length == 0:
        raise InputError(f"{place}.axis", fields["axis"], "a vector of non-zero length")
    z = axis / length
    x = np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.9 else (1.0, 0.0, 0.0), z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    matrix[:3, 3] = center
    return matrix
