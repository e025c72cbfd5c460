"""Girths of bodies and garments, and an ease that is held."""

import json

import dressform
import numpy as np
import pytest
from dressform.errors import BadSettings
from dressform.settings import Settings
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit

#: Transfer and pattern alone.
STILL = {"drape": {"frames": 0, "push_steps": 0, "settle": False}}


@pytest.fixture(scope="module")
def woman(samples):
    return read_character(samples / "characters/source_woman.usdc")[0]


def test_girths_of_a_body(woman):
    girths = dressform.body_girths(woman)
    sizes = {name: girth["girth_m"] for name, girth in girths.items()}
    # Bust, waist, hip and thigh as the body's own dress size has them, within what a tape may err.
    for name, size in {"bust": 0.91, "waist": 0.74, "hip": 1.03, "neck": 0.32}.items():
        assert abs(sizes[name] - size) < 0.04, (name, sizes)
    for limb in ("thigh", "upper_arm"):
        assert abs(sizes[f"{limb}_left"] / sizes[f"{limb}_right"] - 1) < 1e-3


def test_a_held_girth(samples):
    outfit = read_outfit(samples / "outfits/casual_woman.usda", garments=["/Outfit/Tshirt"])
    target = read_character(samples / "characters/heavy_woman.usdc")[0]

    def fit(**hold):
        settings = json.dumps({**STILL, "ease": {"hold": hold}})
        report = dressform.fit_arrays(outfit, target, settings, "cpu").report["garments"][0]
        return report, {girth["girth"]: girth for girth in report["ease"]["girths"] if not girth["side"]}

    _, free = fit()
    assert {"bust", "waist"} <= set(free) and free["waist"]["held_m"] is None
    assert free["waist"]["refit"]["ease_m"] < free["waist"]["source"]["ease_m"] - 0.02
    report, held = fit(waist={"source": "absolute"}, bust={"absolute": 0.12})
    for girth, ease in (("waist", free["waist"]["source"]["ease_m"]), ("bust", 0.12)):
        assert held[girth]["held_m"] == pytest.approx(ease)
        assert held[girth]["refit"]["ease_m"] == pytest.approx(ease, abs=1e-3)
    pattern = report["pattern"]
    assert pattern["converged"] and pattern["flipped_triangles"] == 0
    assert pattern["straight_deviation_max"] < 0.01 and pattern["corner_change_max_deg"] < 3.0
    assert pattern["seam_mismatch_max"] < 0.005


def test_a_refit_alone(sample_outfit):
    garment = sample_outfit.garments[0]
    refitted = dressform.refit_arrays(garment, garment.points * 1.3)
    edges = [
        np.linalg.norm(np.roll(p, 1, 1) - p, axis=-1)
        for p in (refitted.corner_pattern, garment.corner_pattern)
    ]
    assert np.allclose(edges[0], 1.3 * edges[1], rtol=1e-3)
    assert refitted.report["area_ratio"] == pytest.approx(1.69, rel=1e-3)
    with pytest.raises(dressform.BadInput, match="shape"):
        dressform.refit_arrays(garment, garment.points[1:])


def test_a_hold_that_says_two_things(sample_outfit, sample_target):
    hold = {"waist": {"absolute": 0.1, "relative": 0.1}}
    with pytest.raises(BadSettings, match=r"ease\.hold\.waist"):
        dressform.fit_arrays(sample_outfit, sample_target, json.dumps({"ease": {"hold": hold}}), "cpu")
    assert (
        Settings.model_validate({"ease": {"hold": {"waist": {"absolute": 0.04}}}}).ease.hold.waist.absolute
        == 0.04
    )
