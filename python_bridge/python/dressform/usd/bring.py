"""What a character refers to outside of its own root prim.

A reference brings one prim and what is below it; relationships and connections that lead elsewhere
(materials in ``/Materials``, say) vanish, and nothing reports it. So each top-level prim that is
referred to comes along, below the character, and the relationships are authored anew.
"""

from __future__ import annotations

from pxr import Sdf, Usd

from .materials import free_name
from .stage import Source


def bring_outside(source: Source, root: Sdf.Path, layer: Sdf.Layer, asset: str) -> list[str]:
    """Authors references to the outside prims and the relationships to them, in ``layer``.

    Returns:
        Notes on what could not be brought (inside instances nothing can be authored).
    """
    notes: list[str] = []
    places: dict[str, Sdf.Path] = {}
    taken = {child.GetName() for child in source.stage.GetPrimAtPath(root).GetAllChildren()}
    for prim in Usd.PrimRange(source.stage.GetPrimAtPath(root)):
        for prop in prim.GetAuthoredProperties():
            targets = _targets(prop)
            outside = [t for t in targets if not t.HasPrefix(root)]
            if not outside:
                continue
            for target in outside:
                top = target.GetPrefixes()[0]
                if str(top) not in places:
                    name = free_name(top.name, taken)
                    taken.add(name)
                    places[str(top)] = root.AppendChild(name)
                    _reference(layer, places[str(top)], top, asset)
            moved = [t if t.HasPrefix(root) else _moved(t, places) for t in targets]
            _author(layer, prim, prop, moved)
    for top, place in sorted(places.items()):
        notes.append(f"<{top}>, which the character refers to, stands at <{place}> in the result")
    return notes


def _targets(prop: Usd.Property) -> list[Sdf.Path]:
    if isinstance(prop, Usd.Relationship):
        return list(prop.GetTargets())
    return list(prop.GetConnections())


def _moved(path: Sdf.Path, places: dict[str, Sdf.Path]) -> Sdf.Path:
    top = path.GetPrefixes()[0]
    return path.ReplacePrefix(top, places[str(top)])


def _reference(layer: Sdf.Layer, place: Sdf.Path, top: Sdf.Path, asset: str) -> None:
    spec = Sdf.CreatePrimInLayer(layer, place)
    spec.specifier = Sdf.SpecifierDef
    spec.referenceList.prependedItems = [Sdf.Reference(asset, top)]


def _author(layer: Sdf.Layer, prim: Usd.Prim, prop: Usd.Property, targets: list[Sdf.Path]) -> None:
    spec = Sdf.CreatePrimInLayer(layer, prim.GetPath())
    if isinstance(prop, Usd.Relationship):
        Sdf.RelationshipSpec(spec, prop.GetName(), prop.IsCustom()).targetPathList.explicitItems = targets
        return
    attribute = Sdf.AttributeSpec(spec, prop.GetName(), prop.GetTypeName(), prop.GetVariability())
    attribute.connectionPathList.explicitItems = targets
