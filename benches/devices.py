#!/usr/bin/env python3
"""The same fits on the CPU and on a GPU: seconds of every stage, and how far apart they end.

    devices.py DATA [--gpu NAME] [--pairs casual_man:heavy_man ...] [--rounds 2]

Each fit is a process of its own, so that no flow is taken from a fit before it; a GPU's fit compiles
its shaders. Prints one JSON object a fit, then a table in Markdown: wall seconds by stage, the
garments' mean and largest distance from the CPU's.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import dressform
import numpy as np
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit

#: A drape that does nothing.
STILL = {"frames": 0, "push_steps": 0, "settle": False}
#: Name to settings: the whole fit; the transfer alone, also with fine cells.
ROWS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "transfer alone, cells of 2 cm": {"drape": STILL},
    "transfer alone, cells of 1 cm": {"transfer": {"cell": 0.01}, "drape": STILL},
}


def one(data: Path, pair: str, device: str, row: str, out: Path) -> None:
    """One fit in this process; its points go to `out`."""
    outfit_name, character_name = pair.split(":")
    outfit = read_outfit(data / f"outfits/{outfit_name}.usda")
    character, _ = read_character(data / f"characters/{character_name}.usdc")
    settings = json.dumps(ROWS[row] | {"posed": {"enabled": False}})
    start = time.perf_counter()
    result = dressform.fit_arrays(outfit, character, settings, device)
    wall = time.perf_counter() - start
    points = {g.name: r.points for g, r in zip(outfit.garments, result.garments, strict=True)}
    np.savez(out, **points)
    seconds = {stage: round(took, 3) for stage, took in result.report["seconds"].items()}
    print(json.dumps({"device": result.report["device"], "wall": round(wall, 3), "seconds": seconds}))


def run(options: argparse.Namespace, pair: str, device: str, row: str, out: Path) -> dict:
    command = [sys.executable, __file__, str(options.data), "--one", pair, device, row, str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{pair} on {device}: {done.stderr.strip()[-2000:]}")
    found = json.loads(done.stdout.splitlines()[-1])
    print(json.dumps({"pair": pair, "row": row, **found}), file=sys.stderr, flush=True)
    return found


def apart(a: Path, b: Path) -> dict[str, float]:
    with np.load(a) as first, np.load(b) as second:
        gaps = np.concatenate([np.linalg.norm(first[n] - second[n], axis=1) for n in first.files])
    return {"mean_mm": float(gaps.mean() * 1e3), "max_mm": float(gaps.max() * 1e3)}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--gpu", default="gpu")
    parser.add_argument("--pairs", nargs="+", default=["casual_man:heavy_man", "casual_woman:thin_woman"])
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=list(ROWS))
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--scratch", type=Path, default=Path("out/devices"))
    parser.add_argument("--one", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        pair, device, row, out = options.one
        one(options.data, pair, device, row, Path(out))
        return 0
    options.scratch.mkdir(parents=True, exist_ok=True)
    lines = []
    for pair in options.pairs:
        for row in options.rows:
            files = {d: options.scratch / f"{d}.npz" for d in ("cpu", "gpu")}
            names = {"cpu": "cpu", "gpu": options.gpu}
            for _ in range(options.rounds):
                found = {d: run(options, pair, names[d], row, files[d]) for d in files}
                gap = apart(files["cpu"], files["gpu"])
                for d, got in found.items():
                    s = got["seconds"]
                    distance = f"{gap['mean_mm']:.2g} / {gap['max_mm']:.2g}" if d == "gpu" else ""
                    lines.append(
                        f"| {pair.replace(':', ' on ')} | {row} | {got['device']['name']} | {got['wall']:.2f}"
                        f" | {s.get('transfer', 0):.2f} | {s.get('drape', 0):.2f} | {distance} |"
                    )
    print("| pair | settings | device | wall s | transfer s | drape s | apart: mean / largest mm |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
