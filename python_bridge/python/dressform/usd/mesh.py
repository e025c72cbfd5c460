"""Meshes: points in the world, faces as triangles, and the maps back.

A triangle's corners remember which entry of ``faceVertexIndices`` they are, so that any
faceVarying value can be read for them and faces, n-gons included, stay as they were on writing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from ..model import Floats, MeshOrigin
from .polygon import triangulate
from .stage import Source, apply

#: Twice a triangle's area over its longest edge squared; below it has no area. f32 coordinates
#: resolve about 1e-7 of an edge.
DEGENERATE = 1e-9


def read_mesh(
    source: Source, prim: Usd.Prim, world_from_local: Floats | None = None
) -> tuple[Floats, NDArray[np.uint32], MeshOrigin]:
    """World points, outward triangles and the way back.

    Args:
        world_from_local: instead of the prim's own transform (skinned meshes live in their
            skeleton's space).
    """
    mesh = UsdGeom.Mesh(prim)
    local = _points(source, mesh)
    counts, indices = _faces(source, mesh, len(local))
    transform = source.world_from_local(prim) if world_from_local is None else world_from_local
    points = apply(transform, local)
    face, corner = triangulate(points, counts, indices)
    keep = np.isin(face, _holes(source, mesh), invert=True)
    face, corner = face[keep], corner[keep]
    left_handed = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    if left_handed != (np.linalg.det(transform[:3, :3]) < 0.0):
        corner = corner[:, ::-1]  # counter-clockwise seen from outside, as the core wants it
    origin = MeshOrigin(
        file=source.file,
        path=str(prim.GetPath()),
        frame=source.frame,
        world_from_local=transform,
        face_vertex_counts=counts,
        face_vertex_indices=indices,
        face_of_triangle=face.astype(np.uint32),
        corner_of_triangle=np.ascontiguousarray(corner).astype(np.uint32),
    )
    return points, indices[corner].astype(np.uint32), origin


def degenerate_triangles(points: Floats, triangles: NDArray[np.integer]) -> NDArray[np.int64]:
    """Triangles without area; ``points`` may be [n, 3] (with indices) or corners [t, 3, d]."""
    corners = points if points.ndim == 3 else points[triangles]
    if corners.shape[2] == 2:
        corners = np.concatenate([corners, np.zeros((*corners.shape[:2], 1))], axis=2)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    twice = np.linalg.norm(np.cross(a, b), axis=1)
    longest = np.max([(e * e).sum(1) for e in (a, b, a - b)], axis=0)
    return np.flatnonzero(twice <= DEGENERATE * longest)


def _points(source: Source, mesh: UsdGeom.Mesh) -> Floats:
    prim = mesh.GetPrim()
    value = source.value(mesh.GetPointsAttr())
    if value is None or len(value) == 0:
        raise source.bad("the mesh has no points", prim, "points")
    points = np.array(value, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise source.bad(f"the point is not finite: {value[int(bad[0])]}", prim, "points", bad[0])
    return points


def _faces(
    source: Source, mesh: UsdGeom.Mesh, point_count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    prim = mesh.GetPrim()
    counts = np.array(source.value(mesh.GetFaceVertexCountsAttr()) or [], dtype=np.int64)
    indices = np.array(source.value(mesh.GetFaceVertexIndicesAttr()) or [], dtype=np.int64)
    if len(counts) == 0:
        raise source.bad("the mesh has no faces", prim, "faceVertexCounts")
    small = np.flatnonzero(counts < 3)
    if len(small):
        message = f"a face needs at least 3 corners, this one has {counts[small[0]]}"
        raise source.bad(message, prim, "faceVertexCounts", small[0])
    if counts.sum() != len(indices):
        message = f"{len(indices)} indices, but faceVertexCounts ask for {counts.sum()}"
        raise source.bad(message, prim, "faceVertexIndices")
    out = np.flatnonzero((indices < 0) | (indices >= point_count))
    if len(out):
        message = f"names point {indices[out[0]]}, but there are {point_count}"
        raise source.bad(message, prim, "faceVertexIndices", out[0])
    return counts, indices


def _holes(source: Source, mesh: UsdGeom.Mesh) -> NDArray[np.int64]:
    return np.array(source.value(mesh.GetHoleIndicesAttr()) or [], dtype=np.int64)
