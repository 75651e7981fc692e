"""How much leaving an effect out can change a picture: bounds from albedo and geometry, estimates where there are none (theory.md R.50)."""

from __future__ import annotations

import numpy as np

from optsim.cube import Bands
from scenes.materials import Lambertian
from scenes.scene import Scene
from scenes.spectrum import Spectrum
from scenes.viewpoint import ThinLens
from scenes.visibility import Faces, albedo_bound, reflecting_faces, used_materials

MAX_PAIRED_THINGS = 600
"""More faces and spheres than this are not bounded pair by pair: all of a surface's light may then land on another."""
MAX_REFLECTIONS = 200
EDGE_CONTRAST = 2.0
"""Step of an edge, in mean radiances, for which the error of leaving out blur is estimated: black beside twice the mean."""
MIN_BORDER = 4.0
"""Length of the borders in a picture, in its heights, that is counted at least: once round the picture."""


def further_light(scene: Scene) -> float:
    """Bound the light reflected twice or more, relative to the brightest surface in the strongest light (theory.md (R.50)).

    A point of face i gets from face or sphere j at most F_ij = min(1, A_j / (pi d^2)) of its radiosity, A_j being the area that j shows
    and d the distance between i and the ball round j; 0 where one does not reach above the plane of the other. The bound holds
    wherever lamps and shadows are. Infinite with glass, metal or plastic, and where white surfaces may hold light for ever.
    """
    if not all(isinstance(m, Lambertian) for m in used_materials(scene).values()):
        return np.inf
    faces = reflecting_faces(scene)
    owner = np.concatenate([faces.owner, faces.sphere_owner]).astype(int)
    if owner.size == 0:
        return 0.0
    rest = np.array([albedo_bound(scene, shape) for shape in scene.shapes])[owner]
    if owner.size > MAX_PAIRED_THINGS:
        return float(rest.max() / (1 - rest.max())) if rest.max() < 1 else np.inf
    share, sees = _shares(faces)
    received, total = np.ones(owner.size), np.zeros(owner.size)
    for _ in range(MAX_REFLECTIONS):
        sent = rest * received
        received = np.minimum(share @ sent, np.max(np.where(sees, sent, 0.0), axis=1))
        total += received
        if received.max() <= 1e-6 * total.max():
            break
    left = float(received.max())
    if left > 0:
        total += left * rest.max() / (1 - rest.max()) if rest.max() < 1 else np.inf
    return float(np.max(rest * total) / rest.max())


def _shares(faces: Faces) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds (things, things) of the share of its radiosity that each gets from each other, and which may see each other."""
    middle, radius, area = _balls(faces)
    gap = _distances(faces, middle) - radius
    near = np.minimum(1.0, area / (np.pi * np.maximum(gap, 1e-100) ** 2))
    sees = _may_see(faces)
    return np.where(sees, np.where(gap > 0, near, 1.0), 0.0), sees


def _balls(faces: Faces) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return middles and radii of balls round faces and spheres, and the largest area each shows."""
    c = faces.corners
    flat = c.mean(1)
    wide = np.linalg.norm(c - flat[:, None], axis=2).max(1, initial=0.0)
    area = sum(np.linalg.norm(np.cross(c[:, i] - c[:, 0], c[:, i + 1] - c[:, 0]), axis=1) / 2 for i in (1, 2))
    spheres = faces.spheres
    return (
        np.concatenate([flat, spheres[:, :3]]),
        np.concatenate([wide, spheres[:, 3]]),
        np.concatenate([np.asarray(area), np.pi * spheres[:, 3] ** 2]),
    )


def _distances(faces: Faces, points: np.ndarray) -> np.ndarray:
    """Return the (things, P) distances from faces (as filled quadrangles) and spheres to points; negative inside a sphere."""
    c, n = faces.corners, faces.normal
    away = points[None] - c[:, :1]
    height = np.einsum("fpk,fk->fp", away, n)
    along = np.roll(c, -1, axis=1) - c
    inside = np.ones(height.shape, bool)
    nearest = np.full(height.shape, np.inf)
    for i in range(4):
        edge, to = along[:, i][:, None], points[None] - c[:, i][:, None]
        inside &= np.einsum("fpk,fpk->fp", np.cross(n[:, None], edge) + 0 * to, to) >= 0
        length = np.maximum(np.sum(edge**2, -1), 1e-300)
        t = np.clip(np.sum(to * edge, -1) / length, 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(to - t[..., None] * edge, axis=-1))
    flat = np.where(inside, np.abs(height), nearest)
    balls = np.linalg.norm(faces.spheres[:, None, :3] - points, axis=2) - faces.spheres[:, 3:]
    return np.concatenate([flat, balls])


def _may_see(faces: Faces) -> np.ndarray:
    """Tell for each pair of faces and spheres whether each reaches above the plane of the other; a sphere does not see itself."""
    flat, balls = len(faces.corners), len(faces.spheres)
    tolerance = 1e-9 * faces.size
    offset = np.einsum("fk,fk->f", faces.normal, faces.corners[:, 0])
    heights = np.einsum("fk,gck->fgc", faces.normal, faces.corners) - offset[:, None, None]
    above = np.ones((flat + balls, flat + balls), bool)
    above[:flat, :flat] = heights.max(2, initial=-np.inf) > tolerance
    rise = faces.normal @ faces.spheres[:, :3].T - offset[:, None] + faces.spheres[:, 3]
    above[:flat, flat:] = rise > tolerance
    found = above & above.T
    found[np.arange(flat + balls), np.arange(flat + balls)] = False
    return found


def colour_change(scene: Scene, low_nm: float, high_nm: float, reflections: int) -> float:
    """Bound the relative change of transport between the middle of a range and any wavelength in it (theory.md (R.51)).

    Each reflection changes it by at most the largest ratio of a material's reflectances, less 1; infinite where a material is not
    diffuse, or black at the middle only.
    """
    worst = 0.0
    for material in used_materials(scene).values():
        if not isinstance(material, Lambertian):
            return np.inf
        for curve in material.curves:
            x = np.concatenate([[low_nm, (low_nm + high_nm) / 2, high_nm], curve.wavelength_nm])
            values = curve.at(x[(x >= low_nm) & (x <= high_nm)])
            if values.max() > 0:
                worst = max(worst, np.inf if values.min() <= 0 else float(values.max() / values.min()) - 1)
    with np.errstate(over="ignore"):
        return float(np.expm1(reflections * np.log1p(worst))) if worst else 0.0


def colour_spread(scene: Scene, low_nm: float, high_nm: float) -> float:
    """Estimate the relative RMS error of rendering all wavelengths at the middle one: equal areas of all colours, lit once."""
    curves = [curve for m in used_materials(scene).values() if isinstance(m, Lambertian) for curve in m.curves]
    if not curves:
        return 1.0
    x = np.linspace(low_nm, high_nm, 257)
    table = np.array([curve.at(x) for curve in curves])
    wrong = np.sqrt(np.mean((table - table[:, [128]]) ** 2, axis=0))
    level = table.mean(0)
    return float(np.max(np.divide(wrong, level, out=np.zeros_like(wrong), where=level > 0)))


def blur_diameter(scene: Scene) -> float:
    """Return the largest diameter of a lens's blur over the scene's corners, as a share of the picture's height (theory.md (R.34))."""
    view, box = scene.viewpoint, scene.bounds()
    if not isinstance(view, ThinLens) or box is None:
        return 0.0
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    depth = (corners - np.asarray(view.origin)) @ view.axes()[2]
    nearest, farthest = max(float(depth.min()), 1e-3 * view.distance_m), max(float(depth.max()), 1e-3 * view.distance_m)
    defocus = max(abs(1 / nearest - 1 / view.distance_m), abs(1 / farthest - 1 / view.distance_m))
    return float(view.aperture_m * defocus / np.tan(np.deg2rad(view.fov_deg) / 2))


def smear_error(diameter: float, border: float) -> float:
    """Estimate the relative RMS error of leaving out a blur (theory.md (R.52)).

    A step of height h that is blurred over a width b is wrong by h^2 b / 12 per unit of its length.

    Args:
        diameter: b, as a share of the picture's height.
        border: length of the steps, in picture heights.
    """
    return float(min(1.0, EDGE_CONTRAST * np.sqrt(diameter * max(border, MIN_BORDER) / 12)))


def border_length(scene: Scene) -> float:
    """Estimate how long the borders in a picture are, in picture heights: a circle round each shape and each texel."""
    box = scene.bounds()
    if box is None:
        return 0.0
    size = float(np.linalg.norm(box[1] - box[0]))
    total = 0.0
    for shape in scene.shapes:
        own = shape.bounds()
        across = float(np.linalg.norm(own[1] - own[0])) / max(size, 1e-300)
        total += np.pi * across * _texels_a_side(scene, shape.material)
    return total


def _texels_a_side(scene: Scene, material: str) -> int:
    from scenes.textures import Textured

    made_of = scene.materials[material]
    return sum(made_of.size) if isinstance(made_of, Textured) else 1


def centre_error(scene: Scene, bands: Bands) -> float:
    """Return the largest relative error, over lights and colours lit once, of reading the light of a band at its centre.

    Against the exact mean over the band of light times reflectance (theory.md (R.3)); a bound where nothing is reflected twice.
    """
    low, high = float(bands.lower.min()), float(bands.upper.max())
    flat = Spectrum.constant(1.0, low, high)
    curves = [curve for m in used_materials(scene).values() if isinstance(m, Lambertian) for curve in m.curves]
    worst = 0.0
    for light in (light.spectrum for light in scene.lights):
        for curve in (flat, *curves):
            nodes = np.unique(np.concatenate([[low, high], curve.wavelength_nm]))
            nodes = nodes[(nodes >= low) & (nodes <= high)]
            mean = light.hat_weights(nodes, bands.lower, bands.upper) @ curve.at(nodes)
            centre = light.at(bands.center) * (flat.hat_weights(nodes, bands.lower, bands.upper) @ curve.at(nodes))
            good = mean > 0
            worst = max(worst, float(np.max(np.abs(centre[good] / mean[good] - 1), initial=0.0)))
    return worst
