"""What a dressed character's layers hold, and that they read back."""

from __future__ import annotations

import os
import subprocess
import sys

import dressing
import numpy as np
import pytest
import scenes
from conftest import REPOSITORY
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from dressform.usd.write import write_dressed
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils, Vt


@pytest.fixture(scope="module")
def dressed_sample(tmp_path_factory, sample_outfit, sample_target):
    out = tmp_path_factory.mktemp("dressed") / "sub" / "dressed.usda"
    results = dressing.dress(sample_outfit, sample_target)
    notes = write_dressed(out, sample_outfit, sample_target, results)
    assert notes == []
    return out, results


def scene(tmp_path, up="Y", unit=1.0, change=None, change_outfit=None):
    """Outfit (Z up, cm), target and results of the small scene."""
    stage = scenes.outfit_stage(tmp_path / "outfit.usda", "Z", 0.01)
    if change_outfit:
        change_outfit(stage)
    outfit = read_outfit(scenes.saved(stage))
    stage = scenes.character_stage(tmp_path / "hero.usda", up, unit, girth=1.2)
    if change:
        change(stage)
    target, _ = read_character(scenes.saved(stage))
    return outfit, target, dressing.dress(outfit, target)


def subsets_of(prim):
    """Names and faces, in order."""
    subsets = UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim))
    return [(s.GetPrim().GetName(), s.GetIndicesAttr().Get()) for s in subsets]


def test_root_layer_is_small_and_in_the_characters_frame(dressed_sample, sample_target):
    out, _ = dressed_sample
    layer = Sdf.Layer.FindOrOpen(str(out))
    assert out.stat().st_size < 8000
    assert layer.defaultPrim == "thin_woman"
    assert layer.pseudoRoot.GetInfo("upAxis") == "Z" and layer.pseudoRoot.GetInfo("metersPerUnit") == 1.0
    references = {r for r in layer.GetExternalReferences() if r}
    assert len(references) == 2 and all(not os.path.isabs(r) for r in references)
    text = out.read_text()
    assert str(out.parent) not in text and str(out.parent.parent) not in text


def test_stage_composes_and_holds_one_body(dressed_sample):
    out, _ = dressed_sample
    stage = Usd.Stage.Open(str(out))
    assert stage.GetCompositionErrors() == []
    meshes = [str(p.GetPath()) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
    assert meshes == [f"/thin_woman/{name}" for name in ("Body", "Outfit/Tshirt", "Outfit/Skirt")]
    for prim in stage.Traverse():
        for rel in prim.GetAuthoredRelationships():
            for target in rel.GetTargets():
                assert stage.GetObjectAtPath(target), (prim, rel, target)


def test_source_mesh_is_as_it_was(dressed_sample, sample_outfit):
    out, _ = dressed_sample
    stage, source = Usd.Stage.Open(str(out)), Usd.Stage.Open(sample_outfit.file)
    new = {"points", "extent", "normals", "garment:sourceBody", "garment:state", "skel:skeleton"}
    for garment in sample_outfit.garments:
        before, after = (
            source.GetPrimAtPath(garment.path),
            stage.GetPrimAtPath(f"/thin_woman/Outfit/{garment.name}"),
        )
        for attribute in before.GetAuthoredAttributes():
            name = attribute.GetName()
            if name not in new:
                assert after.GetAttribute(name).Get() == attribute.Get(), name
                assert after.GetAttribute(name).GetAllAuthoredMetadata() == attribute.GetAllAuthoredMetadata()
        assert subsets_of(before) == subsets_of(after)


def test_dressed_outfit_reads_back(dressed_sample, sample_outfit, sample_target):
    out, results = dressed_sample
    again = read_outfit(out)
    assert again.notes == [] and np.abs(again.bodies[0].points - sample_target.points).max() == 0.0
    for garment, result, source in zip(again.garments, results, sample_outfit.garments, strict=True):
        assert np.abs(garment.points - result.points).max() < 2e-7
        assert np.abs(garment.corner_pattern - result.corner_pattern).max() < 2e-7
        assert (garment.triangles == source.triangles).all()
        assert (garment.panel_of_triangle == source.panel_of_triangle).all()
        assert garment.pattern_origin.attribute == "primvars:garment:pattern"
        for ours, theirs in zip(garment.seams, source.seams, strict=True):
            assert ours.name == theirs.name and (ours.pairs == theirs.pairs).all()


def test_rest_shapes_hold_the_pattern(dressed_sample):
    """In both dialects, and with the right area: what a cloth importer computes from them."""
    out, results = dressed_sample
    stage = Usd.Stage.Open(str(out))
    for name, result in zip(("Tshirt", "Skirt"), results, strict=True):
        prim = stage.GetPrimAtPath(f"/thin_woman/Outfit/{name}")
        a, b = (result.corner_pattern[:, i] - result.corner_pattern[:, 0] for i in (1, 2))
        expected = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2.0
        for space, triangles, flat in (
            ("physics", "restTriVertexIndices", "flat"),
            ("omniphysics", "restTriVtxIndices", "flatDefault"),
        ):
            rest = np.array(prim.GetAttribute(f"{space}:restShapePoints").Get(), float)
            tri = np.array(prim.GetAttribute(f"{space}:{triangles}").Get())
            assert tri.shape == (len(prim.GetAttribute("faceVertexCounts").Get()), 3)
            normal = np.cross(rest[tri[:, 1]] - rest[tri[:, 0]], rest[tri[:, 2]] - rest[tri[:, 0]])
            assert (normal[:, 2] > 0.0).all()
            assert normal[:, 2].sum() / 2.0 == pytest.approx(expected, rel=1e-5)
            assert prim.GetAttribute(f"{space}:restBendAnglesDefault").Get() == flat
        assert "PhysicsSurfaceDeformableSimAPI" in prim.GetMetadata("apiSchemas").GetAddedOrExplicitItems()


def test_normals_are_new_and_smooth_over_seams(dressed_sample, sample_outfit):
    out, _ = dressed_sample
    stage = Usd.Stage.Open(str(out))
    for garment in sample_outfit.garments:
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/thin_woman/Outfit/{garment.name}"))
        normals, points = np.array(mesh.GetNormalsAttr().Get()), np.array(mesh.GetPointsAttr().Get())
        assert mesh.GetNormalsInterpolation() == "vertex" and normals.shape == points.shape
        corners = points[garment.triangles]
        face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        agree = (face[:, None] * normals[garment.triangles]).sum(axis=2) > 0.0
        assert agree.mean() > 0.99
        assert np.abs(np.linalg.norm(normals, axis=1) - 1.0).max() < 1e-5


def test_weights_are_sorted_normalised_and_of_the_target(dressed_sample, sample_target):
    out, _ = dressed_sample
    stage = Usd.Stage.Open(str(out))
    for name in ("Tshirt", "Skirt"):
        binding = UsdSkel.BindingAPI(stage.GetPrimAtPath(f"/thin_woman/Outfit/{name}"))
        weights, indices = binding.GetJointWeightsPrimvar(), binding.GetJointIndicesPrimvar()
        assert weights.GetElementSize() == indices.GetElementSize() == 8
        assert weights.GetInterpolation() == "vertex"
        w = np.array(weights.Get()).reshape(-1, 8)
        assert (np.diff(w, axis=1) <= 0.0).all() and np.abs(w.sum(axis=1) - 1.0).max() < 1e-5
        assert np.array(indices.Get()).max() < len(sample_target.joints)
        assert binding.GetSkeletonRel().GetTargets() == [Sdf.Path("/thin_woman/Skel")]


def test_weights_are_brought_to_a_sum_of_one_and_in_order(tmp_path):
    outfit, target, results = scene(tmp_path)
    n = len(results[0].points)
    results[0].influences = 3
    results[0].joint_indices = np.tile([2, 0, 1], n)
    results[0].joint_weights = np.tile([0.2, 0.0, 0.6], n)
    out = tmp_path / "out.usda"
    write_dressed(out, outfit, target, results)
    stage = Usd.Stage.Open(str(out))
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Outfit/Shirt"))
    assert np.array(binding.GetJointIndicesPrimvar().Get()).reshape(-1, 3)[5].tolist() == [1, 2, 0]
    assert np.array(binding.GetJointWeightsPrimvar().Get()).reshape(-1, 3)[5].tolist() == [0.75, 0.25, 0.0]


def test_certificate_stands_on_the_garment(tmp_path):
    outfit, target, results = scene(tmp_path)
    out = tmp_path / "out.usda"
    write_dressed(out, outfit, target, results, passed=False, broken=["3 body intersections, 0 allowed"])
    stage = Usd.Stage.Open(str(out))
    prim = stage.GetPrimAtPath("/Hero/Outfit/Shirt")
    assert prim.HasAPI("GarmentCertificateAPI")
    get = lambda key: prim.GetAttribute(f"garment:certificate:{key}").Get()  # noqa: E731
    assert get("passed") is False and list(get("broken")) == ["3 body intersections, 0 allowed"]
    assert get("body_intersections") == 3 and get("body_penetration_max_m") == 1.25e-3
    assert get("strain_warp") == Gf.Vec3d(-0.01, 0.0, 0.02)
    assert prim.GetAttribute("garment:state").Get() == "dressed"
    assert prim.GetRelationship("garment:character").GetTargets() == [Sdf.Path("/Hero")]


@pytest.mark.parametrize(("up", "unit"), [("Y", 1.0), ("Z", 0.01), ("Z", 1.0), ("Y", 0.0254)])
def test_units_and_axes_of_outfit_and_character_differ(tmp_path, up, unit):
    def offset(stage):
        prim = stage.GetPrimAtPath("/Outfit/Shirt")
        for name, value in (("edgesA", [0, 1]), ("edgesB", [40, 41])):
            prim.CreateAttribute(f"garment:seam:pocket:{name}", Sdf.ValueTypeNames.IntArray).Set(value)
        prim.CreateAttribute("garment:seam:pocket:offset", Sdf.ValueTypeNames.Float).Set(0.3)  # 3 mm in cm

    outfit, target, results = scene(tmp_path, up, unit, change_outfit=offset)
    out = tmp_path / "out.usda"
    write_dressed(out, outfit, target, results)
    stage = Usd.Stage.Open(str(out))
    assert UsdGeom.GetStageUpAxis(stage) == up and UsdGeom.GetStageMetersPerUnit(stage) == unit
    prim = stage.GetPrimAtPath("/Hero/Outfit/Shirt")
    assert prim.GetAttribute("garment:seam:pocket:offset").Get() * unit == pytest.approx(0.003)
    again = read_outfit(out)
    assert np.abs(again.garments[0].points - results[0].points).max() < 1e-6
    assert np.abs(again.garments[0].corner_pattern - results[0].corner_pattern).max() < 1e-6
    extent = np.array(UsdGeom.Mesh(prim).GetExtentAttr().Get())
    points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get())
    assert (extent == [points.min(0), points.max(0)]).all()


def test_ngons_uv_sets_colours_and_grain_come_back(tmp_path):
    def decorate(stage):
        prim = stage.GetPrimAtPath("/Outfit/Shirt")
        api = UsdGeom.PrimvarsAPI(prim)
        colour = np.linspace(0, 1, 3 * 4 * 80).reshape(-1, 3).astype(np.float32)
        api.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "faceVarying").Set(
            Vt.Vec3fArray.FromNumpy(colour)
        )
        api.CreatePrimvar("uv2", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
            Vt.Vec2fArray(96, Gf.Vec2f(0.5))
        )
        UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Outfit")).CreatePrimvar(
            "wetness", Sdf.ValueTypeNames.Float, "constant"
        ).Set(0.25)
        stage.GetPrimAtPath("/Outfit/Shirt/back").GetAttribute("garment:panel:grainAngle").Set(30.0)
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(1.0, 2.0, 3.0))
        UsdGeom.PointBased(prim).CreateVelocitiesAttr(Vt.Vec3fArray(96))

    outfit, target, results = scene(tmp_path, change_outfit=decorate)
    out = tmp_path / "out.usda"
    write_dressed(out, outfit, target, results)
    source, stage = Usd.Stage.Open(outfit.file), Usd.Stage.Open(str(out))
    before, after = source.GetPrimAtPath("/Outfit/Shirt"), stage.GetPrimAtPath("/Hero/Outfit/Shirt")
    kept = ("faceVertexCounts", "faceVertexIndices", "primvars:st", "primvars:uv2", "primvars:displayColor")
    for name in kept:
        assert after.GetAttribute(name).Get() == before.GetAttribute(name).Get(), name
    assert after.GetAttribute("primvars:wetness").Get() == 0.25
    assert not after.GetAttribute("velocities").HasAuthoredValue()
    assert UsdGeom.Xformable(after).GetOrderedXformOps() == []
    again = read_outfit(out).garments[0]
    assert [p.grain_angle for p in again.panels] == [0.0, 30.0]
    assert np.abs(again.corner_pattern - results[0].corner_pattern).max() < 1e-6
    assert np.abs(again.points - results[0].points).max() < 1e-6


def test_hard_edges_of_face_varying_normals_stay(tmp_path):
    def hard(stage):
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Outfit/Shirt"))
        points = np.array(mesh.GetPointsAttr().Get(), float)
        quads = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
        flat = np.cross(points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]])
        flat /= np.linalg.norm(flat, axis=1, keepdims=True)
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.repeat(flat, 4, axis=0).astype(np.float32)))
        mesh.SetNormalsInterpolation("faceVarying")

    outfit, target, results = scene(tmp_path, change_outfit=hard)
    out = tmp_path / "out.usda"
    write_dressed(out, outfit, target, results)
    stage = Usd.Stage.Open(str(out))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Hero/Outfit/Shirt"))
    normals = np.array(mesh.GetNormalsAttr().Get()).reshape(-1, 4, 3)
    assert mesh.GetNormalsInterpolation() == "faceVarying"
    columns = normals.reshape(scenes.SHIRT_RINGS - 1, scenes.SIDES, 4, 3)
    assert np.abs(columns[:, :, 0] - columns[:, :, 1]).max() < 0.05  # flat across each facet
    assert (columns[:, 0, 1] * columns[:, 1, 0]).sum(axis=-1).max() < 0.97  # a crease between two


def test_materials_come_along_and_are_bound_again(tmp_path):
    texture = tmp_path / "tex" / "weave.png"
    texture.parent.mkdir()
    texture.write_bytes(b"\x89PNG")

    def materials(stage):
        silk = UsdShade.Material.Define(stage, "/Library/Silk")
        shader = UsdShade.Shader.Define(stage, "/Library/Silk/Texture")
        shader.CreateIdAttr("UsdUVTexture")
        shader.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./tex/weave.png")
        silk.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
        denim = UsdShade.Material.Define(stage, "/Library/Denim")
        UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/Outfit")).Bind(silk)
        UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/Outfit/Shirt/back")).Bind(denim)

    outfit, target, results = scene(tmp_path, change_outfit=materials)
    out = tmp_path / "elsewhere" / "out.usda"
    write_dressed(out, outfit, target, results)
    stage = Usd.Stage.Open(str(out))
    bound = lambda path: UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path)).ComputeBoundMaterial()[0]  # noqa: E731
    assert bound("/Hero/Outfit/Shirt").GetPath() == "/Hero/Outfit/Looks/Silk"
    assert bound("/Hero/Outfit/Shirt/front").GetPath() == "/Hero/Outfit/Looks/Silk"
    assert bound("/Hero/Outfit/Shirt/back").GetPath() == "/Hero/Outfit/Looks/Denim"
    shader, _, _ = bound("/Hero/Outfit/Shirt").ComputeSurfaceSource()
    file = shader.GetInput("file").Get()
    assert file.path == "../tex/weave.png" and os.path.samefile(file.resolvedPath, texture)
    _, _, unresolved = UsdUtils.ComputeAllDependencies(str(out))
    assert unresolved == []
    assert [p.fabric.preset for p in read_outfit(out).garments[0].panels] == ["silk", "denim"]


def test_what_the_character_refers_to_outside_of_its_root_comes_along(tmp_path):
    def skin_material(stage):
        material = UsdShade.Material.Define(stage, "/Materials/Skin")
        UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/Hero/Body")).Bind(material)

    outfit, target, results = scene(tmp_path, change=skin_material)
    out = tmp_path / "out.usda"
    notes = write_dressed(out, outfit, target, results)
    stage = Usd.Stage.Open(str(out))
    body = stage.GetPrimAtPath("/Hero/Body")
    assert UsdShade.MaterialBindingAPI(body).ComputeBoundMaterial()[0].GetPath() == "/Hero/Materials/Skin"
    assert any("/Materials" in note for note in notes)


def test_instanced_character_without_default_prim_and_with_variants(tmp_path):
    scenes.saved(scenes.character_stage(tmp_path / "inner.usda"))
    stage = scenes.new_stage(tmp_path / "set.usda")
    prim = stage.DefinePrim("/Set")
    prim.SetInstanceable(True)
    looks = prim.GetVariantSets().AddVariantSet("who")
    looks.AddVariant("hero")
    looks.SetVariantSelection("hero")
    with looks.GetVariantEditContext():
        prim.GetReferences().AddReference("./inner.usda")
    looks.ClearVariantSelection()
    file = scenes.saved(stage)
    target, _ = read_character(file, variants={"/Set": {"who": "hero"}})
    outfit = read_outfit(scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda")))
    before = file.read_bytes()
    out = tmp_path / "out.usda"
    write_dressed(out, outfit, target, dressing.dress(outfit, target))
    again = read_outfit(out)
    assert again.bodies[0].path == "/Set/Body" and again.garments[0].path == "/Set/Outfit/Shirt"
    assert file.read_bytes() == before


@pytest.mark.parametrize("typed", [True, False])
def test_character_without_skel_root_at_its_top(tmp_path, typed):
    stage = scenes.new_stage(tmp_path / "hero.usda")
    if typed:
        UsdGeom.Xform.Define(stage, "/Hero").AddTranslateOp().Set(Gf.Vec3d(0.5, 0.0, 0.0))
    else:
        stage.DefinePrim("/Hero")
    scenes.add_character(stage, "/Hero/Rig", np.eye(3))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Hero"))
    target, _ = read_character(scenes.saved(stage))
    outfit = read_outfit(scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda")))
    out = tmp_path / "out.usda"
    results = dressing.dress(outfit, target)
    write_dressed(out, outfit, target, results)
    stage = Usd.Stage.Open(str(out))
    assert stage.GetPrimAtPath("/Hero/Outfit").IsA(UsdSkel.Root)
    assert np.abs(read_outfit(out).garments[0].points - results[0].points).max() < 1e-6


def test_names_that_are_taken_get_a_number(tmp_path):
    def busy(stage):
        UsdGeom.Scope.Define(stage, "/Hero/Outfit")

    outfit, target, results = scene(tmp_path, change=busy)
    out = tmp_path / "out.usda"
    write_dressed(out, outfit, target, results)
    stage = Usd.Stage.Open(str(out))
    assert stage.GetPrimAtPath("/Hero/Outfit_1/Shirt")


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_same_input_same_bytes(tmp_path, suffix):
    """In this process and in another one, with other hash seeds."""
    outfit, target, results = scene(tmp_path)
    out = tmp_path / "a" / f"out{suffix}"
    write_dressed(out, outfit, target, results)
    first = {p.name: p.read_bytes() for p in out.parent.iterdir()}
    write_dressed(out, outfit, target, results)
    assert {p.name: p.read_bytes() for p in out.parent.iterdir()} == first
    script = (
        "import sys; sys.path[:0] = sys.argv[4:]; import conftest, dressing\n"
        "from dressform.usd.character import read_character\n"
        "from dressform.usd.garment import read_outfit\n"
        "from dressform.usd.write import write_dressed\n"
        "o, t = read_outfit(sys.argv[1]), read_character(sys.argv[2])[0]\n"
        "write_dressed(sys.argv[3], o, t, dressing.dress(o, t))\n"
    )
    here = str(REPOSITORY / "tests" / "python")
    other = tmp_path / "b" / f"out{suffix}"
    command = [sys.executable, "-c", script, outfit.file, target.origin.file, str(other), here]
    subprocess.run(
        command, check=True, env={**os.environ, "PYTHONHASHSEED": "7", "PXR_WORK_THREAD_LIMIT": "1"}
    )
    assert {p.name: p.read_bytes() for p in other.parent.iterdir()} == first


def test_inputs_are_not_changed(dressed_sample, samples):
    status = subprocess.run(
        ["git", "status", "--porcelain", "samples"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    if status.returncode != 0:
        pytest.skip("not a git checkout")
    assert status.stdout == ""


def test_an_instanced_garment_is_opened_up_in_the_output_only(tmp_path):
    scenes.saved(scenes.outfit_stage(tmp_path / "inner.usda"))
    stage = scenes.new_stage(tmp_path / "outfit.usda")
    holder = stage.DefinePrim("/Wardrobe/Left")
    holder.GetReferences().AddReference("./inner.usda")
    holder.SetInstanceable(True)
    scenes.add_character(stage, "/Body", np.eye(3))
    file = scenes.saved(stage)
    before = file.read_bytes()
    outfit = read_outfit(file)
    assert outfit.garments[0].path == "/Wardrobe/Left/Shirt"
    target, _ = read_character(scenes.saved(scenes.character_stage(tmp_path / "hero.usda", girth=1.2)))
    out = tmp_path / "out.usda"
    results = dressing.dress(outfit, target)
    write_dressed(out, outfit, target, results)
    assert np.abs(read_outfit(out).garments[0].points - results[0].points).max() < 1e-6
    assert file.read_bytes() == before


def test_a_dressed_character_keeps_what_it_wears(tmp_path):
    outfit, target, results = scene(tmp_path)
    first = tmp_path / "first.usda"
    write_dressed(first, outfit, target, results)
    again, notes = read_character(first)
    assert notes == ["it wears Shirt already, which stays and is not collided with"]
    second = tmp_path / "second.usda"
    write_dressed(second, outfit, again, results)
    stage = Usd.Stage.Open(str(second))
    assert stage.GetPrimAtPath("/Hero/Outfit/Shirt") and stage.GetPrimAtPath("/Hero/Outfit_1/Shirt")
