"""A high-visibility vest, made from the shell of a shirt: two reflective straps all around, and
braces in front and back that cross over them, all sewn on with an offset along their edges.

Needs a shirt with the panels ``front`` and ``back``, in metres, Y up, facing +Z.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from dressform.model import AuthoredSeam, GarmentSource, Outfit, Panel
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

#: Heights of straps and braces above the shell [m].
STRAP, BRACE = 4e-3, 8e-3
WIDTH = 0.05
#: Heights of the straps, as shares of the shell's, and how far aside the braces are [m].
STRAPS, BRACE_X = (0.15, 0.4), 0.08
#: Points across a strap and along half a round of it, and the length of a brace's edges [m]. Edges
#: of 6 mm at 4 mm above the shell: none is cut by a crease of less than 106 degrees.
ACROSS, COLUMNS, EDGE = 5, 80, 0.012


#: Rounds of smoothing of the shell.
SMOOTHING = 2
UP = np.array([0.0, 1.0, 0.0])


@dataclass
class Mesh:
    """A garment in the making."""

    points: list[np.ndarray]
    triangles: list[np.ndarray]
    uv: list[np.ndarray]
    panel_of_triangle: list[np.ndarray]
    panels: list[Panel]
    seams: list[AuthoredSeam] = field(default_factory=list)
    count: int = 0


def shell_of(shirt: GarmentSource) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """Front and back alone; also their points and triangles."""
    kept = [i for i, p in enumerate(shirt.panels) if p.label in ("front", "back")]
    taken = np.isin(shirt.panel_of_triangle, kept)
    used, flat = np.unique(shirt.triangles[taken], return_inverse=True)
    triangles = flat.reshape(-1, 3)
    points = smoothed(shirt.points[used], triangles)
    mesh = Mesh(
        points=[points],
        triangles=[triangles],
        uv=[shirt.corner_pattern[taken]],
        panel_of_triangle=[np.searchsorted(kept, shirt.panel_of_triangle[taken])],
        panels=[shirt.panels[i] for i in kept],
        count=len(points),
    )
    return mesh, points, triangles


def smoothed(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The inner points moved towards their neighbours: a vest has no folds for straps to cross."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    both, times = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    inner = np.ones(len(points), dtype=bool)
    inner[both[times == 1]] = False
    for share in (0.5, -0.53) * SMOOTHING:  # [Taubin 1995]: there and back, so that it does not shrink
        total, count = np.zeros_like(points), np.zeros(len(points))
        for a, b in (both.T, both.T[::-1]):
            np.add.at(total, a, points[b])
            np.add.at(count, a, 1.0)
        points = np.where(inner[:, None], points + share * (total / count[:, None] - points), points)
    return points


def hit(points: np.ndarray, triangles: np.ndarray, origin: np.ndarray, way: np.ndarray) -> tuple:
    """The last point of a mesh along a ray, and the mesh's interpolated normal there."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    e1, e2, s = b - a, c - a, origin - a
    p = np.cross(way, e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (s * p).sum(1) / (e1 * p).sum(1)
        q = np.cross(s, e1)
        v = (q * way).sum(1) / (e1 * p).sum(1)
        t = (q * e2).sum(1) / (e1 * p).sum(1)
    inside = np.flatnonzero((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0))
    if len(inside) == 0:
        raise ValueError(f"nothing on the way from {origin} along {way}")
    best = inside[np.argmax(t[inside])]
    smooth = np.zeros_like(points)
    for k in range(3):
        np.add.at(smooth, triangles[:, k], normal)
    weights = np.array([1 - u[best] - v[best], u[best], v[best]])
    n = weights @ smooth[triangles[best]]
    return origin + t[best] * way, n / np.linalg.norm(n)


def add_grid(mesh: Mesh, name: str, grid: np.ndarray, edges: str) -> np.ndarray:
    """A panel of ``grid`` [rows, columns, 3]; its long edges (and ends) are sewn to the shell.

    Returns the index of each grid point.
    """
    rows, columns = grid.shape[:2]
    index = mesh.count + np.arange(rows * columns).reshape(rows, columns)
    along = np.linalg.norm(np.diff(grid, axis=1), axis=2).mean(0)
    across = np.linalg.norm(np.diff(grid, axis=0), axis=2).mean(1)
    u, v = (np.concatenate([[0.0], np.cumsum(d)]) for d in (along, across))
    uv = np.stack(np.meshgrid(u, v), -1) + np.array([0.0, 3.0 + 0.1 * len(mesh.panels)])
    a, b, c, d = (s.ravel() for s in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    mesh.points.append(grid.reshape(-1, 3))
    mesh.triangles.append(triangles)
    mesh.uv.append(uv.reshape(-1, 2)[triangles - mesh.count])
    mesh.panel_of_triangle.append(np.full(len(triangles), len(mesh.panels)))
    mesh.panels.append(Panel(name=name, label=name.rsplit("_", 1)[0], fabric=mesh.panels[0].fabric))
    mesh.count += rows * columns
    border = [index[0], index[-1]] + ([index[:, 0], index[:, -1]] if edges == "all" else [])
    sewn = np.unique(np.concatenate(border))
    shell = mesh.points[0]
    points = np.concatenate(mesh.points)
    nearest = [int(np.argmin(((shell - points[i]) ** 2).sum(1))) for i in sewn]
    mesh.seams.append(AuthoredSeam(name, np.stack([sewn, nearest], 1).astype(np.uint32), offset=True))
    return index


def make_vest(shirt: GarmentSource) -> GarmentSource:
    """The vest, on the shirt's source body."""
    mesh, points, triangles = shell_of(shirt)
    low, high = points[:, 1].min(), points[:, 1].max()
    middle = np.array([points[:, 0].mean(), 0.0, points[:, 2].mean()])

    def lifted(origin: np.ndarray, way: np.ndarray, height: float) -> np.ndarray:
        on, normal = hit(points, triangles, origin, way)
        return on + height * normal

    for k, part in enumerate(STRAPS):
        y = low + part * (high - low) + np.linspace(-0.5, 0.5, ACROSS) * WIDTH
        sides = []
        # From the wearer's right over the front to the left, and on over the back.
        for start, name in ((-np.pi, f"strap_front_{k}"), (0.0, f"strap_back_{k}")):
            angle = start + np.linspace(0.0, np.pi, COLUMNS)
            way = np.stack([np.cos(angle), np.zeros(COLUMNS), -np.sin(angle)], 1)
            grid = np.array([[lifted(middle + h * UP, w, STRAP) for w in way] for h in y])
            sides.append(add_grid(mesh, name, grid, "long"))
        right, left = (np.stack([a, b], 1) for a, b in (
            (sides[0][:, 0], sides[1][:, -1]), (sides[0][:, -1], sides[1][:, 0])
        ))  # fmt: skip
        pairs = np.concatenate([right, left]).astype(np.uint32)
        mesh.seams.append(AuthoredSeam(f"strap_sides_{k}", pairs, offset=False))
    top = low + 0.8 * (high - low)
    y = np.arange(low + 0.08, top, EDGE)
    for way, name in ((1.0, "front"), (-1.0, "back")):
        for x in (-BRACE_X, BRACE_X):
            xs = middle[0] + x + way * np.linspace(0.5, -0.5, ACROSS) * WIDTH
            grid = np.array(
                [
                    [lifted(np.array([u, h, middle[2]]), np.array([0.0, 0.0, way]), BRACE) for h in y]
                    for u in xs
                ]
            )
            add_grid(mesh, f"strap_brace_{name}_{'l' if x > 0 else 'r'}", grid, "all")
    return GarmentSource(
        name="Vest",
        path="/Outfit/Vest",
        layer=shirt.layer,
        body=0,
        points=np.concatenate(mesh.points),
        triangles=np.concatenate(mesh.triangles).astype(np.uint32),
        corner_pattern=np.concatenate(mesh.uv),
        panel_of_triangle=np.concatenate(mesh.panel_of_triangle).astype(np.uint32),
        panels=mesh.panels,
        seams=mesh.seams,
    )


def write_vest(path: Path, outfit_file: Path, outfit: Outfit, vest: GarmentSource) -> None:
    """A copy of an outfit's stage with the vest in place of its garments."""
    stage = Usd.Stage.Open(str(outfit_file)).Flatten()
    stage = Usd.Stage.Open(stage)
    body = ""
    for garment in outfit.garments:
        targets = stage.GetPrimAtPath(garment.path).GetRelationship("garment:sourceBody").GetTargets()
        body = targets[0] if targets else body
        stage.RemovePrim(garment.path)
    mesh = UsdGeom.Mesh.Define(stage, vest.path)
    prim = mesh.GetPrim()
    world = np.column_stack([vest.points, np.ones(len(vest.points))])
    to_stage = outfit.frame.stage_from_world
    parent = UsdGeom.Xformable(prim.GetParent()).ComputeLocalToWorldTransform(Usd.TimeCode.Default())
    to_local = np.array(parent.GetInverse()).T @ to_stage
    points = (world @ to_local.T)[:, :3].astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr([3] * len(vest.triangles))
    mesh.CreateFaceVertexIndicesAttr(vest.triangles.ravel().tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    for schema in ("GarmentAPI", *(f"GarmentSeamAPI:{s.name}" for s in vest.seams)):
        prim.AddAppliedSchema(schema)
    uniform, types = Sdf.VariabilityUniform, Sdf.ValueTypeNames
    prim.CreateAttribute("garment:layer", types.Int, False, uniform).Set(vest.layer)
    prim.CreateRelationship("garment:sourceBody", False).SetTargets([body])
    st = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
        "garment:pattern", types.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    xy = vest.corner_pattern.reshape(-1, 2)  # x warp, y weft: u = -y, v = x
    uv = np.stack([-xy[:, 1], xy[:, 0]], 1).astype(np.float32)
    st.Set([Gf.Vec2f(*map(float, p)) for p in uv])
    for i, panel in enumerate(vest.panels):
        faces = np.flatnonzero(vest.panel_of_triangle == i)
        subset = UsdGeom.Subset.CreateGeomSubset(
            mesh, panel.name, UsdGeom.Tokens.face, Vt.IntArray(faces.tolist()), "pattern"
        )
        subset.GetPrim().AddAppliedSchema("GarmentPanelAPI")
        subset.GetPrim().CreateAttribute("garment:panel:label", types.Token, False, uniform).Set(panel.label)
    UsdGeom.Subset.SetFamilyType(mesh, "pattern", "partition")
    for seam in vest.seams:
        # Lists of edges, two points each, read point to point: a point alone is an edge of itself.
        lead = f"garment:seam:{seam.name}"
        for side, column in (("edgesA", 0), ("edgesB", 1)):
            edges = np.repeat(seam.pairs[:, column], 2).astype(int).tolist()
            prim.CreateAttribute(f"{lead}:{side}", types.IntArray, False, uniform).Set(edges)
        if seam.offset:
            height = STRAP / outfit.frame.meters_per_unit
            prim.CreateAttribute(f"{lead}:offset", types.Float, False, uniform).Set(height)
    stage.Export(str(path))
