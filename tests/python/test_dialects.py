"""Other tools' garments: physics rest shapes, CLO's subsets, shared points with several st."""

from __future__ import annotations

import numpy as np
import pytest
import scenes
from dressform.errors import BadInput
from dressform.usd.garment import read_outfit
from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

TYPES = Sdf.ValueTypeNames
DIALECTS = [("physics", "restTriVertexIndices"), ("omniphysics", "restTriVtxIndices")]


def triangulated_shirt(tmp_path, unit=0.01):
    """The shirt with triangles for quads and no st, in a stage of centimetres; its (u, v) in metres."""
    stage = scenes.outfit_stage(tmp_path / "o.usda", "Y", unit)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Outfit/Shirt"))
    quads = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    uv = np.array(mesh.GetPrim().GetAttribute("primvars:st").Get()).reshape(-1, 4, 2) * 1e-3
    cut = [[0, 1, 2], [0, 2, 3]]
    mesh.GetFaceVertexIndicesAttr().Set(quads[:, cut].ravel().tolist())
    mesh.GetFaceVertexCountsAttr().Set([3] * (2 * len(quads)))
    for name in ("front", "back"):
        faces = np.array(stage.GetAttributeAtPath(f"/Outfit/Shirt/{name}.indices").Get())
        both = np.stack([2 * faces, 2 * faces + 1], axis=1).ravel()
        stage.GetAttributeAtPath(f"/Outfit/Shirt/{name}.indices").Set(both.tolist())
    UsdGeom.PrimvarsAPI(mesh.GetPrim()).RemovePrimvar("st")
    return stage, mesh.GetPrim(), uv[:, cut].reshape(-1, 3, 2)


def author_rest(prim, dialect, uv, unit=0.01, height=0.0):
    space, triangles_name = dialect
    flat = uv.reshape(-1, 2) / unit
    rest = np.column_stack([flat, np.full(len(flat), height)])
    rest[1, 2] += 0.0 if height == 0.0 else 5.0
    prim.CreateAttribute(f"{space}:restShapePoints", TYPES.Point3fArray).Set(
        Vt.Vec3fArray.FromNumpy(rest.astype(np.float32))
    )
    index = np.arange(len(flat)).reshape(-1, 3).astype(np.int32)
    prim.CreateAttribute(f"{space}:{triangles_name}", TYPES.Int3Array).Set(Vt.Vec3iArray.FromNumpy(index))


@pytest.mark.parametrize(("space", "triangles"), DIALECTS)
@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_rest_shapes(tmp_path, space, triangles, orientation):
    stage, prim, uv = triangulated_shirt(tmp_path)
    author_rest(prim, (space, triangles), uv)
    UsdGeom.Mesh(prim).CreateOrientationAttr(orientation)
    shirt = read_outfit(scenes.saved(stage)).garments[0]
    assert shirt.pattern_origin.attribute == f"{space}:restShapePoints"
    turned = np.stack([uv[..., 1], -uv[..., 0]], -1)
    assert np.abs(shirt.corner_pattern - turned).max() < 1e-6


@pytest.mark.parametrize(("space", "triangles"), DIALECTS)
def test_rest_index_out_of_range(tmp_path, space, triangles):
    stage, prim, uv = triangulated_shirt(tmp_path)
    author_rest(prim, (space, triangles), uv)
    value = prim.GetAttribute(f"{space}:{triangles}").Get()
    value[17] = Gf.Vec3i(0, 1, 99_999)
    prim.GetAttribute(f"{space}:{triangles}").Set(value)
    with pytest.raises(BadInput) as caught:
        read_outfit(scenes.saved(stage))
    assert (caught.value.attribute, caught.value.element) == (f"{space}:{triangles}", 17)


def test_a_rest_shape_that_is_not_flat_is_no_pattern(tmp_path):
    stage, prim, uv = triangulated_shirt(tmp_path)
    author_rest(prim, DIALECTS[0], uv, height=2.0)
    with pytest.raises(BadInput, match="there are no panels"):
        read_outfit(scenes.saved(stage))


def test_physics_material(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda", "Y", 0.01)
    material = UsdShade.Material.Define(stage, "/Outfit/Looks/Cloth")
    prim = material.GetPrim()
    for name, value in (
        ("density", 3e-4),  # kg/cm^3: 300 kg/m^3
        ("thickness", 0.05),  # cm
        ("surfaceStretchStiffness", 2e4),  # kg/(cm s^2): 2e6 Pa
        ("surfaceShearStiffness", 1e3),
        ("dynamicFriction", 0.3),
    ):
        prim.CreateAttribute(f"physics:{name}", TYPES.Float).Set(value)
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/Outfit/Shirt")).Bind(material)
    outfit = read_outfit(scenes.saved(stage))
    values = outfit.garments[0].panels[0].fabric.values
    expected = {
        "density": 0.15,
        "thickness": 5e-4,
        "stretch_warp": 1000.0,
        "stretch_weft": 1000.0,
        "shear": 50.0,
        "friction": 0.3,
    }
    assert values == pytest.approx(expected, rel=1e-5) and outfit.notes == []


def test_clo(tmp_path):
    """UV with V down and a scale, seams as edge subsets, fabric on the panel, millimetres and grams."""
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    prim = stage.GetPrimAtPath("/Outfit/Shirt")
    plain = read_outfit(scenes.saved(scenes.outfit_stage(tmp_path / "plain.usda"))).garments[0]
    uv = np.array(prim.GetAttribute("primvars:st").Get()) * 1e-3
    scale = (1.5, 0.8)
    prim.GetAttribute("primvars:st").Set(
        Vt.Vec2fArray.FromNumpy((uv / [scale[0], -scale[1]]).astype(np.float32))
    )
    prim.CreateAttribute("restPositionScale", TYPES.Float2).Set(Gf.Vec2f(*scale))
    sewing = UsdGeom.Subset.Define(stage, "/Outfit/Shirt/sew_0")
    sewing.CreateElementTypeAttr("edge")
    sewing.CreateFamilyNameAttr("sewing")
    sewing.CreateIndicesAttr([0, 40, 1, 41])
    front = stage.GetPrimAtPath("/Outfit/Shirt/front")
    for name, value in (
        ("stretchWarp", 1.2e6),
        ("density", 1.5e-4),
        ("bendingWarp", 9000.0),
        ("shearLeft", 5e4),
        ("shearRight", 7e4),
        ("thickness", 0.5),
    ):
        front.CreateAttribute(f"primvars:clo:{name}", TYPES.Float).Set(value)
    shirt = read_outfit(scenes.saved(stage)).garments[0]
    assert np.abs(shirt.corner_pattern - plain.corner_pattern).max() < 1e-6
    assert [(s.name, s.pairs.tolist()) for s in shirt.seams] == [("sew_0", [[0, 40], [1, 41]])]
    expected = {
        "stretch_warp": 1200.0,
        "density": 0.15,
        "bending_warp": 9e-6,
        "shear": 60.0,
        "thickness": 5e-4,
    }
    assert shirt.panels[0].fabric.values == pytest.approx(expected, rel=1e-5)
    assert shirt.panels[1].fabric.values == {}


def test_clo_sewing_names_a_missing_point(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    sewing = UsdGeom.Subset.Define(stage, "/Outfit/Shirt/sew_0")
    sewing.CreateElementTypeAttr("edge")
    sewing.CreateFamilyNameAttr("sewing")
    sewing.CreateIndicesAttr([0, 40, 1, 4000])
    with pytest.raises(BadInput) as caught:
        read_outfit(scenes.saved(stage))
    assert (caught.value.prim, caught.value.attribute, caught.value.element) == (
        "/Outfit/Shirt/sew_0",
        "indices",
        3,
    )


def test_bare_mesh_named_as_a_garment(tmp_path):
    """As Newton and Style3D have it: one mesh, shared points, st in millimetres, no marks at all."""
    stage = scenes.new_stage(tmp_path / "o.usda")
    scenes.add_character(stage, "/Body", np.eye(3))
    marked = scenes.add_shirt(stage, "/Shirt", np.eye(3)).GetPrim()
    marked.RemoveAppliedSchema("GarmentAPI")
    marked.RemoveProperty("garment:layer")
    for name in ("front", "back"):
        stage.RemovePrim(f"/Shirt/{name}")
    file = scenes.saved(stage)
    with pytest.raises(BadInput, match="name the meshes"):
        read_outfit(file)
    shirt = read_outfit(file, garments=["/Shirt"]).garments[0]
    assert len(shirt.panels) == 2 and shirt.layer == 0 and shirt.pattern_origin.meters_per_unit == 1e-3
