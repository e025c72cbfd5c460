"""AOUSD deformables (`physics:`, OpenUSD-proposals 111) and Omniverse (`omniphysics:`).

Both describe a surface deformable by rest points in the mesh's own units and triangles over them;
Omniverse shortens `Vertex` to `Vtx` and writes `flatDefault` for `flat`. Materials give a volume
density, a thickness and moduli (force over area), which times the thickness are the membrane's
density and stiffness.
"""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdPhysics

from ...model import Floats, MeshOrigin
from ..stage import Source

#: (namespace, rest points, rest triangles, value of restBendAnglesDefault for flat cloth)
REST_SHAPES = (
    ("physics", "restShapePoints", "restTriVertexIndices", "flat"),
    ("omniphysics", "restShapePoints", "restTriVtxIndices", "flatDefault"),
)

_STIFFNESS = {
    "surfaceStretchStiffness": ("stretch_warp", "stretch_weft"),
    "surfaceShearStiffness": ("shear",),
}

#: Rest points this far out of one plane z = const, over the panel's size, are no flat panels.
FLAT = 1e-4


def rest_corners(source: Source, prim: Usd.Prim, origin: MeshOrigin) -> tuple[str, Floats] | None:
    """Attribute and (u, v) of each triangle's corners in the mesh's units, shape [t, 3, 2].

    None where there is no rest shape, or none that is flat and fits the mesh's triangles.
    """
    for space, points_name, triangles_name, _ in REST_SHAPES:
        name = f"{space}:{points_name}"
        value = prim.GetAttribute(name).Get()
        if value is None or len(value) == 0:
            continue
        rest = np.array(value, dtype=np.float64)
        listed = prim.GetAttribute(f"{space}:{triangles_name}").Get()
        triangles = origin.face_vertex_indices if listed is None else np.array(listed, np.int64)
        triangles = triangles.reshape(-1, 3) if triangles.size % 3 == 0 else triangles[:0]
        if (origin.face_vertex_counts != 3).any() or len(triangles) != len(origin.face_vertex_counts):
            source.note(f"{name} does not fit the mesh's triangles and is not used", prim)
            continue
        out = np.flatnonzero((triangles < 0) | (triangles >= len(rest)))
        if len(out):
            message = f"names rest point {triangles.ravel()[out[0]]}, but there are {len(rest)}"
            raise source.bad(message, prim, f"{space}:{triangles_name}", out[0] // 3)
        bad = np.flatnonzero(~np.isfinite(rest).all(axis=1))
        if len(bad):
            raise source.bad("the rest point is not finite", prim, name, bad[0])
        if np.ptp(rest[:, 2]) > FLAT * np.ptp(rest[:, :2], axis=0).max():
            source.note(f"{name} is not flat: it holds no panels and is not used", prim)
            continue
        return name, rest[triangles.ravel()[origin.corner_of_triangle], :2]
    return None


def fabric_values(source: Source, material: Usd.Prim) -> dict[str, float]:
    """Fabric fields (SI) that the material gives; bending stiffness is left to the preset since
    its unit is not settled between the dialects."""
    values: dict[str, float] = {}
    unit = source.frame.meters_per_unit
    mass = UsdPhysics.GetStageKilogramsPerUnit(source.stage)
    for space in ("omniphysics", "physics"):  # AOUSD's names win

        def get(name: str, space: str = space) -> float:
            value = material.GetAttribute(f"{space}:{name}").Get()
            return float(value) if isinstance(value, (int, float)) else 0.0

        thickness = (get("thickness") or get("surfaceThickness")) * unit
        density = get("density") * mass / unit**3
        if thickness > 0.0:
            values["thickness"] = thickness
            if density > 0.0:
                values["density"] = density * thickness
            for name, fields in _STIFFNESS.items():
                if get(name) > 0.0:
                    modulus = get(name) * mass / unit
                    values.update(dict.fromkeys(fields, modulus * thickness))
        if get("dynamicFriction") > 0.0:
            values["friction"] = get("dynamicFriction")
    return values
