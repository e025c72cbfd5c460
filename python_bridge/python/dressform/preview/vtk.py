"""PyVista, loaded late and told to draw off screen."""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np

from ..errors import NotInstalled
from ..model import Floats, Indices


def pyvista() -> Any:
    """The module.

    Raises:
        NotInstalled: the optional part is missing.
    """
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        # Without this VTK tries X first and writes a warning about it.
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        import pyvista as module
    except ImportError as error:
        raise NotInstalled("previews need PyVista: pip install 'dressform[preview]'") from error
    return module


def polydata(points: Floats, triangles: Indices) -> Any:
    """A VTK surface."""
    faces = np.empty((len(triangles), 4), dtype=np.int64)
    faces[:, 0] = 3
    faces[:, 1:] = triangles
    return pyvista().PolyData(np.asarray(points, dtype=np.float64), faces.ravel())
