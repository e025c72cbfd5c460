"""Skin weights from arrays: what comes back, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scenes
from dressform import BadInput, BadSettings, prepare_body, rig_arrays
from dressform.rigging import match_arrays
from dressform.usd.character import read_character


def triangulated(quads: np.ndarray) -> np.ndarray:
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


@pytest.fixture
def hero(tmp_path):
    character, _ = read_character(scenes.saved(scenes.character_stage(tmp_path / "c.usda")))
    return character


@pytest.fixture
def tube():
    points, quads = scenes.tube(0.2, 0.8, 1.3, 21)
    return points, triangulated(quads)


def test_weights_are_those_of_the_body_beneath(hero, tube):
    points, triangles = tube
    # The tube is 5 cm away: evening out would flatten the slope towards its open ends.
    rigged = rig_arrays(hero, points, triangles, settings_json='{"rig": {"reach": 0.0}}')
    assert rigged.joint_weights.shape == rigged.joint_indices.shape == (len(points), rigged.influences)
    assert np.abs(rigged.joint_weights.sum(axis=1) - 1.0).max() < 1e-6
    assert rigged.report["matched"] == 1.0
    shape = (len(hero.points), hero.skin_influences)
    body = np.zeros((len(hero.points), len(hero.joints)))
    indices = hero.joint_indices.reshape(shape).astype(int)
    np.add.at(body, (np.arange(len(body))[:, None], indices), hero.joint_weights.reshape(shape))
    height = hero.points[:, 1]
    levels = np.unique(height.round(6))
    by_height = np.array([body[np.isclose(height, level, atol=1e-5)].mean(axis=0) for level in levels])
    wanted = np.stack([np.interp(points[:, 1], levels, by_height[:, j]) for j in range(body.shape[1])], -1)
    assert np.abs(rigged.dense(len(hero.joints)) - wanted).max() < 0.05


def test_seams_share_their_weights_to_the_bit(hero, tube):
    points, triangles = tube
    low, high = points[:, 1] < 1.05 + 1e-9, points[:, 1] > 1.05 - 1e-9
    both = np.concatenate([points[low], points[high]])
    new_low, new_high = np.cumsum(low) - 1, np.cumsum(high) - 1 + low.sum()
    cut = points[triangles][..., 1].mean(axis=1) < 1.05
    parts = np.concatenate([new_low[triangles[cut]], new_high[triangles[~cut]]])
    ring = np.flatnonzero(low & high)
    assert len(ring) > 0
    seams = np.stack([new_low[ring], new_high[ring]], axis=1)
    weights = rig_arrays(hero, both, parts, seams).dense(len(hero.joints))
    assert (weights[seams[:, 0]] == weights[seams[:, 1]]).all()


def test_a_prepared_body_gives_the_same(hero, tube):
    body = prepare_body(hero)
    first, second = rig_arrays(hero, *tube), rig_arrays(body, *tube)
    assert (first.joint_weights == second.joint_weights).all()
    matched, points = match_arrays(body, *tube)
    assert matched.all() and np.isfinite(points).all()


def test_what_cannot_be_rigged_is_refused(hero, tube):
    points, triangles = tube
    body = prepare_body(hero)
    hole = points.copy()
    hole[7, 1] = np.nan
    cases = [
        ((hole, triangles), "cloth: 'points': element 7 is not a finite number"),
        ((points[:, :2], triangles), "'points': has shape"),
        ((points, triangles + len(points)), r"'triangles': element 0: point \d+, but there are only"),
        ((points, triangles[:0]), "the garment has no triangles"),
        ((points, triangles, [[0, len(points)]]), "'seams': element 0: point"),
    ]
    for arguments, message in cases:
        with pytest.raises(BadInput, match=message):
            rig_arrays(body, *arguments)
    for setting, message in (
        ({"influences": 0}, "'influences' must be at least 1"),
        ({"cone": -1.0}, "'cone' must be between 0 and 180"),
        ({"reach": -0.1}, "'reach' must be finite and not negative"),
        ({"fingers": True}, "unknown field `fingers`"),
    ):
        with pytest.raises(BadSettings, match=message):
            rig_arrays(body, points, triangles, settings_json=json.dumps({"rig": setting}))


def test_a_body_whose_weights_make_no_sense_is_refused(hero, tube):
    hero.joint_weights = hero.joint_weights.copy()
    hero.joint_weights[2 * 7 : 2 * 8] = 0.0
    with pytest.raises(BadInput, match="/Hero/Body: the weights of point 7 are not finite and positive"):
        rig_arrays(hero, *tube)
