"""Blend shapes of the body that move a garment come along: a belly on the tube of a body."""

from __future__ import annotations

import json

import dressform
import numpy as np
import pytest
import scenes
from dressform.errors import BadInput
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from pxr import Gf, Tf, Usd, UsdGeom, UsdSkel, Vt

STILL = {"drape": {"frames": 0, "push_steps": 0, "settle": False}, "posed": {"enabled": False}}
#: How far the belly grows [m]; the shirt is 5 cm from the body.
BELLY = 0.12


def add_shape(stage: Usd.Stage, name: str, world: np.ndarray, moved: np.ndarray, up: str, unit: float):
    """A sparse blend shape of ``/Hero/Body``; world offsets [m] for the points that ``moved`` names."""
    offsets = (world[moved] @ scenes.stage_frame(up, unit).T).astype(np.float32)
    shape = UsdSkel.BlendShape.Define(stage, f"/Hero/Body/{Tf.MakeValidIdentifier(name)}")
    shape.CreatePointIndicesAttr(Vt.IntArray(moved.tolist()))
    shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(offsets))
    binding = UsdSkel.BindingAPI.Apply(stage.GetPrimAtPath("/Hero/Body"))
    names = list(binding.GetBlendShapesAttr().Get() or [])
    binding.CreateBlendShapesAttr([*names, name])
    binding.CreateBlendShapeTargetsRel().AddTarget(shape.GetPath())
    return shape


def belly_of(points: np.ndarray) -> np.ndarray:
    """World offsets of a belly in front (+Z) between 0.85 m and 1.25 m, shape [n, 3]."""
    round_ = np.clip(1.0 - ((points[:, 1] - 1.05) / 0.3) ** 2, 0.0, None)
    ahead = np.clip(points[:, 2], 0.0, None) / 0.15
    return BELLY * (round_ * ahead)[:, None] * np.array([0.0, 0.0, 1.0])


def body_points() -> np.ndarray:
    return scenes.tube(0.15, 0.0, 1.7, scenes.BODY_RINGS)[0]


@pytest.fixture(params=[("Y", 1.0), ("Z", 0.01)], ids=["Y-m", "Z-cm"])
def fitted(request, tmp_path):
    """A dressed character whose body has a belly with an in-between, and a shape of the crown."""
    up, unit = request.param
    stage = scenes.character_stage(tmp_path / "hero.usda", up, unit)
    points = body_points()
    belly, crown = belly_of(points), np.where(points[:, 1:2] > 1.6, [[0.0, 0.05, 0.0]], 0.0)
    moved = np.flatnonzero(np.linalg.norm(belly, axis=1) > 1e-6)
    shape = add_shape(stage, "belly", belly, moved, up, unit)
    between = shape.CreateInbetween("half")
    between.SetWeight(0.5)
    half = 0.7 * belly[moved] @ scenes.stage_frame(up, unit).T
    between.SetOffsets(Vt.Vec3fArray.FromNumpy(half.astype(np.float32)))
    add_shape(stage, "crown", crown, np.flatnonzero(crown[:, 1]), up, unit)
    hero = scenes.saved(stage)
    outfit = scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda"))
    out = tmp_path / "dressed.usda"
    settings = {**STILL, "blend_shapes": {"enabled": True}}
    return dressform.fit(outfit, hero, out, settings=settings, device="cpu"), out


def weighted(out, weight: float) -> tuple[np.ndarray, np.ndarray]:
    """World points of shirt and body as UsdSkel deforms them with the belly at a weight [m]."""
    stage = Usd.Stage.Open(str(out))
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/Hero/Skel"))
        animation = UsdSkel.Animation.Define(stage, "/Hero/Skel/Belly")
        animation.CreateJointsAttr(skeleton.GetJointsAttr().Get())
        animation.SetTransforms(skeleton.GetRestTransformsAttr().Get())
        animation.CreateBlendShapesAttr(["belly"])
        animation.CreateBlendShapeWeightsAttr([weight])
        binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
        binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
        assert UsdSkel.BakeSkinning(UsdSkel.Root(stage.GetPrimAtPath("/Hero")), Gf.Interval(1.0, 1.0))
    frame = read_outfit(out).frame.world_from_stage
    cache = UsdGeom.XformCache(1.0)

    def world(path: str) -> np.ndarray:
        prim = stage.GetPrimAtPath(path)
        points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(1.0), float)
        matrix = frame @ np.array(cache.GetLocalToWorldTransform(prim)).T
        return points @ matrix[:3, :3].T + matrix[:3, 3]

    return world("/Hero/Outfit/Shirt"), world("/Hero/Body")


def radius(points: np.ndarray) -> np.ndarray:
    """Distance from the body's axis in front, as far as the belly has not moved it aside."""
    return np.hypot(points[:, 0], points[:, 2])


def test_the_shape_that_moves_the_garment_comes_along_and_drives_it(fitted):
    result, out = fitted
    (shirt,) = result.garments
    assert shirt.blend_shapes == ["belly", "belly:half"]
    rest, body_rest = weighted(out, 0.0)
    full, body_full = weighted(out, 1.0)
    half, _ = weighted(out, 0.5)
    assert np.abs(body_full - body_rest).max() == pytest.approx(BELLY, rel=0.05)
    moved = full - rest
    # Nothing but forward, as far as the skin below, back to nothing at the back.
    assert np.abs(moved[:, :2]).max() < 1e-3
    front = np.argmax(rest[:, 2] - 10.0 * np.abs(rest[:, 1] - 1.05))
    assert moved[front, 2] == pytest.approx(BELLY, rel=0.2)
    assert np.abs(moved[rest[:, 2] < -0.1]).max() < 5e-3
    # The in-between is followed at its weight.
    assert (half - rest)[front, 2] == pytest.approx(0.7 * moved[front, 2], rel=1e-3)
    # It stays in front of the skin, which without the shape comes through it.
    in_front = (np.abs(rest[:, 0]) < 0.05) & (rest[:, 2] > 0.0)
    skin = np.interp(rest[in_front, 1], *profile(body_full))
    assert (full[in_front, 2] > skin + 0.02).all()
    assert (rest[in_front, 2] < skin).any()


def profile(body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights and how far the body comes forward there."""
    heights = np.unique(np.round(body[:, 1], 4))
    return heights, np.array([body[np.abs(body[:, 1] - h) < 1e-3, 2].max() for h in heights])


def test_shapes_are_sparse_and_named_as_the_bodys(fitted):
    _, out = fitted
    stage = Usd.Stage.Open(str(out))
    shirt = stage.GetPrimAtPath("/Hero/Outfit/Shirt")
    binding = UsdSkel.BindingAPI(shirt)
    assert list(binding.GetBlendShapesAttr().Get()) == ["belly"]
    (target,) = binding.GetBlendShapeTargetsRel().GetTargets()
    shape = UsdSkel.BlendShape(stage.GetPrimAtPath(target))
    count = len(shape.GetPointIndicesAttr().Get())
    assert 0 < count < len(UsdGeom.Mesh(shirt).GetPointsAttr().Get())
    assert len(shape.GetOffsetsAttr().Get()) == count
    assert [b.GetWeight() for b in shape.GetInbetweens()] == [0.5]


def test_without_the_setting_nothing_is_written(tmp_path):
    stage = scenes.character_stage(tmp_path / "hero.usda")
    add_shape(stage, "belly", belly_of(body_points()), np.arange(len(body_points())), "Y", 1.0)
    hero = scenes.saved(stage)
    outfit = scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda"))
    result = dressform.fit(outfit, hero, tmp_path / "out.usda", settings=STILL, device="cpu")
    assert result.garments[0].blend_shapes == []
    stage = Usd.Stage.Open(result.output)
    shirt = stage.GetPrimAtPath("/Hero/Outfit/Shirt")
    assert not UsdSkel.BindingAPI(shirt).GetBlendShapesAttr().HasAuthoredValue()


@pytest.mark.parametrize(
    ("change", "attribute", "said"),
    [
        (lambda s, b: s.CreatePointIndicesAttr([0, 5000]), "pointIndices", "point 5000"),
        (lambda s, b: s.CreateOffsetsAttr([(0, 0, 1)]), "offsets", "1 offsets for 2 points"),
        (lambda s, b: s.CreateOffsetsAttr([(0, 0, 1), (0, float("nan"), 0)]), "offsets", "finite"),
        (lambda s, b: b.CreateBlendShapesAttr(["belly", "more"]), "skel:blendShapes", "2 names for 1"),
        (
            lambda s, b: b.GetBlendShapeTargetsRel().SetTargets(["/Hero/Skel"]),
            "skel:blendShapeTargets",
            "no Blend",
        ),
    ],
)
def test_broken_shapes_are_bad_input(tmp_path, change, attribute, said):
    stage = scenes.character_stage(tmp_path / "hero.usda")
    shape = add_shape(stage, "belly", belly_of(body_points()), np.array([0, 1]), "Y", 1.0)
    change(shape, UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body")))
    hero = scenes.saved(stage)
    with pytest.raises(BadInput, match=said) as caught:
        read_character(hero, blend_shapes=True)
    assert caught.value.attribute == attribute
    assert read_character(hero)[0].blend_shapes == []


def test_arrays_are_checked_by_the_core(tmp_path):
    hero = scenes.saved(scenes.character_stage(tmp_path / "hero.usda"))
    outfit = read_outfit(scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda")))
    character, _ = read_character(hero)
    wrong = dressform.model.BlendShape("belly", np.array([99999], np.uint32), np.zeros((1, 3)))
    character.blend_shapes = [wrong]
    with pytest.raises(BadInput, match="blend shape belly: 'points': element 0: point 99999"):
        dressform.fit_arrays(outfit, character, json.dumps(STILL), "cpu")
