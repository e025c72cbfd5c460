"""Characters: frames, joint orders, bindings, colliders."""

from __future__ import annotations

import numpy as np
import pytest
import scenes
from dressform.errors import BadInput
from dressform.usd.character import read_character, require_same_topology
from pxr import Gf, UsdGeom, UsdSkel, Vt

FRAMES = [("Y", 1.0), ("Z", 1.0), ("Y", 0.01), ("Z", 0.0254)]


@pytest.mark.parametrize(("up", "unit"), FRAMES)
def test_any_frame_gives_the_same_body(tmp_path, up, unit):
    character, notes = read_character(scenes.saved(scenes.character_stage(tmp_path / "c.usda", up, unit)))
    points, _ = scenes.tube(0.15, 0.0, 1.7, scenes.BODY_RINGS)
    assert np.abs(character.points - points).max() < 1e-6
    assert (
        np.abs(character.world_from_joint[:, :3, 3] - [[0, h, 0] for h in scenes.JOINT_HEIGHTS]).max() < 1e-6
    )
    assert character.joints == scenes.JOINTS and character.joint_parents == [-1, 0, 1]
    assert notes == []


def test_faces_point_outward_in_every_handedness(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Hero/Body"))
    mesh.CreateOrientationAttr("leftHanded")
    mesh.GetFaceVertexIndicesAttr().Set(mesh.GetFaceVertexIndicesAttr().Get()[::-1])
    character, _ = read_character(scenes.saved(stage))
    corners = character.points[character.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = corners.mean(axis=1) * [1.0, 0.0, 1.0]
    assert ((normal * outward).sum(axis=1) > 0.0).all()


def test_body_follows_its_binding_and_says_so(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    body = stage.GetPrimAtPath("/Hero/Body")
    shift = Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(0.0, 0.5, 0.0))
    UsdSkel.BindingAPI(body).CreateGeomBindTransformAttr(shift)
    UsdGeom.Xformable(stage.GetPrimAtPath("/Hero")).AddRotateYOp().Set(90.0)
    character, notes = read_character(scenes.saved(stage))
    points, _ = scenes.tube(0.15, 0.5, 2.2, scenes.BODY_RINGS)
    turned = points @ np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0.0]])
    assert np.abs(character.points - turned).max() < 1e-6
    assert any("differs from its binding" in note for note in notes)


def test_mesh_local_joint_order_is_mapped(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    before, _ = read_character(scenes.saved(stage))
    body = stage.GetPrimAtPath("/Hero/Body")
    binding = UsdSkel.BindingAPI(body)
    binding.CreateJointsAttr(scenes.JOINTS[::-1])
    old = np.array(binding.GetJointIndicesPrimvar().Get())
    binding.GetJointIndicesPrimvar().Set(Vt.IntArray((2 - old).tolist()))
    after, _ = read_character(scenes.saved(stage))
    assert (before.joint_indices == after.joint_indices).all()


def test_mesh_joints_are_found_by_name_through_subsets_and_other_roots(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    before, _ = read_character(scenes.saved(stage))
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body"))
    indices = np.array(binding.GetJointIndicesPrimvar().Get())
    indices[indices == 0] = 1  # the mesh leaves the root out
    bare = [joint.rpartition("/")[2] for joint in scenes.JOINTS]
    binding.CreateJointsAttr(["other/" + bare[2], bare[1]])
    binding.GetJointIndicesPrimvar().Set(Vt.IntArray((2 - indices).tolist()))
    after, notes = read_character(scenes.saved(stage))
    assert (np.maximum(before.joint_indices, 1) == after.joint_indices).all()
    assert len(notes) == 1 and "2 joints were found in the skeleton by name alone" in notes[0]
    binding.CreateJointsAttr([bare[2], "tail"])
    with pytest.raises(BadInput, match=r"</Hero/Body>\.skel:joints\[1\].*'tail' is not in the skeleton"):
        read_character(scenes.saved(stage))


def test_constant_weights_are_spread(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body"))
    for name, value in (("jointIndices", Vt.IntArray([1])), ("jointWeights", Vt.FloatArray([1.0]))):
        var = getattr(binding, f"Create{name[0].upper()}{name[1:]}Primvar")(True, 1)
        var.Set(value)
        var.SetElementSize(1)
        var.SetInterpolation(UsdGeom.Tokens.constant)
    character, _ = read_character(scenes.saved(stage))
    assert character.skin_influences == 1
    assert (character.joint_indices == 1).all() and len(character.joint_indices) == len(character.points)


def test_sums_that_are_off_are_normalised_and_named(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    var = UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body")).GetJointWeightsPrimvar()
    weights = np.array(var.Get())
    weights[14:16] *= 0.5
    var.Set(Vt.FloatArray(weights.tolist()))
    character, notes = read_character(scenes.saved(stage))
    assert np.abs(character.joint_weights.reshape(-1, 2).sum(axis=1) - 1.0).max() < 1e-12
    assert len(notes) == 1 and "point 7: 0.5" in notes[0] and "</Hero/Body>" in notes[0]


def test_colliders_by_path_name_and_pattern(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    points, quads = scenes.tube(0.05, 0.0, 0.1, 2)
    for side in "LR":
        scenes.add_mesh(stage, f"/Hero/Shoes/Shoe{side}", points, quads)
    file = scenes.saved(stage)
    for wanted, count in ((["/Hero/Shoes"], 2), (["ShoeL"], 1), (["Shoe?"], 2), (["ShoeL", "Shoes"], 2)):
        assert len(read_character(file, colliders=wanted)[0].colliders) == count, wanted
    with pytest.raises(BadInput, match="named as a collider"):
        read_character(file, colliders=["Hat"])


def test_largest_skinned_mesh_is_the_body_and_another_can_be_named(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    points, quads = scenes.tube(0.16, 0.0, 1.6, 3)
    glove = scenes.add_mesh(stage, "/Hero/Glove", points, quads)
    ones = np.ones((len(points), 1))
    scenes.bind_skin(
        glove.GetPrim(), UsdSkel.Skeleton(stage.GetPrimAtPath("/Hero/Skel")), ones.astype(int), ones
    )
    file = scenes.saved(stage)
    assert read_character(file)[0].path == "/Hero/Body"
    assert read_character(file, body="/Hero/Glove")[0].path == "/Hero/Glove"


def test_variants_are_selected_in_the_session_only(tmp_path):
    stage = scenes.character_stage(tmp_path / "c.usda")
    hero = stage.GetPrimAtPath("/Hero")
    girth = hero.GetVariantSets().AddVariantSet("girth")
    wide = scenes.tube(0.3, 0.0, 1.7, scenes.BODY_RINGS)[0]
    slim = Vt.Vec3fArray(stage.GetPrimAtPath("/Hero/Body").GetAttribute("points").Get())
    stage.GetPrimAtPath("/Hero/Body").GetAttribute("points").Clear()
    for name, points in (("wide", Vt.Vec3fArray.FromNumpy(wide.astype(np.float32))), ("slim", slim)):
        girth.AddVariant(name)
        girth.SetVariantSelection(name)
        with girth.GetVariantEditContext():
            stage.GetPrimAtPath("/Hero/Body").GetAttribute("points").Set(points)
    file = scenes.saved(stage)
    before = file.read_bytes()
    assert np.ptp(read_character(file)[0].points[:, 0]) == pytest.approx(0.3)
    chosen = read_character(file, variants={"/Hero": {"girth": "wide"}})[0]
    assert np.ptp(chosen.points[:, 0]) == pytest.approx(0.6)
    assert file.read_bytes() == before
    with pytest.raises(BadInput, match="huge"):
        read_character(file, variants={"/Hero": {"girth": "huge"}})


def test_instanced_character_is_read(tmp_path):
    scenes.saved(scenes.character_stage(tmp_path / "hero.usda"))
    stage = scenes.new_stage(tmp_path / "set.usda")
    prim = stage.DefinePrim("/Set")
    prim.GetReferences().AddReference("./hero.usda")
    prim.SetInstanceable(True)
    assert len(read_character(scenes.saved(stage))[0].points) == scenes.SIDES * scenes.BODY_RINGS


def test_topology_mismatch_names_the_first_difference(tmp_path):
    source, _ = read_character(scenes.saved(scenes.character_stage(tmp_path / "a.usda")))
    stage = scenes.character_stage(tmp_path / "b.usda")
    same, _ = read_character(scenes.saved(stage))
    require_same_topology(source, same)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Hero/Body"))
    indices = list(mesh.GetFaceVertexIndicesAttr().Get())
    indices[9], indices[10] = indices[10], indices[9]
    mesh.GetFaceVertexIndicesAttr().Set(indices)
    other, _ = read_character(scenes.saved(stage))
    with pytest.raises(BadInput) as caught:
        require_same_topology(source, other)
    assert (caught.value.prim, caught.value.attribute, caught.value.element) == (
        "/Hero/Body",
        "faceVertexIndices",
        9,
    )


def test_sample_characters(samples):
    for file in sorted((samples / "characters").glob("*.usdc")):
        character, notes = read_character(file)
        assert len(character.points) == 13_718 and character.skin_influences == 8 and notes == []
        assert len(character.joints) == 104
        assert 1.6 < np.ptp(character.points[:, 1]) < 1.7 and abs(character.points[:, 1].min()) < 1e-6
