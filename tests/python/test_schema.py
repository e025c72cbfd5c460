"""The codeless schemas: generated files, registration and documentation."""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import REPOSITORY
from dressform.usd import plugin
from pxr import Sdf, Usd, UsdGeom

SINGLE = ("GarmentAPI", "GarmentPanelAPI", "GarmentFabricAPI", "GarmentCertificateAPI")


def test_checked_in_files_are_what_the_schema_generates(tmp_path):
    pytest.importorskip("jinja2")
    command = [sys.executable, str(REPOSITORY / "schemas" / "generate.py"), "--to", str(tmp_path)]
    subprocess.run(command, check=True, capture_output=True)
    for name in ("generatedSchema.usda", "plugInfo.json"):
        ours = (plugin.SCHEMA_DIRECTORY / name).read_text(encoding="utf-8")
        assert (tmp_path / name).read_text(encoding="utf-8") == ours, name


def test_schemas_are_registered_by_the_import():
    registry = Usd.SchemaRegistry()
    for name in SINGLE:
        assert registry.FindAppliedAPIPrimDefinition(name) is not None, name
    assert registry.IsMultipleApplyAPISchema("GarmentSeamAPI")


def test_schemas_apply_by_name_and_bring_fallbacks():
    stage = Usd.Stage.CreateInMemory()
    prim = UsdGeom.Mesh.Define(stage, "/Shirt").GetPrim()
    assert prim.ApplyAPI("GarmentAPI") and prim.HasAPI("GarmentAPI")
    assert prim.ApplyAPI("GarmentSeamAPI", "side")
    assert prim.GetAttribute("garment:layer").Get() == 0
    assert prim.GetAttribute("garment:state").Get() == "authored"
    assert prim.GetAttribute("garment:seam:side:edgesA").GetTypeName() == Sdf.ValueTypeNames.IntArray


def test_panels_apply_to_subsets_only():
    stage = Usd.Stage.CreateInMemory()
    assert UsdGeom.Subset.Define(stage, "/A").GetPrim().CanApplyAPI("GarmentPanelAPI")
    assert not UsdGeom.Mesh.Define(stage, "/B").GetPrim().CanApplyAPI("GarmentPanelAPI")


def test_every_attribute_is_documented():
    layer = Sdf.Layer.FindOrOpen(str(REPOSITORY / "schemas" / "schema.usda"))
    for schema in layer.rootPrims:
        for prop in schema.properties:
            assert prop.documentation.strip(), prop.path
