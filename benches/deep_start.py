#!/usr/bin/env python3
"""A shirt that starts up to 97 mm deep in its body: ours against newton's style3d, in turn.

    deep_start.py [--frames 6] [--rounds 1] [--keep FOLDER]

The shirt is as it sits on the source body, the body is the grown target (`inputs/shirt_s.npz` of the
peers). Both have the same mass and nominal stiffness and run on one thread; times are process CPU
seconds of the drape alone. Both results go through the peers' judges.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import dressform
import numpy as np
from fixtures import fabric, garment, peer, peers


def ours(arrays: dict[str, np.ndarray], frames: int, out: Path) -> dict:
    """Drapes the fixture; what it took and whether it converged."""
    shirt = garment(arrays, fabric(0.2, 100.0, 10.0, 1e-5), "shirt")
    started = time.process_time()
    draped = dressform.drape_arrays(
        shirt,
        colliders=[(arrays["target_v"].astype(float), arrays["body_f"].astype(np.uint32))],
        settings={"drape": {"frames": frames, "settle": False}},
        device="cpu",
    )
    seconds = time.process_time() - started
    np.savez_compressed(out, garment_v=draped.points, garment_f=arrays["garment_f"])
    return {"cpu_s": seconds, **draped.info}


def edge_stretch(before: np.ndarray, after: np.ndarray, triangles: np.ndarray) -> float:
    """99th percentile of edge length over edge length before, as the peer has it."""
    edges = np.unique(np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), 1), axis=0)  # fmt: skip
    length = lambda x: np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1)  # noqa: E731
    return float(np.percentile(length(after) / length(before), 99))


def judged(fixture: Path, out: Path) -> dict:
    """What the peers' judges say of a draped shirt."""
    found = peer("judges.py", fixture, "--garment", out, "--body", "target", "--exact")
    arrays, draped = np.load(fixture), np.load(out)
    return {
        "inside": found["penetration"]["vertices"],
        "body_pairs": found["garment_body"]["pairs"],
        "self_pairs": found["garment_self"]["pairs"],
        "ipctk": found["garment_body"]["ipctk_has"] or found["garment_self"]["ipctk_has"],
        "edge_stretch_p99": edge_stretch(
            arrays["garment_v"].astype(float), draped["garment_v"], arrays["garment_f"]
        ),
    }


def main() -> None:
    """One line a run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--alone", action="store_true", help="leave the peer out")
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    fixture = peers() / "inputs" / "shirt_s.npz"
    arrays = dict(np.load(fixture))
    folder = options.keep or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    for _ in range(options.rounds):
        mine = ours(arrays, options.frames, folder / "ours.npz")
        print("ours", json.dumps({**mine, **judged(fixture, folder / "ours.npz")}), flush=True)
        if options.alone:
            continue
        out = folder / "peer.npz"
        rival = peer("drape_newton.py", fixture, "--body", "target", "--solver", "style3d",
                     "--frames", options.frames, "--out", out)  # fmt: skip
        seconds = rival["seconds_cpu_frame_median"] * options.frames
        print("peer", json.dumps({"cpu_s": seconds, **judged(fixture, out)}), flush=True)
        print(f"ours / peer: {mine['cpu_s'] / seconds:.2f} of the CPU time")


if __name__ == "__main__":
    main()
