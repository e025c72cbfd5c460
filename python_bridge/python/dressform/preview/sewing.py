"""Borders of panels, and which of them are sewn to which."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..model import GarmentSource

#: 2D positions closer than this are one vertex of a panel [m].
SAME = 1e-6


@dataclass
class Run:
    """A line of border edges of one panel, all sewn to the same thing or to nothing."""

    panel: int
    #: Triangle and corner of each vertex along the line, shape [k, 2].
    corners: NDArray[np.int64]
    #: Number of the sewn chain, the same on both sides; -1 where nothing is sewn.
    chain: int = -1


@dataclass
class _Edge:
    panel: int
    #: Panel vertices (numbered over the garment), in the triangle's orientation.
    vertices: tuple[int, int]
    #: The seam groups of the two, smaller first.
    groups: tuple[int, int]
    partners: tuple[int, ...] = field(default=())


def borders(garment: GarmentSource) -> list[Run]:
    """The border of every panel in lines; a dart or a slit is a border too."""
    vertex_of_corner, corner_of_vertex = _vertices(garment)
    edges = _edges(garment, vertex_of_corner)
    uses = defaultdict(list)
    for e, edge in enumerate(edges):
        uses[edge.groups].append(e)
    for e, edge in enumerate(edges):
        # Sewn to the panels that have this edge as well, or to its own other side.
        edge.partners = tuple(sorted(edges[o].panel for o in uses[edge.groups] if o != e))
    numbers = _chains(edges)
    return [Run(p, corner_of_vertex[v], n) for p, v, n in _lines(edges, numbers)]


def _vertices(garment: GarmentSource) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertex of each triangle corner (distinct in 3D, panel or 2D), and a corner of each."""
    flat = np.round(garment.corner_pattern / SAME).astype(np.int64)
    panel = np.repeat(garment.panel_of_triangle.astype(np.int64), 3)
    key = np.column_stack([garment.triangles.reshape(-1).astype(np.int64), panel, flat.reshape(-1, 2)])
    _, first, vertex = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return vertex.reshape(-1, 3), np.column_stack([first // 3, first % 3]).astype(np.int64)


def seam_groups(garment: GarmentSource) -> NDArray[np.int64]:
    """The group of points that seams without offset tie each point to, shape [n]."""
    parent = list(range(len(garment.points)))

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    for seam in garment.seams:
        for pair in [] if seam.offset else seam.pairs.tolist():
            low, high = sorted(root(point) for point in pair)
            parent[high] = low
    return np.array([root(i) for i in range(len(parent))], dtype=np.int64)


def _edges(garment: GarmentSource, vertex_of_corner: NDArray[np.int64]) -> list[_Edge]:
    count: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for t, v in enumerate(vertex_of_corner.tolist()):
        for k in range(3):
            a, b = v[k], v[(k + 1) % 3]
            count[min(a, b), max(a, b)].append((t, k))
    groups = seam_groups(garment)
    edges = []
    for uses in count.values():
        if len(uses) == 1:
            t, k = uses[0]
            ends = [int(groups[garment.triangles[t, j]]) for j in (k, (k + 1) % 3)]
            vertices = (int(vertex_of_corner[t, k]), int(vertex_of_corner[t, (k + 1) % 3]))
            edges.append(_Edge(int(garment.panel_of_triangle[t]), vertices, (min(ends), max(ends))))
    return edges


def _chains(edges: list[_Edge]) -> list[int]:
    """The chain of each edge: edges in touch that are sewn between the same panels."""
    kind = [tuple(sorted((e.panel, *e.partners))) if e.partners else () for e in edges]
    touching = defaultdict(list)
    for e, edge in enumerate(edges):
        for group in edge.groups:
            touching[group, kind[e]].append(e)
    numbers, count = [-1] * len(edges), 0
    for start in range(len(edges)):
        if not kind[start] or numbers[start] >= 0:
            continue
        stack = [start]
        while stack:
            e = stack.pop()
            if numbers[e] < 0:
                numbers[e] = count
                stack += [o for g in edges[e].groups for o in touching[g, kind[e]] if numbers[o] < 0]
        count += 1
    return numbers


def _lines(edges: list[_Edge], numbers: list[int]) -> list[tuple[int, list[int], int]]:
    """Panel, vertices in order and chain of each line of edges with one number."""
    after: dict[int, list[int]] = defaultdict(list)
    before: dict[int, list[int]] = defaultdict(list)
    for e, edge in enumerate(edges):
        after[edge.vertices[0]].append(e)
        before[edge.vertices[1]].append(e)

    def follows(e: int) -> int | None:
        ahead = after[edges[e].vertices[1]]
        one = len(ahead) == 1 and len(before[edges[e].vertices[1]]) == 1
        return ahead[0] if one and numbers[ahead[0]] == numbers[e] else None

    followed = {f for f in map(follows, range(len(edges))) if f is not None}
    done = [False] * len(edges)
    lines = []
    # Lines with a start first; what is left goes round.
    for start in [e for e in range(len(edges)) if e not in followed] + list(range(len(edges))):
        if done[start]:
            continue
        line, e = [edges[start].vertices[0]], start
        while e is not None and not done[e]:
            done[e] = True
            line.append(edges[e].vertices[1])
            e = follows(e)  # type: ignore[assignment]
        lines.append((edges[start].panel, line, numbers[start]))
    return lines
