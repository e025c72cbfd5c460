"""A layer in a fixed order says what the layer said."""

import pytest
from dressform.usd.canonical import in_fixed_order
from pxr import Sdf, Usd, UsdGeom, UsdShade


def scene() -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    mesh = UsdGeom.Mesh.Define(stage, "/Outfit/Shirt")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.GetPointsAttr().Set([(0, 0, 1), (1, 0, 1), (0, 1, 1)], 24.0)
    mesh.GetPrim().SetMetadata("customData", {"stMetersPerUnit": 0.001})
    material = UsdShade.Material.Define(stage, "/Outfit/Looks/Cotton")
    shader = UsdShade.Shader.Define(stage, "/Outfit/Looks/Cotton/Surface")
    material.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    rel = mesh.GetPrim().CreateRelationship("garment:character")
    rel.AddTarget("/A")
    rel.AddTarget("/B", Usd.ListPositionFrontOfPrependList)
    mesh.GetPrim().CreateRelationship("garment:nothing").SetTargets([])
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Outfit"))
    return stage


def test_nothing_is_lost():
    stage = scene()
    layer = stage.GetRootLayer()
    assert in_fixed_order(layer).ExportToString() == layer.ExportToString()


def test_variants_are_no_part_of_a_flattened_layer():
    stage = scene()
    stage.GetPrimAtPath("/Outfit").GetVariantSets().AddVariantSet("size").AddVariant("large")
    with pytest.raises(ValueError, match="variants"):
        in_fixed_order(stage.GetRootLayer())
