#!/usr/bin/env python3
"""A dressed body in motion: garments simulated, and what they cross in every frame.

    DRESSFORM_PEERS=... motion.py DRESSED OUT [--frames 1000] [--only NAME ...] [--judge 50] [--settings JSON]

Walks in place: thighs and knees swing, arms swing, the spine turns; legs by up to 25 degrees, arms
by up to 20. Writes the animated stage and the simulation beside OUT, tells on stderr how far it is,
and prints one JSON object: CPU seconds a frame, what the simulation reports (after every frame it
looks for edges through triangles), and how many triangle pairs libigl with CGAL finds in every
fiftieth written frame (left out where DRESSFORM_PEERS names no folder).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from dressform.simulating import simulate
from dressform.usd.garment import read_outfit
from dressform.usd.motion import read_motion
from dressform.usd.stage import apply, open_stage
from fixtures import peer
from judges import split_by_panel
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

#: Joint (the end of its path), axis in the skeleton's space, amplitude [degrees], phase.
SWINGS = (
    ("upperleg01_L", (1, 0, 0), 25.0, 0.0),
    ("upperleg01_R", (1, 0, 0), 25.0, math.pi),
    ("lowerleg01_L", (1, 0, 0), 15.0, 0.5),
    ("lowerleg01_R", (1, 0, 0), 15.0, math.pi + 0.5),
    ("upperarm01_L", (1, 0, 0), 20.0, math.pi),
    ("upperarm01_R", (1, 0, 0), 20.0, 0.0),
    ("spine03", (0, 0, 1), 8.0, 0.3),
)
PERIOD = 26.0


def animate(dressed: Path, out: Path, frames: int, only: list[str]) -> None:
    """A layer over ``dressed`` with an animation of its skeleton, and ``only`` these garments if any."""
    layer = Sdf.Layer.CreateNew(str(out)) if not out.exists() else Sdf.Layer.FindOrOpen(str(out))
    layer.Clear()
    layer.subLayerPaths = [str(dressed.resolve())]
    theirs = Sdf.Layer.FindOrOpen(str(dressed))
    layer.defaultPrim = theirs.defaultPrim
    for key in ("upAxis", "metersPerUnit"):
        layer.pseudoRoot.SetInfo(key, theirs.pseudoRoot.GetInfo(key))
    stage = Usd.Stage.Open(layer)
    stage.SetTimeCodesPerSecond(24)
    skeleton = next(UsdSkel.Skeleton(p) for p in stage.Traverse() if p.IsA(UsdSkel.Skeleton))
    joints = [str(j) for j in skeleton.GetJointsAttr().Get()]
    topology = UsdSkel.Topology(joints)
    bind = [Gf.Matrix4d(m) for m in skeleton.GetBindTransformsAttr().Get()]
    parents = [topology.GetParent(j) for j in range(len(joints))]
    local = [m if p < 0 else m * bind[p].GetInverse() for m, p in zip(bind, parents, strict=True)]
    animation = UsdSkel.Animation.Define(stage, skeleton.GetPath().AppendChild("Walk"))
    animation.CreateJointsAttr(joints)
    rest = UsdSkel.DecomposeTransforms(Vt.Matrix4dArray(local))
    animation.CreateTranslationsAttr(rest[0])
    animation.CreateScalesAttr(rest[2])
    rotations = animation.CreateRotationsAttr()
    for frame in range(frames):
        posed = list(rest[1])
        for name, axis, degrees, phase in SWINGS:
            j = next(i for i, joint in enumerate(joints) if joint.endswith(name))
            angle = degrees * math.sin(2.0 * math.pi * frame / PERIOD + phase)
            turn = Gf.Rotation(Gf.Vec3d(*axis), angle)
            # About the skeleton's axes as they are in the bind pose, in the parent's frame.
            parent = bind[parents[j]].ExtractRotation() if parents[j] >= 0 else Gf.Rotation((1, 0, 0), 0)
            inside = parent.GetInverse().TransformDir(turn.GetAxis())
            local_turn = Gf.Quatf(Gf.Rotation(inside, angle).GetQuat())
            posed[j] = local_turn * posed[j]
        rotations.Set(Vt.QuatfArray(posed), frame)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    for garment in read_outfit(dressed).garments:
        if only and garment.name not in only:
            stage.OverridePrim(garment.path).SetActive(False)
    layer.Save()


def judge(moving: Path, simulated: Path, every: int) -> dict[str, Any]:
    """Triangle pairs with the body, lower garments and themselves in every so many written frames."""
    outfit, source, written = read_outfit(moving), open_stage(moving), open_stage(simulated)
    body = outfit.bodies[0]
    motion = read_motion(source, body)
    pairs = {"body": 0, "layer": 0, "self": 0}
    looked = range(0, len(motion.times), every)
    with tempfile.TemporaryDirectory() as folder:
        for frame in looked:
            below: list[Path] = []
            for garment in sorted(outfit.garments, key=lambda g: g.layer):
                prim = written.stage.GetPrimAtPath(garment.path)
                local = UsdGeom.PointBased(prim).GetPointsAttr().Get(motion.times[frame])
                points = apply(written.world_from_local(prim), np.array(local, dtype=np.float64))
                file = Path(folder) / f"{garment.name}.npz"
                np.savez(
                    file,
                    target_v=motion.points[motion.lead_in + frame],
                    body_f=body.triangles.astype(np.int64),
                    **split_by_panel(replace(garment, points=points)),
                )
                found = peer("judges.py", file, "--inner", *below)
                pairs["body"] += found["garment_body"]["pairs"]
                pairs["layer"] += sum(inner["pairs"] for inner in found["inner"])
                pairs["self"] += found["garment_self"]["pairs"]
                below.append(file)
    return {"frames": len(looked), "pairs": pairs}


def main() -> None:
    """Animates, simulates and judges."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dressed", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="garments; all by default")
    parser.add_argument("--judge", type=int, default=50, metavar="EVERY")
    parser.add_argument("--settings", type=json.loads, default={})
    options = parser.parse_args()
    moving = options.out.with_name(f"{options.out.stem}.moving.usda")
    animate(options.dressed, moving, options.frames, options.only)
    told = 0.0

    def tell(stage: str, share: float) -> None:
        nonlocal told
        if share >= told:
            print(f"{stage} {share:.0%}", file=sys.stderr, flush=True)
            told = share + 0.01

    before = resource.getrusage(resource.RUSAGE_SELF)
    found = simulate(moving, options.out, settings=options.settings, device="cpu", progress=tell)
    after = resource.getrusage(resource.RUSAGE_SELF)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    made = found["frames"] + found["lead_in"]
    result = {**found, "cpu_s_per_frame": round(spent / made, 2)}
    if os.environ.get("DRESSFORM_PEERS"):
        result["judged"] = judge(moving, options.out, options.judge)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
