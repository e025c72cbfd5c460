"""Panels drawn flat: the refitted pattern over the source pattern, seams in colour."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import NotInstalled
from ..model import Floats, GarmentSource
from .scene import panel_color

#: Space between panels [m].
GAP = 0.04
#: Width of the drawing [inches].
PAGE_WIDTH = 12.0
#: Room below a panel for its label [m].
LABEL = 0.07
BACKGROUND = "#faf9f6"
INK = "#3a3a3a"
#: 2D positions closer than this are one vertex of a panel [m].
SAME = 1e-6


@dataclass
class Outline:
    """Border edges of a panel."""

    #: Corner coordinates, u to the right and grain up [m], shape [e, 2, 2].
    edges: Floats
    #: The 3D points of each edge, smaller index first, shape [e, 2].
    points: NDArray[np.int64]
    #: Triangle corners that the edges start at: the same border in another pattern, shape [e, 2, 2].
    corners: NDArray[np.int64]


def outlines(garment: GarmentSource) -> list[Outline]:
    """The border of each panel; a dart or a slit is a border too."""
    flat = _uv(garment.corner_pattern)
    found = []
    for panel in range(len(garment.panels)):
        triangles = np.flatnonzero(garment.panel_of_triangle == panel)
        count: dict[Any, list[tuple[int, int, int]]] = defaultdict(list)
        keys = np.round(flat[triangles] / SAME).astype(np.int64)
        for t, key in zip(triangles, keys, strict=True):
            for k in range(3):
                a = (int(garment.triangles[t, k]), *map(int, key[k]))
                b = (int(garment.triangles[t, (k + 1) % 3]), *map(int, key[(k + 1) % 3]))
                count[min(a, b), max(a, b)].append((int(t), k, (k + 1) % 3))
        border = [uses[0] for uses in count.values() if len(uses) == 1]
        corners = np.array([[[t, a], [t, b]] for t, a, b in border], dtype=np.int64).reshape(-1, 2, 2)
        points = np.sort(garment.triangles[corners[..., 0], corners[..., 1]].astype(np.int64), axis=1)
        found.append(Outline(flat[corners[..., 0], corners[..., 1]], points, corners))
    return found


def draw_patterns(
    garments: Sequence[GarmentSource],
    output: str | os.PathLike[str],
    *,
    sources: Sequence[GarmentSource] | None = None,
) -> Path:
    """Writes a drawing (SVG, PNG or PDF by the ending), true to scale between panels.

    Args:
        garments: garments with the pattern to draw, filled.
        output: the file.
        sources: the same garments with their source pattern, drawn as a dashed outline.

    Raises:
        NotInstalled: matplotlib is missing.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise NotInstalled("previews need matplotlib: pip install 'dressform[preview]'") from error
    figure = Figure(facecolor=BACKGROUND)
    rows = figure.subplots(len(garments), 1, squeeze=False)[:, 0]
    sizes = [_garment(rows[g], g, m, None if sources is None else sources[g]) for g, m in enumerate(garments)]
    _fit_page(figure, list(rows), np.array(sizes))
    path = Path(output)
    path.parent.mkdir(parents=True, exist_ok=True)
    extra: dict[str, Any] = {"metadata": {"Date": None}} if path.suffix == ".svg" else {}
    figure.savefig(path, dpi=110, facecolor=BACKGROUND, **extra)
    return path


def _fit_page(figure: Any, rows: list[Any], sizes: Floats) -> None:
    """One scale for all garments, and a page that is no larger than they need."""
    title, margin = 0.35, 0.15  # inches
    scale = (PAGE_WIDTH - 2 * margin) / sizes[:, 0].max()
    heights = sizes[:, 1] * scale
    page = float(heights.sum() + title * len(rows) + margin)
    figure.set_size_inches(PAGE_WIDTH, page)
    top = page
    for axes, size, height in zip(rows, sizes, heights, strict=True):
        top -= title + height
        axes.set_position(
            (margin / PAGE_WIDTH, top / page, size[0] * scale / PAGE_WIDTH, float(height) / page)
        )


def _garment(
    axes: Any, index: int, garment: GarmentSource, source: GarmentSource | None
) -> tuple[float, float]:
    """Draws the panels in a row; returns width and height of the drawing [m]."""
    from matplotlib.collections import LineCollection, PolyCollection

    borders, flat = outlines(garment), _uv(garment.corner_pattern)
    before = None if source is None else _uv(source.corner_pattern)
    seams = _seam_colors(garment, borders)
    left = 0.0
    bottom, top = 0.0, 0.0
    for p, (panel, border) in enumerate(zip(garment.panels, borders, strict=True)):
        mine = np.flatnonzero(garment.panel_of_triangle == p)
        middle = flat[mine].mean((0, 1))
        shapes = [flat[mine] - middle]
        if before is not None:
            shapes.append(before[mine] - before[mine].mean((0, 1)))
        low = np.min([s.min((0, 1)) for s in shapes], axis=0)
        high = np.max([s.max((0, 1)) for s in shapes], axis=0)
        shift = np.array([left - low[0], 0.0])
        left += high[0] - low[0] + GAP
        bottom, top = min(bottom, low[1]), max(top, high[1])
        fill = panel_color(index, p, len(garment.panels))
        axes.add_collection(PolyCollection(shapes[0] + shift, facecolors=[fill], alpha=0.35, linewidths=0))
        if before is not None:
            edges = before[border.corners[..., 0], border.corners[..., 1]]
            edges = edges - before[mine].mean((0, 1)) + shift
            dashed = LineCollection(list(edges), colors=INK, linewidths=0.6, linestyles=(0, (4, 2)), zorder=3)
            axes.add_collection(dashed)
        colors = [seams.get(tuple(e), INK) for e in border.points.tolist()]
        axes.add_collection(
            LineCollection(list(border.edges - middle + shift), colors=colors, linewidths=1.8)
        )
        axes.text(shift[0] + (low[0] + high[0]) / 2, low[1] - 0.015, panel.label or panel.name,
                  ha="center", va="top", fontsize=7, color=INK)  # fmt: skip
    note = "filled: refitted, dashed: source" if source is not None else "as read"
    axes.set_title(f"{garment.name}   ({note}; seams in colour)", fontsize=9, color=INK, loc="left")
    axes.set_xlim(-GAP / 2, left - GAP / 2)
    axes.set_ylim(bottom - LABEL, top + GAP / 4)
    axes.axis("off")
    return left, top - bottom + LABEL + GAP / 4


def _seam_colors(garment: GarmentSource, borders: Sequence[Outline]) -> dict[tuple[int, int], Any]:
    """A colour for each border edge that is sewn; both sides of a pair of panels share it."""
    from matplotlib import colormaps

    partner: dict[int, int] = {}
    for seam in garment.seams:
        for a, b in seam.pairs.tolist():
            partner.setdefault(a, b)
            partner.setdefault(b, a)
    panels_at: dict[int, set[int]] = defaultdict(set)
    uses: dict[tuple[int, int], list[int]] = defaultdict(list)
    for p, border in enumerate(borders):
        for a, b in border.points.tolist():
            uses[a, b].append(p)
            panels_at[a].add(p)
            panels_at[b].add(p)
    palette = colormaps["tab20"](np.arange(20))
    number: dict[tuple[int, ...], int] = {}
    colors = {}
    for (a, b), panels in uses.items():
        if len(panels) == 1:
            if a not in partner or b not in partner:
                continue
            other = panels_at[partner[a]] & panels_at[partner[b]]
            pair = tuple(sorted({panels[0], *sorted(other)[:1]}))
        else:
            pair = tuple(sorted(panels))
        colors[a, b] = palette[number.setdefault(pair, len(number)) % len(palette)]
    return colors


def _uv(corner_pattern: Floats) -> Floats:
    """u to the right and grain up from x = warp, y = weft (u = -y, v = x)."""
    return np.stack([-corner_pattern[..., 1], corner_pattern[..., 0]], axis=-1)
