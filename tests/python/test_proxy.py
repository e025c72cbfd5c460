"""Detail panels: what is left out of the simulation, how it comes back, and what is refused."""

import json
import subprocess
import sys
from dataclasses import replace

import dressform
import numpy as np
import pytest
import scenes
import vests
from dressform.check import check
from dressform.settings import parse
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit

#: Every stage, but no time: a drape cut short would leave the cloth strained.
STILL = {"drape": {"frames": 0, "push_steps": 0, "settle": False}}


def fit(outfit, character, out, *more):
    command = [
        sys.executable,
        "-m",
        "dressform",
        "fit",
        outfit,
        character,
        "-o",
        out,
        "--device",
        "cpu",
        *more,
    ]
    done = subprocess.run(map(str, command), capture_output=True, text=True, timeout=300, check=False)
    return done.returncode, " ".join(done.stderr.split())


@pytest.fixture
def character(tmp_path):
    return scenes.saved(scenes.character_stage(tmp_path / "hero.usda"))


def labelled(path, **panels):
    """The made-up shirt with labels or roles (``front="pocket"``, ``back__role="detail"``)."""
    stage = scenes.outfit_stage(path)
    for key, value in panels.items():
        panel, _, what = key.partition("__")
        attribute = f"/Outfit/Shirt/{panel}.garment:panel:{what or 'label'}"
        stage.GetAttributeAtPath(attribute).Set(value)
    return scenes.saved(stage)


def test_labels_that_leave_nothing_are_3(tmp_path, character):
    outfit = labelled(tmp_path / "o.usda", front="Patch Pocket", back="strap_2")
    code, said = fit(outfit, character, tmp_path / "out.usda")
    assert code == 3
    for part in ("o.usda", "</Outfit/Shirt>", "nothing is left", "'Patch Pocket', 'strap_2'", "proxy.keep"):
        assert part in said, said
    assert not (tmp_path / "out.usda").exists()
    found = check(outfit)
    assert not found["ok"] and "nothing is left" in found["problems"][0]["message"]
    assert check(outfit, settings=parse({"proxy": {"enabled": False}}))["ok"]


def test_a_detail_with_no_proxy_near_is_3(tmp_path, character):
    outfit = labelled(tmp_path / "o.usda", back__role="detail")
    code, said = fit(outfit, character, tmp_path / "out.usda")
    assert code == 3
    for part in (
        "o.usda",
        "</Outfit/Shirt>",
        "panel 'back'",
        "its role is 'detail'",
        " m from",
        "proxy.reach",
    ):
        assert part in said, said


def test_a_role_that_is_none_is_refused(tmp_path):
    outfit = labelled(tmp_path / "o.usda", back__role="decor")
    (problem,) = [p for p in check(outfit)["problems"] if p["severity"] == "error"]
    assert problem["attribute"] == "garment:panel:role"
    assert "'decor'" in problem["message"]


@pytest.fixture(scope="module")
def vest(tmp_path_factory, sample_outfit, samples):
    """A vest with straps all around, through a stage."""
    (shirt,) = (g for g in sample_outfit.garments if g.name == "Tshirt")
    path = tmp_path_factory.mktemp("vest") / "vest.usda"
    vests.write_vest(path, samples / "outfits/casual_woman.usda", sample_outfit, vests.make_vest(shirt))
    return path


def test_check_says_what_would_not_be_simulated(vest):
    (garment,) = check(vest)["garments"]
    left_out = {p["panel"]: p for p in garment["proxy"]["left_out"]}
    assert set(left_out) == {p["name"] for p in garment["panels"]} - {"front", "back"}
    assert "'strap'" in left_out["strap_back_1"]["why"]
    assert left_out["strap_back_1"]["distance_max_m"] == pytest.approx(vests.STRAP, rel=0.05)
    # Without labels the straps are known by where they lie; the braces are too far off.
    by_place = check(vest, settings=parse({"proxy": {"leave_out": []}}))["garments"][0]["proxy"]["left_out"]
    assert {p["panel"] for p in by_place} == {f"strap_{s}_{k}" for s in ("front", "back") for k in (0, 1)}
    kept = check(vest, settings=parse({"proxy": {"keep": ["strap"]}}))["garments"][0]["proxy"]["left_out"]
    assert kept == []


def test_a_vest_comes_back_whole(vest, sample_target):
    outfit = read_outfit(vest)
    fitted = dressform.fit_arrays(outfit, sample_target, json.dumps(STILL), "cpu")
    (report,) = fitted.report["garments"]
    proxy, sure = report["proxy"], report["certificate"]
    assert len(proxy["left_out"]) == 8 and proxy["bound_vertices"] > 1000
    assert proxy["inside"] == 0 and proxy["squeezed"] == 0
    assert 0.9 < proxy["offset_least"] <= proxy["offset_most"] < 1.1
    assert sure["self_intersections"] == sure["source_self_intersections"] == 0
    assert sure["seam_weight_error_max"] == 0.0 and sure["seam_gap_max_m"] < 1e-4
    assert report["pattern"]["flipped_triangles"] == 0
    (garment,), (dressed,) = outfit.garments, fitted.garments
    sides = np.concatenate([s.pairs for s in garment.seams if not s.offset])
    assert np.array_equal(dressed.points[sides[:, 0]], dressed.points[sides[:, 1]])


#: Height of the patch above the shirt, and of the coat, which starts between the two [m].
PATCH, COAT = 8e-3, 4e-3


def patched(outfit, *, patch):
    """The made-up shirt, with or without a patch on its front, under a coat that starts inside of it."""
    (shirt,) = outfit.garments
    outward = shirt.points * [1.0, 0.0, 1.0]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    coat = replace(shirt, name="Coat", path="/Outfit/Coat", layer=2, points=shirt.points + COAT * outward)
    if not patch:
        return replace(outfit, garments=[shirt, coat])
    grid = np.arange(len(shirt.points)).reshape(-1, scenes.SIDES)[1:5, 2:7]
    place = {int(v): i for i, v in enumerate(grid.ravel())}
    faces = [i for i, t in enumerate(shirt.triangles.tolist()) if all(v in place for v in t)]
    triangles = np.array([[place[v] for v in t] for t in shirt.triangles[faces].tolist()])
    border = np.unique(np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]]))
    count = len(shirt.points)
    pairs = np.array([[count + place[int(v)], v] for v in border], np.uint32)
    shirt = replace(
        shirt,
        points=np.concatenate([shirt.points, (shirt.points + PATCH * outward)[grid.ravel()]]),
        triangles=np.concatenate([shirt.triangles, triangles + count]).astype(np.uint32),
        corner_pattern=np.concatenate([shirt.corner_pattern, shirt.corner_pattern[faces] + [3.0, 0.0]]),
        panel_of_triangle=np.concatenate(
            [shirt.panel_of_triangle, np.full(len(faces), len(shirt.panels))]
        ).astype(np.uint32),
        panels=[*shirt.panels, dressform.model.Panel("patch", "patch")],
        seams=[*shirt.seams, dressform.model.AuthoredSeam("patch", pairs, offset=True)],
    )
    return replace(outfit, garments=[shirt, coat])


def test_the_next_layer_lies_on_the_details(tmp_path, character):
    target, _ = read_character(character)
    outfit = read_outfit(scenes.saved(scenes.outfit_stage(tmp_path / "o.usda")))
    radius = {}
    for patch in (True, False):
        # Nothing holds these tubes: settled they would slide off.
        settings = json.dumps({"posed": {"enabled": False}, "drape": {"settle": False}})
        fitted = dressform.fit_arrays(patched(outfit, patch=patch), target, settings, "cpu")
        shirt, coat = fitted.report["garments"]
        assert len(shirt["proxy"]["left_out"]) == int(patch)
        assert coat["certificate"]["layer_intersections"] == 0
        over = np.arange(len(fitted.garments[1].points)).reshape(-1, scenes.SIDES)[2:4, 3:6].ravel()
        radius[patch] = np.hypot(*fitted.garments[1].points[over][:, [0, 2]].T)
    # Without the patch it stays near where it was; on the patch it has been pushed out.
    assert radius[False].max() < 0.2 + PATCH
    assert radius[True].min() > 0.2 + PATCH
