"""Blend shapes: those of a body, read into the world, and those of a garment, written.

A shape with in-betweens is several shapes to the core: ``belly`` and ``belly:half``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pxr import Sdf, Tf, Usd, UsdSkel, Vt

from ..model import BlendShape, Character, Floats, Indices
from .stage import Source

#: Between the name of a shape and that of its in-between.
INBETWEEN = ":"


def read_blend_shapes(source: Source, character: Character) -> list[BlendShape]:
    """The blend shapes bound to a character's body, in the order of ``skel:blendShapes``.

    Raises:
        BadInput: names and targets do not fit, or a shape's arrays do not; names prim and element.
    """
    if character.origin is None:
        raise ValueError(f"{character.name}: a character without a stage has no blend shapes to read")
    mesh = source.stage.GetPrimAtPath(character.path)
    linear, point_count = character.origin.world_from_local[:3, :3], len(character.points)
    binding = UsdSkel.BindingAPI(mesh)
    names = [str(n) for n in binding.GetBlendShapesAttr().Get() or []]
    targets = binding.GetBlendShapeTargetsRel().GetForwardedTargets()
    if len(names) != len(targets):
        message = f"{len(names)} names for {len(targets)} targets"
        raise source.bad(message, mesh, "skel:blendShapes")
    shapes: dict[str, BlendShape] = {}
    for name, path in zip(names, targets, strict=True):
        shape = UsdSkel.BlendShape(source.stage.GetPrimAtPath(path))
        if not shape:
            raise source.bad(f"points at <{path}>, which is no BlendShape", mesh, "skel:blendShapeTargets")
        if name in shapes:
            raise source.bad(f"names {name!r} twice", mesh, "skel:blendShapes", names.index(name))
        points = _points(source, shape, point_count)
        full = _offsets(source, shape.GetOffsetsAttr(), len(points)) @ linear.T
        shapes[name] = BlendShape(name, points, full)
        for between in shape.GetInbetweens():
            offsets = _offsets(source, between.GetAttr(), len(points)) @ linear.T
            key = f"{name}{INBETWEEN}{between.GetAttr().GetBaseName()}"
            shapes[key] = BlendShape(key, points, offsets, float(between.GetWeight()))
    return list(shapes.values())


def _points(source: Source, shape: UsdSkel.BlendShape, point_count: int) -> Indices:
    """The points that a shape moves: those it names, or all."""
    named = shape.GetPointIndicesAttr().Get()
    if named is None or len(named) == 0:
        return np.arange(point_count, dtype=np.uint32)
    points = np.array(named, dtype=np.int64)
    outside = np.flatnonzero((points < 0) | (points >= point_count))
    if len(outside):
        message = f"names point {points[outside[0]]}, but the mesh has {point_count}"
        raise source.bad(message, shape.GetPrim(), "pointIndices", outside[0])
    return points.astype(np.uint32)


def _offsets(source: Source, attribute: Usd.Attribute, count: int) -> Floats:
    offsets = np.array(attribute.Get() or [], dtype=np.float64).reshape(-1, 3)
    if len(offsets) != count:
        message = f"{len(offsets)} offsets for {count} points"
        raise source.bad(message, attribute.GetPrim(), attribute.GetName())
    broken = np.flatnonzero(~np.isfinite(offsets).all(axis=1))
    if len(broken):
        raise source.bad("is not a finite number", attribute.GetPrim(), attribute.GetName(), broken[0])
    return offsets


def write_blend_shapes(prim: Usd.Prim, shapes: Sequence[BlendShape], local_from_world: Floats) -> None:
    """Authors sparse blend shapes below a garment and binds them.

    They have the names of the body's, so that an animation's ``blendShapeWeights`` drive both.
    """
    stage, linear = prim.GetStage(), local_from_world[:3, :3]
    names = sorted({shape.name.split(INBETWEEN)[0] for shape in shapes})
    targets: list[Sdf.Path] = []
    for name in names:
        own = {s.name: s for s in shapes if s.name.split(INBETWEEN)[0] == name}
        # In-betweens share the indices of their shape.
        points = np.unique(np.concatenate([s.points for s in own.values()]))
        path = prim.GetPath().AppendChild(Tf.MakeValidIdentifier(name))
        written = UsdSkel.BlendShape.Define(stage, path)
        written.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(points.astype(np.int32)))
        written.CreateOffsetsAttr(_array(own.get(name), points, linear))
        for key, shape in own.items():
            if key != name:
                between = written.CreateInbetween(key.split(INBETWEEN, 1)[1])
                between.SetWeight(shape.weight)
                between.SetOffsets(_array(shape, points, linear))
        targets.append(path)
    binding = UsdSkel.BindingAPI.Apply(prim)
    binding.CreateBlendShapesAttr(Vt.TokenArray(names))
    binding.CreateBlendShapeTargetsRel().SetTargets(targets)


def _array(shape: BlendShape | None, points: Indices, linear: Floats) -> Vt.Vec3fArray:
    """A shape's offsets for ``points``, zero where it has none."""
    dense = np.zeros((len(points), 3))
    if shape is not None:
        dense[np.searchsorted(points, shape.points)] = shape.offsets @ linear.T
    return Vt.Vec3fArray.FromNumpy(dense.astype(np.float32))
