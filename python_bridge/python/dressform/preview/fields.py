"""What a picture can be coloured by."""

from __future__ import annotations

import numpy as np

from ..model import Floats, Indices


def stretch(points: Floats, triangles: Indices, corner_pattern: Floats) -> Floats:
    """Largest strain of each triangle against its panel, shape [t], dimensionless.

    With F the 3x2 deformation gradient and its singular values s: the s - 1 that is largest in
    magnitude, so that stretched cloth is positive and compressed cloth negative.
    """
    corners = points[triangles]
    space = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    rest = np.stack(
        [corner_pattern[:, 1] - corner_pattern[:, 0], corner_pattern[:, 2] - corner_pattern[:, 0]], axis=2
    )
    flat = np.abs(np.linalg.det(rest)) == 0.0
    rest[flat] = np.eye(2)
    gradient = space @ np.linalg.inv(rest)
    strains = np.linalg.svd(gradient, compute_uv=False) - 1.0
    largest = np.take_along_axis(strains, np.abs(strains).argmax(1)[:, None], 1)[:, 0]
    largest[flat] = np.nan
    return np.asarray(largest, dtype=np.float64)


def signed_distance(points: Floats, body_points: Floats, body_triangles: Indices) -> Floats:
    """Distance to a body, negative inside [m], shape [n].

    The sign is that of the pseudo-normal at the closest point: right on a clean skin, a guess
    where skin crosses itself. The certificate does not use it.
    """
    from .vtk import polydata, pyvista

    cloud = pyvista().PolyData(np.asarray(points, dtype=np.float64))
    found = cloud.compute_implicit_distance(polydata(body_points, body_triangles))
    return np.asarray(found["implicit_distance"], dtype=np.float64)
