#!/usr/bin/env python3
"""Bodies and garments of a data folder as one JSON file, for benchmarks that know no USD.

    meshes.py DATA OUT.json

`bodies`: name to points [m], shape [n, 3], and triangles. `outfits`: name to the source body and
the garments with their points and triangles, in the body's frame.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit


def mesh(points: Any, triangles: Any) -> dict[str, Any]:
    return {"points": points.tolist(), "triangles": triangles.tolist()}


def main() -> None:
    """Writes the file."""
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    bodies, outfits = {}, {}
    for path in sorted((data / "characters").glob("*.usdc")):
        character, _ = read_character(path)
        bodies[path.stem] = mesh(character.points, character.triangles)
    for path in sorted((data / "outfits").glob("*.usda")):
        outfit = read_outfit(path)
        body = outfit.bodies[0]
        outfits[path.stem] = {
            "body": mesh(body.points, body.triangles),
            "garments": {g.name: mesh(g.points, g.triangles) for g in outfit.garments},
        }
    out.write_text(json.dumps({"bodies": bodies, "outfits": outfits}))


if __name__ == "__main__":
    main()
