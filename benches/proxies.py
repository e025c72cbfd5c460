#!/usr/bin/env python3
"""What proxies are worth: details left out against details simulated.

    RAYON_NUM_THREADS=1 proxies.py [DATA]

Fits a vest with reflective straps all around (made from the sample's shirt) to heavy_woman, and
with DATA the T-shirt with its pocket to heavy_man. Prints one JSON object a fit: CPU seconds of the
drape, its iterations, what crosses, and how well the details kept their place.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
from pathlib import Path
from typing import Any

import dressform
from dressform.model import Character, Outfit
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(REPOSITORY / "tests" / "python"))

import vests  # noqa: E402


def fit(outfit: Outfit, target: Character, enabled: bool) -> dict[str, Any]:
    """One fit; CPU seconds from the first word of the drape to the first of the rig."""
    clock: dict[str, float] = {}

    def tell(stage: str, part: float) -> None:
        clock.setdefault(stage, resource.getrusage(resource.RUSAGE_SELF).ru_utime)

    settings = json.dumps({"proxy": {"enabled": enabled}})
    (report,) = dressform.fit_arrays(outfit, target, settings, "cpu", tell).report["garments"]
    proxy, drape, sure = report["proxy"], report["drape"], report["certificate"]
    return {
        "garment": report["name"],
        "proxy": enabled,
        "drape_cpu_s": round(clock["rig"] - clock["drape"], 1),
        **{key: drape[key] for key in ("newton_iterations", "cg_iterations", "steps", "unconverged_steps")},
        **{key: sure[key] for key in ("self_intersections", "body_intersections", "strain_change_p99")},
        **{key: value for key, value in proxy.items() if not isinstance(value, list)},
    }


def main() -> None:
    """Prints the fits."""
    file = REPOSITORY / "samples/outfits/casual_woman.usda"
    sample = read_outfit(file)
    (shirt,) = (g for g in sample.garments if g.name == "Tshirt")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "vest.usda"
        vests.write_vest(path, file, sample, vests.make_vest(shirt))
        cases = [(read_outfit(path), REPOSITORY / "samples/characters/heavy_woman.usdc")]
    for data in map(Path, sys.argv[1:2]):
        tshirt = read_outfit(data / "outfits/casual_man.usda", garments=["/Outfit/Tshirt"])
        cases.append((tshirt, data / "characters/heavy_man.usdc"))
    for outfit, character in cases:
        target, _ = read_character(character)
        for enabled in (True, False):
            print(json.dumps(fit(outfit, target, enabled)), flush=True)


if __name__ == "__main__":
    main()
