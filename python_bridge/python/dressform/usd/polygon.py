"""Triangles from faces of any number of corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..model import Floats

Ints = NDArray[np.int64]


def triangulate(points: Floats, counts: Ints, indices: Ints) -> tuple[Ints, Ints]:
    """Cuts faces into triangles without adding points.

    Returns:
        Face of each triangle, shape [t], in face order, and for each corner the position in
        ``indices``, shape [t, 3].
    """
    start = np.concatenate([[0], np.cumsum(counts)[:-1]])
    faces, corners = [], []
    three = np.flatnonzero(counts == 3)
    faces.append(three)
    corners.append(start[three, None] + np.arange(3))
    four = np.flatnonzero(counts == 4)
    if len(four):
        faces.append(np.repeat(four, 2))
        corners.append((start[four, None, None] + _cut_quads(points, start[four], indices)).reshape(-1, 3))
    for many in np.flatnonzero(counts > 4):
        ears = _clip_ears(points[indices[start[many] : start[many] + counts[many]]])
        faces.append(np.full(len(ears), many))
        corners.append(start[many] + ears)
    face: Ints = np.concatenate(faces)
    corner: Ints = np.concatenate(corners)
    order = np.argsort(face, kind="stable")
    return face[order], corner[order]


def _cut_quads(points: Floats, start: Ints, indices: Ints) -> Ints:
    """Both triangles of each quad, [q, 2, 3], by the diagonal that leaves the larger smallest
    signed area (so that a concave quad is cut from its reflex corner)."""
    quad = points[indices[start[:, None] + np.arange(4)]]
    normal = np.cross(quad[:, 2] - quad[:, 0], quad[:, 3] - quad[:, 1])
    cuts = np.array([[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]])
    worst = []
    for cut in cuts:
        tri = quad[:, cut]
        area = np.cross(tri[:, :, 1] - tri[:, :, 0], tri[:, :, 2] - tri[:, :, 0])
        worst.append(np.einsum("qtd,qd->qt", area, normal).min(axis=1))
    chosen: Ints = cuts[(worst[1] > worst[0]).astype(np.int64)]
    return chosen


def _clip_ears(polygon: Floats) -> Ints:
    """Ear clipping in the polygon's mean plane, the roundest ear first, shape [n - 2, 3]."""
    normal = np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0)
    length = np.linalg.norm(normal)
    normal = normal / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    left = list(range(len(polygon)))
    ears = []
    while len(left) > 3:
        best = max(range(len(left)), key=lambda i: _ear_quality(polygon, normal, left, i))
        ears.append([left[best - 1], left[best], left[(best + 1) % len(left)]])
        del left[best]
    return np.array([*ears, left], dtype=np.int64)


def _ear_quality(polygon: Floats, normal: Floats, left: list[int], i: int) -> float:
    """Twice the signed area over the longest edge squared; below zero where it is no ear."""
    ring = (left[i - 1], left[i], left[(i + 1) % len(left)])
    a, b, c = polygon[list(ring)]
    area = float(np.cross(b - a, c - a) @ normal)
    longest = max(float((e * e).sum()) for e in (b - a, c - b, a - c))
    quality = area / longest if longest > 0.0 else -1.0
    if quality <= 0.0:
        return quality - 1.0
    for p in (polygon[j] for j in left if j not in ring):
        sides = (np.cross(v - u, p - u) @ normal for u, v in ((a, b), (b, c), (c, a)))
        if all(side > 0.0 for side in sides):
            return -0.5  # another corner lies inside
    return quality
