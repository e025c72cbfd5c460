"""Panels: from GeomSubsets of family `pattern`, the rest from connected 2D islands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from ..model import PANEL_ROLES, Floats, Indices, MeshOrigin, Panel
from .fabric import read_fabric
from .graph import components, numbered
from .marks import panel_subsets
from .stage import Source

#: Two panel coordinates of one point closer than this are one corner [m], as in the core.
SAME_PATTERN_POINT = 1e-6


def read_panels(
    source: Source, prim: Usd.Prim, origin: MeshOrigin, uv: Floats
) -> tuple[list[Panel], Indices]:
    """Panels in subset order, then islands, and the panel of each triangle."""
    panel_of_face = np.full(len(origin.face_vertex_counts), -1, dtype=np.int64)
    panels: list[Panel] = []
    for subset in panel_subsets(prim):
        faces = _faces_of(source, subset, len(panel_of_face))
        if len(faces) == 0:
            source.note("the panel has no faces and was left out", subset.GetPrim())
            continue
        taken = np.flatnonzero(panel_of_face[faces] >= 0)
        if len(taken):
            face = faces[taken[0]]
            other = panels[panel_of_face[face]].name
            message = f"face {face} is in panel {other!r} too: panels must not overlap"
            raise source.bad(message, subset.GetPrim(), "indices", taken[0])
        panel_of_face[faces] = len(panels)
        panels.append(_panel(source, subset.GetPrim()))
    panel_of_triangle = panel_of_face[origin.face_of_triangle]
    loose = np.flatnonzero(panel_of_triangle < 0)
    if len(loose):
        islands = islands_of(origin, uv, loose)
        if panels:
            message = f"{len(loose)} triangles are in no panel: grouped into {islands.max() + 1} islands"
            source.note(message, prim)
        panel_of_triangle[loose] = len(panels) + islands
        fabric = read_fabric(source, prim)
        panels += [Panel(f"island_{i}", fabric=fabric) for i in range(int(islands.max()) + 1)]
    return panels, panel_of_triangle.astype(np.uint32)


def islands_of(origin: MeshOrigin, uv: Floats, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Island of each given triangle: joined where they share a point at one 2D position."""
    points = origin.face_vertex_indices[origin.corner_of_triangle[triangles]]
    cell = np.round(uv[triangles] / SAME_PATTERN_POINT).astype(np.int64)
    key = np.concatenate([points[..., None], cell], axis=2).reshape(-1, 3)
    _, vertex = np.unique(key, axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    joined = np.concatenate([vertex[:, :2], vertex[:, 1:]])
    label = components(int(vertex.max()) + 1, joined)
    return numbered(label[vertex[:, 0]])


def mark_mirrored(
    source: Source, prim: Usd.Prim, panels: list[Panel], panel_of_triangle: Indices, uv: Floats
) -> None:
    """Marks panels whose triangles run clockwise in the plane: the stage shows their inside."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    total = np.bincount(panel_of_triangle, weights=area, minlength=len(panels))
    against = area * np.sign(total)[panel_of_triangle] < 0.0
    for i, panel in enumerate(panels):
        panel.mirrored = bool(total[i] < 0.0)
        if panel.mirrored:
            source.note(f"panel {panel.name!r} is seen from inside: it was mirrored", prim)
        flipped = int((against & (panel_of_triangle == i)).sum())
        if flipped:
            source.note(f"panel {panel.name!r} has {flipped} flipped triangles", prim)


def _faces_of(source: Source, subset: UsdGeom.Subset, face_count: int) -> NDArray[np.int64]:
    prim = subset.GetPrim()
    faces = np.array(source.value(subset.GetIndicesAttr()) or [], dtype=np.int64)
    out = np.flatnonzero((faces < 0) | (faces >= face_count))
    if len(out):
        message = f"names face {faces[out[0]]}, but there are {face_count}"
        raise source.bad(message, prim, "indices", out[0])
    order = np.argsort(faces, kind="stable")
    twice = np.flatnonzero(np.diff(faces[order]) == 0)
    if len(twice):
        source.note(f"face {faces[order[twice[0]]]} is listed twice", prim)
        _, first = np.unique(faces, return_index=True)
        faces = faces[np.sort(first)]
    return faces


def _panel(source: Source, prim: Usd.Prim) -> Panel:
    label = prim.GetAttribute("garment:panel:label").Get()
    angle = prim.GetAttribute("garment:panel:grainAngle").Get()
    if angle is not None and not np.isfinite(angle):
        raise source.bad(f"the angle is {angle}", prim, "garment:panel:grainAngle")
    role = str(prim.GetAttribute("garment:panel:role").Get() or "auto")
    if role not in PANEL_ROLES:
        message = f"the role is {role!r}; it must be one of {', '.join(PANEL_ROLES)}"
        raise source.bad(message, prim, "garment:panel:role")
    return Panel(
        name=prim.GetName(),
        label="" if label is None else str(label),
        role=role,
        fabric=read_fabric(source, prim),
        grain_angle=0.0 if angle is None else float(angle),
    )
