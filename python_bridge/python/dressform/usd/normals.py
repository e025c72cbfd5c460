"""New normals for a moved mesh, with the smooth and sharp edges that the source's normals show.

Corners that share a point and had one normal on the source form a fan; a fan's new normal is the
sum of its triangles' unit normals weighted by the corner's angle [Thürmer 1998]. Points sewn
together without offset whose source normals agreed are one fan too, so that a seam of an unwelded
garment stays as smooth in shading as it was.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..model import Floats, GarmentSource, MeshOrigin
from .graph import components

#: Source normals closer than this (cosine) belong to one fan.
SAME_NORMAL = 0.999


def vertex_normals(garment: GarmentSource, origin: MeshOrigin, points: Floats, old: Floats | None) -> Floats:
    """Normals for each point, shape [n, 3].

    Args:
        points: new points in any right-handed space; the normals are in the same.
        old: source normals for each point, or None where the source had none.
    """
    corner_points = origin.face_vertex_indices[origin.corner_of_triangle]
    total = np.zeros_like(points)
    np.add.at(total, corner_points.ravel(), corner_weights(points, corner_points, origin).reshape(-1, 3))
    fan = _sewn(garment, len(points), old)
    joined = np.zeros_like(points)
    np.add.at(joined, fan, total)
    return _unit(joined[fan])


def corner_normals(origin: MeshOrigin, points: Floats, old: Floats) -> Floats:
    """Normals for each face corner, shape [corners, 3]; ``old`` has the same shape."""
    indices = origin.face_vertex_indices
    quantised = np.round(_unit(old) * 512.0).astype(np.int64)
    key = np.concatenate([indices[:, None], quantised], axis=1)
    _, fan = np.unique(key, axis=0, return_inverse=True)
    fan = fan.ravel()
    weights = corner_weights(points, indices[origin.corner_of_triangle], origin)
    total = np.zeros((int(fan.max()) + 1, 3))
    np.add.at(total, fan[origin.corner_of_triangle].ravel(), weights.reshape(-1, 3))
    return _unit(total[fan])


def face_normals(origin: MeshOrigin, points: Floats) -> Floats:
    """Normals for each face, shape [faces, 3]."""
    corners = points[origin.face_vertex_indices[origin.corner_of_triangle]]
    area = area_normals(corners, origin)
    total = np.zeros((len(origin.face_vertex_counts), 3))
    np.add.at(total, origin.face_of_triangle, area)
    return _unit(total)


def corner_weights(points: Floats, corner_points: NDArray[np.int64], origin: MeshOrigin) -> Floats:
    """The triangle's unit normal times the corner's angle, shape [t, 3, 3]."""
    corners = points[corner_points]
    normal = _unit(area_normals(corners, origin))
    forward = _unit(np.roll(corners, -1, axis=1) - corners)
    backward = _unit(np.roll(corners, 1, axis=1) - corners)
    angle = np.arccos(np.clip((forward * backward).sum(axis=2), -1.0, 1.0))
    return normal[:, None, :] * angle[:, :, None]


def area_normals(corners: Floats, origin: MeshOrigin) -> Floats:
    """On the side that the mesh's own winding calls its front, shape [t, 3]."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if len(origin.turned):
        normal[origin.turned] *= -1.0
    return normal


def _sewn(garment: GarmentSource, count: int, old: Floats | None) -> NDArray[np.int64]:
    """Smallest point of each sewn group that shares a normal, shape [n]."""
    pairs = [s.pairs.astype(np.int64) for s in garment.seams if not s.offset]
    if not pairs:
        return np.arange(count)
    tied = np.concatenate(pairs)
    if old is not None:
        unit = _unit(old)
        tied = tied[(unit[tied[:, 0]] * unit[tied[:, 1]]).sum(axis=1) > SAME_NORMAL]
    return components(count, tied)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)
