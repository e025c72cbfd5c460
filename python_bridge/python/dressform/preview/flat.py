"""Panels drawn flat: the refitted pattern over the source pattern, seams in colour."""

from __future__ import annotations

import colorsys
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import NotInstalled
from ..model import Floats, GarmentSource
from . import sewing

#: Space between panels [m].
GAP = 0.05
#: Width of the drawing over its height that panels are packed for.
ASPECT = 1.5
#: Width of the drawing [inches], its margin, and the room for title and scale bar.
PAGE_WIDTH = 13.0
MARGIN = 0.35
HEAD = 0.75
FOOT = 0.6
#: Length of the scale bar [m].
BAR = 0.2
BACKGROUND = "#ffffff"
INK = "#2f3237"
SOURCE = "#a3a6aa"
FILL = "#f3ead9"
FAINT = "#8a8d91"


@dataclass
class _Piece:
    """A panel on the page."""

    label: str
    #: Refitted and source triangles, u to the right and grain up [m], shape [t, 3, 2].
    now: Floats
    before: Floats | None
    #: Where its lower left corner goes, and its size [m].
    low: Floats
    size: Floats
    place: Floats


def draw_patterns(
    garments: Sequence[GarmentSource],
    output: str | os.PathLike[str],
    *,
    sources: Sequence[GarmentSource] | None = None,
) -> list[Path]:
    """Writes a drawing (SVG, PNG or PDF by the ending) of each garment, true to scale.

    The two sides of a seam share a colour. With several garments each file has the garment's
    name at the end of its own.

    Args:
        garments: garments with the pattern to draw, filled.
        output: the file.
        sources: the same garments with their source pattern, drawn as a grey outline.

    Raises:
        NotInstalled: matplotlib is missing.
    """
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
    except ImportError as error:
        raise NotInstalled("previews need matplotlib: pip install 'dressform[preview]'") from error
    path = Path(output)
    path.parent.mkdir(parents=True, exist_ok=True)
    extra: dict[str, Any] = {"metadata": {"Date": None}} if path.suffix == ".svg" else {}
    written = []
    for g, garment in enumerate(garments):
        name = path if len(garments) == 1 else path.with_name(f"{path.stem}-{garment.name}{path.suffix}")
        # Without a salt of its own an SVG's identifiers differ from run to run.
        with rc_context({"svg.hashsalt": "dressform", "font.family": "DejaVu Sans"}):
            figure = Figure(facecolor=BACKGROUND)
            _draw(figure, garment, None if sources is None else sources[g])
            figure.savefig(name, dpi=120, facecolor=BACKGROUND, **extra)
        written.append(name)
    return written


def _draw(figure: Any, garment: GarmentSource, source: GarmentSource | None) -> None:
    pieces, extent = _arrange(garment, source)
    scale = (PAGE_WIDTH - 2 * MARGIN) / extent[0]  # inches for a metre
    height = extent[1] * scale + HEAD + FOOT
    figure.set_size_inches(PAGE_WIDTH, height)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(-MARGIN / scale, (PAGE_WIDTH - MARGIN) / scale)
    axes.set_ylim(-FOOT / scale, (height - FOOT) / scale)
    axes.axis("off")

    runs = sewing.borders(garment)
    colors = _colors(1 + max((run.chain for run in runs), default=-1))
    for p, piece in enumerate(pieces):
        _panel(axes, piece, [run for run in runs if run.panel == p], garment, colors)
    top = (height - FOOT) / scale
    note = "as read" if source is None else "filled: refitted; grey outline: source"
    axes.text(0, top - 0.28 / scale, garment.name, fontsize=15, color=INK, weight="bold", va="center")
    seams = f"{note}; the two sides of a seam share a colour"
    axes.text(0, top - 0.55 / scale, seams, fontsize=8.5, color=FAINT, va="center")
    _scale_bar(axes, scale)


def _arrange(garment: GarmentSource, source: GarmentSource | None) -> tuple[list[_Piece], Floats]:
    """Panels on shelves, tall ones first; and the size of the whole [m]."""
    flat = _uv(garment.corner_pattern)
    before = None if source is None else _uv(source.corner_pattern)
    pieces = []
    for p, panel in enumerate(garment.panels):
        mine = garment.panel_of_triangle == p
        now = flat[mine] - _middle(flat[mine])
        old = None if before is None else before[mine] - _middle(before[mine])
        both = now if old is None else np.concatenate([now, old])
        low, high = both.min((0, 1)), both.max((0, 1))
        pieces.append(_Piece(panel.label or panel.name, now, old, low, high - low, np.zeros(2)))
    order = sorted(range(len(pieces)), key=lambda p: (-round(pieces[p].size[1], 2), p))
    area = sum(float(np.prod(piece.size + GAP)) for piece in pieces)
    width = max(float(np.sqrt(area * ASPECT)), *(float(piece.size[0]) for piece in pieces))
    shelves: list[list[int]] = [[]]
    for p in order:
        used = sum(float(pieces[q].size[0]) + GAP for q in shelves[-1])
        if shelves[-1] and used + pieces[p].size[0] > width:
            shelves.append([])
        shelves[-1].append(p)
    extent = np.zeros(2)
    for shelf in reversed(shelves):
        left = 0.0
        for p in shelf:
            pieces[p].place = np.array([left, extent[1]])
            left += float(pieces[p].size[0]) + GAP
        tallest = max(float(pieces[p].size[1]) for p in shelf)
        extent = np.array([max(extent[0], left - GAP), extent[1] + tallest + GAP])
    return pieces, extent


def _panel(
    axes: Any, piece: _Piece, runs: list[sewing.Run], garment: GarmentSource, colors: list[Any]
) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    shift = piece.place - piece.low
    mine = np.flatnonzero(garment.panel_of_triangle == runs[0].panel)
    row = np.full(len(garment.triangles), -1)
    row[mine] = np.arange(len(mine))

    def lines(triangles: Floats) -> list[Floats]:
        return [triangles[row[run.corners[:, 0]], run.corners[:, 1]] + shift for run in runs]

    # Edges in the colour of the fill close the hairlines between triangles.
    triangles = PolyCollection(list(piece.now + shift), facecolors=FILL, edgecolors=FILL, linewidths=0.4)
    axes.add_collection(triangles)
    if piece.before is not None:
        outline = LineCollection(lines(piece.before), colors=SOURCE, linewidths=1.0, zorder=2)
        axes.add_collection(outline)
    tints = [INK if run.chain < 0 else colors[run.chain] for run in runs]
    widths = [1.1 if run.chain < 0 else 2.6 for run in runs]
    borders = LineCollection(
        lines(piece.now), colors=tints, linewidths=widths, capstyle="round", joinstyle="round", zorder=3
    )
    axes.add_collection(borders)

    # Centres of gravity lie together: see _arrange.
    size = 100 * np.ptp(piece.now.reshape(-1, 2), axis=0)
    text = f"{size[0]:.0f} × {size[1]:.0f} cm"
    if piece.before is not None:
        text += f"\narea {100 * (_area(piece.now) / _area(piece.before) - 1):+.0f} %"
    x, y = shift
    flat = size[1] < 10  # a waistband has no room for three lines
    label = f"{piece.label}   {text.replace(chr(10), '   ')}" if flat else piece.label
    axes.text(x, y + (0 if flat else 0.012), label, ha="center", va="center" if flat else "bottom",
              fontsize=7.5, color=INK, zorder=4)  # fmt: skip
    if not flat:
        axes.text(x, y, text, ha="center", va="top", fontsize=6.5, color=FAINT, zorder=4, linespacing=1.4)


def _scale_bar(axes: Any, scale: float) -> None:
    y, tick = -0.3 / scale, 0.05 / scale
    axes.plot([0, BAR], [y, y], color=INK, linewidth=1.4, solid_capstyle="butt")
    for x in np.linspace(0, BAR, 5):
        axes.plot([x, x], [y, y + tick], color=INK, linewidth=1.0)
    axes.text(BAR + 0.08 / scale, y, f"{100 * BAR:.0f} cm", fontsize=8, color=INK, va="center")


def _colors(count: int) -> list[Any]:
    """Hues a golden angle apart, in three lightnesses."""
    return [
        colorsys.hls_to_rgb((0.58 + 0.381966 * k) % 1.0, (0.40, 0.52, 0.30)[k % 3], 0.75)
        for k in range(count)
    ]


def _doubled(triangles: Floats) -> Floats:
    e, f = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]


def _area(triangles: Floats) -> float:
    return float(np.abs(_doubled(triangles)).sum() / 2)


def _middle(triangles: Floats) -> Floats:
    """Centre of gravity of a panel."""
    weights = np.abs(_doubled(triangles))
    return np.asarray((triangles.mean(1) * weights[:, None]).sum(0) / weights.sum())


def _uv(corner_pattern: Floats) -> Floats:
    """u to the right and grain up from x = warp, y = weft (u = -y, v = x)."""
    return np.stack([-corner_pattern[..., 1], corner_pattern[..., 0]], axis=-1)
