"""A garment on its own body, where it stands and moved elsewhere, comes back as it was."""

import copy
import json

import dressform
import numpy as np
import pytest
from dressform.usd.garment import read_outfit

#: Transfer and pattern alone.
STILL = json.dumps({"drape": {"frames": 0, "push_steps": 0, "settle": False}})


@pytest.mark.parametrize("by", [(0.0, 0.0, 0.0), (0.31, -0.17, 0.23)])
def test_own_body(samples, by):
    outfit = read_outfit(samples / "outfits/casual_woman.usda")
    body = copy.deepcopy(outfit.bodies[0])
    body.points = body.points + np.array(by)
    fitted = dressform.fit_arrays(outfit, body, STILL, "cpu")
    for garment, result in zip(outfit.garments, fitted.garments, strict=True):
        assert np.abs(result.points - garment.points - np.array(by)).max() < 1e-5
        assert np.abs(result.corner_pattern - garment.corner_pattern).max() < 1e-5


def test_another_body_moves_it(samples):
    outfit = read_outfit(samples / "outfits/casual_woman.usda", garments=["/Outfit/Skirt"])
    body = copy.deepcopy(outfit.bodies[0])
    body.points = body.points * np.array([1.0, 1.05, 1.0])
    fitted = dressform.fit_arrays(outfit, body, STILL, "cpu")
    (garment,), (result,) = outfit.garments, fitted.garments
    # Taller by 5 %: so is the skirt, and its pattern grows with it.
    ratio = np.ptp(result.points[:, 1]) / np.ptp(garment.points[:, 1])
    assert 1.04 < ratio < 1.06
    assert np.ptp(result.corner_pattern[..., 0]) > 1.02 * np.ptp(garment.corner_pattern[..., 0])
