"""What marks a prim as a garment, a panel or a seam.

Stages may carry our schemas applied by name or just their attributes (a DCC that does not know a
schema drops it from ``apiSchemas`` and keeps the attributes): both count.
"""

from __future__ import annotations

from pxr import Usd, UsdGeom

PATTERN_FAMILY = "pattern"
SEAM_PREFIX = "garment:seam:"


def applied(prim: Usd.Prim) -> set[str]:
    """Names of applied schemas, registered or not, without instance names."""
    listed = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    op = prim.GetMetadata("apiSchemas")
    named = list(listed) + (list(op.GetAddedOrExplicitItems()) if op else [])
    return {name.split(":")[0] for name in named}


def is_garment(prim: Usd.Prim) -> bool:
    """A mesh with GarmentAPI, garment attributes, or panels."""
    if not prim.IsA(UsdGeom.Mesh):
        return False
    if applied(prim) & {"GarmentAPI", "GarmentSeamAPI"}:
        return True
    if any(p.IsAuthored() for p in prim.GetPropertiesInNamespace("garment")):
        return True
    return bool(panel_subsets(prim))


def panel_subsets(prim: Usd.Prim) -> list[UsdGeom.Subset]:
    """The mesh's face subsets of family `pattern`, in stage order."""
    return [
        s
        for s in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim))
        if s.GetFamilyNameAttr().Get() == PATTERN_FAMILY
        and s.GetElementTypeAttr().Get() == UsdGeom.Tokens.face
    ]
