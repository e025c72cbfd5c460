"""The garment moves with the body: UsdSkel's own skinning against ours, in a test pose.

``UsdSkel.BakeSkinning`` returns True on broken bindings too, so values are compared. It turns the
SkelRoot into an Xform in the layer that it edits, so it edits the session layer.
"""

from __future__ import annotations

import dressing
import numpy as np
import pytest
import scenes
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from dressform.usd.write import write_dressed
from pxr import Gf, Usd, UsdGeom, UsdSkel


def pose(stage: Usd.Stage, skeleton_path: str, angles: dict[int, float]) -> np.ndarray:
    """Animates joints by angles [degrees] about x in the session; joint transforms in the
    skeleton's space, [j, 4, 4]."""
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath(skeleton_path))
    rest = list(skeleton.GetRestTransformsAttr().Get())
    for joint, angle in angles.items():
        rest[joint] = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 0, 0), angle)) * rest[joint]
    animation = UsdSkel.Animation.Define(stage, f"{skeleton_path}/Pose")
    animation.CreateJointsAttr(skeleton.GetJointsAttr().Get())
    animation.SetTransforms(rest, 1.0)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    parents = [UsdSkel.Topology(skeleton.GetJointsAttr().Get()).GetParent(j) for j in range(len(rest))]
    world: list[np.ndarray] = []
    for joint, parent in enumerate(parents):
        local = np.array(rest[joint]).T
        world.append(local if parent < 0 else world[parent] @ local)
    return np.array(world)


def baked_against_ours(out, results, skeleton_path, angles):
    """Largest distance [m] of UsdSkel's skinned garments from the dressed points, skinned by us, and
    how far they moved [m]."""
    again = read_outfit(out)
    character = again.bodies[0]
    stage = Usd.Stage.Open(str(out))
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        posed = pose(stage, skeleton_path, angles)
        roots = [UsdSkel.Root(p) for p in stage.Traverse() if p.IsA(UsdSkel.Root)]
        for root in roots:
            assert UsdSkel.BakeSkinning(root, Gf.Interval(1.0, 1.0))
    cache = UsdGeom.XformCache(1.0)
    frame = again.frame.world_from_stage
    world_from_skeleton = (
        frame @ np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(skeleton_path))).T
    )
    transforms = world_from_skeleton @ posed @ np.linalg.inv(character.world_from_joint)
    return apart(stage, 1.0, out, again, results, transforms)


def apart(stage, time, out, again, results, transforms):
    """Largest distance [m] of a baked stage's garments from ours under skinning ``transforms`` at one
    time, and how far they moved [m]."""
    cache = UsdGeom.XformCache(time)
    away, moved = 0.0, 0.0
    for garment, result in zip(again.garments, results, strict=True):
        prim = stage.GetPrimAtPath(garment.path)
        points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(time), float)
        matrix = again.frame.world_from_stage @ np.array(cache.GetLocalToWorldTransform(prim)).T
        baked = points @ matrix[:3, :3].T + matrix[:3, 3]
        indices, weights = weights_of(out, garment.path)
        ours = dressing.skinned(result.points, indices, weights, transforms)
        away = max(away, np.linalg.norm(baked - ours, axis=1).max())
        moved = max(moved, np.linalg.norm(baked - result.points, axis=1).max())
    return away, moved


def weights_of(out, path):
    stage = Usd.Stage.Open(str(out))
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath(path))
    k = binding.GetJointWeightsPrimvar().GetElementSize()
    indices = np.array(binding.GetJointIndicesPrimvar().Get()).reshape(-1, k)
    return indices, np.array(binding.GetJointWeightsPrimvar().Get(), float).reshape(-1, k)


def test_sample_moves_with_the_body(tmp_path, sample_outfit, sample_target):
    out = tmp_path / "dressed.usda"
    results = dressing.dress(sample_outfit, sample_target)
    write_dressed(out, sample_outfit, sample_target, results)
    names = [j.rsplit("/", 1)[-1] for j in sample_target.joints]
    angles = {
        names.index("upperleg01_L"): 40.0,
        names.index("spine03"): 20.0,
        names.index("upperarm01_R"): -30.0,
    }
    away, moved = baked_against_ours(out, results, sample_target.skeleton_path, angles)
    assert moved > 0.1 and away < 1e-4


@pytest.mark.parametrize(("up", "unit"), [("Y", 1.0), ("Z", 0.01)])
@pytest.mark.parametrize("nested", [False, True])
def test_every_frame_and_place_of_the_skel_root(tmp_path, up, unit, nested):
    """The skeleton under transforms of its own, the SkelRoot at the top or deeper down."""
    stage = scenes.new_stage(tmp_path / "hero.usda", up, unit)
    path = "/Hero/Rig" if nested else "/Hero"
    if nested:
        UsdGeom.Xform.Define(stage, "/Hero")
    scenes.add_character(stage, path, scenes.stage_frame(up, unit), girth=1.2)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Hero"))
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/Hero"))
    move.AddTranslateOp().Set(Gf.Vec3d(0.1 / unit, 0.05 / unit, 0.0))
    UsdGeom.Xformable(stage.GetPrimAtPath(f"{path}/Skel")).AddTranslateOp().Set(
        Gf.Vec3d(0.0, 0.0, 0.02 / unit)
    )
    target, _ = read_character(scenes.saved(stage))
    outfit = read_outfit(scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda")))
    out = tmp_path / "dressed.usda"
    results = dressing.dress(outfit, target)
    write_dressed(out, outfit, target, results)
    away, moved = baked_against_ours(out, results, target.skeleton_path, {1: 35.0})
    assert moved > 0.1 and away < 1e-4
