"""One outfit whose garments were made on different bodies: each goes its own way to the target."""

import json

import dressform
import numpy as np
import pytest
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from pxr import Sdf, Usd, UsdGeom

#: Transfer and pattern alone.
STILL = json.dumps({"drape": {"frames": 0, "push_steps": 0, "settle": False}})


@pytest.fixture(scope="module")
def mixed(outside_data, tmp_path_factory):
    """A man's shirt and a woman's skirt in one stage, Z up and in metres."""
    file = tmp_path_factory.mktemp("mixed") / "mixed.usda"
    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    outfits, characters = outside_data / "outfits", outside_data / "characters"
    for name, layer, body in (
        ("Tshirt", "casual_man/tshirt.usdc", "source_man"),
        ("Skirt", "casual_woman/skirt.usdc", "source_woman"),
    ):
        person = stage.DefinePrim(f"/Sources/{body}", "Xform")
        person.GetReferences().AddReference(str(characters / f"{body}.usdc"))
        garment = stage.DefinePrim(f"/Outfit/{name}", "Mesh")
        garment.GetReferences().AddReference(str(outfits / layer))
        rel = garment.CreateRelationship("garment:sourceBody")
        rel.SetTargets([Sdf.Path(f"/Sources/{body}")])
    skirt = UsdGeom.Xformable(stage.GetPrimAtPath("/Outfit/Skirt"))
    skirt.AddScaleOp().Set((0.01, 0.01, 0.01))  # made in centimetres, Y up
    skirt.AddRotateXOp().Set(90.0)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Outfit"))
    stage.Save()
    return file


@pytest.mark.data
def test_each_garment_comes_from_its_own_body(mixed, outside_data):
    outfit = read_outfit(mixed)
    assert [b.path.split("/")[2] for b in outfit.bodies] == ["source_man", "source_woman"]
    target, _ = read_character(outside_data / "characters/thin_woman.usdc")
    together = dressform.fit_arrays(outfit, target, STILL, "cpu")
    assert [flow["source"].split("/")[2] for flow in together.report["flows"]] == [
        "source_man",
        "source_woman",
    ]
    for report in together.report["garments"]:
        assert report["transfer"]["converged"]
        assert report["certificate"]["self_intersections"] == 0
    # The same as in the outfits that they were taken from.
    for i, (file, name) in enumerate((("casual_man", "Tshirt"), ("casual_woman", "Skirt"))):
        alone = read_outfit(outside_data / f"outfits/{file}.usda", garments=[f"/Outfit/{name}"])
        (expected,) = dressform.fit_arrays(alone, target, STILL, "cpu").garments
        got = together.garments[i]
        assert np.abs(got.points - expected.points).max() < 1e-5
        assert np.abs(got.corner_pattern - expected.corner_pattern).max() < 1e-5
