"""Blender's own importer and armature against our skinning.

Blender runs in a process of its own (its USD library and usd-core's do not share stages), with the
Python that ``BLENDER_PYTHON`` names: one that has the ``bpy`` wheel. ``make test-dcc`` sees to it.
"""

import os
import subprocess
from pathlib import Path

import dressform
import numpy as np
import pytest
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from pxr import Usd, UsdSkel

REPOSITORY = Path(__file__).resolve().parents[2]
SCRIPT = Path(__file__).with_name("blender_pose.py")
#: Every stage, but no time: what is asked is whether the weights arrive.
STILL = {"drape": {"frames": 0, "push_steps": 0}, "posed": {"enabled": False}}
POSES = ("t", "arms_up", "arms_crossed", "sit", "squat", "bend", "twist")
#: Largest distance of a point from where our skinning puts it [m].
TOLERANCE = 1e-4


@pytest.fixture(scope="session")
def blender() -> str:
    python = os.environ.get("BLENDER_PYTHON")
    if not python:
        pytest.fail("BLENDER_PYTHON names no Python with the bpy wheel: run make test-dcc")
    return python


@pytest.fixture(scope="session")
def dressed(tmp_path_factory):
    samples = REPOSITORY / "samples"
    out = tmp_path_factory.mktemp("dcc") / "dressed.usda"
    dressform.fit(
        samples / "outfits/casual_woman.usda",
        samples / "characters/heavy_woman.usdc",
        out,
        settings=STILL,
        device="cpu",
    )
    return out


def weights_of(stage: Usd.Stage, path: str, joints: int) -> np.ndarray:
    """Dense weights as the layer has them, shape [n, j]."""
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath(path))
    k = binding.GetJointWeightsPrimvar().GetElementSize()
    indices = np.array(binding.GetJointIndicesPrimvar().Get()).reshape(-1, k)
    values = np.array(binding.GetJointWeightsPrimvar().Get(), float).reshape(-1, k)
    dense = np.zeros((len(indices), joints))
    np.add.at(dense, (np.arange(len(indices))[:, None], indices), values)
    return dense


def test_blender_poses_the_garments_as_we_do(dressed, blender, tmp_path):
    character, _ = read_character(dressed)
    garments = read_outfit(dressed).garments
    poses = {name: m for name, m in dressform.native.poses(character).items() if name in POSES}
    assert set(poses) == set(POSES)
    # Blender is Z up, in metres; (x, y, z) of ours is (x, -z, y) there.
    turn = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)
    theirs = {name: turn @ m @ turn.T for name, m in poses.items()}
    np.savez(tmp_path / "poses.npz", joints=np.array(character.joints), **theirs)
    command = [blender, SCRIPT, dressed, tmp_path / "poses.npz", tmp_path / "out.npz"]
    done = subprocess.run(map(str, command), capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = dict(np.load(tmp_path / "out.npz"))
    stage = Usd.Stage.Open(str(dressed))
    for garment in garments:
        dense = weights_of(stage, garment.path, len(character.joints))
        assert np.abs(found[f"weights/{garment.name}"] - dense).max() < 1e-6
        rest = found[f"rest/{garment.name}"] @ turn[:3, :3]
        assert np.abs(rest - garment.points).max() < 1e-5
        homogeneous = np.column_stack([garment.points, np.ones(len(garment.points))])
        moved = 0.0
        for name, matrices in poses.items():
            ours = np.einsum("nj,jik,nk->ni", dense, matrices, homogeneous)[:, :3]
            ours /= dense.sum(axis=1, keepdims=True)
            blenders = found[f"{name}/{garment.name}"] @ turn[:3, :3]
            away = np.linalg.norm(blenders - ours, axis=1).max()
            moved = max(moved, np.linalg.norm(ours - garment.points, axis=1).max())
            print(f"{garment.name} in {name}: {1e3 * away:.4f} mm")
            assert away < TOLERANCE, (garment.name, name, away)
        assert moved > 0.2, "the poses move it"
