"""Writes a simulation: a root layer over the dressed stage, and time samples in a crate file.

The root layer has the dressed stage as its sublayer. The samples are points of the garments, which
are no longer skinned: their weights are blocked, or the pose would move them twice.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pxr import Sdf, UsdGeom, Vt

from ..errors import BadOutput
from ..model import Floats, GarmentSource
from . import atomic
from .stage import Source, apply
from .write import _export, check_target, relative_asset

#: Attributes that would skin the points again.
BLOCKED = ("primvars:skel:jointIndices", "primvars:skel:jointWeights")
METADATA = ("upAxis", "metersPerUnit", "timeCodesPerSecond", "framesPerSecond", "kilogramsPerUnit")


def write_simulation(
    out: str | os.PathLike[str],
    source: Source,
    garments: Sequence[GarmentSource],
    frames: Sequence[Floats],
    times: Sequence[float],
    *,
    clobber: bool = True,
) -> None:
    """Writes time samples of the garments' points over a dressed stage.

    Args:
        out: ``.usda``, ``.usdc`` or ``.usd``; the samples go to a crate file beside it.
        source: the dressed stage.
        garments: its garments, as read.
        frames: each garment's points over time [m], world, shape [times, n, 3].
        times: time codes.
        clobber: whether an existing ``out`` is replaced.

    Raises:
        BadOutput: ``out`` cannot be written; an older one is as it was.
    """
    target = check_target(out, clobber=clobber)
    if target.exists() and os.path.samefile(target, source.file):
        raise BadOutput("this is the input, which is never changed", file=str(target))
    samples = _samples(source, garments, frames, times)
    with atomic.workshop(target) as folder:
        arrays, root = folder / "samples.usdc", folder / f"root{target.suffix}"
        _export(samples, arrays, target)
        name = atomic.content_name(target, arrays)
        _export(_root(source, target, name, times), root, target)
        atomic.install(arrays, target.with_name(name), root, target)


def _samples(
    source: Source, garments: Sequence[GarmentSource], frames: Sequence[Floats], times: Sequence[float]
) -> Sdf.Layer:
    layer = Sdf.Layer.CreateAnonymous("samples.usdc")
    for garment, world in zip(garments, frames, strict=True):
        prim = source.stage.GetPrimAtPath(garment.path)
        local_from_world = np.linalg.inv(source.world_from_local(prim)).astype(np.float64)
        spec = Sdf.CreatePrimInLayer(layer, garment.path)
        points = Sdf.AttributeSpec(spec, "points", Sdf.ValueTypeNames.Point3fArray)
        extent = Sdf.AttributeSpec(spec, "extent", Sdf.ValueTypeNames.Float3Array)
        for time, positions in zip(times, world, strict=True):
            local = Vt.Vec3fArray.FromNumpy(apply(local_from_world, positions).astype(np.float32))
            layer.SetTimeSample(points.path, time, local)
            layer.SetTimeSample(extent.path, time, UsdGeom.PointBased.ComputeExtent(local))
        for blocked in BLOCKED:
            attribute = prim.GetAttribute(blocked)
            if attribute:
                over = Sdf.AttributeSpec(spec, blocked, attribute.GetTypeName())
                over.default = Sdf.ValueBlock()
        if prim.GetAttribute("normals").HasAuthoredValue():
            # Those of the first moment would be wrong at every other one.
            normals = Sdf.AttributeSpec(spec, "normals", Sdf.ValueTypeNames.Normal3fArray)
            normals.default = Sdf.ValueBlock()
        state = Sdf.AttributeSpec(spec, "garment:state", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform)
        state.default = "simulated"
    return layer


def _root(source: Source, target: Path, samples: str, times: Sequence[float]) -> Sdf.Layer:
    layer = Sdf.Layer.CreateAnonymous(f"root{target.suffix}")
    layer.subLayerPaths = [f"./{samples}", relative_asset(source.file, target.parent)]
    theirs = source.stage.GetRootLayer()
    layer.defaultPrim = theirs.defaultPrim
    for key in METADATA:
        if theirs.pseudoRoot.HasInfo(key):
            layer.pseudoRoot.SetInfo(key, theirs.pseudoRoot.GetInfo(key))
    layer.startTimeCode, layer.endTimeCode = times[0], times[-1]
    return layer
