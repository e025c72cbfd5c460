"""One dressed garment: the source's mesh with new points, pattern, rest shape and skin.

Whatever is not named here is copied as the source has it: faces, n-gons, subsets, UV sets,
colours and every other primvar.
"""

from __future__ import annotations

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel, Vt

from ..model import Character, DressedGarment, Floats, GarmentSource, MeshOrigin
from .blend_shapes import write_blend_shapes
from .marks import SEAM_PREFIX
from .materials import dangling
from .normals import corner_normals, face_normals, vertex_normals
from .rest import uv_of_corners, write_rest_shape
from .stage import Source, apply, gf_matrix

#: Properties that belong to the source's place, pose, motion or an earlier dressing.
DROPPED = ("xformOpOrder", "velocities", "accelerations", "garment:state", "garment:sourceBody")
DROPPED_PREFIXES = (
    "xformOp:",
    "skel:",
    "primvars:skel:",
    "material:binding",
    "garment:certificate:",
    "garment:character",
    "primvars:garment:pattern",
    "physics:rest",
    "omniphysics:rest",
)
DROPPED_SCHEMAS = {"SkelBindingAPI", "MaterialBindingAPI", "GarmentCertificateAPI"}
#: Prim metadata that a garment inside a character does not carry.
DROPPED_METADATA = ("kind", "instanceable", "hidden", "assetInfo", "clips", "clipSets")


class Placement:
    """The space that dressed garments are written in: the character's root prim."""

    def __init__(self, character_source: Source, character: Character) -> None:
        stage = character_source.stage
        root = stage.GetPrimAtPath(character.root_path)
        skeleton = stage.GetPrimAtPath(character.skeleton_path)
        self.frame = character_source.frame
        self.world_from_root = character_source.world_from_local(root)
        self.root_from_world = np.linalg.inv(self.world_from_root).astype(np.float64)
        world_from_skeleton = character_source.world_from_local(skeleton)
        self.skeleton_from_root = np.linalg.inv(world_from_skeleton) @ self.world_from_root


def copy_mesh(
    source: Source, flat: Sdf.Layer, garment: GarmentSource, layer: Sdf.Layer, path: Sdf.Path
) -> None:
    """Copies the garment's mesh and subsets, without what belongs to its old surroundings."""
    Sdf.CopySpec(flat, Sdf.Path(garment.path), layer, path)
    spec = layer.GetPrimAtPath(path)
    for child in list(spec.nameChildren):
        if child.typeName != "GeomSubset":
            source.note(f"its child {child.name!r} is no subset and was left out", garment.path)
            del spec.nameChildren[child.name]
    for prim_spec in (spec, *spec.nameChildren):
        _clean(prim_spec)
    _settle_schemas(spec)
    for name in dangling(layer, path):
        source.note(f"{name} points outside of the garment and was left out", garment.path)


def write_garment(
    source: Source, prim: Usd.Prim, garment: GarmentSource, dressed: DressedGarment, place: Placement
) -> None:
    """Authors the dressed state on a copied mesh.

    Args:
        source: the outfit's stage, to read what the source had.
        prim: the copy.
        place: the space to write in.
    """
    origin = _origin(garment)
    points = _shaped(dressed.points, (len(garment.points), 3), garment, "points")
    pattern = _shaped(dressed.corner_pattern, garment.corner_pattern.shape, garment, "pattern")
    original = source.stage.GetPrimAtPath(garment.path)
    local = apply(place.root_from_world, points).astype(np.float32)
    mesh = UsdGeom.Mesh(prim)
    _set_shape(mesh, origin, local)
    mirrored = _set_orientation(UsdGeom.Mesh(original), mesh, origin, place)
    _set_normals(source, mesh, garment, local.astype(np.float64), mirrored)
    _inherited_primvars(original, prim)
    _scale_offsets(prim, origin, place)
    uv = uv_of_corners(garment, pattern)
    write_rest_shape(prim, garment, origin, uv, place.frame.meters_per_unit)
    write_skin(prim, garment, dressed, place)
    if dressed.blend_shapes:
        write_blend_shapes(prim, dressed.blend_shapes, place.root_from_world)


def write_skin(prim: Usd.Prim, garment: GarmentSource, dressed: DressedGarment, place: Placement) -> None:
    """Skin weights, largest first; the skeleton itself is named where the character is known."""
    k = dressed.influences
    shape = (len(garment.points), k)
    weights = _shaped(np.reshape(dressed.joint_weights, shape), shape, garment, "joint weights")
    indices = np.reshape(dressed.joint_indices, shape).astype(np.int64)
    indices = np.where(weights > 0.0, indices, 0)
    order = np.lexsort((indices, -weights), axis=1)
    weights = np.take_along_axis(weights, order, axis=1)
    indices = np.take_along_axis(indices, order, axis=1)
    total = weights.sum(axis=1, keepdims=True)
    if (total <= 0.0).any() or (weights < 0.0).any():
        raise ValueError(f"{garment.name}: a point has no positive skin weights")
    binding = UsdSkel.BindingAPI.Apply(prim)
    binding.CreateJointIndicesPrimvar(False, k).Set(Vt.IntArray.FromNumpy(indices.ravel().astype(np.int32)))
    binding.CreateJointWeightsPrimvar(False, k).Set(
        Vt.FloatArray.FromNumpy((weights / total).ravel().astype(np.float32))
    )
    binding.CreateGeomBindTransformAttr().Set(gf_matrix(place.skeleton_from_root))


def _clean(spec: Sdf.PrimSpec) -> None:
    for key in DROPPED_METADATA:
        if spec.HasInfo(key):
            spec.ClearInfo(key)
    for prop in list(spec.properties):
        if prop.name in DROPPED or prop.name.startswith(DROPPED_PREFIXES):
            spec.RemoveProperty(prop)


def _settle_schemas(spec: Sdf.PrimSpec) -> None:
    """Applied schemas as one prepended list, in the order in which the source composed them."""
    listed = spec.GetInfo("apiSchemas") if spec.HasInfo("apiSchemas") else Sdf.TokenListOp()
    names = [n for n in listed.GetAddedOrExplicitItems() if n.split(":")[0] not in DROPPED_SCHEMAS]
    if "GarmentAPI" not in names:
        names.insert(0, "GarmentAPI")
    spec.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=names))


def _set_shape(mesh: UsdGeom.Mesh, origin: MeshOrigin, local: np.ndarray) -> None:
    points = Vt.Vec3fArray.FromNumpy(local)
    for attribute, value in (
        (mesh.GetPointsAttr(), points),
        (mesh.GetFaceVertexCountsAttr(), Vt.IntArray.FromNumpy(origin.face_vertex_counts.astype(np.int32))),
        (mesh.GetFaceVertexIndicesAttr(), Vt.IntArray.FromNumpy(origin.face_vertex_indices.astype(np.int32))),
        (mesh.CreateExtentAttr(), UsdGeom.PointBased.ComputeExtent(points)),
    ):
        attribute.Clear()  # animated sources keep no samples beside the dressed state
        attribute.Set(value)


def _set_orientation(
    original: UsdGeom.Mesh, mesh: UsdGeom.Mesh, origin: MeshOrigin, place: Placement
) -> bool:
    """Keeps outward faces outward where a mirroring transform is lost or won; True if corners of
    our triangles run against the written winding's right hand."""
    tokens = UsdGeom.Tokens
    left = original.GetOrientationAttr().Get() == tokens.leftHanded
    sides = [np.linalg.det(m[:3, :3]) < 0.0 for m in (origin.world_from_local, place.world_from_root)]
    if sides[0] != sides[1]:
        left = not left
        mesh.CreateOrientationAttr().Set(tokens.leftHanded if left else tokens.rightHanded)
    return bool(sides[1])


def _set_normals(
    source: Source, mesh: UsdGeom.Mesh, garment: GarmentSource, local: Floats, mirrored: bool
) -> None:
    """New normals where the source had some, or where nothing else would smooth the surface."""
    original = source.stage.GetPrimAtPath(garment.path)
    was = UsdGeom.Mesh(original)
    var = UsdGeom.PrimvarsAPI(original).GetPrimvar("normals")
    if var.HasValue():
        old, kind = var.ComputeFlattened(source.time_of(var.GetAttr())), var.GetInterpolation()
        UsdGeom.PrimvarsAPI(mesh.GetPrim()).RemovePrimvar("normals")
    else:
        old, kind = source.value(was.GetNormalsAttr()), was.GetNormalsInterpolation()
    none = UsdGeom.Tokens.none
    if old is None and was.GetSubdivisionSchemeAttr().Get() != none:
        return
    before = None if old is None else np.array(old, dtype=np.float64)
    normals, kind = _normals(garment, local, before, kind)
    attribute = mesh.CreateNormalsAttr()
    attribute.Clear()
    attribute.Set(Vt.Vec3fArray.FromNumpy((-normals if mirrored else normals).astype(np.float32)))
    mesh.SetNormalsInterpolation(kind)


def _normals(garment: GarmentSource, local: Floats, old: Floats | None, kind: str) -> tuple[Floats, str]:
    tokens, origin = UsdGeom.Tokens, _origin(garment)
    if kind == tokens.faceVarying and old is not None and len(old) == len(origin.face_vertex_indices):
        return corner_normals(origin, local, old), tokens.faceVarying
    if kind == tokens.uniform:
        return face_normals(origin, local), tokens.uniform
    fits = old is not None and len(old) == len(local)
    return vertex_normals(garment, origin, local, old if fits else None), tokens.vertex


def _inherited_primvars(original: Usd.Prim, prim: Usd.Prim) -> None:
    """Constant primvars that the source got from its parents."""
    for var in UsdGeom.PrimvarsAPI(original).FindPrimvarsWithInheritance():
        name = var.GetPrimvarName()
        if var.GetAttr().GetPrim() == original or name.startswith("skel:") or not var.HasValue():
            continue
        copy = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, var.GetTypeName(), var.GetInterpolation())
        copy.Set(var.ComputeFlattened() if var.IsIndexed() else var.Get())


def _scale_offsets(prim: Usd.Prim, origin: MeshOrigin, place: Placement) -> None:
    """Seam offsets are lengths in the mesh's space, which changes."""
    sizes = [np.cbrt(abs(np.linalg.det(m[:3, :3]))) for m in (origin.world_from_local, place.world_from_root)]
    factor = sizes[0] / sizes[1]
    for attribute in prim.GetAuthoredAttributes():
        name = attribute.GetName()
        if name.startswith(SEAM_PREFIX) and name.endswith(":offset") and abs(factor - 1.0) > 1e-9:
            attribute.Set(float(attribute.Get() * factor))


def _origin(garment: GarmentSource) -> MeshOrigin:
    if garment.origin is None:
        raise ValueError(f"{garment.name}: without its stage's bookkeeping it cannot be written")
    return garment.origin


def _shaped(array: Floats, shape: tuple[int, ...], garment: GarmentSource, what: str) -> Floats:
    """The pipeline's array as f64; a wrong shape or a number that is not finite is a bug, not input."""
    array = np.asarray(array, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{garment.name}: {what} have shape {array.shape}, not {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{garment.name}: {what} are not all finite")
    return array
