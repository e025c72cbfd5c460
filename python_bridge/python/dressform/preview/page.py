"""Contact sheets: rows of scenes, seen from several sides."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model import Floats, Indices
from .vtk import polydata, pyvista

#: Where the camera stands, seen from the middle; bodies face +Z.
VIEWS: dict[str, tuple[float, float, float]] = {
    "front": (0.0, 0.0, 1.0),
    "side": (1.0, 0.0, 0.0),
    "back": (0.0, 0.0, -1.0),
    "left": (-1.0, 0.0, 0.0),
    "three-quarter": (0.6, 0.25, 0.75),
}
BACKGROUND = "#eceae6"
INK = "#3a3a3a"
SKIN = (0.72, 0.71, 0.70)


@dataclass
class Item:
    """A surface in one colour, or coloured by numbers.

    Shapes: ``points`` [n, 3] in metres, Y up; ``triangles`` [t, 3]; ``colors`` [t, 3] from 0 to 1;
    ``values`` [n] or [t].
    """

    points: Floats
    triangles: Indices
    color: tuple[float, float, float] = SKIN
    colors: Floats | None = None
    values: Floats | None = None
    #: Whether the surface frames the picture.
    subject: bool = False


@dataclass
class Row:
    """One scene of a sheet."""

    title: str
    items: list[Item]
    #: Colour map and its range for ``values``, and the title of its bar.
    cmap: Any = "coolwarm"
    limits: tuple[float, float] = (0.0, 1.0)
    legend: str = ""
    #: Names beside colours.
    keys: list[tuple[str, tuple[float, float, float]]] = field(default_factory=list)


def sheet(
    rows: Sequence[Row],
    output: str | os.PathLike[str],
    *,
    views: Sequence[str] = ("front", "side", "back"),
    cell: tuple[int, int] = (480, 620),
    close: bool = False,
) -> Path:
    """Draws rows of scenes, one column for each view, and writes a PNG.

    Args:
        rows: the scenes.
        output: the picture.
        views: keys of :data:`VIEWS`.
        cell: width and height of one view [pixels].
        close: frame the subjects and not the whole scene.

    Raises:
        NotInstalled: PyVista is missing.
        ValueError: no rows, or an unknown view.
    """
    unknown = [view for view in views if view not in VIEWS]
    if not rows or not views or unknown:
        raise ValueError(f"a sheet needs rows and views of {', '.join(VIEWS)}; got {unknown or 'none'}")
    size = (cell[0] * len(views), cell[1] * len(rows))
    plotter = pyvista().Plotter(
        off_screen=True, shape=(len(rows), len(views)), window_size=size, border=False, lighting="none"
    )
    try:
        for r, row in enumerate(rows):
            for c, view in enumerate(views):
                plotter.subplot(r, c)
                _scene(plotter, row, view, first=c == 0, last=c == len(views) - 1)
                _aim(plotter, row, view, cell, close)
        path = Path(output)
        path.parent.mkdir(parents=True, exist_ok=True)
        plotter.screenshot(str(path))
    finally:
        plotter.close()
    return path


def _scene(plotter: Any, row: Row, view: str, *, first: bool, last: bool) -> None:
    plotter.set_background(BACKGROUND)
    plotter.enable_anti_aliasing("ssaa")
    _lights(plotter)
    bar = {
        "title": row.legend, "title_font_size": 12, "label_font_size": 11, "color": INK, "fmt": "%.3g",
        "vertical": True, "width": 0.05, "height": 0.3, "position_x": 0.82, "position_y": 0.05,
    }  # fmt: skip
    shown = False
    for item in row.items:
        surface = polydata(item.points, item.triangles).compute_normals(
            cell_normals=False, split_vertices=True, feature_angle=60.0, consistent_normals=False
        )
        style = {"smooth_shading": True, "ambient": 0.18, "diffuse": 0.86, "specular": 0.0}
        if item.values is not None:
            numbers, at = _carried(surface, item)
            wanted = last and not shown and bool(row.legend)
            shown = shown or wanted
            plotter.add_mesh(
                surface, scalars=numbers, preference=at, cmap=row.cmap, clim=row.limits, nan_color="white",
                show_scalar_bar=wanted, scalar_bar_args=bar if wanted else None, **style,
            )  # fmt: skip
        elif item.colors is not None:
            plotter.add_mesh(surface, scalars=np.asarray(item.colors), rgb=True, preference="cell", **style)
        else:
            plotter.add_mesh(surface, color=item.color, **style)
    _words(plotter, (0.02, 0.955), f"{row.title}, {view}" if first else view)
    if last:
        for k, (name, color) in enumerate(row.keys):
            _words(plotter, (0.7, 0.955 - 0.03 * k), f"\u25a0 {name}", color)


def _words(plotter: Any, place: tuple[float, float], text: str, color: Any = INK) -> None:
    """Small text at a fraction of the view, of the same size in every view."""
    plotter.add_text(text, position=place, viewport=True, font_size=7, color=color, shadow=False)


def _carried(surface: Any, item: Item) -> tuple[NDArray[np.float64], str]:
    """Values on the surface whose vertices were split at sharp edges."""
    values = np.asarray(item.values, dtype=np.float64)
    if len(values) == len(item.triangles):
        return values, "cell"
    old = np.asarray(item.triangles).ravel()
    new = surface.faces.reshape(-1, 4)[:, 1:].ravel()
    carried = np.zeros(surface.n_points)
    carried[new] = values[old]
    return carried, "point"


def _lights(plotter: Any) -> None:
    light = pyvista().Light
    for position, strength in (((1.0, 1.6, 1.2), 0.7), ((-2.0, 0.3, 1.0), 0.3), ((0.0, 0.0, 1.0), 0.35)):
        # The plotter's own add_light would light every view of the sheet.
        plotter.renderer.add_light(light(position=position, intensity=strength, light_type="camera light"))


def _aim(plotter: Any, row: Row, view: str, cell: tuple[int, int], close: bool) -> None:
    """Parallel projection, the same scale in every view."""
    framed = [i for i in row.items if i.subject] if close else row.items
    points = np.concatenate([i.points for i in framed or row.items])
    low, high = points.min(0), points.max(0)
    middle, extent = (low + high) / 2, high - low
    toward = np.array(VIEWS[view]) / np.linalg.norm(VIEWS[view])
    width = float(np.hypot(extent[0], extent[2]) if toward[1] else max(extent[0], extent[2]))
    camera = plotter.camera
    camera.focal_point = middle
    camera.position = middle + 6.0 * toward
    camera.up = (0.0, 1.0, 0.0)
    camera.parallel_projection = True
    camera.parallel_scale = 0.53 * max(float(extent[1]), width * cell[1] / cell[0])
    plotter.renderer.reset_camera_clipping_range()
