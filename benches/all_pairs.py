#!/usr/bin/env python3
"""Fits every outfit of a data folder to every character and writes the table of results.

    all_pairs.py DATA OUT [--only OUTFIT:CHARACTER ...] [--device cpu] [--table docs/pairs.md]

DATA holds `outfits/*.usda` and `characters/*.usdc`. An outfit meets every target and its own
source body. Each pair is one `dressform fit --json`, so that a fault in one leaves the others.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
from pathlib import Path

COLUMNS = (
    "outfit | character | exit | garment | gap p99 mm | gap mean mm | outer | CG | strain change p50/p99 (pattern) "
    "| seam mismatch | flips | drape residual | at rest | body | layer | self | depth mm | strain change p99 (draped) | fold angle rms deg (source) | seconds"
)

HELD = "outfit | character | garment | held by | tension N | stretch | moved mean / max mm | settling steps"


def pairs(data: Path) -> list[tuple[Path, Path]]:
    """Every outfit with every target, and with the source body that it names."""
    characters = sorted((data / "characters").glob("*.usdc"))
    targets = [c for c in characters if not c.stem.startswith("source_")]
    result = []
    for outfit in sorted((data / "outfits").glob("*.usda")):
        own = [c for c in characters if c.name in outfit.read_text()]
        result += [(outfit, c) for c in own + targets]
    return result


def fit(outfit: Path, character: Path, out: Path, device: str) -> dict:
    """One fit; its JSON, with the exit code and wall seconds."""
    started = time.perf_counter()
    command = [sys.executable, "-m", "dressform", "fit", str(outfit), str(character), "-o", str(out)]
    done = subprocess.run(
        [*command, "--device", device, "--json"], capture_output=True, text=True, check=False
    )
    result: dict = {"garments": []}
    if done.returncode in (0, 1):
        result = json.loads(done.stdout)
    else:
        print(done.stderr[-2000:], file=sys.stderr)
    result.update(exit=done.returncode, wall=time.perf_counter() - started)
    return result


def head(columns: str) -> list[str]:
    """The first two lines of a table."""
    return [f"| {columns} |", "|" + " --- |" * (columns.count("|") + 1)]


def rows(outfit: str, character: str, result: dict) -> list[str]:
    """Table rows of a pair, one a garment."""
    lines = []
    for g in result["garments"]:
        t, p, d, c = g["transfer"], g["pattern"], g["drape"], g["certificate"]
        cells = [
            outfit, character, str(result["exit"]), g["name"],
            f"{t['gap_p99_m'] * 1e3:.2f}", f"{t['gap_mean_m'] * 1e3:.3f}",
            str(t["outer_iterations"]), str(t["cg_iterations"]),
            f"{p['strain_change_p50']:.4f} / {p['strain_change_p99']:.3f}",
            f"{p['seam_mismatch_max']:.4f}", str(p["flipped_triangles"]),
            f"{d['residual']:.2g}{'' if d['converged'] else ' (not converged)'}",
            "yes" if d["at_rest"] else "no",
            str(c["body_intersections"]), str(c["layer_intersections"]), str(c["self_intersections"]),
            f"{c['body_penetration_max_m'] * 1e3:.2f}", f"{c['strain_change_p99']:.3f}",
            f"{math.degrees(c['fold_angle_rms']):.0f} ({math.degrees(c['source_fold_angle_rms']):.0f})",
            f"{result['wall']:.0f}",
        ]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    if not lines:
        lines.append(f"| {outfit} | {character} | {result['exit']} |" + " |" * (COLUMNS.count("|") - 2))
    return lines


def held(outfit: str, character: str, result: dict) -> list[str]:
    """Table rows of the bands that were held."""
    return [
        f"| {outfit} | {character} | {g['name']} | {h['kind']} | {h['force_n']:.1f} | {h['extension']:.3f} "
        f"| {h['moved_mean_m'] * 1e3:.1f} / {h['moved_max_m'] * 1e3:.1f} | {g['drape']['settle_steps']} |"
        for g in result["garments"]
        for h in g["held"]
    ]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", nargs="*", default=[], metavar="OUTFIT:CHARACTER")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--table", type=Path)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    table, bands = head(COLUMNS), head(HELD)
    exits: dict[int, int] = {}
    for outfit, character in pairs(options.data):
        name = f"{outfit.stem}:{character.stem}"
        if options.only and name not in options.only:
            continue
        result = fit(
            outfit, character, options.out / f"{outfit.stem}_on_{character.stem}.usda", options.device
        )
        (options.out / f"{outfit.stem}_on_{character.stem}.json").write_text(json.dumps(result, indent=1))
        exits[result["exit"]] = exits.get(result["exit"], 0) + 1
        table += rows(outfit.stem, character.stem, result)
        bands += held(outfit.stem, character.stem, result)
        print(
            f"{name}: exit {result['exit']}, {result['wall']:.0f} s",
            *result.get("broken", []),
            sep="\n  ",
            flush=True,
        )
    summary = ", ".join(f"{count} exit {code}" for code, count in sorted(exits.items()))
    print(f"{sum(exits.values())} pairs: {summary}")
    if options.table:
        title = "# Every outfit on every character\n\nMade by `make pairs` (benches/all_pairs.py). "
        parts = [title + summary + ".", "\n".join(table), "## Held bands", "\n".join(bands)]
        options.table.write_text("\n\n".join(parts) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
