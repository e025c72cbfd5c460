"""AOUSD deformables (`physics:`, OpenUSD-proposals 111) and Omniverse (`omniphysics:`).

Both describe a surface deformable by rest points in the mesh's own units and triangles over them;
Omniverse shortens `Vertex` to `Vtx` and writes `flatDefault` for `flat`. Materials give a volume
density, a thickness and moduli (force over area), which times the thickness are the membrane's
density and stiffness.
"""

from __future__ import annotations

from pxr import Usd, UsdPhysics

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
