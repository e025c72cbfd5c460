#!/usr/bin/env python3
"""Lets outside judges count what is left in fitted outfits: libigl with CGAL, and ipctk.

    DRESSFORM_PEERS=... judges.py DATA RESULTS [--table docs/judges.md]

RESULTS is the folder that ``all_pairs.py`` wrote. Every garment of every result is judged against
the character's whole body mesh, against each garment below it, and against itself, sewn points
welded; the same garment on its source body is judged too, since it may have crossed itself there.
Exit code 1 if a judge found what our certificate did not.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from all_pairs import head
from dressform.model import Character, GarmentSource
from dressform.usd.garment import read_outfit
from fixtures import peer

COLUMNS = (
    "outfit | character | garment | body pairs (CGAL) | ipctk | inside | depth mm | layer pairs | self pairs "
    "| ipctk | self pairs on the source | ours: body, layer, self | strain beyond the source's"
)
#: How far warp and weft strains (p1 and p99 over triangles) may leave the source garment's range.
WIDENED = 0.05


def split_by_panel(garment: GarmentSource) -> dict[str, np.ndarray]:
    """One vertex for each 3D point and 2D position, in the peers' keys; welded by ``seams``."""
    corners = garment.triangles.astype(np.int64).reshape(-1)
    flat = garment.corner_pattern.reshape(-1, 2)
    key = np.column_stack([corners, np.round(flat * 1e7).astype(np.int64)])
    unique, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    point = unique[:, 0]
    same = point[1:] == point[:-1]
    seams = [np.column_stack([np.flatnonzero(same), np.flatnonzero(same) + 1])]
    vertex = np.full(len(garment.points), -1)
    vertex[point] = np.arange(len(point))
    for seam in garment.seams:
        if not seam.offset:
            pairs = vertex[seam.pairs]
            seams.append(pairs[(pairs >= 0).all(axis=1)])
    return {
        "garment_v": garment.points[point],
        "garment_f": inverse.reshape(-1, 3),
        "panel_v": flat[first],
        "seams": np.concatenate(seams),
    }


def judge(stage: Path, folder: Path) -> dict[str, dict]:
    """What the judges say of each garment of a stage, by its name."""
    outfit = read_outfit(stage)
    files, verdicts = {}, {}
    for garment in sorted(outfit.garments, key=lambda g: g.layer):
        body: Character = outfit.bodies[garment.body]
        file = folder / f"{stage.stem}.{garment.name}.npz"
        np.savez(
            file, target_v=body.points, body_f=body.triangles.astype(np.int64), **split_by_panel(garment)
        )
        verdicts[garment.name] = peer("judges.py", file, "--inner", *files.values())
        files[garment.name] = file
    return verdicts


def beyond(strain: dict, source: dict) -> float:
    """How far strains leave the source's range, widened; along either thread."""
    excess = 0.0
    for axis in ("warp", "weft"):
        own, first = strain[axis], source[axis]
        excess = max(excess, own["p99"] - first["p99"] - WIDENED, first["p1"] - WIDENED - own["p1"])
    return excess


def row(outfit: str, character: str, name: str, verdict: dict, source: dict, ours: dict) -> list[str]:
    """Cells of a garment."""
    body, own, depth = verdict["garment_body"], verdict["garment_self"], verdict["penetration"]
    return [
        outfit, character, name,
        str(body["pairs"]), "some" if body["ipctk_has"] else "none",
        str(depth["vertices"]), f"{depth['depth_max'] * 1e3:.2f}",
        str(sum(i["pairs"] for i in verdict["inner"])),
        str(own["pairs"]), "some" if own["ipctk_has"] else "none",
        str(source["garment_self"]["pairs"]),
        ", ".join(str(ours[f"{what}_intersections"]) for what in ("body", "layer", "self")),
        f"{beyond(verdict['strain'], source['strain']):.3f}",
    ]  # fmt: skip


def main() -> int:
    """Prints and writes the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--table", type=Path)
    options = parser.parse_args()
    table = head(COLUMNS)
    unseen = clean = within = 0
    sources: dict[str, dict] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for stage in sorted(options.results.glob("*_on_*.usda")):
            outfit, character = stage.stem.split("_on_", 1)
            if outfit not in sources:
                sources[outfit] = judge(options.data / "outfits" / f"{outfit}.usda", folder)
            report = json.loads(stage.with_suffix(".json").read_text())
            ours = {g["name"]: g["certificate"] for g in report["garments"]}
            for garment, verdict in judge(stage, folder).items():
                cells = row(outfit, character, garment, verdict, sources[outfit][garment], ours[garment])
                table.append("| " + " | ".join(cells) + " |")
                print(table[-1], flush=True)
                found = [int(cells[3]), int(cells[7]), int(cells[8])]
                unseen += any(f > int(o) for f, o in zip(found, cells[-2].split(", "), strict=True))
                clean += not any(found)
                within += float(cells[-1]) == 0.0
    count = len(table) - 2
    summary = (
        f"{count} garments: {clean} without a pair; in {unseen} the judges found more than we did; "
        f"strains of {within} within the source's range widened by {WIDENED}."
    )
    print(summary)
    if options.table:
        title = (
            "# Outside judges over every pair\n\nMade by benches/judges.py from the results of `make pairs`. "
        )
        options.table.write_text(title + summary + "\n\n" + "\n".join(table) + "\n")
    return 1 if unseen else 0


if __name__ == "__main__":
    sys.exit(main())
