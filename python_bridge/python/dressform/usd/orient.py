"""Which side of a garment is out.

Pattern tools mirror pieces freely, so that panels may be wound against their neighbours. Triangles
are oriented through the edges that they share and through their seams, and each connected piece as
a whole away from the body. Only our triangles are turned: the mesh is written back as it was.

Orientation is a two-colouring: each triangle stands twice in a graph, as it is and turned. An edge
run in opposite directions joins equal states, an edge run the same way joins opposite ones. A piece
whose triangle is connected with its own turned self cannot be oriented (a Moebius strip).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from ..model import AuthoredSeam, Floats, Indices
from .graph import components
from .stage import Source

Flags = NDArray[np.bool_]

#: Mean cosine between normals and the way out from the body beyond which a piece's side is clear.
CLEAR = 0.2
#: Triangles of a piece that are asked for the way out.
ASKED = 400


def turned_triangles(
    source: Source,
    prim: Usd.Prim,
    points: Floats,
    triangles: Indices,
    seams: list[AuthoredSeam],
    body: Floats | None,
) -> Flags:
    """Triangles to be turned over so that the garment faces outward, shape [t]."""
    tri = triangles.astype(np.int64)
    same, opposite = _neighbours(tri, _welded(len(points), seams))
    n = len(tri)
    crossed = [opposite + np.array(shift) for shift in ((0, n), (n, 0))]
    states = np.concatenate([same, same + n, *crossed])
    label = components(2 * n, states)
    piece = np.minimum(label[:n], label[n:])
    turned = label[n:] < label[:n]
    for index in np.unique(piece):
        mine = np.flatnonzero(piece == index)
        if (label[mine] == label[mine + n]).any():
            source.note(
                f"a piece of {len(mine)} triangles (with triangle {mine[0]}) cannot be oriented: "
                "its sides run into one another",
                prim,
            )
            turned[mine] = False
            continue
        turned[mine] ^= _faces_in(points, tri[mine], turned[mine], body)
    if turned.any():
        source.note(f"{int(turned.sum())} triangles faced inward and are read turned over", prim)
    return turned


def _welded(count: int, seams: list[AuthoredSeam]) -> NDArray[np.int64]:
    """Points with seams closed, shape [count]."""
    pairs = [s.pairs.astype(np.int64) for s in seams if not s.offset]
    return components(count, np.concatenate(pairs)) if pairs else np.arange(count)


def _neighbours(
    tri: NDArray[np.int64], point: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of triangles that share an edge, oriented alike and against each other."""
    corner = point[tri]
    edge = np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]])
    owner = np.tile(np.arange(len(tri)), 3)
    real = edge[:, 0] != edge[:, 1]
    edge, owner = edge[real], owner[real]
    _, key, times = np.unique(np.sort(edge, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(key.ravel(), kind="stable")
    order = order[times[key.ravel()[order]] == 2]  # edges of three or more say nothing
    pairs, forward = owner[order].reshape(-1, 2), (edge[:, 0] < edge[:, 1])[order].reshape(-1, 2)
    alike = forward[:, 0] != forward[:, 1]
    return pairs[alike], pairs[~alike]


def _faces_in(points: Floats, tri: NDArray[np.int64], turned: Flags, body: Floats | None) -> bool:
    """Whether a piece, after turning, faces the body; without a clear answer, whether most of it
    was turned."""
    corners = points[tri]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal[turned] *= -1.0
    area = np.linalg.norm(normal, axis=1)
    if body is not None:
        asked = np.unique(np.linspace(0, len(tri) - 1, ASKED).astype(np.int64))
        centre = corners[asked].mean(axis=1)
        away = centre - body[_nearest(centre, body)]
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
        mean = float((normal[asked] * away).sum() / max(area[asked].sum(), 1e-30))
        if abs(mean) > CLEAR:
            return mean < 0.0
    return bool(area[turned].sum() > 0.5 * area.sum())


def _nearest(points: Floats, body: Floats) -> NDArray[np.int64]:
    size = (body**2).sum(axis=1)
    blocks = np.array_split(points, max(1, len(points) // 64))
    return np.concatenate([np.argmin(size - 2.0 * block @ body.T, axis=1) for block in blocks])
