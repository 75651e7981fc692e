"""Flat faces as a viewpoint sees them: projected to the picture, the nearest at each point, and back into space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optsim.render.cells import Cells, NotFlat
from optsim.render.flat_faces import Face
from optsim.render.frame import Frame
from optsim.render.polygons import PolygonSet, area, clip, clip_to_box
from scenes.viewpoint import Orthographic, Perspective, Viewpoint

NEAR = 1e-9
"""What is nearer to the eye than this share of the farthest corner's distance is not seen."""
EDGE_ON = 1e-12
"""Faces whose normal is perpendicular to the view up to this cosine cover nothing."""
SMALLEST_AREA = 1e-15
"""Faces that cover less of the picture than this, in pixels, are left out."""


@dataclass(frozen=True)
class Seen:
    """Hold cells that show the front of a reflecting face, with the face and its row of the band table."""

    cells: Cells
    face: np.ndarray
    row: np.ndarray

    def take(self, chosen: np.ndarray) -> Seen:
        """Return some of them."""
        return Seen(self.cells.take(chosen), self.face[chosen], self.row[chosen])


class FlatView:
    """Project faces.

    Args:
        view: orthographic or perspective.
        frame: renderer coordinates.
        film: (height, width) in pixels.
        faces: the faces.

    Attributes:
        polygons: those that cover some of the picture.
        face: (P,) number of the face of each polygon.
        front: (F,) whether a face shows its front.
        normal: (F, 3).
        segments: (S, 4) all borders in the picture, those between texels too.

    Raises:
        NotFlat: when a texture reaches behind the eye.
    """

    def __init__(self, view: Viewpoint, frame: Frame, film: tuple[int, int], faces: list[Face]) -> None:
        assert isinstance(view, Orthographic | Perspective)
        self.film, self.faces = film, faces
        self._right, self._up, self._forward = view.axes()
        self._eye = frame.to_units(np.asarray(view.origin))
        self._parallel = isinstance(view, Orthographic)
        self._half = view.half_height / frame.unit if isinstance(view, Orthographic) else float(np.tan(np.deg2rad(view.fov_deg) / 2))
        self._half_width = self._half * film[1] / film[0]
        depths = [(f.corners - self._eye) @ self._forward for f in faces]
        self._near = NEAR * max((float(np.abs(d).max()) for d in depths), default=1.0)
        self.normal = np.array([f.normal for f in faces]).reshape(-1, 3)
        self._start = np.array([f.corners[0] for f in faces]).reshape(-1, 3)
        toward = -self.normal @ self._forward if self._parallel else np.sum((self._eye - self._start) * self.normal, 1)
        self.front = toward > 0
        self._nearness = self._planes(toward)
        kept, polygons = [], []
        for i, face in enumerate(faces):
            if abs(toward[i]) <= EDGE_ON:
                continue
            outline = clip_to_box(self.project(face.corners), film[1], film[0])
            if abs(area(outline)) > SMALLEST_AREA:
                kept.append(i)
                polygons.append(outline)
        self.face = np.array(kept, np.int64)
        self.polygons = PolygonSet(polygons)
        lines = [self._texel_lines(faces[i]) for i in kept if faces[i].texture is not None]
        self.segments = np.concatenate([self.polygons.segments, *lines])

    def _planes(self, toward: np.ndarray) -> np.ndarray:
        """Return (F, 3): how near the plane of each face is at a point (1, x, y) of the picture: -t where rays are parallel, else 1 / t."""
        corners = np.array([[0.0, 0.0], [self.film[1], 0.0], [0.0, self.film[0]]])
        origin, direction = self._rays(corners[:, 0], corners[:, 1])
        safe = np.where(np.abs(toward) > EDGE_ON, toward, 1.0)
        if self._parallel:
            at = np.einsum("fk,fpk->fp", self.normal, self._start[:, None] - origin) / safe[:, None]
        else:
            at = -(self.normal @ direction.T) / safe[:, None]
        return np.stack([at[:, 0], (at[:, 1] - at[:, 0]) / self.film[1], (at[:, 2] - at[:, 0]) / self.film[0]], 1)

    def _rays(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return origin and direction (of forward component 1) of the rays through picture points."""
        across = (2 * x / self.film[1] - 1)[..., None] * self._half_width * self._right
        down = (2 * y / self.film[0] - 1)[..., None] * self._half * self._up
        if self._parallel:
            return self._eye + across - down, np.broadcast_to(self._forward, (*x.shape, 3))
        return np.broadcast_to(self._eye, (*x.shape, 3)), self._forward + across - down

    def project(self, corners: np.ndarray) -> np.ndarray:
        """Return the (m, 2) picture points of what of a polygon lies before the eye; may be empty."""
        away = corners - self._eye
        away = clip(away, away @ self._forward - self._near) if len(away) else away
        if len(away) == 0:
            return np.zeros((0, 2))
        scale = 1.0 if self._parallel else 1 / (away @ self._forward)
        a, b = away @ self._right * scale / self._half_width, -(away @ self._up) * scale / self._half
        return np.stack([(a + 1) / 2 * self.film[1], (b + 1) / 2 * self.film[0]], 1)

    def _texel_lines(self, face: Face) -> np.ndarray:
        assert face.texture is not None
        corner, along_u, along_v = face.texture
        u, v = along_u / (along_u @ along_u), along_v / (along_v @ along_v)
        rows, columns = face.texels
        ends = [(corner + u * i / columns, corner + u * i / columns + v) for i in range(1, columns)]
        ends += [(corner + v * i / rows, corner + v * i / rows + u) for i in range(1, rows)]
        if not ends:
            return np.zeros((0, 4))
        points = np.array(ends).reshape(-1, 3)
        if not np.all((points - self._eye) @ self._forward > self._near):
            raise NotFlat("a texture reaches behind the eye")
        return self.project(points).reshape(-1, 4)

    def nearest(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the number of the face that each picture point shows, -1 for none."""
        point, polygon = self.polygons.covering(x, y)
        found = np.full(len(x), -1)
        if not len(point):
            return found
        face = self.face[polygon]
        near = self._at(x[point], y[point], face)
        starts = np.flatnonzero(np.diff(point, prepend=-1))
        most = np.repeat(np.maximum.reduceat(near, starts), np.diff(starts, append=len(point)))
        best = np.flatnonzero(near == most)
        found[point[best]] = face[best]
        return found

    def _at(self, x: np.ndarray, y: np.ndarray, face: np.ndarray) -> np.ndarray:
        plane = self._nearness[face]
        found = plane[:, 0] + plane[:, 1] * x + plane[:, 2] * y
        return found

    def seen(self, cells: Cells) -> Seen:
        """Return the cells that show the front of a reflecting face."""
        x, y = cells.middle()
        face = self.nearest(x, y)
        reflecting = np.array([f.light < 0 and not f.black for f in self.faces] + [False]) & np.append(self.front, False)
        chosen = np.flatnonzero(reflecting[face])
        face = face[chosen]
        row = np.array([f.row for f in self.faces], np.int64)[face] if len(chosen) else np.zeros(0, np.int64)
        for number in np.unique(face):
            one = self.faces[number]
            if one.texture is not None:
                here = np.flatnonzero(face == number)
                row[here] += self._texel(one, self.places(x[chosen[here]][:, None], y[chosen[here]][:, None], face[here])[:, 0])
        return Seen(cells.take(chosen), face, row)

    def _texel(self, face: Face, places: np.ndarray) -> np.ndarray:
        assert face.texture is not None
        corner, along_u, along_v = face.texture
        (rows, columns), away = face.texels, places - corner
        i = np.clip(np.floor((1 - away @ along_v) * rows), 0, rows - 1)
        j = np.clip(np.floor(away @ along_u * columns), 0, columns - 1)
        return (i * columns + j).astype(np.int64)

    def places(self, x: np.ndarray, y: np.ndarray, face: np.ndarray) -> np.ndarray:
        """Return the points (C, m, 3) in space of picture points (C, m) on the planes of faces (C,)."""
        plane = self._nearness[face][:, :, None]
        near = plane[:, 0] + plane[:, 1] * x + plane[:, 2] * y
        distance = -near if self._parallel else 1 / near
        origin, direction = self._rays(x, y)
        return origin + distance[..., None] * direction
