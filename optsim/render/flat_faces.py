"""The faces of a scene that can be rendered without samples: flat, opaque, diffuse, none crossing another (theory.md (R.38))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optsim.render.choice import Physics
from optsim.render.frame import Frame
from optsim.render.polygons import clip
from optsim.render.settings import RenderSettings
from scenes.lights import SKIES, AreaLight, ConstantSky
from scenes.materials import Diffuse, Lambertian
from scenes.scene import Scene
from scenes.shapes import Mesh, Rectangle, Sphere
from scenes.textures import Textured
from scenes.viewpoint import ThinLens
from scenes.visibility import first_pair_that_sees_each_other, is_diffuse

MAX_FACES = 1000
MAX_TEXELS = 2**20
LEVEL = 1e-9
"""Heights above a plane below this share of the scene's size count as lying in it."""


@dataclass(frozen=True)
class Face:
    """Hold one convex polygon in renderer coordinates.

    Args:
        corners: (m, 3), anticlockwise seen from the front.
        normal: unit normal of the front.
        row: the row of the band table that its front reflects by; of its first texel when textured.
        light: index of the scene's light that its front is, or -1.
        texture: corner of the texture, (3,), then the vectors along u and v whose products with a place give texel fractions; or None.
        texels: (rows, columns) of the texture.
        black: whether it reflects nothing.
    """

    corners: np.ndarray
    normal: np.ndarray
    row: int
    light: int = -1
    texture: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    texels: tuple[int, int] = (1, 1)
    black: bool = False

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Return the heights of points (..., 3) above the face's plane."""
        return (points - self.corners[0]) @ self.normal

    def part(self, corners: np.ndarray) -> Face:
        """Return a part of the face."""
        return Face(corners, self.normal, self.row, self.light, self.texture, self.texels, self.black)


def why_not_flat(scene: Scene, settings: RenderSettings) -> str | None:
    """Say why a scene cannot be rendered without samples as far as its contents tell, or None."""
    if settings.samples_per_pixel is not None:
        return "a number of samples was asked for"
    if {Physics.EMITTER_SAMPLING, Physics.SPECTRAL_NODES, Physics.DISPERSION} & {*settings.force, *settings.without}:
        return "how samples are taken was decided by hand"
    if settings.max_depth is not None and settings.max_depth < 2:
        return "reflected light is left out"
    if not is_diffuse(scene):
        return "not all surfaces are diffuse"
    if isinstance(scene.viewpoint, ThinLens):
        return "the view goes through a lens"
    if any(isinstance(shape, Sphere) for shape in scene.shapes):
        return "a sphere is not flat"
    if any(isinstance(light, SKIES) and not isinstance(light, ConstantSky) for light in scene.lights):
        return "the sky is not constant"
    if sum(len(s.faces) if isinstance(s, Mesh) else len(s.polygons() or ()) for s in scene.shapes) > MAX_FACES:
        return f"there are more than {MAX_FACES} faces"
    textures = {s.material: scene.material_of(s) for s in scene.shapes}
    if sum(m.size[0] * m.size[1] for m in textures.values() if isinstance(m, Textured)) > MAX_TEXELS:
        return f"there are more than {MAX_TEXELS} texels"
    return "light may be reflected more than once" if first_pair_that_sees_each_other(scene) is not None else None


def faces_of(scene: Scene, frame: Frame) -> list[Face]:
    """Collect shapes and area lights; faces that cross the plane of an area light are cut there."""
    names = list(scene.materials)
    first, after = {}, len(names) + 1
    for name, material in scene.materials.items():
        if isinstance(material, Textured):
            first[name] = after
            after += material.size[0] * material.size[1]
    faces: list[Face] = []
    for shape in scene.shapes:
        material = scene.materials[shape.material]
        assert isinstance(material, Lambertian)
        row = first.get(shape.material, names.index(shape.material))
        texture, texels = None, (1, 1)
        if isinstance(material, Textured):
            assert isinstance(shape, Rectangle)
            u, v = np.asarray(shape.half_u), np.asarray(shape.half_v)
            corner = frame.to_units(np.asarray(shape.center) - u - v)
            texture, texels = (corner, u * frame.unit / (2 * u @ u), v * frame.unit / (2 * v @ v)), material.size
        for polygon in shape.polygons() or ():
            corners = frame.to_units(np.asarray(polygon))
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            length = np.linalg.norm(normal)
            if length > 0:
                faces.append(Face(corners, normal / length, row, -1, texture, texels, material.largest <= 0))
    lamps = [
        Face(frame.to_units(light.corners()), light.normal, len(names), i)
        for i, light in enumerate(scene.lights)
        if isinstance(light, AreaLight)
    ]
    for lamp in lamps:
        faces = [part for face in faces for part in _cut(face, lamp)]
    return faces + lamps


def _cut(face: Face, lamp: Face) -> list[Face]:
    heights = lamp.heights(face.corners)
    level = LEVEL * float(np.abs(heights).max(initial=1.0))
    if heights.min() >= -level or heights.max() <= level:
        return [face]
    return [face.part(clip(face.corners, heights)), face.part(clip(face.corners, -heights))]


def band_table(scene: Scene, nodes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return (rows, K): what a surface of each row sends out in every band under unit irradiance x pi (theory.md (R.41)).

    Rows are the materials, a black one, then the texels of every texture in the order of the materials.

    Args:
        scene: whose materials.
        nodes: (n,) in nm.
        weights: (K, n) from transport to bands.
    """
    used = {shape.material for shape in scene.shapes}
    rows = np.zeros((len(scene.materials) + 1, len(weights)))
    texels = [rows]
    for i, (name, material) in enumerate(scene.materials.items()):
        if isinstance(material, Diffuse) and name in used:
            rows[i] = weights @ material.reflectance.at(nodes)
        elif isinstance(material, Textured):
            mixed = material.weights.reshape(-1, len(material.basis)).astype(np.float64)
            texels.append(mixed @ (material.table(nodes) @ weights.T) if name in used else np.zeros((len(mixed), len(weights))))
    return np.concatenate(texels)


def why_ambiguous(faces: list[Face], sky: bool) -> str | None:
    """Say what makes it unclear which face is in front of which, or what of the sky a face sees; None when all is proven clear."""
    if not faces:
        return None
    most = max(len(face.corners) for face in faces)
    corners = np.stack([np.concatenate([f.corners, np.repeat(f.corners[-1:], most - len(f.corners), 0)]) for f in faces])
    normal, start = np.stack([f.normal for f in faces]), corners[:, 0]
    heights = np.einsum("fk,gmk->fgm", normal, corners) - np.einsum("fk,fk->f", normal, start)[:, None, None]
    level = LEVEL * float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    highest, lowest = heights.max(2), heights.min(2)
    if sky and np.any(highest > level):
        return "something rises above a face and may hide a part of the sky from it"
    low, high = corners.min(1), corners.max(1)
    extent = (high - low) > level
    apart = ((low[:, None] >= high[None] - level) | (low[None] >= high[:, None] - level)) & (extent[:, None] | extent[None])
    close = np.triu(~apart.any(2), 1)
    across = (highest > level) & (lowest < -level)
    if np.any(across & across.T & close):
        return "two faces may cross"
    one_plane = (highest <= level) & (lowest >= -level)
    for i, j in np.argwhere(one_plane & one_plane.T & close):
        if _overlap(faces[i], faces[j], level):
            return "two faces overlap in one plane"
    return None


def _overlap(a: Face, b: Face, level: float) -> bool:
    """Tell whether two convex faces of one plane share an area: no side of either parts them."""
    for one, other in ((a, b), (b, a)):
        for start, stop in zip(one.corners, np.roll(one.corners, -1, 0)):
            outwards = np.cross(stop - start, one.normal)
            length = np.linalg.norm(outwards)
            if length > 0 and np.all((other.corners - start) @ (outwards / length) >= -level):
                return False
    return True
