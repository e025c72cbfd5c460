"""Small made-up scenes: a tube of a body with three joints and a tube of a shirt with two panels.

The body is 1.7 m high with radius 0.15 m; the shirt has radius 0.2 m from 0.8 m to 1.3 m. Every
builder returns an open stage, so that a test can break what it wants to before saving.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

SIDES = 16
BODY_RINGS = 12
SHIRT_RINGS = 6
JOINTS = ["root", "root/spine", "root/spine/head"]
JOINT_HEIGHTS = [0.0, 0.8, 1.5]


def stage_frame(up: str, unit: float) -> np.ndarray:
    """Stage coordinates from world metres, Y up, shape [3, 3]."""
    turn = np.eye(3) if up == "Y" else np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    return turn / unit


def tube(radius: float, low: float, high: float, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Points [n, 3] in metres, Y up, and outward quads [m, 4]."""
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    height = np.linspace(low, high, rings)
    ring = np.stack([radius * np.sin(angle), np.zeros(SIDES), radius * np.cos(angle)], axis=1)
    points = (ring[None] + height[:, None, None] * np.array([0.0, 1.0, 0.0])).reshape(-1, 3)
    r, s = np.meshgrid(np.arange(rings - 1), np.arange(SIDES), indexing="ij")
    right = (s + 1) % SIDES
    quads = np.stack([r * SIDES + s, r * SIDES + right, (r + 1) * SIDES + right, (r + 1) * SIDES + s], -1)
    return points, quads.reshape(-1, 4)


def new_stage(path: Path, up: str = "Y", unit: float = 1.0) -> Usd.Stage:
    """An empty stage in memory, whose root layer will be saved at ``path``."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    return stage


def add_character(stage: Usd.Stage, path: str, frame: np.ndarray, girth: float = 1.0) -> UsdGeom.Mesh:
    """A SkelRoot with ``Skel`` and ``Body``."""
    root = UsdSkel.Root.Define(stage, path)
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/Skel")
    skeleton.CreateJointsAttr(JOINTS)
    at = np.array([[0.0, h, 0.0] for h in JOINT_HEIGHTS]) @ frame.T
    bind = [Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(*map(float, p))) for p in at]
    rest = [bind[0], bind[1] * bind[0].GetInverse(), bind[2] * bind[1].GetInverse()]
    skeleton.CreateBindTransformsAttr(bind)
    skeleton.CreateRestTransformsAttr(rest)
    points, quads = tube(0.15 * girth, 0.0, 1.7, BODY_RINGS)
    body = add_mesh(stage, f"{path}/Body", points @ frame.T, quads)
    along = np.interp(points[:, 1], JOINT_HEIGHTS, [0.0, 1.0, 2.0])
    low = np.clip(np.floor(along).astype(int), 0, 1)
    weights = np.stack([1.0 - (along - low), along - low], axis=1)
    bind_skin(body.GetPrim(), skeleton, np.stack([low, low + 1], axis=1), weights)
    UsdSkel.BindingAPI.Apply(root.GetPrim())
    return body


def bind_skin(prim: Usd.Prim, skeleton: UsdSkel.Skeleton, indices: np.ndarray, weights: np.ndarray) -> None:
    binding = UsdSkel.BindingAPI.Apply(prim)
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    k = indices.shape[1]
    binding.CreateJointIndicesPrimvar(False, k).Set(Vt.IntArray(indices.ravel().tolist()))
    binding.CreateJointWeightsPrimvar(False, k).Set(Vt.FloatArray(weights.ravel().tolist()))


def add_mesh(stage: Usd.Stage, path: str, points: np.ndarray, faces: np.ndarray) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([faces.shape[1]] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    return mesh


def add_shirt(
    stage: Usd.Stage, path: str, frame: np.ndarray, body: str | None = None, st_unit: float = 1e-3
) -> UsdGeom.Mesh:
    """A welded tube of quads with two panels; panel coordinates in ``st_unit``."""
    points, quads = tube(0.2, 0.8, 1.3, SHIRT_RINGS)
    mesh = add_mesh(stage, path, points @ frame.T, quads)
    prim = mesh.GetPrim()
    prim.AddAppliedSchema("GarmentAPI")
    prim.CreateAttribute("garment:layer", Sdf.ValueTypeNames.Int, False, Sdf.VariabilityUniform).Set(1)
    if body:
        prim.CreateRelationship("garment:sourceBody", False).SetTargets([body])
    column = np.tile(np.arange(SIDES), SHIRT_RINGS - 1)
    width = 2.0 * 0.2 * np.sin(np.pi / SIDES)
    u = (column[:, None] + np.array([0, 1, 1, 0])) * width
    u = u + (column[:, None] >= SIDES // 2) * 0.05  # the panels lie 5 cm apart
    v = points[quads][..., 1] - 0.8
    st = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    uv = np.stack([u, v], -1).reshape(-1, 2) / st_unit
    st.Set(Vt.Vec2fArray.FromNumpy(uv.astype(np.float32)))
    for name, half in (("front", column < SIDES // 2), ("back", column >= SIDES // 2)):
        add_panel(mesh, name, np.flatnonzero(half))
    UsdGeom.Subset.SetFamilyType(mesh, "pattern", "partition")
    return mesh


def add_panel(mesh: UsdGeom.Mesh, name: str, faces: np.ndarray, grain: float = 0.0) -> UsdGeom.Subset:
    subset = UsdGeom.Subset.CreateGeomSubset(
        mesh, name, UsdGeom.Tokens.face, Vt.IntArray(faces.tolist()), "pattern"
    )
    prim = subset.GetPrim()
    prim.AddAppliedSchema("GarmentPanelAPI")
    uniform, types = Sdf.VariabilityUniform, Sdf.ValueTypeNames
    prim.CreateAttribute("garment:panel:label", types.Token, False, uniform).Set(name)
    prim.CreateAttribute("garment:panel:grainAngle", types.Float, False, uniform).Set(grain)
    return subset


def character_stage(path: Path, up: str = "Y", unit: float = 1.0, girth: float = 1.0) -> Usd.Stage:
    """A character of its own at ``/Hero``."""
    stage = new_stage(path, up, unit)
    add_character(stage, "/Hero", stage_frame(up, unit), girth)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Hero"))
    return stage


def outfit_stage(path: Path, up: str = "Y", unit: float = 1.0) -> Usd.Stage:
    """``/Outfit/Shirt`` on ``/SourceBody/Character``."""
    stage = new_stage(path, up, unit)
    frame = stage_frame(up, unit)
    UsdGeom.Xform.Define(stage, "/Outfit")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Outfit"))
    UsdGeom.Xform.Define(stage, "/SourceBody")
    add_character(stage, "/SourceBody/Character", frame)
    add_shirt(stage, "/Outfit/Shirt", frame, "/SourceBody/Character")
    return stage


def saved(stage: Usd.Stage) -> Path:
    """Writes the stage and gives its file."""
    stage.GetRootLayer().Save()
    return Path(stage.GetRootLayer().realPath)
