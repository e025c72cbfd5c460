"""The peers' fixtures as our data classes, their scripts as functions.

`DRESSFORM_PEERS` names the folder of the peers' scripts and `inputs/`; `DRESSFORM_PEERS_PYTHON` the
interpreter that has what they need (this one by default).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from dressform.model import AuthoredSeam, Fabric, GarmentSource, Panel


def peers() -> Path:
    """The folder of the peers; leaves the program visibly where there is none."""
    folder = os.environ.get("DRESSFORM_PEERS")
    if not folder:
        print("skipped: DRESSFORM_PEERS names no folder")
        raise SystemExit(0)
    return Path(folder)


def peer(script: str, *arguments: Any) -> dict[str, Any]:
    """Runs a peer's script; the JSON object that it prints last."""
    python = os.environ.get("DRESSFORM_PEERS_PYTHON", sys.executable)
    command = [python, str(peers() / script), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{script}: {done.stderr[-2000:]}")
    result: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return result


def fabric(density: float, stretch: float, shear: float, bending: float) -> Fabric:
    """An isotropic fabric in the peers' figures (SI)."""
    values = {
        "density": density,
        "stretch_warp": stretch,
        "stretch_weft": stretch,
        "shear": shear,
        "bending_warp": bending,
        "bending_weft": bending,
        "bending_shear": bending,
        "friction": 0.2,
        "thickness": 5e-4,
    }
    return Fabric(values=values)


def flat_copies(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Each triangle laid flat by itself, warp towards Y where it can be; shape [t, 3, 2]."""
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    up = np.where(np.abs(normal[:, 1:2]) < 0.99, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    warp = up - normal * (up * normal).sum(1, keepdims=True)
    warp /= np.linalg.norm(warp, axis=1, keepdims=True)
    axes = np.stack([warp, np.cross(normal, warp)], axis=2)
    return np.einsum("tkc,tca->tka", corners - corners[:, :1], axes)


def garment(arrays: dict[str, np.ndarray], cloth: Fabric, name: str = "garment") -> GarmentSource:
    """A fixture's garment: one panel for all, or its own panels where it has them."""
    points, triangles = arrays["garment_v"].astype(float), arrays["garment_f"].astype(np.uint32)
    if "panel_v" in arrays:
        corners = arrays["panel_v"].astype(float)[triangles]
    else:
        corners = flat_copies(points, triangles)
    seams = []
    if len(arrays.get("seams", ())):
        seams = [AuthoredSeam(name="seams", pairs=arrays["seams"].astype(np.uint32))]
    return GarmentSource(
        name=name,
        path=f"/{name}",
        layer=0,
        body=0,
        points=points,
        triangles=triangles,
        corner_pattern=corners,
        panel_of_triangle=np.zeros(len(triangles), dtype=np.uint32),
        panels=[Panel(name="panel", fabric=cloth)],
        seams=seams,
    )
