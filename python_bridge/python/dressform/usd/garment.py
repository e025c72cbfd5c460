"""Garments and outfits."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

from ..errors import BadInput
from ..model import Character, Floats, GarmentSource, Outfit
from .character import character_under, skinned_meshes, world_from_skinned
from .marks import is_garment
from .mesh import degenerate_triangles, read_mesh
from .orient import turned_triangles
from .panels import mark_mirrored, read_panels
from .pattern import panel_from_uv, read_pattern
from .seams import read_seams
from .stage import Source, copy_variants, open_stage
from .topology import note_topology


def read_outfit(
    file: str | os.PathLike[str],
    *,
    garments: Iterable[str] = (),
    source_body: str | os.PathLike[str] | None = None,
    pattern_primvar: str | None = None,
    variants: Mapping[str, Mapping[str, str]] | None = None,
) -> Outfit:
    """Reads a stage with one or more garments and the bodies that they were authored on.

    Args:
        file: the stage.
        garments: paths of the meshes to read; all that are marked as garments by default.
        source_body: a character's stage, for outfits that do not hold their body.
        pattern_primvar: read panels from this primvar.
        variants: ``{prim path: {variant set: variant}}``.

    Raises:
        BadInput: names file, prim, attribute and element.
    """
    source = open_stage(file, variants)
    prims = garment_prims(source, list(garments))
    bodies = Bodies(source, source_body)
    outfit = Outfit(name=Path(source.file).stem, garments=[], bodies=bodies.found)
    outfit.file, outfit.frame = source.file, source.frame
    for prim in prims:
        body = bodies.of(prim)
        garment = read_garment(source, prim, bodies.found[body].points, pattern_primvar)
        garment.body = body
        outfit.garments.append(garment)
    outfit.notes = source.notes
    outfit.variants = copy_variants(variants)
    return outfit


def garment_prims(source: Source, paths: list[str]) -> list[Usd.Prim]:
    """The garments of a stage, or those at ``paths``."""
    if paths:
        prims = [source.stage.GetPrimAtPath(p) for p in paths]
        for path, prim in zip(paths, prims, strict=True):
            if not prim or not prim.IsA(UsdGeom.Mesh):
                raise source.bad("the garment that was asked for is no mesh of this stage", path)
        return prims
    marked = [p for p in source.prims() if is_garment(p)]
    if not marked:
        meshes = [p for p in source.prims() if p.IsA(UsdGeom.Mesh)]
        if not meshes:
            raise source.bad("there is no mesh", "/")
        message = "no mesh is marked as a garment (GarmentAPI, garment: attributes or a pattern subset)"
        raise source.bad(f"{message}; name the meshes to read", "/")
    return marked


def read_garment(
    source: Source, prim: Usd.Prim, body: Floats | None = None, pattern_primvar: str | None = None
) -> GarmentSource:
    """One garment, checked: what comes back satisfies the core's own validation.

    Args:
        body: world points of its source body, to tell outside from inside.
    """
    points, triangles, origin = read_mesh(source, prim, world_from_skinned(source, prim))
    flat = degenerate_triangles(points, triangles)
    if len(flat):
        raise _degenerate(source, prim, origin.face_of_triangle[flat[0]], "in 3D")
    note_topology(source, prim, len(points), triangles)
    seams = read_seams(source, prim, len(points))
    origin.turned = turned_triangles(source, prim, points, triangles, seams, body)
    for corners in (triangles, origin.corner_of_triangle):
        corners[origin.turned] = corners[origin.turned][:, ::-1]
    uv, pattern_origin = read_pattern(source, prim, origin, points, pattern_primvar)
    flat = degenerate_triangles(uv, triangles)
    if len(flat):
        raise _degenerate(source, prim, origin.face_of_triangle[flat[0]], "in its panel")
    panels, panel_of_triangle = read_panels(source, prim, origin, uv)
    mark_mirrored(source, prim, panels, panel_of_triangle, uv)
    layer = source.value(prim.GetAttribute("garment:layer"))
    if UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible:
        source.note("the garment is invisible and is read all the same", prim)
    return GarmentSource(
        name=prim.GetName(),
        path=str(prim.GetPath()),
        layer=0 if layer is None else int(layer),
        body=-1,
        points=points,
        triangles=triangles,
        corner_pattern=np.einsum("tij,tkj->tki", panel_from_uv(panels)[panel_of_triangle], uv),
        panel_of_triangle=panel_of_triangle,
        panels=panels,
        seams=seams,
        joints=[str(joint) for joint in UsdSkel.BindingAPI(prim).GetJointsAttr().Get() or ()],
        origin=origin,
        pattern_origin=pattern_origin,
    )


def _degenerate(source: Source, prim: Usd.Prim, face: int, where: str) -> BadInput:
    return source.bad(f"face {face} has no area {where}", prim, "faceVertexIndices", face)


class Bodies:
    """Source bodies by the prim that holds them, each read once."""

    def __init__(self, source: Source, file: str | os.PathLike[str] | None) -> None:
        self.source = source
        self.outside = open_stage(file) if file is not None else None
        self.found: list[Character] = []
        self.index: dict[str, int] = {}

    def of(self, garment: Usd.Prim) -> int:
        """Index of the body that the garment was authored on."""
        if self.outside is not None:
            return self._read(self.outside, self.outside.stage.GetPseudoRoot())
        for name in ("garment:sourceBody", "garment:character"):
            rel = garment.GetRelationship(name)
            targets = rel.GetForwardedTargets() if rel else []
            if len(targets) > 1:
                raise self.source.bad("names several bodies", garment, name)
            if targets:
                root = self.source.stage.GetPrimAtPath(targets[0])
                if not root:
                    raise self.source.bad(f"points at <{targets[0]}>, which is not there", garment, name)
                return self._read(self.source, root)
        everything = self.source.stage.GetPseudoRoot()
        if not skinned_meshes(self.source, everything):
            message = "says nothing of a body and the stage has none: name the source body"
            raise self.source.bad(message, garment, "garment:sourceBody")
        return self._read(self.source, everything)

    def _read(self, source: Source, root: Usd.Prim) -> int:
        key = str(root.GetPath())
        if key not in self.index:
            single = root.IsA(UsdGeom.Mesh)
            character = character_under(source, root, key if single else None)
            if source is not self.source:
                self.source.notes += [n for n in source.notes if n not in self.source.notes]
            same = [i for i, c in enumerate(self.found) if c.path == character.path]
            self.index[key] = same[0] if same else len(self.found)
            if not same:
                self.found.append(character)
        return self.index[key]
