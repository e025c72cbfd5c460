#!/usr/bin/env python3
"""The transfer against the same method in warp.fem, in turn in one run.

    DRESSFORM_DATA=... DRESSFORM_PEERS=... transfer_speed.py MESHES.json [--pair OUTFIT/GARMENT:TARGET] [--runs 3]

DRESSFORM_PEERS holds `transfer_warpfem.py` and `from_usd.py`; PEERS_PYTHON is a Python that has their
packages. Both stop when the 99th percentile of the gap over all vertices of the body is below 2 mm (cells of
2 cm, beta 1e6). Prints medians of CPU seconds: the peer runs on one thread, ours, with default settings but
for the gap asked for, on one and on two. What it takes to go on to 0.5 mm is told apart.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
STOP, ON = 2e-3, 5e-4


def bench_program() -> str:
    """Builds the Rust benchmark and names its program."""
    command = ["cargo", "bench", "--bench", "transfer", "--no-run", "--locked", "--message-format=json"]
    out = subprocess.run(command, cwd=REPOSITORY, check=True, stdout=subprocess.PIPE, text=True).stdout
    messages = [json.loads(line) for line in out.splitlines() if line.startswith("{")]
    return next(m["executable"] for m in messages if m.get("target", {}).get("name") == "transfer")


def ours(program: str, meshes: Path, pair: str, threads: int) -> list[dict[str, Any]]:
    """The transfers to 2 and to 0.5 mm."""
    environment = os.environ | {
        "RAYON_NUM_THREADS": str(threads),
        "DRESSFORM_MESHES": str(meshes),
        "DRESSFORM_PAIR": pair,
        "DRESSFORM_GAPS": f"{STOP},{ON}",
    }
    command = [program, "speed"]
    out = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    return [json.loads(line) for line in out.stdout.splitlines()]


def peer(python: str, folder: Path, npz: Path) -> dict[str, Any]:
    script = folder / "transfer_warpfem.py"
    command = [python, str(script), str(npz), "--cell", "0.02", "--beta", "1e6", "--gap", str(STOP)]
    out = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    result: dict[str, Any] = json.loads(out.stdout.splitlines()[-1])
    return result


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("meshes", type=Path)
    parser.add_argument("--pair", default="casual_man/Tshirt:heavy_man")
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    data, peers = os.environ.get("DRESSFORM_DATA"), os.environ.get("DRESSFORM_PEERS")
    python = os.environ.get("PEERS_PYTHON", sys.executable)
    if not data or not peers:
        print("skipped: the transfer's peer (DRESSFORM_DATA and DRESSFORM_PEERS name no folders)")
        return 0
    if subprocess.run([python, "-c", "import warp"], check=False, stderr=subprocess.DEVNULL).returncode:
        print("skipped: the transfer's peer (PEERS_PYTHON has no warp)")
        return 0
    outfit, garment, target = options.pair.replace("/", ":").split(":")
    program = bench_program()
    with tempfile.TemporaryDirectory() as folder:
        npz = Path(folder) / "pair.npz"
        stages = [f"{data}/outfits/{outfit}.usda", f"{data}/characters/{target}.usdc"]
        subprocess.run(
            [sys.executable, f"{peers}/from_usd.py", *stages, str(npz), "--garment", garment],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        rounds = []
        for _ in range(options.runs):
            one = ours(program, options.meshes, options.pair, 1)
            theirs = peer(python, Path(peers), npz)
            two = ours(program, options.meshes, options.pair, 2)
            rounds.append((theirs, one, two))
            print(json.dumps([theirs["seconds_cpu"], one, two]), file=sys.stderr, flush=True)
    median = statistics.median
    peer_cpu = median(t["seconds_cpu"] for t, _, _ in rounds)
    peer_wall = median(t["seconds_total"] for t, _, _ in rounds)
    report: dict[str, Any] = {
        "pair": options.pair,
        "peer": {
            "seconds_cpu": peer_cpu,
            "seconds_wall": peer_wall,
            "gap_p99_m": rounds[0][0]["gap_max_p99_mean"][-1][1],
            "cg": rounds[0][0]["cg_total"],
            "converged": rounds[0][0]["converged"],
        },
    }
    for k, gap in enumerate(("to 2 mm", "to 0.5 mm")):
        for name, index in (("one thread", 1), ("two threads", 2)):
            runs = [r[index][k] for r in rounds]
            cpu, wall = (median(r[key] for r in runs) for key in ("seconds_cpu", "seconds_wall"))
            report[f"{gap}, {name}"] = runs[0] | {
                "seconds_cpu": cpu,
                "seconds_wall": wall,
                "peer_over_ours_cpu": peer_cpu / cpu,
                "peer_over_ours_wall": peer_wall / wall,
            }
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
