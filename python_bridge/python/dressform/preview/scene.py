"""Scenes of an outfit on its body: by panel, by strain, by distance."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..model import Character, GarmentSource, Outfit
from .fields import signed_distance, stretch
from .page import Item, Row

#: Strain at which the colours end.
STRAIN_RANGE = 0.15
#: Distances at which the colours end [m].
DISTANCE_RANGE = (-0.01, 0.06)
Color = tuple[float, float, float]


def panel_color(garment: int, panel: int, panels: int) -> Color:
    """A hue for each garment, lightness and a little hue for each of its panels."""
    hue = (0.58 + 0.381966 * garment + 0.10 * (panel / max(panels, 1) - 0.5)) % 1.0
    light = 0.42 + 0.30 * ((panel * 0.618034) % 1.0)
    return colorsys.hls_to_rgb(hue, light, 0.45)


def by_panel(garments: Sequence[GarmentSource], body: Character) -> Row:
    """Every panel in a colour of its own."""
    row = Row("by panel", [_skin(body)])
    for g, garment in enumerate(garments):
        palette = np.array([panel_color(g, p, len(garment.panels)) for p in range(len(garment.panels))])
        colors = palette[garment.panel_of_triangle]
        row.items.append(Item(garment.points, garment.triangles, colors=colors, subject=True))
        middle = panel_color(g, 0, len(garment.panels))
        row.keys.append((f"{garment.name} ({len(garment.panels)} panels)", middle))
    return row


def by_strain(garments: Sequence[GarmentSource], body: Character) -> Row:
    """The largest strain of each triangle against its panel."""
    limits = (-STRAIN_RANGE, STRAIN_RANGE)
    row = Row("strain against the panels", [_skin(body)], cmap="RdBu_r", limits=limits, legend="strain")
    for garment in garments:
        values = stretch(garment.points, garment.triangles, garment.corner_pattern)
        row.items.append(Item(garment.points, garment.triangles, values=values, subject=True))
    return row


def by_distance(garments: Sequence[GarmentSource], body: Character) -> Row:
    """Signed distance to the body in millimetres; what is inside is red."""
    low, high = (1000.0 * d for d in DISTANCE_RANGE)
    row = Row("distance to the body", [_skin(body)], cmap=_distance_map(), limits=(low, high), legend="mm")
    for garment in garments:
        values = 1000.0 * signed_distance(garment.points, body.points, body.triangles)
        row.items.append(Item(garment.points, garment.triangles, values=values, subject=True))
    return row


def dressed(outfit: Outfit, body: Character | None = None, names: Sequence[str] = ()) -> list[Row]:
    """The three rows for an outfit (or for the garments named), on its own body by default."""
    chosen = [g for g in outfit.garments if not names or g.name in names]
    chosen.sort(key=lambda g: g.layer)
    wearer = body or outfit.bodies[chosen[0].body]
    return [by_panel(chosen, wearer), by_strain(chosen, wearer), by_distance(chosen, wearer)]


def _skin(body: Character) -> Item:
    return Item(body.points, body.triangles)


def _distance_map() -> Any:
    """Red below zero, then pale to blue."""
    from matplotlib.colors import LinearSegmentedColormap

    low, high = DISTANCE_RANGE
    zero = -low / (high - low)
    stops = [
        (0.0, "#7f0000"), (zero - 1e-6, "#ff3b20"),
        (zero, "#f3efe0"), ((zero + 1) / 2, "#7fb8c9"), (1.0, "#234a78"),
    ]  # fmt: skip
    return LinearSegmentedColormap.from_list("distance", stops)
