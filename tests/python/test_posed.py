"""The posed check: poses from the skeleton, what it says of weights, and where that is written."""

from __future__ import annotations

import json
from dataclasses import replace

import dressform
import dressing
import numpy as np
import pytest
import scenes
from dressform import rig_arrays
from dressform.errors import BadInput, BadSettings
from dressform.native import SkinnedMesh, posed_check, poses
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from dressform.usd.write import write_dressed
from pxr import Usd

STILL = {"drape": {"frames": 0, "push_steps": 0, "settle": False}}
#: Height of a second skin above the body [m].
ABOVE = 4e-3


def second_skin(character) -> SkinnedMesh:
    """The body's own surface, a little further out, with the body's own weights."""
    corners = character.points[character.triangles.astype(int)]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(character.points)
    for k in range(3):
        np.add.at(normals, character.triangles[:, k].astype(int), faces)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return SkinnedMesh(
        character.points + ABOVE * normals,
        character.triangles,
        character.skin_influences,
        character.joint_indices,
        character.joint_weights,
    )


def test_a_skeleton_has_at_least_twelve_poses(sample_target):
    found = poses(sample_target)
    assert len(found) >= 12
    for name, matrices in found.items():
        assert matrices.shape == (len(sample_target.joints), 4, 4)
        turns = matrices[:, :3, :3]
        assert np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3), atol=1e-12), name
        assert np.allclose(matrices[:, 3], [0, 0, 0, 1])
        if name != "a":
            assert np.abs(turns - np.eye(3)).max() > 0.3, name


def test_weights_of_the_body_follow_it_and_those_of_one_joint_do_not(sample_target):
    own = second_skin(sample_target)
    stiff = replace(
        own,
        skin_influences=1,
        joint_indices=np.zeros(len(own.points), np.uint32),
        joint_weights=np.ones(len(own.points)),
    )
    ours, theirs = posed_check(sample_target, [own, stiff])
    assert [f["pose"] for f in ours] == list(poses(sample_target))
    mean = lambda figures, key: np.mean([f[key] for f in figures])  # noqa: E731
    assert mean(ours, "inside") < 0.01
    assert mean(theirs, "inside") > 0.02
    assert mean(ours, "depth_mean_m") < 0.05 * mean(theirs, "depth_mean_m")
    assert all(f["edge_stretch"] == pytest.approx([1.0] * 3) for f in theirs)
    (sit,) = posed_check(sample_target, [own], '{"posed": {"poses": ["sit"]}}')[0]
    assert sit == next(f for f in ours if f["pose"] == "sit")


def test_a_skeleton_without_limbs_is_noted(tmp_path):
    hero = scenes.saved(scenes.character_stage(tmp_path / "hero.usda"))
    outfit = scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda"))
    result = dressform.fit(outfit, hero, tmp_path / "out.usda", settings=STILL, device="cpu")
    assert result.garments[0].certificate.posed == []
    said = " ".join(result.notes)
    assert "the skeleton's arms were not found: the posed check leaves out t, a" in said


def test_a_pose_that_is_none_is_refused(tmp_path):
    hero = scenes.saved(scenes.character_stage(tmp_path / "hero.usda"))
    outfit = scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda"))
    settings = {"posed": {"poses": ["handstand"]}}
    with pytest.raises(BadSettings, match=r"posed\.poses: there is no pose 'handstand'"):
        dressform.fit(outfit, hero, tmp_path / "out.usda", settings=settings, device="cpu")


def test_figures_are_arrays_in_the_layer(tmp_path):
    target, _ = read_character(scenes.saved(scenes.character_stage(tmp_path / "hero.usda")))
    outfit = read_outfit(scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda")))
    results = dressing.dress(outfit, target)
    figures = {"inside": 0.25, "depth_max_m": 2e-3, "edge_stretch": [0.9, 1.0, 1.5]}
    results[0].certificate["posed"] = [{"pose": name, **figures} for name in ("t", "sit")]
    write_dressed(tmp_path / "out.usda", outfit, target, results)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    shirt = stage.GetPrimAtPath("/Hero/Outfit/Shirt")
    value = lambda key: shirt.GetAttribute(f"garment:certificate:posed:{key}").Get()  # noqa: E731
    assert list(value("poses")) == ["t", "sit"]
    assert list(value("inside")) == [0.25, 0.25]
    assert np.allclose(value("edge_stretch"), [[0.9, 1.0, 1.5]] * 2)


def test_switched_off_nothing_is_written(tmp_path):
    hero = scenes.saved(scenes.character_stage(tmp_path / "hero.usda"))
    outfit = scenes.saved(scenes.outfit_stage(tmp_path / "outfit.usda"))
    settings = {**STILL, "posed": {"enabled": False}}
    result = dressform.fit(outfit, hero, tmp_path / "out.usda", settings=settings, device="cpu")
    stage = Usd.Stage.Open(result.output)
    shirt = stage.GetPrimAtPath("/Hero/Outfit/Shirt")
    assert not [a for a in shirt.GetAuthoredAttributes() if ":posed:" in a.GetName()]
    assert not [note for note in result.notes if "posed" in note]


def test_poses_of_the_callers_own(sample_target):
    body = second_skin(sample_target)
    still = {"still": np.tile(np.eye(4), (len(sample_target.joints), 1, 1))}
    ((figures,),) = posed_check(sample_target, [body], poses=still)
    assert figures["pose"] == "still" and figures["inside"] == 0.0
    assert figures["edge_stretch_max"] == pytest.approx(1.0)
    with pytest.raises(BadInput, match=r"pose 'flat'.*4, 4"):
        posed_check(sample_target, [body], poses={"flat": np.zeros((len(sample_target.joints), 3, 3))})


def test_weights_are_refined_in_poses(sample_target):
    """A tube of cloth around the hips, on weights that know the bind pose alone and refined ones."""
    heights, angles = np.linspace(0.75, 1.05, 31), np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    near = sample_target.points[np.abs(sample_target.points[:, 1] - 0.9) < 0.15]
    near = near[np.abs(near[:, 0]) < 0.3]
    radius = np.linalg.norm(near[:, [0, 2]], axis=1).max() + 0.01
    ring = np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], axis=1) * radius
    points = (ring[None] + heights[:, None, None] * np.array([0.0, 1.0, 0.0])).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(30), np.arange(72), indexing="ij"))
    a, b, c, d = i * 72 + j, i * 72 + (j + 1) % 72, (i + 1) * 72 + (j + 1) % 72, (i + 1) * 72 + j
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    depth = {}
    for rounds in (0, 5):
        rigged = rig_arrays(
            sample_target, points, triangles, settings_json=json.dumps({"rig": {"refine": rounds}})
        )
        mesh = SkinnedMesh(
            points,
            triangles.astype(np.uint32),
            rigged.influences,
            rigged.joint_indices.ravel(),
            rigged.joint_weights.ravel(),
        )
        (figures,) = posed_check(sample_target, [mesh])
        depth[rounds] = sum(f["depth_mean_m"] for f in figures)
    before, after = rigged.report["sunk_m"]
    assert after < 0.5 * before and rigged.report["refined"] > 0.0
    assert depth[5] < 0.5 * depth[0]
