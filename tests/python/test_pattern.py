"""The refit of real garments from crumpled transfers."""

import json

import dressform
import numpy as np
import pytest
from dressform.usd.garment import read_outfit

#: Triangles smaller than this part of their original area have collapsed.
COLLAPSED = 1e-3


def area(corners):
    a, b, c = np.moveaxis(corners, 1, 0)
    (x, y), (z, w) = (b - a).T, (c - a).T
    return 0.5 * (x * w - y * z)


@pytest.fixture(scope="module")
def garments(samples):
    return read_outfit(samples / "outfits/casual_woman.usda").garments


@pytest.mark.parametrize("millimetres", [5, 10, 20])
def test_crumpled_cloth_gives_whole_panels(garments, millimetres):
    for number, garment in enumerate(garments):
        noise = np.random.default_rng(number).uniform(-1e-3, 1e-3, garment.points.shape) * millimetres
        refitted = dressform.refit_arrays(garment, garment.points + noise)
        share = area(refitted.corner_pattern) / area(garment.corner_pattern)
        assert share.min() > COLLAPSED, (garment.name, refitted.report["repaired"])
        assert refitted.report["flipped_triangles"] == 0


def test_a_repair_that_was_needed_is_reported(garments):
    # Cloth gathered to a tenth along one axis and thrown about: most triangles ask for the impossible.
    garment = garments[0]
    rng = np.random.default_rng(7)
    points = garment.points * [0.1, 1.0, 1.0] + rng.uniform(-0.02, 0.02, garment.points.shape)
    free = {"straight_bound": 100.0, "corner_bound": 180.0, "mirror": False}
    refitted = dressform.refit_arrays(garment, points, json.dumps({"pattern": free}))
    share = area(refitted.corner_pattern) / area(garment.corner_pattern)
    assert refitted.report["flipped_triangles"] == 0 and share.min() > 0
    assert refitted.report["repaired"] != "none" and refitted.report["crumpled_triangles"] > 0
