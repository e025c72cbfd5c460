"""Garments that say themselves which joints move them (``skel:joints``), in any order."""

from __future__ import annotations

import json

import dressform
import numpy as np
import pytest
import scenes
from dressform.native import fit_arrays
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from pxr import Usd, UsdSkel

SETTINGS = {"drape": {"frames": 0, "push_steps": 0, "settle": False}, "rig": {"ignore": []}}


def outfit_with(tmp_path, joints):
    stage = scenes.outfit_stage(tmp_path / "outfit.usda")
    UsdSkel.BindingAPI.Apply(stage.GetPrimAtPath("/Outfit/Shirt")).CreateJointsAttr(joints)
    return scenes.saved(stage)


def fitted(tmp_path, joints):
    """Weight of each of the skeleton's joints at each point, the report of the rig, and notes."""
    outfit = read_outfit(outfit_with(tmp_path, joints))
    assert outfit.garments[0].joints == joints
    target, _ = read_character(scenes.saved(scenes.character_stage(tmp_path / "hero.usda", girth=1.1)))
    made = fit_arrays(outfit, target, json.dumps(SETTINGS), "cpu")
    dressed = made.garments[0]
    weights = np.zeros((len(dressed.points), len(target.joints)))
    rows = np.repeat(np.arange(len(dressed.points)), dressed.influences)
    np.add.at(weights, (rows, dressed.joint_indices), dressed.joint_weights)
    return weights, made.report["garments"][0]["rig"], made.report["notes"]


def test_a_subset_in_another_order_takes_all_weight(tmp_path):
    first, second, third = scenes.JOINTS
    free, _, _ = fitted(tmp_path, [])
    assert (free.max(axis=0) > 0.1)[1:].all(), "the shirt hangs on the upper two joints"
    bound, rig, notes = fitted(tmp_path, [second, first])
    assert np.allclose(bound.sum(axis=1), 1.0)
    assert bound[:, 2].max() == 0.0
    assert rig["own_joints"] == 2 and not [n for n in notes if "skel:joints" in n]
    assert bound[:, 1].max() > free[:, 1].max()
    assert third not in (first, second)


def test_joints_are_found_by_name_and_what_is_missing_is_said(tmp_path):
    names = [f"Other/{joint.rpartition('/')[2]}" for joint in scenes.JOINTS[:2]]
    bound, rig, notes = fitted(tmp_path, [*names, "Other/Tail"])
    assert bound[:, 2].max() == 0.0 and rig["own_joints"] == 2
    assert any("/Outfit/Shirt" in n and "2 of the 3 joints" in n for n in notes)


def test_joints_of_another_skeleton_bind_nothing(tmp_path):
    free, _, _ = fitted(tmp_path, [])
    bound, rig, notes = fitted(tmp_path, ["Hips", "Hips/Chest"])
    assert np.array_equal(bound, free) and rig["own_joints"] == 0
    assert any("0 of the 2 joints" in n and "every joint" in n for n in notes)


def test_weights_are_written_over_the_skeletons_own_joints(tmp_path):
    outfit = outfit_with(tmp_path, [scenes.JOINTS[1], scenes.JOINTS[0]])
    hero = scenes.saved(scenes.character_stage(tmp_path / "hero.usda"))
    result = dressform.fit(outfit, hero, tmp_path / "out.usda", settings=SETTINGS, device="cpu")
    stage = Usd.Stage.Open(str(result.output))
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath("/Hero/Outfit/Shirt"))
    assert not binding.GetJointsAttr().HasValue()
    indices = np.array(binding.GetJointIndicesPrimvar().Get())
    weights = np.array(binding.GetJointWeightsPrimvar().Get())
    assert set(indices[weights > 0.0]) <= {0, 1}


@pytest.mark.parametrize("joints", [["A", "A"], [""]])
def test_names_that_say_nothing_do_no_harm(tmp_path, joints):
    bound, rig, _ = fitted(tmp_path, joints)
    assert np.allclose(bound.sum(axis=1), 1.0) and rig["own_joints"] == 0
