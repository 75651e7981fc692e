"""The shapes that scenes are built of, in metres."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from scenes.errors import InputError
from scenes.model import LENGTH_LIMIT_M, Direction, Model, Vector, ranged

MAX_FACES = 2_000_000
PERPENDICULAR = 1e-6
"""Cosines below this count as right angles."""

Name = Annotated[str, Field(min_length=1, max_length=100)]


def require_perpendicular(**sides: tuple[float, float, float]) -> None:
    """Refuse side vectors that are not mutually perpendicular.

    Raises:
        InputError: naming the second vector of the offending pair.
    """
    names = list(sides)
    unit = {name: np.asarray(v) / np.linalg.norm(v) for name, v in sides.items()}
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            cosine = abs(float(unit[first] @ unit[second]))
            if cosine > PERPENDICULAR:
                raise InputError(second, sides[second], f"perpendicular to {first} (the cosine is {cosine:.3g})")


class Shape(Model):
    """A named surface with a material; abstract, see ``SHAPES`` for the final ones."""

    place: ClassVar[str] = "shape"
    name: Name
    material: Name

    def bounds(self) -> np.ndarray:
        """Return the (2, 3) corners of the axis-aligned box round the shape, in metres."""
        raise NotImplementedError

    def polygons(self) -> tuple[np.ndarray, ...] | None:
        """Return the flat faces as (n, 3) corners, anticlockwise seen from the front; None for a curved shape."""
        raise NotImplementedError


class Rectangle(Shape):
    """A flat rectangle; its front faces along half_u x half_v.

    Args:
        center: the middle.
        half_u: from the middle to the middle of one side.
        half_v: from the middle to the middle of a neighbouring side, perpendicular to half_u.
    """

    center: Vector
    half_u: Direction
    half_v: Direction

    @model_validator(mode="after")
    def _sides(self) -> Rectangle:
        require_perpendicular(half_u=self.half_u, half_v=self.half_v)
        return self

    @property
    def normal(self) -> np.ndarray:
        """Return the unit normal of the front."""
        n = np.cross(self.half_u, self.half_v)
        return n / np.linalg.norm(n)

    def corners(self) -> np.ndarray:
        """Return the (4, 3) corners, anticlockwise seen from the front."""
        c, u, v = (np.asarray(x) for x in (self.center, self.half_u, self.half_v))
        return np.array([c - u - v, c + u - v, c + u + v, c - u + v])

    def bounds(self) -> np.ndarray:
        """Return the (2, 3) corners of the axis-aligned box round the shape, in metres."""
        return _box_round(self.corners())

    def polygons(self) -> tuple[np.ndarray, ...]:
        """Return the one face."""
        return (self.corners(),)


class Box(Shape):
    """A rectangular block, outside is front.

    Args:
        center: the middle.
        half_u: from the middle to one face.
        half_v: the same to a second face, perpendicular.
        half_w: the same to a third face, perpendicular to both.
    """

    center: Vector
    half_u: Direction
    half_v: Direction
    half_w: Direction

    @model_validator(mode="after")
    def _sides(self) -> Box:
        require_perpendicular(half_u=self.half_u, half_v=self.half_v, half_w=self.half_w)
        return self

    def bounds(self) -> np.ndarray:
        """Return the (2, 3) corners of the axis-aligned box round the shape, in metres."""
        return _box_round(np.concatenate(self.polygons()))

    def polygons(self) -> tuple[np.ndarray, ...]:
        """Return the six faces, seen from outside."""
        c, u, v, w = (np.asarray(x) for x in (self.center, self.half_u, self.half_v, self.half_w))
        if np.dot(np.cross(u, v), w) < 0:
            w = -w
        faces = []
        for a, b, n in ((u, v, w), (v, w, u), (w, u, v)):
            faces.append(np.array([c + n - a - b, c + n + a - b, c + n + a + b, c + n - a + b]))
            faces.append(np.array([c - n - b - a, c - n + b - a, c - n + b + a, c - n - b + a]))
        return tuple(faces)


class Sphere(Shape):
    """A sphere, outside is front.

    Args:
        center: the middle.
        radius: above 0 m.
    """

    center: Vector
    radius: Annotated[float, ranged(0, LENGTH_LIMIT_M, "m", "(]")]

    def bounds(self) -> np.ndarray:
        """Return the (2, 3) corners of the axis-aligned box round the shape, in metres."""
        c = np.asarray(self.center)
        return np.array([c - self.radius, c + self.radius])

    def polygons(self) -> None:
        """Return None: the sphere is curved."""


def _vertices(value: Any) -> np.ndarray:
    array = _table(value, "an (n, 3) table of coordinates in metres")
    bad = ~np.isfinite(array) | (np.abs(array) > LENGTH_LIMIT_M)
    if np.any(bad):
        i = int(np.argwhere(bad)[0, 0])
        raise InputError("", array[i].tolist(), f"finite and within {LENGTH_LIMIT_M:g} m; the first bad vertex is number {i}")
    return array


def _faces(value: Any) -> np.ndarray:
    table = _table(value, "an (n, 3) table of vertex numbers")
    if table.shape[0] > MAX_FACES:
        raise InputError("", table.shape[0], f"at most {MAX_FACES} faces")
    bad = ~((table >= 0) & (table < 2**31) & (table == np.floor(table)))
    if np.any(bad):
        i = int(np.argwhere(bad)[0, 0])
        raise InputError("", table[i].tolist(), f"whole vertex numbers from 0; the first bad face is number {i}")
    faces = table.astype(np.int64)
    faces.setflags(write=False)
    return faces


def _table(value: Any, form: str) -> np.ndarray:
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise InputError("", type(value).__name__, form) from None
    if array.ndim != 2 or array.shape[1] != 3 or array.shape[0] == 0:
        raise InputError("", array.shape, f"{form}, at least one row")
    array.setflags(write=False)
    return array


class Mesh(Shape):
    """A triangle mesh with flat faces; a face's front is where its vertices run anticlockwise.

    Args:
        vertices: (n, 3) coordinates in metres.
        faces: (m, 3) vertex numbers from 0 to n - 1, m >= 1.

    Raises:
        InputError: ``shape.vertices`` or ``shape.faces`` with the number of the first bad row.
    """

    vertices: Annotated[np.ndarray, BeforeValidator(_vertices)]
    faces: Annotated[np.ndarray, BeforeValidator(_faces)]

    @model_validator(mode="after")
    def _indices(self) -> Mesh:
        bad = np.any(self.faces >= len(self.vertices), axis=1)
        if np.any(bad):
            i = int(np.argmax(bad))
            raise InputError(
                "faces", self.faces[i].tolist(), f"vertex numbers from 0 to {len(self.vertices) - 1}; the first bad face is number {i}"
            )
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        if not np.any(np.cross(b - a, c - a)):
            raise InputError("faces", len(self.faces), "faces with an area above 0 (all are degenerate)")
        return self

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mesh):
            return NotImplemented
        same = self.name == other.name and self.material == other.material
        return same and np.array_equal(self.vertices, other.vertices) and np.array_equal(self.faces, other.faces)

    def __hash__(self) -> int:
        return hash((self.name, self.material, self.vertices.tobytes(), self.faces.tobytes()))

    def bounds(self) -> np.ndarray:
        """Return the (2, 3) corners of the axis-aligned box round the used vertices, in metres."""
        return _box_round(self.vertices[np.unique(self.faces)])

    def polygons(self) -> tuple[np.ndarray, ...]:
        """Return the triangles."""
        return tuple(self.vertices[self.faces])


def _box_round(points: np.ndarray) -> np.ndarray:
    return np.array([points.min(0), points.max(0)])


SHAPES: tuple[type[Shape], ...] = (Rectangle, Box, Sphere, Mesh)
"""Every shape a scene may use."""
