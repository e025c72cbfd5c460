#!/usr/bin/env python3
"""What must agree with itself: identity, translation, a round trip, a rerun, CPU and GPU.

    agreement.py DATA [--gpu NAME]

Prints one JSON object: distances of garment points in millimetres (mean and largest), the
pattern's in millimetres, and whether a rerun gave the same bytes.
"""

from __future__ import annotations

import argparse
import copy
import json
import sys
from pathlib import Path
from typing import Any

import dressform
import numpy as np
from dressform.model import Character, GarmentSource, Outfit
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit

#: Transfer and pattern alone; and the default drape.
STILL = json.dumps({"drape": {"frames": 0, "push_steps": 0, "settle": False}})
DRAPED = "{}"


def distance(a: Any, b: Any) -> dict[str, float]:
    gap = np.linalg.norm(np.asarray(a) - np.asarray(b), axis=-1) * 1e3
    return {"mean_mm": float(gap.mean()), "max_mm": float(gap.max())}


def moved(character: Character, by: Any) -> Character:
    other = copy.deepcopy(character)
    other.points = character.points + by
    other.world_from_joint = character.world_from_joint.copy()
    other.world_from_joint[:, :3, 3] += by
    return other


def compare(garments: list[GarmentSource], results: Any, by: Any = 0.0) -> dict[str, dict]:
    return {
        g.name: {
            "points": distance(r.points, g.points + by),
            "pattern": distance(r.corner_pattern, g.corner_pattern),
        }
        for g, r in zip(garments, results.garments, strict=True)
    }


def identity(outfit: Outfit) -> dict:
    body = outfit.bodies[0]
    fit = dressform.fit_arrays
    by = np.array([0.31, -0.17, 0.23])
    still = fit(outfit, body, STILL, "cpu")
    draped = fit(outfit, body, DRAPED, "cpu")
    return {
        "transfer": compare(outfit.garments, still),
        "translated": compare(outfit.garments, fit(outfit, moved(body, by), STILL, "cpu"), by),
        "draped": compare(outfit.garments, draped),
    }


def round_trip(outfit: Outfit, target: Character) -> dict:
    """Source to target, taken as an outfit of the target, and back."""
    there = dressform.fit_arrays(outfit, target, STILL, "cpu")
    back = copy.deepcopy(outfit)
    back.bodies = [target]
    for garment, result in zip(back.garments, there.garments, strict=True):
        garment.points, garment.corner_pattern = result.points, result.corner_pattern
    returned = dressform.fit_arrays(back, outfit.bodies[0], STILL, "cpu")
    return compare(outfit.garments, returned)


def devices(outfit: Outfit, target: Character, gpu: str) -> dict:
    """The same pair on both devices, before and after the drape; and a rerun on each."""
    report = {}
    for name, settings in (("transfer", STILL), ("draped", DRAPED)):
        runs = [dressform.fit_arrays(outfit, target, settings, d) for d in ("cpu", "cpu", gpu)]
        garments = list(zip(outfit.garments, *(r.garments for r in runs), strict=True))
        report[name] = {g.name: distance(a.points, c.points) for g, a, _, c in garments}
        report[f"{name}_same_bytes_on_rerun"] = all(
            a.points.tobytes() == b.points.tobytes()
            and a.corner_pattern.tobytes() == b.corner_pattern.tobytes()
            for _, a, b, _ in garments
        )
    return report


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--gpu", default="gpu")
    options = parser.parse_args()
    report: dict = {}
    for path in sorted((options.data / "outfits").glob("*.usda")):
        outfit = read_outfit(path)
        report[path.stem] = {"identity": identity(outfit)}
        print(path.stem, json.dumps(report[path.stem], indent=1), file=sys.stderr, flush=True)
    woman = read_outfit(options.data / "outfits/casual_woman.usda")
    target, _ = read_character(options.data / "characters/thin_woman.usdc")
    report["round_trip"] = round_trip(woman, target)
    print("round trip", json.dumps(report["round_trip"], indent=1), file=sys.stderr, flush=True)
    report["devices"] = devices(woman, target, options.gpu)
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
