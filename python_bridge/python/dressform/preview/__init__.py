"""Pictures: contact sheets of dressed bodies, and panels drawn flat.

Needs the optional part ``dressform[preview]`` (PyVista, which brings VTK and matplotlib). It
draws off screen; where there is no display, VTK needs EGL or OSMesa from the system (on Debian
``libegl1`` and ``libgl1-mesa-dri``, or ``libosmesa6``).
"""

from .fields import signed_distance, stretch
from .flat import draw_patterns
from .page import VIEWS, Item, Row, sheet
from .scene import by_distance, by_panel, by_strain, dressed
from .stage import draw_stage

__all__ = [
    "VIEWS",
    "Item",
    "Row",
    "by_distance",
    "by_panel",
    "by_strain",
    "draw_patterns",
    "draw_stage",
    "dressed",
    "sheet",
    "signed_distance",
    "stretch",
]
