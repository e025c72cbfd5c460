#!/usr/bin/env python3
"""A dressed body in motion: garments simulated, with the simulation's own count of crossings.

    motion.py DRESSED OUT [FRAMES [SETTINGS]]

Walks in place: thighs and knees swing, arms swing, the spine turns; legs by up to 25 degrees, arms
by up to 20. Writes the animated stage and the simulation beside OUT, prints one JSON object: CPU
seconds a frame, and what the simulation reports. The written points are judged by nobody else.
"""

from __future__ import annotations

import json
import math
import resource
import sys
from pathlib import Path

from dressform.simulating import simulate
from pxr import Gf, Sdf, Usd, UsdSkel, Vt

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


def animate(dressed: Path, out: Path, frames: int) -> None:
    """A layer over ``dressed`` with an animation of its skeleton."""
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
    layer.Save()


def main() -> None:
    """Animates, simulates and judges."""
    dressed, out = Path(sys.argv[1]), Path(sys.argv[2])
    frames = int(sys.argv[3]) if len(sys.argv) > 3 else 1000
    settings = json.loads(sys.argv[4]) if len(sys.argv) > 4 else {}
    moving = out.with_name(f"{out.stem}.moving.usda")
    animate(dressed, moving, frames)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    found = simulate(moving, out, settings=settings, device="cpu")
    spent = resource.getrusage(resource.RUSAGE_SELF).ru_utime - before
    made = found["frames"] + found["lead_in"]
    print(json.dumps({**found, "cpu_s_per_frame": round(spent / made, 2)}))


if __name__ == "__main__":
    main()
