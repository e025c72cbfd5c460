"""What is wrong with a file is said with file, prim, attribute and element."""

from __future__ import annotations

import numpy as np
import pytest
import scenes
from dressform.errors import BadInput
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from pxr import Gf, Sdf, UsdGeom, UsdSkel, Vt

INTS = Sdf.ValueTypeNames.IntArray


def attribute(stage, path):
    return stage.GetAttributeAtPath(path)


def expect(read, file, *wanted):
    """The error's prim, attribute, element and words, and that its text names all of them."""
    prim, name, element, words = wanted
    with pytest.raises(BadInput) as caught:
        read(file)
    error = caught.value
    assert (error.file, error.prim, error.attribute, error.element) == (str(file), prim, name, element)
    text = str(error)
    for part in (str(file), prim, name, "" if element is None else f"[{element}]", words):
        assert part in text, (part, text)


def nan_point(stage):
    points = np.array(attribute(stage, "/Outfit/Shirt.points").Get())
    points[5, 1] = np.nan
    attribute(stage, "/Outfit/Shirt.points").Set(Vt.Vec3fArray.FromNumpy(points))


def index_out_of_range(stage):
    indices = attribute(stage, "/Outfit/Shirt.faceVertexIndices").Get()
    indices[6] = 9999
    attribute(stage, "/Outfit/Shirt.faceVertexIndices").Set(indices)


def too_few_indices(stage):
    indices = attribute(stage, "/Outfit/Shirt.faceVertexIndices").Get()
    attribute(stage, "/Outfit/Shirt.faceVertexIndices").Set(indices[:-1])


def two_cornered_face(stage):
    counts = attribute(stage, "/Outfit/Shirt.faceVertexCounts").Get()
    counts[3] = 2
    attribute(stage, "/Outfit/Shirt.faceVertexCounts").Set(counts)


def no_panels(stage):
    UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Outfit/Shirt")).RemovePrimvar("st")


def short_st(stage):
    st = attribute(stage, "/Outfit/Shirt.primvars:st")
    st.Set(st.Get()[:-3])


def nan_st(stage):
    values = np.array(attribute(stage, "/Outfit/Shirt.primvars:st").Get())
    values[11] = np.inf
    attribute(stage, "/Outfit/Shirt.primvars:st").Set(Vt.Vec2fArray.FromNumpy(values))


def bad_st_index(stage):
    var = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Outfit/Shirt")).GetPrimvar("st")
    indices = np.arange(len(var.Get()))
    indices[2] = -1
    var.SetIndices(Vt.IntArray(indices.tolist()))


def uniform_st(stage):
    UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Outfit/Shirt")).GetPrimvar("st").SetInterpolation("uniform")


def bad_unit(stage):
    prim = stage.GetPrimAtPath("/Outfit/Shirt")
    prim.CreateAttribute("garment:stMetersPerUnit", Sdf.ValueTypeNames.Double).Set(-1.0)


def overlapping_panels(stage):
    front = attribute(stage, "/Outfit/Shirt/front.indices").Get()
    back = list(attribute(stage, "/Outfit/Shirt/back.indices").Get())
    attribute(stage, "/Outfit/Shirt/back.indices").Set([*back, front[0]])


def panel_out_of_range(stage):
    attribute(stage, "/Outfit/Shirt/back.indices").Set([0, 1, 5000])


def seam(stage, a, b):
    prim = stage.GetPrimAtPath("/Outfit/Shirt")
    prim.CreateAttribute("garment:seam:side:edgesA", INTS).Set(a)
    prim.CreateAttribute("garment:seam:side:edgesB", INTS).Set(b)


def degenerate(stage):
    indices = attribute(stage, "/Outfit/Shirt.faceVertexIndices").Get()
    for corner in range(4):
        indices[4 * 7 + corner] = indices[4 * 7]
    attribute(stage, "/Outfit/Shirt.faceVertexIndices").Set(indices)


def flat_in_panel(stage):
    values = np.array(attribute(stage, "/Outfit/Shirt.primvars:st").Get())
    values[4 * 7 : 4 * 8] = values[4 * 7]
    attribute(stage, "/Outfit/Shirt.primvars:st").Set(Vt.Vec2fArray.FromNumpy(values))


def flattened_by_transform(stage):
    UsdGeom.Xformable(stage.GetPrimAtPath("/Outfit")).AddScaleOp().Set(Gf.Vec3f(1, 0, 1))


def lost_body(stage):
    stage.GetPrimAtPath("/Outfit/Shirt").GetRelationship("garment:sourceBody").SetTargets(["/Nobody"])


SHIRT = "/Outfit/Shirt"
GARMENT_CASES = [
    (nan_point, SHIRT, "points", 5, "not finite"),
    (index_out_of_range, SHIRT, "faceVertexIndices", 6, "names point 9999"),
    (too_few_indices, SHIRT, "faceVertexIndices", None, "faceVertexCounts ask for"),
    (two_cornered_face, SHIRT, "faceVertexCounts", 3, "at least 3"),
    (no_panels, SHIRT, "primvars:st", None, "there are no panels"),
    (short_st, SHIRT, "primvars:st", None, "face corners"),
    (nan_st, SHIRT, "primvars:st", 11, "not finite"),
    (bad_st_index, SHIRT, "primvars:st:indices", 2, "is -1"),
    (uniform_st, SHIRT, "primvars:st", None, "uniform"),
    (bad_unit, SHIRT, "garment:stMetersPerUnit", None, "-1.0"),
    (overlapping_panels, f"{SHIRT}/back", "indices", 40, "must not overlap"),
    (panel_out_of_range, f"{SHIRT}/back", "indices", 2, "names face 5000"),
    (lambda s: seam(s, [0, 1], [4, 777]), SHIRT, "garment:seam:side:edgesB", 1, "names point 777"),
    (lambda s: seam(s, [0, 1, 2, 3], [4, 5]), SHIRT, "garment:seam:side:edgesB", None, "edgesA has 4"),
    (lambda s: seam(s, [0, 1, 2], [4, 5, 6]), SHIRT, "garment:seam:side:edgesA", None, "no edges"),
    (degenerate, SHIRT, "faceVertexIndices", 7, "no area in 3D"),
    (flat_in_panel, SHIRT, "faceVertexIndices", 7, "no area in its panel"),
    (flattened_by_transform, SHIRT, "xformOpOrder", None, "cannot be inverted"),
    (lost_body, SHIRT, "garment:sourceBody", None, "/Nobody"),
]


@pytest.mark.parametrize("case", GARMENT_CASES)
def test_garments(tmp_path, case):
    breaks, *wanted = case
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    breaks(stage)
    expect(read_outfit, scenes.saved(stage), *wanted)


def skin(stage, name, change):
    var = getattr(UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body")), f"Get{name}Primvar")()
    values = np.array(var.Get())
    var.Set(type(var.Get())(change(values).tolist()))


def put(index, value):
    def change(values):
        values[index] = value
        return values

    return change


def zero_weights(stage):
    skin(stage, "JointWeights", put(slice(6, 8), 0.0))


def element_sizes_differ(stage):
    UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body")).GetJointWeightsPrimvar().SetElementSize(4)


def two_targets(stage):
    UsdSkel.Skeleton.Define(stage, "/Hero/Other")
    rel = UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body")).GetSkeletonRel()
    rel.SetTargets(["/Hero/Skel", "/Hero/Other"])


def several_skeletons(stage):
    scenes.add_character(stage, "/Hero/Twin", np.eye(3))


def no_skeleton(stage):
    stage.RemovePrim("/Hero/Skel")
    body = stage.GetPrimAtPath("/Hero/Body")
    for name in ("skel:skeleton", "primvars:skel:jointIndices", "primvars:skel:jointWeights"):
        body.RemoveProperty(name)


def no_mesh(stage):
    stage.RemovePrim("/Hero/Body")


def no_weights(stage):
    stage.GetPrimAtPath("/Hero/Body").RemoveProperty("primvars:skel:jointWeights")


def unbound(stage):
    stage.GetPrimAtPath("/Hero/Body").RemoveProperty("skel:skeleton")


def bound_to_a_mesh(stage):
    UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body")).GetSkeletonRel().SetTargets(["/Hero/Body"])


def short_bind(stage):
    value = attribute(stage, "/Hero/Skel.bindTransforms").Get()
    attribute(stage, "/Hero/Skel.bindTransforms").Set(value[:2])


def flat_bind(stage):
    value = attribute(stage, "/Hero/Skel.bindTransforms").Get()
    value[1] = Gf.Matrix4d(0.0)
    attribute(stage, "/Hero/Skel.bindTransforms").Set(value)


def loose_joints(stage):
    attribute(stage, "/Hero/Skel.joints").Set(["root/spine", "root", "root/spine/head"])


def giant(stage):
    UsdGeom.SetStageMetersPerUnit(stage, 100.0)


def wrong_joint_name(stage):
    UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Body")).CreateJointsAttr(["root", "tail", "root/spine"])


BODY, SKEL = "/Hero/Body", "/Hero/Skel"
INDICES, WEIGHTS = "primvars:skel:jointIndices", "primvars:skel:jointWeights"
CHARACTER_CASES = [
    (no_mesh, "/", "", None, "no body mesh"),
    (no_skeleton, "/", "", None, "no skeleton"),
    (no_weights, BODY, WEIGHTS, None, "no mesh has joint weights"),
    (unbound, BODY, "skel:skeleton", None, "bound to no skeleton"),
    (bound_to_a_mesh, BODY, "skel:skeleton", None, "no Skeleton"),
    (two_targets, BODY, "skel:skeleton", None, "several skeletons"),
    (several_skeletons, "/", "skel:skeleton", None, "several skeletons"),
    (short_bind, SKEL, "bindTransforms", None, "2 transforms for 3 joints"),
    (flat_bind, SKEL, "bindTransforms", 1, "cannot be inverted"),
    (loose_joints, SKEL, "joints", None, "no tree"),
    (wrong_joint_name, BODY, "skel:joints", 1, "'tail'"),
    (zero_weights, BODY, WEIGHTS, 6, "sum to 0, not 1"),
    (lambda s: skin(s, "JointWeights", put(4, -0.5)), BODY, WEIGHTS, 4, "point 2"),
    (lambda s: skin(s, "JointWeights", put(4, np.nan)), BODY, WEIGHTS, 4, "point 2"),
    (lambda s: skin(s, "JointIndices", put(9, 44)), BODY, INDICES, 9, "names joint 44"),
    (lambda s: skin(s, "JointIndices", lambda v: v[:-1]), BODY, INDICES, None, "expected"),
    (element_sizes_differ, BODY, WEIGHTS, None, "elementSize 4"),
    (giant, BODY, "points", None, "170 m high"),
]


@pytest.mark.parametrize("case", CHARACTER_CASES)
def test_characters(tmp_path, case):
    breaks, *wanted = case
    stage = scenes.character_stage(tmp_path / "c.usda")
    breaks(stage)
    expect(read_character, scenes.saved(stage), *wanted)


@pytest.mark.parametrize("read", [read_outfit, read_character])
def test_files(tmp_path, read):
    text = tmp_path / "text.usda"
    text.write_text("this is not USD")
    binary = tmp_path / "binary.usdc"
    binary.write_bytes(b"PXR-USDC" + b"\x07" * 64)
    other = tmp_path / "picture.png"
    other.write_bytes(b"\x89PNG")
    expect(read, tmp_path / "missing.usda", "", "", None, "does not exist")
    expect(read, tmp_path, "", "", None, "folder")
    for file in (text, binary, other):
        expect(read, file, "", "", None, "USD cannot open it")


def test_missing_reference(tmp_path):
    stage = scenes.new_stage(tmp_path / "o.usda")
    stage.DefinePrim("/Outfit").GetReferences().AddReference("./gone.usdc")
    expect(read_outfit, scenes.saved(stage), "", "", None, "gone.usdc")


def test_empty_stage_and_unmarked_meshes(tmp_path):
    expect(read_outfit, scenes.saved(scenes.new_stage(tmp_path / "e.usda")), "/", "", None, "no mesh")
    file = scenes.saved(scenes.character_stage(tmp_path / "c.usda"))
    expect(read_outfit, file, "/", "", None, "marked as a garment")


def test_outfit_without_a_body(tmp_path):
    stage = scenes.new_stage(tmp_path / "o.usda")
    scenes.add_shirt(stage, "/Shirt", np.eye(3))
    expect(read_outfit, scenes.saved(stage), "/Shirt", "garment:sourceBody", None, "source body")


def test_time_samples_are_read_at_their_earliest_and_named(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    points = attribute(stage, "/Outfit/Shirt.points")
    first = np.array(points.Get())
    points.Clear()
    points.Set(Vt.Vec3fArray.FromNumpy(first), 3.0)
    points.Set(Vt.Vec3fArray.FromNumpy(first + np.float32(1.0)), 9.0)
    outfit = read_outfit(scenes.saved(stage))
    assert np.abs(outfit.garments[0].points - first).max() < 1e-6
    assert outfit.notes == ["</Outfit/Shirt>: points has 2 time samples: the earliest sample is taken"]


def test_default_value_wins_over_time_samples(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    points = attribute(stage, "/Outfit/Shirt.points")
    first = np.array(points.Get())
    points.Set(Vt.Vec3fArray.FromNumpy(first + np.float32(1.0)), 1.0)
    outfit = read_outfit(scenes.saved(stage))
    assert np.abs(outfit.garments[0].points - first).max() < 1e-6
    assert "the default value is taken" in outfit.notes[0]


def test_repairs_and_oddities_are_named(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    UsdGeom.Imageable(stage.GetPrimAtPath("/Outfit/Shirt")).MakeInvisible()
    stage.GetRootLayer().pseudoRoot.ClearInfo("metersPerUnit")
    outfit_file = scenes.saved(stage)
    with pytest.raises(BadInput):  # 1.7 units of 0.01 m
        read_outfit(outfit_file)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    notes = read_outfit(scenes.saved(stage)).notes
    assert notes == ["</Outfit/Shirt>: the garment is invisible and is read all the same"]
