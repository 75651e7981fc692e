"""Which surfaces of a scene can light each other: an exact test for flat faces, and a sampled measure of how much."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.materials import Dielectric, Lambertian, Material
from scenes.scene import Scene
from scenes.shapes import Mesh, Shape, Sphere

MAX_PROOF_FACES = 6000
"""More flat faces than this are not compared pair by pair: nothing is proven then."""
MAX_RAY_TESTS = 8_000_000
DIRECTIONS = 16
ROUNDING = 1e-9
"""Heights above a plane below this fraction of the scene's size count as lying in it."""


@dataclass(frozen=True)
class Faces:
    """The reflecting surfaces of a scene: flat faces and spheres.

    Args:
        corners: (F, 4, 3) in metres; triangles repeat their last corner.
        normal: (F, 3) unit normals of the fronts.
        owner: (F,) index of the shape.
        spheres: (S, 4) middle and radius.
        sphere_owner: (S,) index of the shape.
        size: the scene's diameter in metres.
    """

    corners: np.ndarray
    normal: np.ndarray
    owner: np.ndarray
    spheres: np.ndarray
    sphere_owner: np.ndarray
    size: float


def albedo_bound(scene: Scene, shape: Shape) -> float:
    """Return the largest share of light that a shape gives back at any wavelength: 0 to 1."""
    material = scene.material_of(shape)
    if isinstance(material, Lambertian):
        return material.largest
    return 1.0


def largest_albedo(scene: Scene) -> float:
    """Return the largest share of light that any shape gives back; 0 without shapes."""
    return max((albedo_bound(scene, shape) for shape in scene.shapes), default=0.0)


def reflecting_faces(scene: Scene) -> Faces:
    """Collect the faces of all shapes that reflect anything (degenerate faces are left out)."""
    corners: list[np.ndarray] = []
    owner, spheres, sphere_owner = [], [], []
    for i, shape in enumerate(scene.shapes):
        if albedo_bound(scene, shape) == 0:
            continue
        if isinstance(shape, Sphere):
            spheres.append([*shape.center, shape.radius])
            sphere_owner.append(i)
            continue
        found = _quads(shape)
        corners.append(found)
        owner += [i] * len(found)
    table = np.concatenate([np.zeros((0, 4, 3)), *corners])
    normal = np.cross(table[:, 1] - table[:, 0], table[:, 2] - table[:, 0])
    length = np.linalg.norm(normal, axis=1)
    good = length > 0
    box = scene.bounds()
    return Faces(
        table[good],
        normal[good] / length[good, None],
        np.array(owner, int)[good],
        np.array(spheres, np.float64).reshape(-1, 4),
        np.array(sphere_owner, int),
        0.0 if box is None else float(np.linalg.norm(box[1] - box[0])),
    )


def _quads(shape: Shape) -> np.ndarray:
    """Return the (n, 4, 3) corners of a shape's flat faces; triangles repeat their last corner."""
    if isinstance(shape, Mesh):
        return shape.vertices[shape.faces[:, [0, 1, 2, 2]]]
    return np.array(shape.polygons()).reshape(-1, 4, 3)


def face_count(scene: Scene) -> int:
    """Return the number of reflecting flat faces; above ``MAX_PROOF_FACES`` nothing is proven about them."""
    return len(reflecting_faces(scene).corners)


def first_pair_that_sees_each_other(scene: Scene) -> tuple[str, str] | None:
    """Return the names of two reflecting shapes of which parts face each other, or None when it is proven that none do.

    Two flat faces can exchange light if and only if each reaches above the plane of the other (theory.md (R.9)); what stands between
    them is not considered. A sphere sees every other sphere outside it and every face that it rises above. Glass lets light
    through, so a scene with glass returns the glass twice. With more than 6000 faces nothing is proven: the first two reflecting shapes are
    returned.
    """
    glass = [s.name for s in scene.shapes if isinstance(scene.material_of(s), Dielectric)]
    if glass:
        return glass[0], glass[0]
    faces = reflecting_faces(scene)
    names = [shape.name for shape in scene.shapes]
    tolerance = ROUNDING * faces.size
    if len(faces.corners) > MAX_PROOF_FACES:
        return names[faces.owner[0]], names[faces.owner[-1]]
    pair = _facing_faces(faces, tolerance)
    if pair is None:
        pair = _facing_spheres(faces, tolerance)
    return None if pair is None else (names[pair[0]], names[pair[1]])


def _facing_faces(faces: Faces, tolerance: float) -> tuple[int, int] | None:
    count = len(faces.corners)
    offset = np.einsum("fk,fk->f", faces.normal, faces.corners[:, 0])
    points = faces.corners.reshape(-1, 3)
    above = np.zeros((count, count), bool)
    step = max(1, 4_000_000 // max(1, 4 * count))
    for a in range(0, count, step):
        heights = faces.normal[a : a + step] @ points.T - offset[a : a + step, None]
        above[a : a + step] = heights.reshape(-1, count, 4).max(2) > tolerance
    both = above & above.T
    if not both.any():
        return None
    i, j = np.argwhere(both)[0]
    return int(faces.owner[i]), int(faces.owner[j])


def _facing_spheres(faces: Faces, tolerance: float) -> tuple[int, int] | None:
    for s, (x, y, z, radius) in enumerate(faces.spheres):
        middle = np.array([x, y, z])
        apart = np.linalg.norm(faces.spheres[:, :3] - middle, axis=1)
        nested = apart + np.minimum(radius, faces.spheres[:, 3]) <= np.maximum(radius, faces.spheres[:, 3]) + tolerance
        if not nested.all():
            return int(faces.sphere_owner[s]), int(faces.sphere_owner[np.argmin(nested)])
        rise = np.einsum("fk,fk->f", faces.normal, middle - faces.corners[:, 0]) + radius
        outside = np.linalg.norm(faces.corners - middle, axis=2).max(1) > radius
        facing = (rise > tolerance) & outside
        if facing.any():
            return int(faces.sphere_owner[s]), int(faces.owner[np.argmax(facing)])
    return None


@dataclass(frozen=True)
class Coverage:
    """How much of what leaves a surface lands on other surfaces: shares of a cosine-weighted hemisphere, 0 to 1.

    Args:
        mean: over all reflecting area.
        returned: mean share that is also given back, i.e. weighted by the albedo of what is hit.
        measured: False when the scene was too big and the safe answer stands here.
    """

    mean: float
    returned: float
    measured: bool = True


def coverage(scene: Scene, seed: int = 0) -> Coverage:
    """Measure by ray casting how much of the light that leaves reflecting surfaces lands on reflecting surfaces.

    Points are uniform on the reflecting area, directions follow the cosine law. An estimate (up to 1024 points
    of 16 directions; fewer for big meshes); glass counts as giving back all
    that lands on it; a scene too big for it gets the safe answer 1.
    """
    faces = reflecting_faces(scene)
    rest = np.array([albedo_bound(scene, shape) for shape in scene.shapes])
    things = 2 * len(faces.corners) + len(faces.spheres)
    rays = MAX_RAY_TESTS // max(1, things)
    if rays < 64 * DIRECTIONS:
        return Coverage(1.0, float(rest.max(initial=0.0)), False)
    if things == 0:
        return Coverage(0.0, 0.0)
    rng = np.random.Generator(np.random.Philox(seed))
    points = min(1024, rays // DIRECTIONS)
    origin, normal = _points_on(faces, points, rng)
    direction = _cosine_directions(np.repeat(normal, DIRECTIONS, 0), rng)
    start = np.repeat(origin + normal * faces.size * 1e-6, DIRECTIONS, 0)
    hit = np.concatenate([_first_front(faces, start[i : i + 512], direction[i : i + 512]) for i in range(0, len(start), 512)])
    given = np.where(hit >= 0, rest[hit], 0.0)
    return Coverage(float((hit >= 0).mean()), float(given.mean()))


def _points_on(faces: Faces, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    c = faces.corners
    halves = np.concatenate([c[:, [0, 1, 2]], c[:, [0, 2, 3]]])
    area = np.linalg.norm(np.cross(halves[:, 1] - halves[:, 0], halves[:, 2] - halves[:, 0]), axis=1) / 2
    weight = np.concatenate([area, 4 * np.pi * faces.spheres[:, 3] ** 2])
    pick = rng.choice(len(weight), count, p=weight / weight.sum())
    flat = pick < len(halves)
    u, v = rng.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    unit = rng.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    origin, normal = np.empty((count, 3)), unit
    t = halves[pick[flat]]
    origin[flat] = t[:, 0] + u[flat, None] * (t[:, 1] - t[:, 0]) + v[flat, None] * (t[:, 2] - t[:, 0])
    ball = faces.spheres[pick[~flat] - len(halves)]
    origin[~flat] = ball[:, :3] + ball[:, 3:] * unit[~flat]
    normal[flat] = np.concatenate([faces.normal, faces.normal])[pick[flat]]
    return origin, normal


def _cosine_directions(normal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    unit = rng.normal(size=normal.shape)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    out = normal + unit
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)


def _first_front(faces: Faces, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return for each ray the shape whose front it meets first, or -1 (nothing, or a black back)."""
    best = np.full(len(origin), np.inf)
    shape = np.full(len(origin), -1)
    c = faces.corners
    for half in ([0, 1, 2], [0, 2, 3]):
        t = _meet_triangles(c[:, half], origin, direction)
        nearest = t.argmin(1) if t.shape[1] else np.zeros(len(origin), int)
        distance = t[np.arange(len(origin)), nearest] if t.shape[1] else best
        closer = distance < best
        best = np.where(closer, distance, best)
        front = np.einsum("rk,rk->r", faces.normal[nearest], direction) < 0 if t.shape[1] else closer
        shape = np.where(closer, np.where(front, faces.owner[nearest], -1), shape) if t.shape[1] else shape
    for (x, y, z, radius), owner in zip(faces.spheres, faces.sphere_owner, strict=True):
        away = origin - np.array([x, y, z])
        b = np.einsum("rk,rk->r", away, direction)
        inside = b**2 - np.einsum("rk,rk->r", away, away) + radius**2
        t_ball = -b - np.sqrt(np.maximum(inside, 0))
        closer = (inside > 0) & (t_ball > 0) & (t_ball < best)
        best, shape = np.where(closer, t_ball, best), np.where(closer, owner, shape)
    return shape


def _meet_triangles(triangles: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the (rays, triangles) distances, infinite where a ray misses (Moeller and Trumbore 1997)."""
    e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(direction[:, None], e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.einsum("rfk,fk->rf", p, e1)
        s = origin[:, None] - triangles[:, 0]
        u = np.einsum("rfk,rfk->rf", s, p) * inverse
        q = np.cross(s, e1)
        v = np.einsum("rk,rfk->rf", direction, q) * inverse
        t = np.einsum("fk,rfk->rf", e2, q) * inverse
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return np.where(hit, t, np.inf)


def is_diffuse(scene: Scene) -> bool:
    """Tell whether every shape is Lambertian."""
    return all(isinstance(scene.material_of(shape), Lambertian) for shape in scene.shapes)


def used_materials(scene: Scene) -> dict[str, Material]:
    """Return the materials that shapes refer to, by name, in the order of their first use."""
    return {shape.material: scene.material_of(shape) for shape in scene.shapes}
