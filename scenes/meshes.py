"""Triangle meshes: procedural shapes through trimesh, and files that are checked before and after trimesh reads them."""

from __future__ import annotations

import io
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scenes.errors import InputError
from scenes.shapes import MAX_FACES, Mesh

FILE_TYPES = (".ply", ".obj", ".stl")
"""The only mesh files that are read: no archives, no formats that name other files."""
MAX_FILE_BYTES = 256 * 2**20
MAX_HEADER_BYTES = 64 * 2**10


def torus(name: str, material: str, radii: tuple[float, float], placed: ArrayLike, sections: int = 32) -> Mesh:
    """Return a ring round the z axis, moved by a (4, 4) matrix.

    Args:
        name: of the shape.
        material: of the shape.
        radii: of the ring and of its tube, in metres, ring > tube > 0.
        placed: (4, 4) rigid transform into the scene, or three coordinates of the middle.
        sections: facets round the ring and round the tube, 3 to 512.
    """
    _require_sections(sections)
    ring, tube = radii
    if not 0 < tube < ring < np.inf:
        raise InputError("radii", radii, "(ring, tube) with ring > tube > 0 m")
    import trimesh

    return _mesh(name, material, trimesh.creation.torus(ring, tube, sections, sections), placed)


def cylinder(name: str, material: str, size: tuple[float, float], placed: ArrayLike, sections: int = 32) -> Mesh:
    """Return an upright solid of (radius, height) in metres round the z axis; 3 sections make a triangular prism."""
    _require_sections(sections)
    radius, height = size
    if not (0 < radius < np.inf and 0 < height < np.inf):
        raise InputError("size", size, "(radius, height), both above 0 m")
    import trimesh

    return _mesh(name, material, trimesh.creation.cylinder(radius, height, sections), placed)


def cone(name: str, material: str, size: tuple[float, float], placed: ArrayLike, sections: int = 32) -> Mesh:
    """Return an upright cone of (radius, height) in metres, its tip half the height above the middle."""
    _require_sections(sections)
    radius, height = size
    if not (0 < radius < np.inf and 0 < height < np.inf):
        raise InputError("size", size, "(radius, height), both above 0 m")
    import trimesh

    solid = trimesh.creation.cone(radius, height, sections)
    solid.apply_translation((0, 0, -height / 2))
    return _mesh(name, material, solid, placed)


def icosphere(name: str, material: str, radius: float, placed: ArrayLike, subdivisions: int = 3) -> Mesh:
    """Return a sphere of 20 x 4^subdivisions flat facets (0 to 7), of a radius in metres."""
    if not (isinstance(subdivisions, int) and 0 <= subdivisions <= 7):
        raise InputError("subdivisions", subdivisions, "a whole number from 0 to 7")
    if not 0 < radius < np.inf:
        raise InputError("radius", radius, "above 0 m")
    import trimesh

    return _mesh(name, material, trimesh.creation.icosphere(subdivisions, radius), placed)


def read_mesh(path: Path | str, name: str, material: str, metres_per_unit: float = 1.0, placed: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """Read a PLY, OBJ or STL file as a Mesh.

    Nothing but this one file is opened (OBJ materials are ignored). Declared sizes are checked against the file's length before
    trimesh sees it; indices, coordinates and areas are checked afterwards.

    Args:
        path: of a regular file of at most 256 MiB.
        name: of the shape.
        material: of the shape.
        metres_per_unit: what one unit of the file is in metres, above 0.
        placed: where the file's origin is, in metres, or a rigid (4, 4) transform into the scene.

    Raises:
        InputError: ``mesh`` naming the file and what is wrong; ``shape.faces`` or ``shape.vertices`` with the first bad row.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in FILE_TYPES:
        raise InputError("mesh", str(path), f"a file of type {', '.join(FILE_TYPES)}")
    if not (np.isfinite(metres_per_unit) and metres_per_unit > 0):
        raise InputError("metres_per_unit", metres_per_unit, "above 0 m")
    data = read_regular(path, MAX_FILE_BYTES, "mesh")
    declared = _CHECKS[kind](data, str(path))
    import trimesh

    try:
        loaded: Any = trimesh.load_mesh(io.BytesIO(data), file_type=kind[1:], process=False, skip_materials=True)
        vertices, faces = np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces)
    except Exception as error:  # a foreign parser: whatever it raises means that the file is not readable
        raise InputError("mesh", str(path), f"a readable {kind[1:].upper()} file ({type(error).__name__}: {error})") from None
    if declared is not None and len(vertices) != declared:
        raise InputError("mesh", str(path), f"a file with the {declared} vertices that its header declares ({len(vertices)} found)")
    matrix = _rigid(placed)
    return Mesh(name=name, material=material, vertices=vertices * metres_per_unit @ matrix[:3, :3].T + matrix[:3, 3], faces=faces)


def read_regular(path: Path, limit: int, field: str) -> bytes:
    """Return the bytes of a regular file (no device, pipe or folder) of at most ``limit`` bytes.

    Raises:
        InputError: naming the field and the file.
    """
    try:
        kind = path.stat()
    except (OSError, ValueError) as error:
        raise InputError(field, str(path), f"a file that can be read ({getattr(error, 'strerror', None) or error})") from None
    if not stat.S_ISREG(kind.st_mode):
        raise InputError(field, str(path), "a regular file (not a folder, pipe or device)")
    if kind.st_size > limit:
        raise InputError(field, kind.st_size, f"a file of at most {limit} bytes")
    with path.open("rb") as file:
        return file.read(limit)


def _check_ply(data: bytes, path: str) -> int | None:
    head = data[:MAX_HEADER_BYTES]
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        raise InputError("mesh", path, f"a PLY file (ply ... end_header within {MAX_HEADER_BYTES} bytes)")
    vertices = None
    for line in head[:end].splitlines():
        words = line.split()
        if len(words) >= 3 and words[0] == b"element":
            count = int(words[2]) if words[2].isdigit() else -1
            if not 0 <= count <= len(data) - end:
                raise InputError(
                    "mesh", path, f"a PLY file that holds the {words[2].decode(errors='replace')} elements its header declares"
                )
            if words[1] == b"vertex":
                vertices = count
    return vertices


def _check_stl(data: bytes, path: str) -> None:
    if len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return
    if not data.lstrip()[:5].lower() == b"solid":
        raise InputError("mesh", path, "an STL file: text that starts with 'solid', or 84 + 50 bytes for each declared triangle")


def _check_obj(data: bytes, path: str) -> None:
    if b"\0" in data:
        raise InputError("mesh", path, "a text file in OBJ format")


_CHECKS: dict[str, Callable[[bytes, str], int | None]] = {".ply": _check_ply, ".stl": _check_stl, ".obj": _check_obj}


def _require_sections(sections: int) -> None:
    if not (isinstance(sections, int) and 3 <= sections <= 512):
        raise InputError("sections", sections, f"a whole number from 3 to 512 (at most {MAX_FACES} faces)")


def _rigid(placed: ArrayLike) -> np.ndarray:
    """Return a rigid (4, 4) transform given as one, or as the place of the origin."""
    matrix = np.asarray(placed, np.float64)
    if matrix.shape == (3,):
        move, matrix = matrix, np.eye(4)
        matrix[:3, 3] = move
    if matrix.shape != (4, 4) or not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-9):
        raise InputError("placed", matrix.tolist(), "three coordinates or a rigid (4, 4) transform")
    return matrix


def _mesh(name: str, material: str, solid: Any, placed: ArrayLike) -> Mesh:
    matrix = _rigid(placed)
    vertices = np.asarray(solid.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
    return Mesh(name=name, material=material, vertices=vertices, faces=np.asarray(solid.faces))
