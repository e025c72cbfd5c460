"""Garments: frames, units, grain, panels, seams, fabrics, n-gons."""

from __future__ import annotations

import numpy as np
import pytest
import scenes
from dressform.usd.fabric import preset_named
from dressform.usd.garment import read_outfit
from dressform.usd.polygon import triangulate
from pxr import Gf, Sdf, UsdGeom, UsdShade, UsdSkel, Vt


def shirt_of(stage):
    outfit = read_outfit(scenes.saved(stage))
    return outfit.garments[0], outfit


def edge_lengths(corners: np.ndarray) -> np.ndarray:
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


def signed_area(corners: np.ndarray) -> np.ndarray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2.0


@pytest.mark.parametrize(("up", "unit"), [("Y", 1.0), ("Z", 1.0), ("Y", 0.01), ("Z", 0.0254)])
def test_any_frame_gives_the_same_garment(tmp_path, up, unit):
    shirt, outfit = shirt_of(scenes.outfit_stage(tmp_path / "o.usda", up, unit))
    points, _ = scenes.tube(0.2, 0.8, 1.3, scenes.SHIRT_RINGS)
    assert np.abs(shirt.points - points).max() < 1e-6
    assert shirt.layer == 1 and shirt.body == 0 and outfit.notes == []
    assert outfit.bodies[0].path == "/SourceBody/Character/Body"
    # a tube of facets develops exactly: 2D and 3D lengths agree whatever the stage's unit
    assert (
        np.abs(edge_lengths(shirt.points[shirt.triangles]) - edge_lengths(shirt.corner_pattern)).max() < 1e-5
    )


def test_warp_is_up_the_grain_and_no_panel_is_turned_inside_out(tmp_path):
    shirt, _ = shirt_of(scenes.outfit_stage(tmp_path / "o.usda"))
    corners = shirt.points[shirt.triangles]
    height = corners[..., 1] - corners[:, :1, 1]
    warp = shirt.corner_pattern[..., 0] - shirt.corner_pattern[:, :1, 0]
    assert np.abs(height - warp).max() < 1e-6
    assert (signed_area(shirt.corner_pattern) > 0.0).all()


def test_grain_angle_turns_counter_clockwise_from_v(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    stage.GetPrimAtPath("/Outfit/Shirt/back").GetAttribute("garment:panel:grainAngle").Set(30.0)
    plain, _ = shirt_of(scenes.outfit_stage(tmp_path / "plain.usda"))
    shirt, _ = shirt_of(stage)
    back = shirt.panel_of_triangle == 1
    v, u = plain.corner_pattern[back][..., 0], -plain.corner_pattern[back][..., 1]
    a = np.radians(30.0)
    assert np.abs(shirt.corner_pattern[back][..., 0] - (-np.sin(a) * u + np.cos(a) * v)).max() < 1e-6
    assert (signed_area(shirt.corner_pattern) > 0.0).all()
    assert np.abs(shirt.corner_pattern[~back] - plain.corner_pattern[~back]).max() == 0.0


def test_a_panel_seen_from_inside_is_mirrored_and_named(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    st = stage.GetPrimAtPath("/Outfit/Shirt").GetAttribute("primvars:st")
    values = np.array(st.Get())
    half = len(values) // (scenes.SHIRT_RINGS - 1)
    column = (np.arange(len(values)) // 4) % (half // 4)
    values[column >= scenes.SIDES // 2, 0] *= -1.0
    st.Set(Vt.Vec2fArray.FromNumpy(values))
    shirt, outfit = shirt_of(stage)
    assert (signed_area(shirt.corner_pattern) > 0.0).all()
    assert [p.mirrored for p in shirt.panels] == [False, True]
    assert any("'back' is seen from inside" in note for note in outfit.notes)


@pytest.mark.parametrize("how", ["attribute", "customData", "inferred", "default"])
def test_unit_of_panel_coordinates(tmp_path, how):
    unit = 1e-3 if how == "default" else 0.01
    stage = scenes.new_stage(tmp_path / "o.usda")
    scenes.add_character(stage, "/Body", np.eye(3))
    prim = scenes.add_shirt(stage, "/Shirt", np.eye(3), st_unit=unit).GetPrim()
    if how == "attribute":
        prim.CreateAttribute("garment:stMetersPerUnit", Sdf.ValueTypeNames.Double).Set(unit)
    elif how == "customData":
        prim.SetCustomDataByKey("stMetersPerUnit", unit)
    shirt, outfit = shirt_of(stage)
    assert shirt.pattern_origin.meters_per_unit == pytest.approx(unit)
    assert shirt.pattern_origin.inferred == (how == "inferred")
    assert len(outfit.notes) == (1 if how == "inferred" else 0)
    assert (
        np.abs(edge_lengths(shirt.points[shirt.triangles]) - edge_lengths(shirt.corner_pattern)).max() < 1e-5
    )


def test_our_own_primvar_wins_over_st(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    prim = stage.GetPrimAtPath("/Outfit/Shirt")
    api = UsdGeom.PrimvarsAPI(prim)
    st = np.array(api.GetPrimvar("st").Get())
    var = api.CreatePrimvar("garment:pattern", Sdf.ValueTypeNames.TexCoord2fArray, "faceVarying")
    var.Set(Vt.Vec2fArray.FromNumpy((st * 1.1e-3).astype(np.float32)))
    shirt, _ = shirt_of(stage)
    plain, _ = shirt_of(scenes.outfit_stage(tmp_path / "plain.usda"))
    assert np.abs(shirt.corner_pattern - 1.1 * plain.corner_pattern).max() < 1e-6


def test_faces_without_subset_become_islands(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    for name in ("front", "back"):
        stage.RemovePrim(f"/Outfit/Shirt/{name}")
    shirt, _ = shirt_of(stage)
    assert [p.name for p in shirt.panels] == ["island_0", "island_1"]
    whole, _ = shirt_of(scenes.outfit_stage(tmp_path / "plain.usda"))
    assert (shirt.panel_of_triangle == whole.panel_of_triangle).all()


def test_seams_are_pairs_of_points(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    prim = stage.GetPrimAtPath("/Outfit/Shirt")
    uniform, ints = Sdf.VariabilityUniform, Sdf.ValueTypeNames.IntArray
    for name, a, b in (("side", [0, 1, 1, 2], [4, 5, 5, 5]), ("pocket", [7, 8], [9, 9])):
        prim.CreateAttribute(f"garment:seam:{name}:edgesA", ints, False, uniform).Set(a)
        prim.CreateAttribute(f"garment:seam:{name}:edgesB", ints, False, uniform).Set(b)
    prim.CreateAttribute("garment:seam:pocket:offset", Sdf.ValueTypeNames.Float, False, uniform).Set(0.003)
    seams = shirt_of(stage)[0].seams
    assert [(s.name, s.offset, s.pairs.tolist()) for s in seams] == [
        ("pocket", True, [[7, 9], [8, 9]]),
        ("side", False, [[0, 4], [1, 5], [2, 5]]),
    ]


def test_quads_keep_their_maps(tmp_path):
    shirt, _ = shirt_of(scenes.outfit_stage(tmp_path / "o.usda"))
    origin = shirt.origin
    assert len(shirt.triangles) == 2 * len(origin.face_vertex_counts)
    assert (origin.face_vertex_indices[origin.corner_of_triangle] == shirt.triangles).all()
    assert (origin.corner_of_triangle // 4 == origin.face_of_triangle[:, None]).all()


def test_concave_polygons_are_cut_inside():
    arrow = np.array([[0, 0, 0], [2, -1, 0], [0.5, 0, 0], [2, 1, 0]], float)
    star = np.array([[np.cos(t), np.sin(t), 0] for t in np.linspace(0, 2 * np.pi, 11)[:-1]])
    star[1::2] *= 0.4
    points = np.concatenate([arrow, star])
    face, corner = triangulate(points, np.array([4, 10]), np.arange(14))
    area = signed_area(points[corner][..., :2])
    assert (area > 0.0).all() and np.bincount(face).tolist() == [2, 8]
    for i, polygon in enumerate((arrow, star)):
        x, y = polygon[:, 0], polygon[:, 1]
        shoelace = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2.0
        assert area[face == i].sum() == pytest.approx(shoelace, abs=1e-12)


def test_fabrics_from_bound_materials(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    silk = UsdShade.Material.Define(stage, "/Outfit/Looks/Silk_Blue")
    plain = UsdShade.Material.Define(stage, "/Outfit/Looks/Plain")
    plain.GetPrim().CreateAttribute("garment:fabric:preset", Sdf.ValueTypeNames.Token).Set("denim")
    plain.GetPrim().CreateAttribute("garment:fabric:stretchWarp", Sdf.ValueTypeNames.Double).Set(77.0)
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/Outfit")).Bind(silk)
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/Outfit/Shirt/back")).Bind(plain)
    front, back = (p.fabric for p in shirt_of(stage)[0].panels)
    assert (front.preset, front.name, front.values) == ("silk", "Silk_Blue", {})
    assert (back.preset, back.name, back.values) == ("denim", "Plain", {"stretch_warp": 77.0})


def test_unknown_fabric_falls_back_to_cotton_with_a_note(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    material = UsdShade.Material.Define(stage, "/Outfit/Looks/Unobtainium")
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/Outfit/Shirt")).Bind(material)
    shirt, outfit = shirt_of(stage)
    assert {p.fabric.preset for p in shirt.panels} == {"cotton"}
    assert outfit.notes == ["</Outfit/Looks/Unobtainium>: no fabric is called 'Unobtainium': cotton is taken"]


def test_preset_names():
    assert preset_named("Denim") == "denim" and preset_named("heavyWool_02") == "wool"
    assert preset_named("silkworm") is None and preset_named("cotton_or_silk") is None


def test_source_body_under_rotation_and_scale(tmp_path):
    """A body from a Z-up stage in metres, referenced into a Y-up stage in centimetres."""
    scenes.saved(scenes.character_stage(tmp_path / "hero.usda", "Z", 1.0))
    stage = scenes.new_stage(tmp_path / "o.usda", "Y", 0.01)
    holder = UsdGeom.Xform.Define(stage, "/Source")
    holder.AddRotateXOp().Set(-90.0)
    holder.AddScaleOp().Set(Gf.Vec3f(100.0))
    stage.DefinePrim("/Source/Hero").GetReferences().AddReference("./hero.usda")
    scenes.add_shirt(stage, "/Shirt", scenes.stage_frame("Y", 0.01), "/Source/Hero")
    _, outfit = shirt_of(stage)
    points, _ = scenes.tube(0.15, 0.0, 1.7, scenes.BODY_RINGS)
    assert np.abs(outfit.bodies[0].points - points).max() < 1e-6
    assert outfit.bodies[0].world_from_joint[2, 1, 3] == pytest.approx(1.5)


def test_garments_of_different_bodies(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    scenes.add_character(stage, "/SourceBody/Other", np.eye(3), girth=1.1)
    scenes.add_shirt(stage, "/Outfit/Coat", np.eye(3), "/SourceBody/Other/Body")
    scenes.add_shirt(stage, "/Outfit/Vest", np.eye(3), "/SourceBody/Character")
    outfit = read_outfit(scenes.saved(stage))
    assert [g.body for g in outfit.garments] == [0, 1, 0] and len(outfit.bodies) == 2


def test_outfit_through_sublayers_and_references(tmp_path):
    scenes.saved(scenes.outfit_stage(tmp_path / "base.usda"))
    over = scenes.new_stage(tmp_path / "over.usda")
    over.GetRootLayer().subLayerPaths.append("./base.usda")
    over.OverridePrim("/Outfit/Shirt").GetAttribute("garment:layer").Set(7)
    assert shirt_of(over)[0].layer == 7


def test_a_skinned_source_body_outside_of_the_stage(tmp_path, samples):
    stage = scenes.new_stage(tmp_path / "o.usda")
    scenes.add_shirt(stage, "/Shirt", np.eye(3))
    outfit = read_outfit(scenes.saved(stage), source_body=samples / "characters" / "source_woman.usdc")
    assert len(outfit.bodies[0].points) == 13_718


def test_sample_outfit(sample_outfit):
    tshirt, skirt = sample_outfit.garments
    assert (tshirt.layer, skirt.layer) == (1, 0) and sample_outfit.notes == []
    assert (len(tshirt.points), len(tshirt.triangles), len(tshirt.panels)) == (2443, 4736, 6)
    assert (len(skirt.points), len(skirt.triangles), len(skirt.panels)) == (2414, 4489, 4)
    assert [len(s.pairs) for s in skirt.seams] == [26, 26, 19, 19, 4, 4] and tshirt.seams == []
    for seam in skirt.seams:
        gap = skirt.points[seam.pairs[:, 0]] - skirt.points[seam.pairs[:, 1]]
        assert np.linalg.norm(gap, axis=1).max() < 1e-6
    for garment in (tshirt, skirt):
        ratio = edge_lengths(garment.points[garment.triangles]) / edge_lengths(garment.corner_pattern)
        low, high = np.percentile(ratio, [1, 99])
        assert 0.85 < low < 1.0 < high < 1.2
        assert (signed_area(garment.corner_pattern) > 0.0).all()


def test_outside_data(outside_data):
    outfits = sorted((outside_data / "outfits").glob("*.usda"))
    assert outfits
    for file in outfits:
        outfit = read_outfit(file)
        assert outfit.notes == [] and len(outfit.bodies) == 1


def test_a_skinned_garment_follows_its_binding(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    prim = stage.GetPrimAtPath("/Outfit/Shirt")
    ones = np.ones((len(prim.GetAttribute("points").Get()), 1))
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/SourceBody/Character/Skel"))
    scenes.bind_skin(prim, skeleton, ones.astype(int), ones)
    UsdSkel.BindingAPI(prim).CreateGeomBindTransformAttr(Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 0.1, 0)))
    UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(5.0, 0.0, 0.0))
    points, _ = scenes.tube(0.2, 0.9, 1.4, scenes.SHIRT_RINGS)
    assert np.abs(shirt_of(stage)[0].points - points).max() < 1e-6
    UsdSkel.BindingAPI(prim).GetSkeletonRel().SetTargets(["/Gone"])
    shirt, outfit = shirt_of(stage)
    assert np.abs(shirt.points - (points - [0, 0.1, 0] + [5.0, 0, 0])).max() < 1e-6
    assert any("/Gone" in note for note in outfit.notes)
