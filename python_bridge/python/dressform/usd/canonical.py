"""Layers whose bytes depend on what they say alone.

``Sdf.CopySpec`` and flattening set the fields of a spec in the order of addresses in memory, and
crate files keep the order in which fields were set: the same content would now and then give
other bytes, and so another content hash.
"""

from __future__ import annotations

from pxr import Sdf


def in_fixed_order(layer: Sdf.Layer) -> Sdf.Layer:
    """A copy of a flattened layer with every spec's fields set in the order of their names."""
    copy = Sdf.Layer.CreateAnonymous(layer.GetDisplayName())
    _fields(layer.pseudoRoot, copy.pseudoRoot)
    for prim in layer.rootPrims:
        _prim(prim, Sdf.PrimSpec(copy, prim.name, prim.specifier, prim.typeName))
    return copy


def _prim(old: Sdf.PrimSpec, new: Sdf.PrimSpec) -> None:
    if old.variantSets:
        raise ValueError(f"<{old.path}> has variants: the layer is not flattened")
    _fields(old, new)
    for prop in old.properties:
        if isinstance(prop, Sdf.RelationshipSpec):
            copy = Sdf.RelationshipSpec(new, prop.name, prop.custom, prop.variability)
        else:
            copy = Sdf.AttributeSpec(new, prop.name, prop.typeName, prop.variability, prop.custom)
        _fields(prop, copy)
    for child in old.nameChildren:
        _prim(child, Sdf.PrimSpec(new, child.name, child.specifier, child.typeName))


def _fields(old: Sdf.Spec, new: Sdf.Spec) -> None:
    for key in sorted(old.ListInfoKeys()):
        if key == "targetPaths":
            new.targetPathList.CopyItems(old.targetPathList)
        elif key == "connectionPaths":
            new.connectionPathList.CopyItems(old.connectionPathList)
        elif key == "timeSamples":
            for time in old.layer.ListTimeSamplesForPath(old.path):
                new.layer.SetTimeSample(new.path, time, old.layer.QueryTimeSample(old.path, time))
        else:
            new.SetInfo(key, old.GetInfo(key))
