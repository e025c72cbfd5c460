"""The refitted pattern as USD: our primvar, and the rest shape in the physics dialects.

``primvars:garment:pattern`` holds (u, v) in metres, grain turned back, indexed: one value for each
(point, 2D position). The physics names hold the same panels as points in the mesh's own units, at
z = 0, with triangles in the order of the mesh's own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from ..model import Floats, GarmentSource, MeshOrigin
from .dialects.physics import REST_SHAPES
from .panels import SAME_PATTERN_POINT
from .pattern import panel_from_uv

APPLIED = ("PhysicsSurfaceDeformableSimAPI", "OmniPhysicsSurfaceDeformableSimAPI")


def uv_of_corners(garment: GarmentSource, corner_pattern: Floats) -> Floats:
    """(u, v) in metres of each triangle's corners, shape [t, 3, 2]: grain turned back."""
    back = panel_from_uv(garment.panels)[garment.panel_of_triangle]
    return np.einsum("tji,tkj->tki", back, corner_pattern)


def write_rest_shape(
    prim: Usd.Prim, garment: GarmentSource, origin: MeshOrigin, uv: Floats, meters_per_unit: float
) -> None:
    """Authors the pattern and the rest shapes on a garment's mesh."""
    values, index = _vertices(garment, origin, uv)
    _write_primvar(prim, origin, values, index)
    rest = np.zeros((len(values), 3))
    rest[:, :2] = values / meters_per_unit
    triangles = _authored_winding(origin, index)
    types = Sdf.ValueTypeNames
    for space, points_name, triangles_name, flat in REST_SHAPES:
        points = prim.CreateAttribute(f"{space}:{points_name}", types.Point3fArray, False)
        points.Set(Vt.Vec3fArray.FromNumpy(rest.astype(np.float32)))
        faces = prim.CreateAttribute(f"{space}:{triangles_name}", types.Int3Array, False)
        faces.Set(Vt.Vec3iArray.FromNumpy(triangles.astype(np.int32)))
        angles = prim.CreateAttribute(
            f"{space}:restBendAnglesDefault", types.Token, False, Sdf.VariabilityUniform
        )
        angles.Set(flat)
    for schema in APPLIED:
        prim.AddAppliedSchema(schema)


def _vertices(garment: GarmentSource, origin: MeshOrigin, uv: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Distinct (panel, point, position) in order of first use, and their index by corner."""
    points = origin.face_vertex_indices[origin.corner_of_triangle]
    panel = np.broadcast_to(garment.panel_of_triangle[:, None], points.shape)
    cell = np.round(uv / SAME_PATTERN_POINT).astype(np.int64)
    key = np.concatenate([panel[..., None], points[..., None], cell], axis=2).reshape(-1, 4)
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    return uv.reshape(-1, 2)[first[order]], rank[index.ravel()].reshape(-1, 3)


def _write_primvar(prim: Usd.Prim, origin: MeshOrigin, values: Floats, index: NDArray[np.int64]) -> None:
    of_corner = np.zeros(len(origin.face_vertex_indices), dtype=np.int64)
    of_corner[origin.corner_of_triangle] = index
    var = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
        "garment:pattern", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    var.Set(Vt.Vec2fArray.FromNumpy(values.astype(np.float32)))
    var.SetIndices(Vt.IntArray.FromNumpy(of_corner.astype(np.int32)))


def _authored_winding(origin: MeshOrigin, index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles wound as the mesh's faces are, where reading had to turn them: a triangle cut from
    a face keeps the face's winding if its corners are an even permutation of their order."""
    a, b, c = origin.corner_of_triangle.astype(np.int64).T
    odd = ((a > b).astype(int) + (b > c) + (a > c)) % 2 == 1
    return np.where(odd[:, None], index[:, ::-1], index)
