"""What a garment's mesh may have that cloth does not: told, not repaired."""

from __future__ import annotations

import numpy as np
from pxr import Usd

from ..model import Indices
from .stage import Source


def note_topology(source: Source, prim: Usd.Prim, point_count: int, triangles: Indices) -> None:
    """Notes duplicate triangles, edges of more than two and loose points."""
    tri = triangles.astype(np.int64)
    _, times = np.unique(np.sort(tri, axis=1), axis=0, return_counts=True)
    if (times > 1).any():
        source.note(f"{int((times - 1).sum())} triangles are there more than once", prim)
    directed = np.concatenate([tri[:, [0, 1]], tri[:, [1, 2]], tri[:, [2, 0]]])
    edges, shared = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    if (shared > 2).any():
        a, b = edges[int(np.argmax(shared))]
        count = int((shared > 2).sum())
        source.note(f"{count} edges have more than two triangles (points {a} and {b})", prim)
    loose = np.setdiff1d(np.arange(point_count), tri)
    if len(loose):
        source.note(f"{len(loose)} points are in no face and stay where they are (point {loose[0]})", prim)
