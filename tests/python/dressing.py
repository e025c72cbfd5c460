"""A stand-in for the fitting core: garments moved with the nearest body point, its weights taken.

Good enough to test writing: every array has the right shape and plausible values.
"""

from __future__ import annotations

import numpy as np
from dressform.model import Character, DressedGarment, Outfit


def nearest(points: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Index of the nearest body point, by brute force in blocks."""
    size = (body**2).sum(axis=1)
    blocks = np.array_split(points, max(1, len(points) // 256))
    return np.concatenate([np.argmin(size - 2.0 * block @ body.T, axis=1) for block in blocks])


def dress(outfit: Outfit, target: Character) -> list[DressedGarment]:
    """Each garment moved as its nearest body points move; the pattern is stretched by 2%."""
    results = []
    k = target.skin_influences
    for garment in outfit.garments:
        body = outfit.bodies[garment.body]
        index = nearest(garment.points, body.points)
        results.append(
            DressedGarment(
                points=garment.points + (target.points - body.points)[index],
                corner_pattern=garment.corner_pattern * 1.02,
                joint_indices=target.joint_indices.reshape(-1, k)[index].ravel(),
                joint_weights=target.joint_weights.reshape(-1, k)[index].ravel(),
                influences=k,
                certificate={
                    "body_intersections": 3,
                    "body_penetration_max_m": 1.25e-3,
                    "strain_warp": [-0.01, 0.0, 0.02],
                },
            )
        )
    return results


def skinned(
    points: np.ndarray, indices: np.ndarray, weights: np.ndarray, transforms: np.ndarray
) -> np.ndarray:
    """Linear blend skinning: sum of w T p over influences; transforms [j, 4, 4] in the same space."""
    blended = np.einsum("nk,nkij->nij", weights, transforms[indices])
    return np.einsum("nij,nj->ni", blended[:, :3, :3], points) + blended[:, :3, 3]
