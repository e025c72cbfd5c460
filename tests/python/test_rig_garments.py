"""Skin weights of garments that do not lie on the skin: open, standing up, folded, in layers."""

from __future__ import annotations

import json

import numpy as np
import pytest
from dressform import rig_arrays
from dressform.model import Character

#: As it is found, without what poses say: these bodies have no limbs to pose.
AROUND, ALONG = 64, 40


def surface(rings: np.ndarray, *, closed: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of rings of points, shape [m, n, 3], seen from outside."""
    m, n = rings.shape[:2]
    last = n if closed else n - 1
    i, j = (a.ravel() for a in np.meshgrid(np.arange(m - 1), np.arange(last), indexing="ij"))
    a, b = i * n + j, i * n + (j + 1) % n
    c, d = b + n, a + n
    return rings.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def ring(angles: np.ndarray, radius, height) -> np.ndarray:
    """Rings about the Y axis, counter-clockwise as seen from above; shape [m, n, 3]."""
    radius, height = np.broadcast_arrays(radius, height)
    radius, height = (np.broadcast_to(x, (len(x), len(angles))) for x in (radius, height))
    return np.stack([radius * np.sin(angles), height, radius * np.cos(angles)], axis=-1)


def full(count: int = AROUND) -> np.ndarray:
    return np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)


def body(points: np.ndarray, triangles: np.ndarray, upper: np.ndarray) -> Character:
    """A body whose points hang on `lower` and `upper`, the latter with the given weights."""
    frames = np.tile(np.eye(4), (2, 1, 1))
    frames[1, 1, 3] = 0.3
    return Character(
        name="body",
        path="/Body",
        points=points,
        triangles=triangles.astype(np.uint32),
        skin_influences=2,
        joint_indices=np.tile([0, 1], len(points)).astype(np.uint32),
        joint_weights=np.stack([1.0 - upper, upper], axis=1).ravel(),
        joints=["lower", "lower/upper"],
        joint_parents=[-1, 0],
        world_from_joint=frames,
    )


def trunk(radius: float = 0.15) -> Character:
    """A trunk that bends over all of its height of 0.6 m."""
    heights = np.linspace(0.0, 0.6, 61)[:, None]
    points, triangles = surface(ring(full(), radius, heights))
    return body(points, triangles, points[:, 1] / 0.6)


def jumps(weights: np.ndarray, triangles: np.ndarray) -> float:
    """Largest sum of absolute differences along an edge."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return float(np.abs(weights[edges[:, 0]] - weights[edges[:, 1]]).sum(axis=1).max())


def test_an_open_jacket_over_another_layer_follows_the_trunk_on_both_sides():
    """Open in front: its edges stand 4 cm off, where its back lies 2 cm off over a shirt."""
    angles = np.linspace(0.25, 2.0 * np.pi - 0.25, AROUND)
    off = 0.02 + 0.02 * np.abs(np.cos(angles / 2.0)) ** 8
    heights = np.linspace(0.1, 0.5, ALONG)[:, None]
    points, triangles = surface(ring(angles, 0.15 + off[None], heights), closed=False)
    rigged = rig_arrays(trunk(), points, triangles)
    assert rigged.report["nearest"] == 0.0
    weights = rigged.dense(2)[:, 1].reshape(ALONG, AROUND)
    # Evening out flattens the slope at the free ends; in the middle it is the trunk's.
    middle = np.abs(heights[:, 0] - 0.3) < 0.1
    assert np.abs(weights[middle] - heights[middle] / 0.6).max() < 0.08
    # Left and right are mirror images, and neither flap bleeds into the other across the gap.
    assert np.abs(weights - weights[:, ::-1]).max() < 0.02
    assert jumps(rigged.dense(2), triangles) < 0.1


def test_a_collar_folded_over_moves_with_the_neck_beneath_it():
    """A stand that rises 5 cm along the neck, and its fall, which hangs over it inside out."""
    heights = np.linspace(0.0, 0.2, 41)[:, None]
    points, triangles = surface(ring(full(), 0.06, heights))
    neck = body(points, triangles, np.clip(points[:, 1] / 0.2, 0.0, 1.0))
    up = np.linspace(0.05, 0.1, 11)
    down = np.linspace(0.1, 0.055, 10)[1:]
    profile_height = np.concatenate([up, down])[:, None]
    profile_radius = np.concatenate([np.full(len(up), 0.068), np.full(len(down), 0.074)])[:, None]
    points, triangles = surface(ring(full(), profile_radius, profile_height))
    rigged = rig_arrays(neck, points, triangles, settings_json=json.dumps({"rig": {"reach": 0.0}}))
    assert rigged.report["nearest"] == 0.0
    assert np.abs(rigged.dense(2)[:, 1] - points[:, 1] / 0.2).max() < 0.08
    smooth = rig_arrays(neck, points, triangles)
    assert np.abs(smooth.dense(2)[:, 1] - points[:, 1] / 0.2).max() < 0.12
    assert jumps(smooth.dense(2), triangles) < 0.2


@pytest.mark.parametrize("apart", [1e-3, 1e-5])
def test_layers_that_nearly_touch_have_the_same_weights_also_inside_out(apart):
    """Two sheets one over the other, the outer one wound the wrong way round."""
    heights = np.linspace(0.1, 0.5, ALONG)[:, None]
    inner, triangles = surface(ring(full(), 0.155, heights))
    outer, _ = surface(ring(full(), 0.155 + apart, heights))
    points = np.concatenate([inner, outer])
    both = np.concatenate([triangles, triangles[:, ::-1] + len(inner)])
    rigged = rig_arrays(trunk(), points, both)
    assert rigged.report["turned_pieces"] == 1 and rigged.report["nearest"] == 0.0
    weights = rigged.dense(2)[:, 1]
    assert np.abs(weights[: len(inner)] - weights[len(inner) :]).max() < 0.01
    assert np.abs(weights - points[:, 1] / 0.6).max() < 0.05


def test_sleeves_that_touch_do_not_bleed_into_each_other():
    """Two limbs side by side, each on a joint of its own, in sleeves a tenth of a millimetre apart."""
    heights = np.linspace(0.0, 0.6, 61)[:, None]
    limb, faces = surface(ring(full(), 0.05, heights))
    shift = np.array([0.06, 0.0, 0.0])
    both = np.concatenate([limb - shift, limb + shift])
    bodies = body(both, np.concatenate([faces, faces + len(limb)]), np.repeat([0.0, 1.0], len(limb)))
    sleeve, cloth = surface(ring(full(), 0.06 - 5e-5, np.linspace(0.1, 0.5, ALONG)[:, None]))
    points = np.concatenate([sleeve - shift, sleeve + shift])
    rigged = rig_arrays(bodies, points, np.concatenate([cloth, cloth + len(sleeve)]))
    weights = rigged.dense(2)[:, 1]
    assert weights[: len(sleeve)].max() < 1e-6 and weights[len(sleeve) :].min() > 1.0 - 1e-6
