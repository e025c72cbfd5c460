"""Skeleton animation that a character brings: the garments follow it, and nothing of it is edited."""

from __future__ import annotations

import hashlib

import dressing
import numpy as np
import pytest
import scenes
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from dressform.usd.write import write_dressed
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel
from test_skinning import apart

#: Bend of the joint in the middle [degrees], by time.
BENDS = {1.0: 0.0, 12.0: 30.0, 24.0: -50.0}


def animated(path, owner: str, *, nested: bool, unit: float, up: str) -> Usd.Stage:
    """A character whose ``owner`` (``Skel`` or ``Root``) names an animation as its source."""
    stage = scenes.new_stage(path, up, unit)
    top = "/Hero/Rig" if nested else "/Hero"
    if nested:
        UsdGeom.Xform.Define(stage, "/Hero")
    scenes.add_character(stage, top, scenes.stage_frame(up, unit), girth=1.1)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Hero"))
    stage.SetStartTimeCode(1.0)
    stage.SetEndTimeCode(24.0)
    stage.SetTimeCodesPerSecond(30.0)
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath(f"{top}/Skel"))
    animation = UsdSkel.Animation.Define(stage, f"{top}/Anim/Walk")
    animation.CreateJointsAttr(skeleton.GetJointsAttr().Get())
    for time, angle in BENDS.items():
        rest = list(skeleton.GetRestTransformsAttr().Get())
        rest[1] = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 0, 0), angle)) * rest[1]
        animation.SetTransforms(rest, time)
    prim = skeleton.GetPrim() if owner == "Skel" else stage.GetPrimAtPath(top)
    UsdSkel.BindingAPI.Apply(prim).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return stage


def followed(out, results, skeleton_path: str) -> tuple[float, float]:
    """Largest distance [m] of UsdSkel's garments from ours at the times of the animation, and how far
    they moved."""
    again = read_outfit(out)
    character = again.bodies[0]
    stage = Usd.Stage.Open(str(out))
    stage.GetSessionLayer().timeCodesPerSecond = stage.GetTimeCodesPerSecond()  # else samples are scaled
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for root in [UsdSkel.Root(p) for p in stage.Traverse() if p.IsA(UsdSkel.Root)]:
            assert UsdSkel.BakeSkinning(root, Gf.Interval(1.0, 24.0))
    bind = np.array(UsdSkel.Skeleton(stage.GetPrimAtPath(skeleton_path)).GetBindTransformsAttr().Get())
    spine = bind[1].T
    frame = again.frame.world_from_stage
    away, moved = 0.0, 0.0
    for time, angle in BENDS.items():
        cache = UsdGeom.XformCache(time)
        world = frame @ np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(skeleton_path))).T
        turn = np.array(Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 0, 0), angle))).T
        posed = np.array([m.T for m in bind])
        posed[1:] = spine @ turn @ np.linalg.inv(spine) @ posed[1:]
        transforms = world @ posed @ np.linalg.inv(character.world_from_joint)
        here = apart(stage, time, out, again, results, transforms)
        away, moved = max(away, here[0]), max(moved, here[1])
    return away, moved


@pytest.mark.parametrize("owner", ["Skel", "Root"])
@pytest.mark.parametrize(("nested", "up", "unit"), [(False, "Y", 1.0), (True, "Z", 0.01)])
def test_garments_follow_the_characters_animation(tmp_path, owner, nested, up, unit):
    hero = scenes.saved(animated(tmp_path / "hero.usda", owner, nested=nested, up=up, unit=unit))
    before = hashlib.sha256(hero.read_bytes()).hexdigest()
    target, _ = read_character(hero)
    outfit = read_outfit(scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda")))
    out = tmp_path / "dressed.usda"
    results = dressing.dress(outfit, target)
    write_dressed(out, outfit, target, results)
    away, moved = followed(out, results, target.skeleton_path)
    assert moved > 0.1 and away < 1e-4
    assert hashlib.sha256(hero.read_bytes()).hexdigest() == before
    stage = Usd.Stage.Open(str(out))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1.0, 24.0)
    assert stage.GetTimeCodesPerSecond() == 30.0
    nothing_of_the_animation_is_authored(stage)


def nothing_of_the_animation_is_authored(stage: Usd.Stage) -> None:
    """Neither of the layers that were written has an opinion on an animation or its source."""
    arrays = [layer for layer in stage.GetUsedLayers() if "garments-" in layer.identifier]
    written = [stage.GetRootLayer(), *arrays]
    assert len(written) == 2
    paths: list[Sdf.Path] = []
    for layer in written:
        layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    assert not [p for p in paths if p.name == "skel:animationSource" or "Anim" in str(p)]
