"""The number of threads decides how long a fit takes, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

#: Fits the sample's skirt and prints a digest of all that comes back.
FIT = """
import hashlib, json, sys
import dressform
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit

outfit = read_outfit(sys.argv[1], garments=["/Outfit/Skirt"])
character, _ = read_character(sys.argv[2])
settings = json.dumps({"posed": {"enabled": False}})
garment = dressform.fit_arrays(outfit, character, settings, "cpu").garments[0]
arrays = (garment.points, garment.corner_pattern, garment.joint_weights)
print([hashlib.sha256(a.tobytes()).hexdigest() for a in arrays])
"""


def test_one_thread_and_three_give_the_same_bytes(samples: Path) -> None:
    files = [samples / "outfits/casual_woman.usda", samples / "characters/thin_woman.usdc"]
    digests = [
        subprocess.run(
            [sys.executable, "-c", FIT, *map(str, files)],
            env=os.environ | {"RAYON_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "3")
    ]
    assert digests[0] == digests[1]
    assert digests[0].count(",") == 2
