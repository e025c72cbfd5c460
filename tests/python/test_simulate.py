"""A garment on a body that an animation moves: a tube that bends, in a shirt held by an elastic."""

import dressform
import numpy as np
import pytest
import scenes
from dressform.errors import BadInput
from dressform.simulating import simulate
from dressform.usd.character import read_character
from dressform.usd.motion import read_motion
from dressform.usd.stage import open_stage
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

TIMES = (10, 13)
HELD = {"drape": {"hold": {"when": "always", "elastic": ["front", "back"]}}}


def bend(stage: Usd.Stage, degrees: float) -> None:
    """The spine bends sideways from 0 at the first time to ``degrees`` at the last."""
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/SourceBody/Character/Skel"))
    animation = UsdSkel.Animation.Define(stage, "/SourceBody/Character/Skel/Bend")
    animation.CreateJointsAttr(scenes.JOINTS)
    at, _, size = UsdSkel.DecomposeTransforms(skeleton.GetRestTransformsAttr().Get())
    animation.CreateTranslationsAttr(at)
    animation.CreateScalesAttr(size)
    rotations = animation.CreateRotationsAttr()
    for time, angle in zip(TIMES, (5.0, degrees), strict=True):
        turn = Gf.Quatf(Gf.Rotation(Gf.Vec3d(0, 1, 0), angle).GetQuat())
        rotations.Set(Vt.QuatfArray([Gf.Quatf(1), turn, Gf.Quatf(1)]), time)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])


@pytest.fixture
def moving(tmp_path):
    stage = scenes.new_stage(tmp_path / "moving.usda", up="Z", unit=0.01)
    frame = scenes.stage_frame("Z", 0.01)
    # A body that fills the shirt but for 4 mm: its elastic has something to hold on to.
    body = "/SourceBody/Character"
    scenes.add_character(stage, body, frame, girth=1.3)
    scenes.add_shirt(stage, "/Outfit/Shirt", frame, body)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Outfit"))
    bend(stage, 15.0)
    return scenes.saved(stage)


def test_the_body_moves_as_usd_moves_it(moving):
    character = read_character(moving)[0]
    source = open_stage(moving)
    motion = read_motion(source, character, lead_in=3)
    assert (motion.times, motion.lead_in) == ([10.0, 11.0, 12.0, 13.0], 3)
    assert motion.seconds_per_frame == pytest.approx(1 / 24)
    np.testing.assert_allclose(motion.points[0], character.points, atol=1e-9)
    # The lead-in goes from the bind pose to the first frame without a jump.
    jumps = np.abs(np.diff(motion.points[:4], axis=0)).max(axis=(1, 2))
    assert 0.0 < jumps.max() < 0.08
    stage = Usd.Stage.Open(str(moving))
    root = UsdSkel.Root(stage.GetPrimAtPath("/SourceBody/Character"))
    assert UsdSkel.BakeSkinning(root, Gf.Interval(10, 13))
    baked = UsdGeom.Mesh(stage.GetPrimAtPath("/SourceBody/Character/Body"))
    for i, time in ((0, 10.0), (3, 13.0)):  # USD bakes at authored times only
        points = np.array(baked.GetPointsAttr().Get(time), dtype=np.float64)
        local = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(baked.GetPrim())).T
        world = source.frame.world_from_stage @ local
        posed = points @ world[:3, :3].T + world[:3, 3]
        np.testing.assert_allclose(motion.points[3 + i], posed, atol=1e-6)


def test_points_are_written_over_time_and_no_longer_skinned(moving, tmp_path):
    before = moving.read_bytes()
    out = tmp_path / "simulated.usda"
    found = simulate(moving, out, lead_in=3, settings=HELD, device="cpu")
    (shirt,) = found["garments"]
    assert found["frames"] == 4
    assert shirt["crossed_frames"] == 0
    assert shirt["drape"]["blocked_steps"] == 0
    assert moving.read_bytes() == before
    stage = Usd.Stage.Open(str(out))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == TIMES
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/Outfit/Shirt")).GetPointsAttr()
    assert points.GetTimeSamples() == [10.0, 11.0, 12.0, 13.0]
    first, last = (np.array(points.Get(t)) for t in TIMES)
    assert np.isfinite(last).all()
    # Held by its elastic it goes along as the spine bends: its top moves by more than its bottom.
    moved = np.linalg.norm(last - first, axis=1).reshape(scenes.SHIRT_RINGS, -1).mean(axis=1)
    assert moved[-1] > moved[0] + 2.0


def test_a_body_without_animation_is_refused(tmp_path):
    path = scenes.saved(scenes.outfit_stage(tmp_path / "still.usda"))
    with pytest.raises(BadInput, match="not animated"):
        simulate(path, tmp_path / "out.usda")


def test_frames_must_have_the_body_s_points(sample_outfit):
    (body,) = sample_outfit.bodies
    with pytest.raises(dressform.errors.BadInput, match="has 10 points"):
        dressform.native.simulate_arrays(sample_outfit, body, np.zeros((2, 10, 3)), 1 / 24, device="cpu")
