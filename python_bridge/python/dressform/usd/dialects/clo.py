"""CLO / Marvelous Designer, as Unreal's importer reads them.

Panels are face subsets of family `pattern` like ours; their fabric stands on the subset
(`CloFabricAPI`), in millimetres and grams; seams are edge subsets of family `sewing` that hold
flat pairs of points; panel coordinates are the UV times `restPositionScale`, V pointing down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

#: clo attribute -> (fabric field, SI value of one unit)
_FABRIC = {
    "stretchWarp": ("stretch_warp", 1e-3),  # g/s^2 -> N/m
    "stretchWeft": ("stretch_weft", 1e-3),
    "bendingWarp": ("bending_warp", 1e-9),  # g mm^2/s^2 -> N m
    "bendingWeft": ("bending_weft", 1e-9),
    "density": ("density", 1e3),  # g/mm^2 -> kg/m^2
    "friction": ("friction", 1.0),
    "thickness": ("thickness", 1e-3),  # mm -> m
}
#: Both sides of the bias, averaged.
_BIAS = {
    "shear": ("shearLeft", "shearRight", 1e-3),
    "bending_shear": ("bendingBiasLeft", "bendingBiasRight", 1e-9),
}


def fabric_values(prim: Usd.Prim) -> dict[str, float]:
    """Fabric fields (SI) that a pattern subset carries."""

    def get(name: str) -> float | None:
        value = prim.GetAttribute(f"primvars:clo:{name}").Get()
        return float(np.ravel(value)[0]) if value is not None and np.size(value) else None

    values = {}
    for name, (field, unit) in _FABRIC.items():
        if (value := get(name)) is not None:
            values[field] = value * unit
    for field, (left, right, unit) in _BIAS.items():
        sides = [side for side in (get(left), get(right)) if side is not None]
        if sides:
            values[field] = sum(sides) / len(sides) * unit
    return values


def rest_position_scale(prim: Usd.Prim) -> tuple[float, float] | None:
    """Metres-less scale from UV to the panel's plane, V already flipped; None if not CLO's."""
    for name in ("restPositionScale", "primvars:restPositionScale", "clo:restPositionScale"):
        value = prim.GetAttribute(name).Get()
        if value is not None and len(value) == 2:
            return float(value[0]), -float(value[1])
    return None


def sewing(prim: Usd.Prim) -> list[tuple[str, NDArray[np.int64]]]:
    """Name and flat pairs of points of each edge subset of family `sewing`, not checked."""
    seams = []
    for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)):
        if subset.GetFamilyNameAttr().Get() != "sewing":
            continue
        flat = np.array(subset.GetIndicesAttr().Get() or [], dtype=np.int64)
        seams.append((subset.GetPrim().GetName(), flat))
    return seams
