"""Characters: the body mesh, its skeleton and weights, and further colliders.

All of it is read in the bind pose. A skinned mesh lives in its skeleton's space: its points go
through ``geomBindTransform`` and the skeleton's transform, not through the mesh's own (that is
what UsdSkel does, and what the fitted garment will be skinned with).
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from ..errors import BadInput
from ..model import Character, Collider, Floats
from .blend_shapes import read_blend_shapes
from .marks import is_garment
from .mesh import read_mesh
from .skeleton import SkeletonData, bound_skeleton, read_skeleton
from .skin import geom_bind_transform, is_skinned, read_skin
from .stage import Source, copy_variants, open_stage

#: Heights outside of this are not bodies in metres [m].
POSSIBLE_HEIGHT = (0.1, 10.0)
#: Heights outside of this are worth a note [m].
USUAL_HEIGHT = (0.4, 2.6)


def read_character(
    file: str | os.PathLike[str],
    *,
    body: str | None = None,
    colliders: Iterable[str] = (),
    variants: Mapping[str, Mapping[str, str]] | None = None,
    blend_shapes: bool = False,
) -> tuple[Character, list[str]]:
    """Reads a stage with a body mesh and a skeleton.

    Args:
        file: the stage.
        body: path of the body mesh, where the largest skinned mesh is not it.
        colliders: further meshes that cloth must not pass, each a prim path (whatever is below
            it counts), a prim name or a pattern such as ``Shoe*``.
        variants: ``{prim path: {variant set: variant}}``.
        blend_shapes: whether the body's blend shapes are read.

    Returns:
        The character and notes on what was inferred or repaired.

    Raises:
        BadInput: names file, prim, attribute and element.
    """
    source = open_stage(file, variants)
    character = character_under(source, source.stage.GetPseudoRoot(), body, colliders)
    if blend_shapes:
        character.blend_shapes = read_blend_shapes(source, character)
    character.variants = copy_variants(variants)
    worn = [p.GetName() for p in source.prims() if is_garment(p)]
    if worn:
        source.note(f"it wears {', '.join(worn)} already, which stays and is not collided with")
    return character, source.notes


def character_under(
    source: Source, root: Usd.Prim, body: str | None = None, colliders: Iterable[str] = ()
) -> Character:
    """The character below a prim of an open stage."""
    mesh = _named_body(source, body) if body else _largest_body(source, root)
    skeleton_prim = bound_skeleton(source, mesh)
    if skeleton_prim is None:
        raise source.bad("the body mesh is bound to no skeleton", mesh, "skel:skeleton")
    skeleton = read_skeleton(source, skeleton_prim)
    points, triangles, origin = read_mesh(source, mesh, _world_from_bound(source, mesh, skeleton))
    influences, indices, weights = read_skin(source, mesh, len(points), skeleton.joints)
    _check_size(source, mesh, points)
    top = mesh.GetPath().GetPrefixes()[0]
    return Character(
        name=Path(source.file).stem if root.IsPseudoRoot() else root.GetName(),
        path=str(mesh.GetPath()),
        points=points,
        triangles=triangles,
        skin_influences=influences,
        joint_indices=indices,
        joint_weights=weights,
        joints=skeleton.joints,
        joint_parents=skeleton.parents,
        world_from_joint=skeleton.world_from_joint,
        colliders=_colliders(source, mesh, list(colliders)),
        origin=origin,
        skeleton_path=skeleton.path,
        root_path=str(top),
    )


def skinned_meshes(source: Source, root: Usd.Prim) -> list[Usd.Prim]:
    """Meshes with joint weights that are no garments, in stage order."""
    return [p for p in source.prims(root) if p.IsA(UsdGeom.Mesh) and not is_garment(p) and is_skinned(p)]


def require_same_topology(source: Character, target: Character) -> None:
    """Raises BadInput unless both bodies have the same points and faces by index."""
    mine, its = target.origin, source.origin
    if mine is None or its is None:
        raise ValueError("characters without their stage's bookkeeping cannot be compared")

    def bad(message: str, attribute: str, element: int | None = None) -> BadInput:
        return BadInput(
            f"{message} (source body {its.file} <{source.path}>)",
            file=mine.file,
            prim=target.path,
            attribute=attribute,
            element=element,
        )

    if len(source.points) != len(target.points):
        message = f"the body has {len(target.points)} points and the source body {len(source.points)}"
        raise bad(message, "points")
    for name in ("face_vertex_counts", "face_vertex_indices"):
        ours, theirs = getattr(mine, name), getattr(its, name)
        attribute = "faceVertexCounts" if name.endswith("counts") else "faceVertexIndices"
        if len(ours) != len(theirs):
            message = f"{len(ours)} entries where the source body has {len(theirs)}"
            raise bad(message, attribute)
        differ = np.flatnonzero(ours != theirs)
        if len(differ):
            i = int(differ[0])
            raise bad(f"{ours[i]} where the source body has {theirs[i]}", attribute, i)


def _named_body(source: Source, path: str) -> Usd.Prim:
    prim = source.stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if not prim or not prim.IsA(UsdGeom.Mesh):
        raise source.bad("the body that was asked for is no mesh of this stage", path)
    if not is_skinned(prim):
        raise source.bad("the body mesh has no joint weights", prim, "primvars:skel:jointWeights")
    return prim


def _largest_body(source: Source, root: Usd.Prim) -> Usd.Prim:
    meshes = skinned_meshes(source, root)
    if not meshes:
        _explain_no_body(source, root)
    bound = {m.GetPath(): bound_skeleton(source, m) for m in meshes}
    skeletons = sorted({str(s.GetPath()) for s in bound.values() if s is not None})
    if len(skeletons) > 1:
        names = ", ".join(f"<{s}>" for s in skeletons)
        message = f"meshes are bound to several skeletons ({names}): name the body mesh"
        raise source.bad(message, root, "skel:skeleton")
    return max(meshes, key=lambda m: len(UsdGeom.Mesh(m).GetPointsAttr().Get() or []))


def _explain_no_body(source: Source, root: Usd.Prim) -> None:
    meshes = [p for p in source.prims(root) if p.IsA(UsdGeom.Mesh) and not is_garment(p)]
    if not meshes:
        raise source.bad("there is no body mesh", root)
    if not any(p.IsA(UsdSkel.Skeleton) for p in source.prims(root)):
        raise source.bad("there is no skeleton", root)
    raise source.bad("no mesh has joint weights", meshes[0], "primvars:skel:jointWeights")


def _world_from_bound(source: Source, mesh: Usd.Prim, skeleton: SkeletonData) -> Floats:
    bind = source.checked(geom_bind_transform(mesh), mesh)
    transform = skeleton.world_from_skeleton @ bind
    own = source.world_from_local(mesh)
    if not np.allclose(own, transform, rtol=0.0, atol=1e-4):
        source.note("its own transform differs from its binding's, which is taken", mesh)
    return transform


def _check_size(source: Source, mesh: Usd.Prim, points: Floats) -> None:
    height = float(np.ptp(points[:, 1]))
    if not POSSIBLE_HEIGHT[0] < height < POSSIBLE_HEIGHT[1]:
        message = f"the body is {height:.3g} m high: check metersPerUnit, upAxis and transforms"
        raise source.bad(message, mesh, "points")
    if not USUAL_HEIGHT[0] < height < USUAL_HEIGHT[1]:
        source.note(f"the body is {height:.2f} m high: is metersPerUnit right?", mesh)


def _colliders(source: Source, body: Usd.Prim, wanted: list[str]) -> list[Collider]:
    found: dict[str, Collider] = {}
    for want in wanted:
        meshes = [
            p
            for p in source.prims()
            if p.IsA(UsdGeom.Mesh) and p != body and not is_garment(p) and _matches(p, want)
        ]
        if not meshes:
            raise source.bad("no mesh has this path or name, which was named as a collider", want)
        for prim in meshes:
            path = str(prim.GetPath())
            if path not in found:
                points, triangles, _ = read_mesh(source, prim, world_from_skinned(source, prim))
                found[path] = Collider(path, points, triangles)
    return list(found.values())


def _matches(prim: Usd.Prim, want: str) -> bool:
    if want.startswith("/"):
        return prim.GetPath().HasPrefix(Sdf.Path(want)) if Sdf.Path.IsValidPathString(want) else False
    return any(fnmatch(name, want) for name in str(prim.GetPath()).split("/")[1:])


def world_from_skinned(source: Source, prim: Usd.Prim) -> Floats | None:
    """World from a mesh through its binding; None for meshes that no skeleton moves."""
    try:
        skeleton = bound_skeleton(source, prim) if is_skinned(prim) else None
    except BadInput as error:
        source.note(f"skel:skeleton {error.message}: its own transform is taken", prim)
        return None
    if skeleton is None:
        return None
    world = source.world_from_local(skeleton)
    return source.checked(world @ geom_bind_transform(prim), prim)
