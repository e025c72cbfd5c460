"""A target whose rest pose is not the source's: fitted in the source's pose and brought back."""

import copy
import json

import dressform
import numpy as np
import pytest
from dressform.model import Character, Outfit
from dressing import skinned

#: Transfer and pattern alone.
STILL = json.dumps({"drape": {"frames": 0, "push_steps": 0, "settle": False}})
ARMS = {"upperarm01_L": 1.0, "upperarm01_R": -1.0}


def pose_matrices(character: Character, degrees: float) -> np.ndarray:
    """Skinning matrices that lift both arms sideways, [joints, 4, 4]; children follow."""
    bind = np.asarray(character.world_from_joint)
    matrices = np.tile(np.eye(4), (len(bind), 1, 1))
    for j, (joint, parent) in enumerate(zip(character.joints, character.joint_parents, strict=True)):
        if parent >= 0:
            assert parent < j
            matrices[j] = matrices[parent]
        side = ARMS.get(joint.rsplit("/", 1)[-1])
        if side is not None:
            angle = np.radians(side * degrees)
            turn = np.eye(4)
            turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
            at = bind[j, :3, 3]
            turn[:3, 3] = at - turn[:3, :3] @ at
            matrices[j] = matrices[j] @ turn
    return matrices


def posed(points, indices, weights, matrices) -> np.ndarray:
    k = np.asarray(indices).size // len(points)
    weights = np.asarray(weights).reshape(-1, k)
    weights = weights / weights.sum(axis=1, keepdims=True)
    return skinned(points, np.asarray(indices).reshape(-1, k).astype(int), weights, matrices)


def posed_character(character: Character, degrees: float) -> Character:
    matrices = pose_matrices(character, degrees)
    result = copy.deepcopy(character)
    result.points = posed(character.points, character.joint_indices, character.joint_weights, matrices)
    result.world_from_joint = matrices @ np.asarray(character.world_from_joint)
    return result


def posed_garment_points(garment, character: Character, degrees: float) -> np.ndarray:
    matrices = pose_matrices(character, degrees)
    return posed(garment.points, garment.joint_indices, garment.joint_weights, matrices)


@pytest.fixture(scope="module")
def shirt(sample_outfit) -> Outfit:
    outfit = copy.deepcopy(sample_outfit)
    outfit.garments = [g for g in outfit.garments if g.name == "Tshirt"]
    return outfit


@pytest.fixture(scope="module")
def plain(shirt, sample_target):
    """The shirt on the target, both in the pose of the data."""
    return dressform.fit_arrays(shirt, sample_target, STILL, "cpu")


def millimetres(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return 1e3 * np.linalg.norm(a - b, axis=1)


def test_the_same_pose_is_left_alone(plain):
    assert plain.report["flows"][0]["pose"] is None


def test_target_with_raised_arms(shirt, sample_target, plain):
    target = posed_character(sample_target, 40.0)
    fitted = dressform.fit_arrays(shirt, target, STILL, "cpu")
    (garment,), report = fitted.garments, fitted.report
    pose = report["flows"][0]["pose"]
    assert 35.0 < pose["angle_degrees"] < 45.0 and "arm" in pose["joint"]
    assert any("another pose" in note for note in report["notes"])
    # As if it had been fitted in the source's pose and then posed like any skinned garment.
    expected = posed_garment_points(plain.garments[0], sample_target, 40.0)
    assert np.percentile(millimetres(garment.points, expected), 99) < 4.0
    assert np.abs(garment.corner_pattern - plain.garments[0].corner_pattern).max() < 5e-3
    certificate = report["garments"][0]["certificate"]
    assert certificate["self_intersections"] == 0


def test_source_with_raised_arms(shirt, sample_target, plain):
    own = dressform.fit_arrays(shirt, shirt.bodies[0], STILL, "cpu").garments[0]
    raised = copy.deepcopy(shirt)
    raised.garments[0].points = posed_garment_points(own, shirt.bodies[0], 40.0)
    raised.bodies[0] = posed_character(shirt.bodies[0], 40.0)
    fitted = dressform.fit_arrays(raised, sample_target, STILL, "cpu")
    assert 35.0 < fitted.report["flows"][0]["pose"]["angle_degrees"] < 45.0
    distance = millimetres(fitted.garments[0].points, plain.garments[0].points)
    assert np.percentile(distance, 99) < 15.0 and distance.mean() < 2.0


def test_a_pose_can_be_left_to_the_flow(shirt, sample_target):
    target = posed_character(sample_target, 16.0)
    settings = json.dumps({**json.loads(STILL), "transfer": {"unpose": 180.0}})
    fitted = dressform.fit_arrays(shirt, target, settings, "cpu")
    assert fitted.report["flows"][0]["pose"] is None


def test_a_setting_out_of_range_is_refused(shirt, sample_target):
    with pytest.raises(dressform.BadSettings, match="unpose"):
        dressform.fit_arrays(shirt, sample_target, json.dumps({"transfer": {"unpose": 200.0}}), "cpu")
