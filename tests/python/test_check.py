"""``dressform check``: one report names every part and every problem."""

from __future__ import annotations

import json

import dressing
import numpy as np
import scenes
from dressform.check import check
from dressform.usd.garment import read_outfit
from dressform.usd.write import write_dressed
from pxr import UsdGeom, Vt


def test_sample_outfit(samples):
    report = check(samples / "outfits" / "casual_woman.usda")
    json.dumps(report)
    assert report["ok"] and report["problems"] == []
    assert (report["up_axis"], report["meters_per_unit"]) == ("Y", 0.01)
    assert [b["points"] for b in report["bodies"]] == [13_718]
    assert [s["joints"] for s in report["skeletons"]] == [104]
    tshirt, skirt = report["garments"]
    assert (tshirt["layer"], len(tshirt["panels"]), tshirt["welded_seam_points"] > 100) == (1, 6, True)
    assert (skirt["layer"], len(skirt["panels"]), len(skirt["seams"])) == (0, 4, 6)
    assert skirt["welded_seam_points"] == 0
    assert abs(sum(p["area_m2"] for p in skirt["panels"]) - 0.6) < 0.4


def test_sample_characters(samples):
    for file in (samples / "characters").glob("*.usdc"):
        report = check(file)
        assert report["ok"] and report["garments"] == [] and len(report["bodies"]) == 1


def test_a_dressed_character(tmp_path, sample_outfit, sample_target):
    out = tmp_path / "dressed.usda"
    write_dressed(out, sample_outfit, sample_target, dressing.dress(sample_outfit, sample_target))
    report = check(out)
    assert report["ok"] and report["problems"] == []
    assert {g["state"] for g in report["garments"]} == {"dressed"}
    assert {g["body"] for g in report["garments"]} == {"/thin_woman/Body"}


def test_every_broken_part_is_named(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    scenes.add_shirt(stage, "/Outfit/Coat", np.eye(3), "/SourceBody/Character")
    UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Outfit/Shirt")).RemovePrimvar("st")
    stage.GetAttributeAtPath("/Outfit/Coat.points").Set(Vt.Vec3fArray(3))
    stage.GetAttributeAtPath("/SourceBody/Character/Skel.bindTransforms").Clear()
    report = check(scenes.saved(stage))
    assert not report["ok"] and report["garments"] == []
    found = {(p["severity"], p["prim"], p["attribute"]) for p in report["problems"]}
    assert found == {
        ("error", "/Outfit/Shirt", "primvars:st"),
        ("error", "/Outfit/Coat", "faceVertexIndices"),
        ("error", "/SourceBody/Character/Skel", "bindTransforms"),
    }


def test_files_that_are_nothing(tmp_path):
    report = check(tmp_path / "missing.usda")
    assert not report["ok"] and report["problems"][0]["message"] == "the file does not exist"
    report = check(scenes.saved(scenes.new_stage(tmp_path / "empty.usda")))
    assert not report["ok"] and "neither a body nor a garment" in report["problems"][0]["message"]


def test_topology_that_cloth_does_not_have(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Outfit/Shirt"))
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    indices[3] = indices[3][::-1]  # one face wound the other way
    indices[60] = indices[59]  # one face twice
    mesh.GetFaceVertexIndicesAttr().Set(indices.ravel().tolist())
    mesh.GetPointsAttr().Set([*mesh.GetPointsAttr().Get(), (0.0, 1.0, 0.3)])
    text = " / ".join(p["message"] for p in check(scenes.saved(stage))["problems"])
    for words in (
        "more than once",
        "faced inward and are read turned over",
        "1 points are in no face",
        "more than two triangles",
    ):
        assert words in text, words


def test_check_and_reading_agree(tmp_path):
    file = scenes.saved(scenes.outfit_stage(tmp_path / "o.usda"))
    assert check(file)["garments"][0]["triangles"] == len(read_outfit(file).garments[0].triangles)


def test_outside_data(outside_data):
    files = [*(outside_data / "characters").glob("*.usdc"), *(outside_data / "outfits").glob("*.usda")]
    assert files
    for file in files:
        report = check(file)
        assert report["ok"] and report["problems"] == [], file
