"""Fabrics: from the material bound to a panel or its mesh.

What the material says itself (GarmentFabricAPI attributes, or those of a known dialect) lies over
a preset, which it names or is named after. A name that is not known falls back to cotton.
"""

from __future__ import annotations

import re

import numpy as np
from pxr import Usd, UsdShade

from ..model import FABRIC_FIELDS, FABRIC_PRESETS, Fabric
from .dialects import clo, physics
from .stage import Source

DEFAULT = "cotton"
#: Fields that may be zero; the others must be above it.
MAY_BE_ZERO = {"bending_warp", "bending_weft", "bending_shear", "friction"}


def read_fabric(source: Source, prim: Usd.Prim) -> Fabric:
    """The fabric of a panel's subset or of a mesh."""
    values = clo.fabric_values(prim)
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    if not material:
        return Fabric(values=_checked(source, prim, values))
    owner = material.GetPrim()
    values = {**physics.fabric_values(source, owner), **_own_values(owner), **values}
    stated = owner.GetAttribute("garment:fabric:preset").Get()
    name = str(stated) if stated else owner.GetName()
    preset = preset_named(name)
    if preset is None:
        if stated or not values:
            source.note(f"no fabric is called {name!r}: {DEFAULT} is taken", owner)
        preset = DEFAULT
    return Fabric(preset, owner.GetName(), _checked(source, owner, values))


def preset_named(name: str) -> str | None:
    """The preset that a name stands for: the whole of it or one of its words, as in `Denim_Blue`."""
    words = re.findall(r"[a-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())
    named = [word for word in words if word in FABRIC_PRESETS]
    return named[0] if len(set(named)) == 1 else None


def _own_values(material: Usd.Prim) -> dict[str, float]:
    values = {}
    for field in FABRIC_FIELDS:
        head, *tail = field.split("_")
        name = "garment:fabric:" + head + "".join(word.capitalize() for word in tail)
        value = material.GetAttribute(name).Get()
        if value is not None:
            values[field] = float(value)
    return values


def _checked(source: Source, prim: Usd.Prim, values: dict[str, float]) -> dict[str, float]:
    for field, value in values.items():
        if not np.isfinite(value) or value < 0.0 or (value == 0.0 and field not in MAY_BE_ZERO):
            raise source.bad(f"{field} is {value}, which no cloth has", prim, field)
    return values
