"""Writes a dressed character: a small root layer that references the character, and one crate
file beside it with the garments' arrays.

    /<Root>                     the character, by reference; its up axis and unit are the stage's
    /<Root>/Outfit              the garments, by reference to <stem>.garments-<hash>.usdc
    /<Root>/Outfit/<Garment>    mesh, pattern, weights; the root adds skeleton and certificate
    /<Root>/Outfit/Looks        the garments' materials

Inputs are never edited. Neither file holds times or names of machines: the same input gives the
same bytes.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdSkel, UsdUtils, Vt

from ..errors import BadOutput
from ..model import Character, DressedGarment, Outfit
from . import atomic
from .bring import bring_outside
from .canonical import in_fixed_order
from .materials import Materials, free_name
from .stage import Source, open_stage
from .write_garment import Placement, copy_mesh, write_garment

#: Layer metadata that gives the character's animation its time.
TIME_METADATA = ("timeCodesPerSecond", "framesPerSecond", "startTimeCode", "endTimeCode")


def write_dressed(
    out: str | os.PathLike[str],
    outfit: Outfit,
    character: Character,
    dressed: Sequence[DressedGarment],
    *,
    passed: bool = True,
    broken: Sequence[str] = (),
    clobber: bool = True,
) -> list[str]:
    """Writes the root layer ``out`` and the garments' arrays beside it.

    Args:
        out: ``.usda``, ``.usdc`` or ``.usd``.
        outfit: as read from its stage; opened again to copy what the garments carry.
        character: the target, as read from its stage, which ``out`` will reference.
        dressed: a result for each garment of the outfit.
        passed: whether every threshold was kept.
        broken: thresholds that were broken, in words.
        clobber: whether an existing ``out`` is replaced.

    Returns:
        Notes on what could not be carried over.

    Raises:
        BadOutput: ``out`` cannot be written; an older ``out`` is as it was.
    """
    target = check_target(out, clobber=clobber)
    outfit_source = open_stage(outfit.file, outfit.variants)
    character_source = open_stage(_file_of(character), character.variants)
    _refuse_inputs(target, outfit_source, character_source)
    writer = _Writer(target, outfit_source, character_source, character)
    with atomic.workshop(target) as folder:
        arrays, root = folder / "garments.usdc", folder / f"root{target.suffix}"
        layer = writer.garments(outfit, dressed)
        _export(layer, arrays, target)
        _check_arrays(layer, arrays, target)
        name = atomic.content_name(target, arrays)
        _export(writer.root(dressed, name, passed, broken), root, target)
        before = referenced_arrays(target)
        atomic.install(arrays, target.with_name(name), root, target)
        atomic.remove_old_arrays(target, before - _used_by_others(target) - {name})
    for written in (target, target.with_name(name)):
        known = Sdf.Layer.Find(str(written))
        if known:
            known.Reload(force=True)
    return outfit_source.notes + [n for n in character_source.notes if n not in outfit_source.notes]


class _Writer:
    """The two layers of one result."""

    def __init__(self, target: Path, outfit: Source, character_source: Source, character: Character) -> None:
        self.target = target
        self.source = outfit
        self.character_source = character_source
        self.character = character
        self.place = Placement(character_source, character)
        self.top = Sdf.Path(character.root_path)
        here = character_source.stage.GetPrimAtPath(self.top)
        self.scope_name = free_name("Outfit", {child.GetName() for child in here.GetAllChildren()})
        self.names: list[str] = []

    def garments(self, outfit: Outfit, dressed: Sequence[DressedGarment]) -> Sdf.Layer:
        """The layer of arrays: ``/Outfit`` with meshes and materials."""
        if len(dressed) != len(outfit.garments):
            raise ValueError(f"{len(dressed)} results for {len(outfit.garments)} garments")
        flat = _flattened(self.source, [g.path for g in outfit.garments])
        layer = Sdf.Layer.CreateAnonymous("garments.usdc")
        stage = Usd.Stage.Open(layer)
        scope = Sdf.Path.absoluteRootPath.AppendChild(self.scope_name)
        stage.DefinePrim(scope, "SkelRoot")  # valid by itself; the root layer says what it is there
        stage.SetDefaultPrim(stage.GetPrimAtPath(scope))
        UsdGeom.SetStageUpAxis(stage, self.place.frame.up_axis)
        UsdGeom.SetStageMetersPerUnit(stage, self.place.frame.meters_per_unit)
        materials = Materials(self.source, flat, layer, scope.AppendChild("Looks"))
        taken = {"Looks"}
        for garment, result in zip(outfit.garments, dressed, strict=True):
            name = free_name(garment.name, taken)
            taken.add(name)
            self.names.append(name)
            path = scope.AppendChild(name)
            copy_mesh(self.source, flat, garment, layer, path)
            prim = stage.GetPrimAtPath(path)
            write_garment(self.source, prim, garment, result, self.place)
            prim.CreateAttribute("garment:layer", Sdf.ValueTypeNames.Int, False, Sdf.VariabilityUniform).Set(
                garment.layer
            )
            materials.bind(self.source.stage.GetPrimAtPath(garment.path), prim)
        UsdUtils.ModifyAssetPaths(layer, self._relative)
        return in_fixed_order(layer)

    def root(
        self, dressed: Sequence[DressedGarment], arrays: str, passed: bool, broken: Sequence[str]
    ) -> Sdf.Layer:
        """The layer that is opened: references and everything that is small."""
        layer = Sdf.Layer.CreateAnonymous(f"root{self.target.suffix}")
        top = Sdf.CreatePrimInLayer(layer, self.top)
        top.specifier = Sdf.SpecifierDef
        top.referenceList.prependedItems = [self._character_reference()]
        self._metadata(layer)
        prim = self.character_source.stage.GetPrimAtPath(self.top)
        if prim.IsInstanceable():
            top.SetInfo("instanceable", False)  # else nothing below the character could be added
        self._variants(layer)
        for note in bring_outside(self.character_source, self.top, layer, self._character_asset()):
            self.character_source.note(note)
        scope = Sdf.CreatePrimInLayer(layer, self.top.AppendChild(self.scope_name))
        scope.specifier = Sdf.SpecifierDef
        scope.typeName = "Scope" if self._inside_skel_root() else "SkelRoot"
        scope.referenceList.prependedItems = [Sdf.Reference(f"./{arrays}")]
        for name, result in zip(self.names, dressed, strict=True):
            over = Sdf.CreatePrimInLayer(layer, scope.path.AppendChild(name))
            self._state(over)
            _certificate(over, result.certificate, passed, broken)
        return layer

    def _state(self, over: Sdf.PrimSpec) -> None:
        over.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=["GarmentCertificateAPI"]))
        for name, path in (("garment:character", self.top), ("skel:skeleton", self.character.skeleton_path)):
            rel = Sdf.RelationshipSpec(over, name, False)
            rel.targetPathList.explicitItems = [Sdf.Path(path)]
        _attribute(over, "garment:state", Sdf.ValueTypeNames.Token, "dressed")

    def _inside_skel_root(self) -> bool:
        return bool(self.character_source.stage.GetPrimAtPath(self.top).IsA(UsdSkel.Root))

    def _character_asset(self) -> str:
        return relative_asset(_file_of(self.character), self.target.parent)

    def _character_reference(self) -> Sdf.Reference:
        default = self.character_source.stage.GetRootLayer().defaultPrim
        plain = default in (self.top.name, str(self.top))
        return Sdf.Reference(self._character_asset(), Sdf.Path() if plain else self.top)

    def _variants(self, layer: Sdf.Layer) -> None:
        for path, choices in sorted(self.character.variants.items()):
            if Sdf.Path(path).HasPrefix(self.top):
                spec = Sdf.CreatePrimInLayer(layer, path)
                for name, variant in sorted(choices.items()):
                    spec.variantSelections[name] = variant

    def _metadata(self, layer: Sdf.Layer) -> None:
        layer.defaultPrim = self.top.name
        layer.pseudoRoot.SetInfo("upAxis", self.place.frame.up_axis)
        layer.pseudoRoot.SetInfo("metersPerUnit", self.place.frame.meters_per_unit)
        theirs = self.character_source.stage.GetRootLayer().pseudoRoot
        for key in ("kilogramsPerUnit", *TIME_METADATA):
            if theirs.HasInfo(key):
                layer.pseudoRoot.SetInfo(key, theirs.GetInfo(key))

    def _relative(self, asset: str) -> str:
        return relative_asset(asset, self.target.parent) if os.path.isabs(asset) else asset


def relative_asset(file: str | os.PathLike[str], folder: Path) -> str:
    """The asset path of a file as seen from a layer in ``folder``, with forward slashes."""
    try:
        path = os.path.relpath(os.path.abspath(file), folder).replace(os.sep, "/")
    except ValueError:  # another drive
        return Path(file).as_posix()
    return path if path.startswith("../") else f"./{path}"


def referenced_arrays(root: Path) -> set[str]:
    """Names of the files beside ``root`` that it references; empty where it cannot be read."""
    if not root.is_file():
        return set()
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(root))
    except Tf.ErrorException:
        return set()
    return {p.removeprefix("./") for p in layer.GetExternalReferences()} if layer else set()


def _used_by_others(target: Path) -> set[str]:
    """Arrays that a root of the same stem refers to (``x.usdc`` beside ``x.usda``)."""
    others = (target.with_suffix(s) for s in atomic.LAYER_SUFFIXES if s != target.suffix)
    return {name for other in others for name in referenced_arrays(other)}


def check_target(out: str | os.PathLike[str], *, clobber: bool = True) -> Path:
    """What can be said of ``out`` before anything is computed; its absolute path.

    Raises:
        BadOutput: the name is no layer's, something is in the way, or nothing can be written there.
    """
    target = Path(os.path.abspath(out))
    if target.suffix not in atomic.LAYER_SUFFIXES:
        message = f"the name must end in one of {', '.join(atomic.LAYER_SUFFIXES)}"
        raise BadOutput(message, file=str(target))
    if target.is_dir():
        raise BadOutput("this is a folder", file=str(target))
    if target.exists() and not clobber:
        raise BadOutput("it exists already and is not to be replaced", file=str(target))
    above = next(p for p in target.parents if p.exists())
    if not above.is_dir():
        raise BadOutput(f"cannot be written: {above} is a file, not a folder", file=str(target))
    if not os.access(above, os.W_OK | os.X_OK):
        raise BadOutput(f"cannot be written: no permission to write in {above}", file=str(target))
    return target


def _refuse_inputs(target: Path, *sources: Source) -> None:
    used = {layer.realPath for s in sources for layer in s.stage.GetUsedLayers() if layer.realPath}
    if target.exists() and any(os.path.samefile(target, path) for path in used if os.path.exists(path)):
        raise BadOutput("this is one of the inputs, which are never changed", file=str(target))


def _file_of(character: Character) -> str:
    if character.origin is None:
        raise ValueError(f"{character.name}: a character without a stage cannot be referenced")
    return str(character.origin.file)


def _flattened(source: Source, paths: list[str]) -> Sdf.Layer:
    """The outfit as one layer; instances that hold a garment are opened up in the session only."""
    stage = source.stage
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for path in paths:
            for prefix in Sdf.Path(path).GetPrefixes():
                prim = stage.GetPrimAtPath(prefix)
                if prim.IsInstance():
                    prim.SetInstanceable(False)
    return stage.Flatten(addSourceFileComment=False)


def _certificate(over: Sdf.PrimSpec, values: Mapping[str, Any], passed: bool, broken: Sequence[str]) -> None:
    types = Sdf.ValueTypeNames
    _attribute(over, "garment:certificate:passed", types.Bool, passed)
    if broken:
        _attribute(over, "garment:certificate:broken", types.StringArray, Vt.StringArray(list(broken)))
    for key, value in sorted(values.items()):
        name = f"garment:certificate:{key}"
        if key == "posed":
            _posed(over, name, value)
            continue
        if isinstance(value, bool | np.bool_):
            _attribute(over, name, types.Bool, bool(value))
        elif isinstance(value, int | np.integer):
            _attribute(over, name, types.Int, int(value))
        elif isinstance(value, float | np.floating):
            _attribute(over, name, types.Double, float(value))
        elif isinstance(value, str):
            _attribute(over, name, types.String, value)
        elif len(value) == 3:
            _attribute(over, name, types.Double3, tuple(float(v) for v in value))
        else:
            _attribute(over, name, types.DoubleArray, Vt.DoubleArray([float(v) for v in value]))


def _posed(over: Sdf.PrimSpec, name: str, poses: Sequence[Mapping[str, Any]]) -> None:
    """Figures of the posed check: an array for each, in the order of the poses."""
    types = Sdf.ValueTypeNames
    for key in sorted({key for figures in poses for key in figures}):
        column = [figures[key] for figures in poses]
        if key == "pose":
            _attribute(over, f"{name}:poses", types.TokenArray, Vt.TokenArray(column))
        elif isinstance(column[0], Sequence):
            rows = Vt.Vec3dArray([Gf.Vec3d(*map(float, row)) for row in column])
            _attribute(over, f"{name}:{key}", types.Double3Array, rows)
        else:
            _attribute(over, f"{name}:{key}", types.DoubleArray, Vt.DoubleArray([float(x) for x in column]))


def _attribute(spec: Sdf.PrimSpec, name: str, kind: Sdf.ValueTypeName, value: object) -> None:
    Sdf.AttributeSpec(spec, name, kind, Sdf.VariabilityUniform).default = value


def _export(layer: Sdf.Layer, path: Path, target: Path) -> None:
    try:
        good = layer.Export(str(path))
    except Tf.ErrorException as error:
        raise BadOutput(f"USD cannot write it: {error}", file=str(target)) from error
    if not good or not path.is_file():
        raise BadOutput("USD cannot write it", file=str(target))


def _check_arrays(layer: Sdf.Layer, path: Path, target: Path) -> None:
    """Reads the crate file back: USD does not report every write that fell short."""
    try:
        back = Sdf.Layer.OpenAsAnonymous(str(path))
    except Tf.ErrorException:
        back = None
    scope = layer.defaultPrim
    for name in [s.name for s in layer.GetPrimAtPath(f"/{scope}").nameChildren]:
        for attribute in ("points", "primvars:skel:jointWeights", "primvars:garment:pattern"):
            at = f"/{scope}/{name}.{attribute}"
            spec = layer.GetAttributeAtPath(at)
            if spec is not None and (back is None or back.GetAttributeAtPath(at).default != spec.default):
                raise BadOutput("what was written does not read back: is the disk full?", file=str(target))
