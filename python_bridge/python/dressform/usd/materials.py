"""Materials of the garments, brought into the layer that holds them.

A reference to a garment alone would leave its bindings dangling, so the bound materials are copied
beside the garments and bound again. Bindings are resolved by USD (direct, inherited, through
collections) before that, so that what comes out is direct and needs nothing else.
"""

from __future__ import annotations

from pxr import Sdf, Usd, UsdGeom, UsdShade

from .stage import Source

PURPOSES = ("", "full", "preview", "physics")


class Materials:
    """Copies materials from a flattened stage into ``layer`` below ``scope``, each once."""

    def __init__(self, source: Source, flat: Sdf.Layer, layer: Sdf.Layer, scope: Sdf.Path) -> None:
        self.source = source
        self.flat = flat
        self.layer = layer
        self.scope = scope
        self.copies: dict[Sdf.Path, Sdf.Path] = {}

    def bind(self, original: Usd.Prim, copy: Usd.Prim) -> None:
        """Binds a copied garment, and its subsets, as the original is bound."""
        whole = self._bindings(original)
        self._author(copy, whole)
        for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(original)):
            prim = subset.GetPrim()
            own = self._bindings(prim)
            target = copy.GetStage().GetPrimAtPath(copy.GetPath().AppendChild(prim.GetName()))
            if target:
                self._author(target, {p: m for p, m in own.items() if whole.get(p) != m})

    def _bindings(self, prim: Usd.Prim) -> dict[str, Sdf.Path]:
        """Material of each purpose; a purpose that only falls back to the general one is left out."""
        found: dict[str, Sdf.Path] = {}
        api = UsdShade.MaterialBindingAPI(prim)
        for purpose in PURPOSES:
            material, _ = api.ComputeBoundMaterial(purpose) if purpose else api.ComputeBoundMaterial()
            if material and found.get("") != material.GetPath():
                found[purpose] = material.GetPath()
        return found

    def _author(self, prim: Usd.Prim, bindings: dict[str, Sdf.Path]) -> None:
        for purpose, path in bindings.items():
            material = UsdShade.Material(prim.GetStage().GetPrimAtPath(self._copied(path)))
            UsdShade.MaterialBindingAPI.Apply(prim).Bind(
                material,
                UsdShade.Tokens.fallbackStrength,
                purpose or UsdShade.Tokens.allPurpose,
            )

    def _copied(self, path: Sdf.Path) -> Sdf.Path:
        if path in self.copies:
            return self.copies[path]
        if not self.layer.GetPrimAtPath(self.scope):
            Sdf.CreatePrimInLayer(self.layer, self.scope)
            scope = self.layer.GetPrimAtPath(self.scope)
            scope.specifier, scope.typeName = Sdf.SpecifierDef, "Scope"
        taken = {copy.name for copy in self.copies.values()}
        target = self.scope.AppendChild(free_name(path.name, taken))
        Sdf.CopySpec(self.flat, path, self.layer, target)
        self._cut_loose(path, target)
        self.copies[path] = target
        return target

    def _cut_loose(self, original: Sdf.Path, copy: Sdf.Path) -> None:
        """Drops connections and targets that lead out of the material, with a note."""
        for where in dangling(self.layer, copy):
            self.source.note(f"{where} leads out of the material and was left out", original)


def dangling(layer: Sdf.Layer, root: Sdf.Path) -> list[str]:
    """Removes targets and connections below ``root`` that lead out of it; names what had them."""
    removed = []
    paths: list[Sdf.Path] = []
    layer.Traverse(root, paths.append)
    for path in paths:
        spec = layer.GetObjectAtPath(path)
        if isinstance(spec, Sdf.RelationshipSpec):
            listed = spec.targetPathList
        elif isinstance(spec, Sdf.AttributeSpec):
            listed = spec.connectionPathList
        else:
            continue
        items = list(listed.GetAddedOrExplicitItems())
        inside = [item for item in items if item.HasPrefix(root)]
        if len(inside) != len(items):
            removed.append(path.name)
            listed.ClearEditsAndMakeExplicit()
            listed.explicitItems = inside
    return sorted(removed)


def free_name(name: str, taken: set[str]) -> str:
    """The name, numbered if it is taken."""
    number, candidate = 0, name
    while candidate in taken:
        number += 1
        candidate = f"{name}_{number}"
    return candidate
