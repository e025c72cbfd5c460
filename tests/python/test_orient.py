"""Panels that a pattern tool wound the wrong way are read facing outward and written as they were."""

from __future__ import annotations

import dressing
import numpy as np
import pytest
import scenes
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from dressform.usd.graph import components, numbered
from dressform.usd.write import write_dressed
from pxr import Sdf, Usd, UsdGeom, Vt


def outward(garment) -> np.ndarray:
    corners = garment.points[garment.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return (normal * corners.mean(axis=1) * [1.0, 0.0, 1.0]).sum(axis=1) > 0.0


def reverse(stage, faces):
    """Winds quads backwards, their st with them, as a mirrored piece comes."""
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Outfit/Shirt"))
    st = mesh.GetPrim().GetAttribute("primvars:st")
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    values = np.array(st.Get()).reshape(-1, 4, 2)
    indices[faces], values[faces] = indices[faces][:, ::-1], values[faces][:, ::-1]
    mesh.GetFaceVertexIndicesAttr().Set(indices.ravel().tolist())
    st.Set(Vt.Vec2fArray.FromNumpy(values.reshape(-1, 2)))


def faces_of(name):
    column = np.tile(np.arange(scenes.SIDES), scenes.SHIRT_RINGS - 1)
    half = column < scenes.SIDES // 2
    return {"front": half, "back": ~half, "all": half | True}[name]


@pytest.mark.parametrize("which", ["front", "back", "all"])
@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_turned_pieces(tmp_path, which, orientation):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    reverse(stage, faces_of(which))
    UsdGeom.Mesh(stage.GetPrimAtPath("/Outfit/Shirt")).CreateOrientationAttr(orientation)
    outfit = read_outfit(scenes.saved(stage))
    shirt = outfit.garments[0]
    assert outward(shirt).all()
    turned = faces_of(which) ^ (orientation == "leftHanded")
    if turned.any():
        assert f"{2 * turned.sum()} triangles faced inward" in outfit.notes[0]
    first, second = (shirt.corner_pattern[:, i] - shirt.corner_pattern[:, 0] for i in (1, 2))
    assert (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] > 0.0).all()
    height = shirt.points[shirt.triangles][..., 1]
    assert np.abs(height - 0.8 - shirt.corner_pattern[..., 0]).max() < 1e-6


def test_a_turned_piece_is_written_as_it_was(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    reverse(stage, faces_of("back"))
    outfit = read_outfit(scenes.saved(stage))
    target, _ = read_character(scenes.saved(scenes.character_stage(tmp_path / "hero.usda", girth=1.2)))
    results = dressing.dress(outfit, target)
    out = tmp_path / "out.usda"
    write_dressed(out, outfit, target, results)
    dressed = Usd.Stage.Open(str(out))
    before, after = (
        UsdGeom.Mesh(s.GetPrimAtPath(p))
        for s, p in ((stage, "/Outfit/Shirt"), (dressed, "/Hero/Outfit/Shirt"))
    )
    for name in ("faceVertexIndices", "faceVertexCounts", "primvars:st"):
        assert before.GetPrim().GetAttribute(name).Get() == after.GetPrim().GetAttribute(name).Get()
    pattern = UsdGeom.PrimvarsAPI(after).GetPrimvar("garment:pattern").ComputeFlattened()
    st = UsdGeom.PrimvarsAPI(after).GetPrimvar("st").Get()
    assert np.abs(np.array(pattern) - 1.02e-3 * np.array(st)).max() < 1e-5
    # normals stay on the side that the mesh's own winding calls its front
    points, normals = np.array(after.GetPointsAttr().Get()), np.array(after.GetNormalsAttr().Get())
    quads = np.array(after.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    inside = faces_of("back") & ~np.isin(quads, quads[faces_of("front")]).any(axis=1)
    assert ((normals[quads[inside]] * points[quads[inside]] * [1, 0, 1]).sum(axis=2) < 0.0).all()
    again = read_outfit(out).garments[0]
    assert (again.triangles == outfit.garments[0].triangles).all()
    assert np.abs(again.corner_pattern - results[0].corner_pattern).max() < 1e-6


def test_pieces_are_oriented_through_their_seams(tmp_path):
    """Two unwelded strips, sewn: without a body near them, the seam alone decides."""
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    x, y = np.meshgrid([0.0, 0.1, 0.2], np.linspace(0.0, 0.5, 6), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(18)], axis=1)
    grid = np.arange(18).reshape(3, 6)
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], -1).reshape(-1, 4)
    second = quads[:, ::-1] + 18
    mesh = scenes.add_mesh(
        stage,
        "/Outfit/Cape",
        np.concatenate([points, points + np.array([0.2, 0, 0])]),
        np.concatenate([quads, second]),
    )
    prim = mesh.GetPrim()
    flat = np.concatenate([points, points + np.array([0.3, 0.0, 0.0])])[:, :2].astype(np.float32) * 1000
    var = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    var.Set(Vt.Vec2fArray.FromNumpy(flat))
    for name, side in (("edgesA", grid[2]), ("edgesB", grid[0] + 18)):
        edges = np.stack([side[:-1], side[1:]], axis=1).ravel()
        prim.CreateAttribute(f"garment:seam:side:{name}", Sdf.ValueTypeNames.IntArray).Set(edges.tolist())
    prim.CreateRelationship("garment:sourceBody").SetTargets(["/SourceBody/Character"])
    cape = read_outfit(scenes.saved(stage), garments=["/Outfit/Cape"]).garments[0]
    corners = cape.points[cape.triangles]
    z = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (z > 0.0).all() or (z < 0.0).all()


def test_a_moebius_strip_cannot_be_oriented(tmp_path):
    stage = scenes.outfit_stage(tmp_path / "o.usda")
    n = 24
    angle = 2.0 * np.pi * np.arange(n) / n
    across = np.stack(
        [np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2), np.cos(angle / 2) * np.cos(angle)], 1
    )
    ring = 0.3 * np.stack([np.sin(angle), np.zeros(n), np.cos(angle)], axis=1) + [0.0, 1.0, 0.0]
    points = np.concatenate([ring - 0.05 * across, ring + 0.05 * across])
    i = np.arange(n)
    right = (i + 1) % n
    quads = np.stack([i, right, right + n, i + n], axis=1)
    quads[-1] = [n - 1, n, 0, 2 * n - 1]
    mesh = scenes.add_mesh(stage, "/Outfit/Band", points, quads)
    st = np.stack([i[:, None] + [0, 1, 1, 0], np.tile([0, 1.3, 1.3, 0], (n, 1))[:, [0, 3, 1, 2]]], -1) * 78.0
    var = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "faceVarying")
    var.Set(Vt.Vec2fArray.FromNumpy(st.reshape(-1, 2).astype(np.float32)))
    notes = read_outfit(scenes.saved(stage), garments=["/Outfit/Band"]).notes
    assert any("cannot be oriented" in note for note in notes)


def test_components():
    pairs = np.array([[5, 4], [1, 2], [4, 2], [7, 8]])
    label = components(10, pairs)
    assert label.tolist() == [0, 1, 1, 3, 1, 1, 6, 7, 7, 9]
    assert numbered(label[::-1]).tolist() == [0, 1, 1, 2, 3, 3, 4, 3, 3, 5]
    chain = np.random.default_rng(1).permutation(5000)
    assert (components(5000, np.stack([chain[:-1], chain[1:]], axis=1)) == 0).all()
    assert components(3, np.zeros((0, 2), dtype=np.int64)).tolist() == [0, 1, 2]
