#!/usr/bin/env python3
"""Skin weights against libigl's nearest point and against weight inpainting [Abdrashitov 2023].

    RAYON_NUM_THREADS=1 DRESSFORM_PEERS=FOLDER [DRESSFORM_DATA=FOLDER] rig.py

The stage is measured without its refinement against poses, which the peers have not; where the
body can be posed, a row says what that makes of it. Every input goes to ours and, in the same run, to ``rig_igl.py`` of DRESSFORM_PEERS (run by
DRESSFORM_PEERS_PYTHON, or the ``venv`` in that folder): the same body, cloth, seams and joints, none
ignored. Prints a table: CPU seconds of the search (with and without building the body's hierarchy)
and of the whole stage, largest L1 jump of weights along an edge, seam mismatch, error of the sums.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from dressform import rigging
from dressform.model import Character, Floats

REPEAT = 5
SETTINGS = {"ignore": [], "refine": 0}
REFINED = {"ignore": []}
#: The peers' own fixtures: name, arguments of make_inputs.py.
MADE = {
    "shirt 12k": ("--garment", "shirt", "--body-edge", "0.014", "--cloth-edge", "0.010"),
    "shirt 34k": ("--garment", "shirt", "--body-edge", "0.014", "--cloth-edge", "0.006"),
}
COLUMNS = ("search s", "+ tree s", "stage s", "jump", "seams", "sums")

Input = dict[str, Any]
Result = TypeVar("Result")


def peer_python(peers: Path) -> str:
    """The interpreter that has libigl."""
    own = peers / "venv/bin/python"
    return os.environ.get("DRESSFORM_PEERS_PYTHON") or (str(own) if own.exists() else sys.executable)


def run_peer(peers: Path, script: str, *arguments: str) -> str:
    """What a peer's script prints."""
    command = [peer_python(peers), str(peers / script), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def inputs(peers: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """Name and npz of each input."""
    for name, arguments in MADE.items():
        path = folder / f"{name}.npz"
        run_peer(peers, "make_inputs.py", str(path), *arguments)
        yield name, path
    for path in sorted((peers / "inputs").glob("*.npz")):
        yield path.stem, path
    if data := os.environ.get("DRESSFORM_DATA"):
        yield from garments(Path(data), folder)
    else:
        print("skipped: the real garments (DRESSFORM_DATA names no folder)")


def garments(data: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """The garments of the data on their source bodies, with details left out."""
    from dressform.usd.garment import read_outfit

    for file in sorted((data / "outfits").glob("*.usda")):
        outfit = read_outfit(file)
        for garment in outfit.garments:
            body = outfit.bodies[garment.body]
            kept = [garment.panels[p].label != "pocket" for p in garment.panel_of_triangle]
            used, triangles = np.unique(garment.triangles[np.array(kept)], return_inverse=True)
            new = np.full(len(garment.points), -1)
            new[used] = np.arange(len(used))
            none = [np.zeros((0, 2), dtype=np.int64)]
            seams = new[np.concatenate(none + [s.pairs for s in garment.seams if not s.offset])]
            path = folder / f"{file.stem} {garment.name}.npz"
            np.savez(
                path,
                source_v=body.points,
                body_f=body.triangles.astype(np.int32),
                weights=dense(body),
                garment_v=garment.points[used],
                garment_f=triangles.reshape(-1, 3).astype(np.int32),
                seams=seams.astype(np.int64),
                parents=np.array(body.joint_parents),
                names=np.array(body.joints),
                centers=body.world_from_joint[:, :3, 3],
            )
            yield path.stem, path


def dense(body: Character) -> Floats:
    """The body's weights over all joints, shape [points, joints]."""
    shape = (len(body.points), body.skin_influences)
    return rigging.Rigged(
        shape[1], body.joint_indices.reshape(shape), body.joint_weights.reshape(shape), {}
    ).dense(len(body.joints))


def character(data: Input) -> Character:
    """The body; where the fixture has no skeleton, each joint is in the middle of its points."""
    weights = data["weights"] / data["weights"].sum(axis=1, keepdims=True)
    count = weights.shape[1]
    middle = (weights.T @ data["source_v"]) / np.maximum(weights.sum(axis=0), 1e-9)[:, None]
    most = int((weights > 0.0).sum(axis=1).max())
    order = np.argsort(-weights, axis=1)[:, :most]
    frames = np.tile(np.eye(4), (count, 1, 1))
    frames[:, :3, 3] = data.get("centers", middle)
    return Character(
        name="body",
        path="/Body",
        points=data["source_v"],
        triangles=data["body_f"].astype(np.uint32),
        skin_influences=most,
        joint_indices=order.ravel().astype(np.uint32),
        joint_weights=np.take_along_axis(weights, order, axis=1).ravel(),
        joints=[str(name) for name in data.get("names", [f"joint{i}" for i in range(count)])],
        joint_parents=[int(p) for p in data.get("parents", np.full(count, -1))],
        world_from_joint=frames,
    )


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """The last result and the median of the CPU seconds."""
    seconds = []
    for _ in range(REPEAT):
        before = time.process_time()
        result = work()
        seconds.append(time.process_time() - before)
    return result, statistics.median(seconds)


def ours(data: Input, rig: dict[str, Any]) -> dict[str, float]:
    """Our figures, by the names of :data:`COLUMNS`."""
    settings = json.dumps({"rig": rig})
    body = character(data)
    cloth = (data["garment_v"], data["garment_f"], data.get("seams"))
    prepared, tree = timed(lambda: rigging.prepare_body(body))
    _, search = timed(lambda: rigging.match_arrays(prepared, *cloth, settings))
    rigged, stage = timed(lambda: rigging.rig_arrays(prepared, *cloth, settings))
    weights = rigged.dense(len(body.joints))
    tri = data["garment_f"]
    edges = np.concatenate([tri[:, [0, 1]], tri[:, [1, 2]], tri[:, [2, 0]]])
    pairs = data.get("seams", np.zeros((0, 2), dtype=np.int64))
    across = np.abs(weights[pairs[:, 0]] - weights[pairs[:, 1]]).sum(axis=1)
    jump = np.abs(weights[edges[:, 0]] - weights[edges[:, 1]]).sum(axis=1).max()
    sums = np.abs(weights.sum(axis=1) - 1.0).max()
    figures = (search, search + tree, stage + tree, jump, across.max(initial=0.0), sums)
    return dict(zip(COLUMNS, map(float, figures), strict=True))


def peer_rows(report: dict[str, Any]) -> dict[str, dict[str, float]]:
    """The peers' figures, by the names of :data:`COLUMNS`."""
    rows = {}
    for name, key in (("nearest (libigl)", "nearest"), ("inpainting", "inpaint")):
        peer = report[key]
        seconds = peer["seconds_cpu"]
        search = seconds if key == "nearest" else float("nan")
        figures = (float("nan"), search, seconds, peer["edge_jump_max"])
        more = (peer.get("seam_mismatch_max", 0.0), peer["sum_error"])
        rows[name] = dict(zip(COLUMNS, figures + more, strict=True))
    return rows


def main() -> None:
    """Prints the table."""
    folder = os.environ.get("DRESSFORM_PEERS")
    if not folder:
        print("skipped: skin weights against their peers (DRESSFORM_PEERS names no folder)")
        return
    peers = Path(folder)
    print("| input | vertices | | " + " | ".join(COLUMNS) + " |")
    print("| --- " * (len(COLUMNS) + 3) + "|")
    with tempfile.TemporaryDirectory() as temporary:
        for name, path in inputs(peers, Path(temporary)):
            data = dict(np.load(path))
            report = json.loads(run_peer(peers, "rig_igl.py", str(path)).splitlines()[-1])
            rows = {"ours": ours(data, SETTINGS)}
            if "names" in data:
                rows["ours, refined"] = ours(data, REFINED)
            for who, row in {**rows, **peer_rows(report)}.items():
                figures = " | ".join("" if np.isnan(v) else f"{v:.3g}" for v in row.values())
                print(f"| {name} | {len(data['garment_v'])} | {who} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
