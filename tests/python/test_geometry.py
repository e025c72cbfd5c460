"""Winding numbers, distance grids and the outer skin of real bodies and garments, judged by libigl."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from dressform.native import grid_distances, outer_skin, winding_numbers


def around(points: np.ndarray, count: int, spread: float, seed: int = 7) -> np.ndarray:
    """Points of a mesh, moved by up to ``spread`` [m]."""
    random = np.random.default_rng(seed)
    chosen = points[random.integers(len(points), size=count)]
    return chosen + random.uniform(-spread, spread, (count, 3))


def exact(points: np.ndarray, triangles: np.ndarray, queries: np.ndarray) -> np.ndarray:
    return igl.winding_number(points, triangles.astype(np.int64), queries)


def body(character) -> tuple[np.ndarray, np.ndarray]:
    return np.ascontiguousarray(character.points), character.triangles


def garments(outfit) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.ascontiguousarray(g.points), g.triangles) for g in outfit.garments]


def test_winding_numbers_are_those_of_libigl(sample_target, sample_outfit):
    for points, triangles in [body(sample_target), *garments(sample_outfit)]:
        queries = np.concatenate([around(points, 1500, 0.005), around(points, 1500, 0.2)])
        error = np.abs(winding_numbers(points, triangles, queries) - exact(points, triangles, queries))
        assert error.max() < 1e-3


def test_a_garment_is_sealed_at_a_quarter(sample_outfit):
    """In sleeves and legs the number is above 0.25, though hems and necks are open."""
    shirt = next(g for g in sample_outfit.garments if g.name == "Tshirt")
    middle = shirt.points[np.abs(shirt.points[:, 1] - np.median(shirt.points[:, 1])) < 0.02].mean(axis=0)
    number = winding_numbers(shirt.points, shirt.triangles, middle[None])[0]
    assert abs(number) > 0.25


def test_the_grid_is_within_its_stated_error(sample_target):
    """sqrt(3) h at creases, 3 h^2 / (8 R) where smooth: its 99th percentile was 0.28 h here."""
    points, triangles = outer_skin(*body(sample_target))
    torso = around(points[np.abs(points[:, 1] - 1.1) < 0.15], 3000, 0.012)
    spacing = 0.008
    found = grid_distances(points, triangles, torso, spacing=spacing, band=0.03)
    distance = np.sqrt(igl.point_mesh_squared_distance(torso, points, triangles.astype(np.int64))[0])
    signed = np.where(exact(points, triangles, torso) > 0.5, -distance, distance)
    assert np.isfinite(found).all()
    error = np.abs(found - signed)
    assert error.max() < np.sqrt(3) * spacing
    assert np.percentile(error, 99) < spacing / 3


def test_the_outer_skin_leaves_eyes_and_mouth_out(sample_target):
    points, triangles = body(sample_target)
    skin_points, skin_triangles = outer_skin(points, triangles)
    assert 0.5 * len(triangles) < len(skin_triangles) < len(triangles)
    # Whatever is far outside of the body is outside of its skin, and the chest is inside.
    chest = points[np.abs(points[:, 1] - 1.2) < 0.01]
    inner = chest[np.abs(chest[:, 0]) < 0.12].mean(axis=0)[None]
    assert winding_numbers(skin_points, skin_triangles, inner)[0] == pytest.approx(1.0, abs=0.05)
    assert np.abs(winding_numbers(skin_points, skin_triangles, inner + np.array([[0.0, 0.0, 2.0]])))[0] < 0.01
