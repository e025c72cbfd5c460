#!/usr/bin/env python3
"""The draper against newton's style3d: CPU seconds until a skirt hangs still.

    drape.py [--sizes s m l] [--substeps N] [--frames N]

`DRESSFORM_PEERS` names the folder of the peers' scripts and of `inputs/` with skirt_s.npz,
skirt_m.npz and skirt_l.npz (2.3k, 8.9k and 24.7k welded vertices); `DRESSFORM_PEERS_PYTHON` the
interpreter that has what they need. Both solvers start from the same vertices, with the same mass,
nominal stiffness, friction and self-contact, on one thread, in turn. Each is judged against its own
state of rest: the CPU time after which 99% of the vertices stay within a millimetre of where they
end. The body is the fixtures' wide one: on the other the skirt's waist slides over the hips and
nothing ever comes to rest. The peer keeps its velocities (with the paper's damping it would creep for minutes) and ends
when no vertex has moved by a millimetre in twelve frames, or after --frames.

Needs numpy and scipy in this interpreter (`make bench` provides them) and cargo. Prints one JSON
object a size, with the ratio of ours to the peer's.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]

#: The peer's cloth, see `add_cloth_mesh` in its script.
FABRIC = {
    "name": "peer",
    "density": 0.2,
    "stretch_warp": 100.0,
    "stretch_weft": 100.0,
    "shear": 10.0,
    "bending_warp": 2.0e-5,
    "bending_weft": 1.0e-5,
    "bending_shear": 5.0e-6,
    "friction": 0.2,
    "thickness": 5.0e-4,
}
#: The settling phase alone, with the peer's contact distances.
SETTINGS = {"frames": 0, "settle_steps": 60, "settle": True, "body_distance": 3e-3, "self_distance": 2e-3}
#: A vertex this close to its place at the end has arrived [m].
ARRIVED = 1e-3


def panels(triangles: np.ndarray, count: int) -> np.ndarray:
    """The panel of each vertex: its connected component."""
    label = np.arange(count)
    while True:
        least = label[triangles].min(1)
        new = label.copy()
        for k in range(3):
            np.minimum.at(new, triangles[:, k], least)
        if (new == label).all():
            return np.unique(label, return_inverse=True)[1]
        label = new


def write_case(npz: Path, path: Path) -> None:
    """A fixture as a case of benches/drape.rs."""
    data = np.load(npz)
    triangles = data["garment_f"]
    panel = panels(triangles, len(data["garment_v"]))[triangles[:, 0]]
    source = {
        "name": npz.stem,
        "path": f"/{npz.stem}",
        "layer": 0,
        "body": 0,
        "mesh": {"points": data["garment_v"].tolist(), "triangles": triangles.tolist()},
        "corner_pattern": data["panel_v"][triangles].tolist(),
        "panel_of_triangle": panel.tolist(),
        "panels": [{"name": f"panel{i}", "label": "skirt", "fabric": FABRIC} for i in range(panel.max() + 1)],
        "seams": [{"name": "side", "pairs": data["seams"].tolist(), "offset": False}],
        "joints": [],
    }
    body = {"points": data["target_v"].tolist(), "triangles": data["body_f"].tolist()}
    path.write_text(json.dumps({"source": source, "colliders": [body]}))


def ours(case: Path, folder: Path) -> dict[str, Any]:
    """One drape on one thread."""
    settings = folder / "settings.json"
    settings.write_text(json.dumps(SETTINGS))
    command = ["cargo", "test", "--release", "--workspace", "--bench", "drape", "--", case, settings]
    done = subprocess.run(
        command,
        cwd=REPOSITORY,
        env={**os.environ, "RAYON_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(done.stderr[-2000:])
    result: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return result


def theirs(npz: Path, folder: Path, frames: int, substeps: int) -> dict[str, Any]:
    """The peer, frame by frame."""
    python = os.environ.get("DRESSFORM_PEERS_PYTHON", sys.executable)
    out = folder / "peer.npz"
    script = npz.parents[1] / "drape_newton.py"
    command = [python, REPOSITORY / "benches/peer_frames.py", script, out, "1.0", npz]
    command += [
        "--body",
        "target",
        "--solver",
        "style3d",
        "--keep-velocity",
        "--frames",
        frames,
        "--substeps",
        substeps,
    ]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if not out.exists():
        raise SystemExit(done.stderr[-2000:])
    data = np.load(out)
    apart = np.percentile(np.linalg.norm(data["frames"] - data["frames"][-1], axis=2), 99, axis=1)
    late = np.flatnonzero(apart > ARRIVED)
    first = min(late[-1] + 1, len(apart) - 1) if len(late) else 0
    return {
        "arrived_cpu_s": float(data["cpu"][first]),
        "frames": len(apart) - 1,
        "still": "still" in done.stderr,
    }


def main() -> None:
    """Prints a line for each size."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", default=["s", "m", "l"])
    parser.add_argument("--substeps", type=int, default=10)
    parser.add_argument("--frames", type=int, default=150)
    arguments = parser.parse_args()
    peers = os.environ.get("DRESSFORM_PEERS")
    if not peers:
        print("skipped: DRESSFORM_PEERS names no folder")
        return
    for size in arguments.sizes:
        npz = Path(peers) / "inputs" / f"skirt_{size}.npz"
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_case(npz, folder / "case.json")
            mine = ours(folder / "case.json", folder)
            peer = theirs(npz, folder, arguments.frames, arguments.substeps)
        line = {
            "skirt": size,
            "nodes": mine["nodes"],
            "ours_cpu_s": mine["arrived_cpu_s"],
            "ours_total_cpu_s": mine["cpu_s"],
            "at_rest": mine["drape"]["at_rest"],
            "converged": mine["drape"]["converged"],
            "peer_cpu_s": peer["arrived_cpu_s"],
            "peer_frames": peer["frames"],
            "peer_still": peer["still"],
            "ratio": round(mine["arrived_cpu_s"] / peer["arrived_cpu_s"], 3),
        }
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
