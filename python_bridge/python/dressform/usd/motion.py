"""A character's body over time: skinned by its skeleton's animation.

The garments of a dressed stage are on the body in its bind pose. An animation begins elsewhere, so
a lead-in comes before it: joint by joint from the bind pose to the animation's first frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

from ..model import Character, Floats
from .stage import Source, apply, matrix


@dataclass
class BodyMotion:
    """A body at every frame."""

    #: Points of the body [m], world, shape [frames, n, 3]: the bind pose, the lead-in, the animation.
    points: Floats
    #: World from world of the bind pose at the first time, shape [4, 4]: where the motion begins.
    world_from_bind: Floats
    #: Frames before the animation's first.
    lead_in: int
    #: Time codes of the animation's frames.
    times: list[float]
    #: Seconds from a frame to the next.
    seconds_per_frame: float


def read_motion(
    source: Source,
    character: Character,
    *,
    start: float | None = None,
    end: float | None = None,
    step: float = 1.0,
    lead_in: int = 24,
) -> BodyMotion:
    """The body of an open stage over its animation.

    Args:
        source: the stage that ``character`` was read from.
        character: its body, in the bind pose.
        start: first time code; the animation's first by default.
        end: last time code.
        step: time codes from frame to frame.
        lead_in: frames from the bind pose to the first.

    Raises:
        BadInput: there is no animation, or its transforms are not finite.
    """
    stage = source.stage
    prim = stage.GetPrimAtPath(character.skeleton_path)
    skeleton = _query(source, prim)
    samples = skeleton.GetAnimQuery().GetJointTransformTimeSamples() if skeleton.GetAnimQuery() else []
    if not samples:
        raise source.bad("its skeleton is not animated (no time samples at skel:animationSource)", prim)
    first = samples[0] if start is None else start
    last = samples[-1] if end is None else end
    times = [float(t) for t in np.arange(first, last + 0.5 * step, step)]
    bind = np.array(UsdSkel.Skeleton(prim).GetBindTransformsAttr().Get(), dtype=np.float64)
    inverse = np.linalg.inv(bind)
    at_bind = source.world_from_local(prim)
    in_skeleton = apply(np.linalg.inv(at_bind).astype(np.float64), character.points)

    def world(time: float) -> Floats:
        local = UsdGeom.XformCache(Usd.TimeCode(time)).GetLocalToWorldTransform(prim)
        return source.frame.world_from_stage @ matrix(local)

    def posed(transforms: NDArray[np.float64], world_from_skeleton: Floats, time: float) -> Floats:
        if not np.isfinite(transforms).all():
            raise source.bad(f"the pose at time {time:g} is not finite", prim)
        skinning = (inverse @ transforms).transpose(0, 2, 1)
        return apply(world_from_skeleton, _skinned(character, in_skeleton, skinning))

    begin = world(times[0])
    frames = [apply(begin, in_skeleton)]
    for pose in _lead_in(skeleton, bind, times[0], lead_in):
        frames.append(posed(pose, begin, times[0]))
    for time in times:
        transforms = np.array(skeleton.ComputeJointSkelTransforms(Usd.TimeCode(time)), dtype=np.float64)
        frames.append(posed(transforms, world(time), time))
    rate = stage.GetTimeCodesPerSecond()
    return BodyMotion(
        points=np.stack(frames),
        world_from_bind=begin @ np.linalg.inv(at_bind),
        lead_in=len(frames) - len(times),
        times=times,
        seconds_per_frame=step / rate,
    )


def _query(source: Source, prim: Usd.Prim) -> UsdSkel.SkeletonQuery:
    cache = UsdSkel.Cache()
    root = UsdSkel.Root.Find(prim)
    if root:
        cache.Populate(root, Usd.TraverseInstanceProxies())
    query = cache.GetSkelQuery(UsdSkel.Skeleton(prim))
    if not query:
        raise source.bad("the skeleton cannot be evaluated", prim)
    # The query reads from the cache, which must live as long.
    query.cache = cache
    return query


def _lead_in(
    skeleton: UsdSkel.SkeletonQuery, bind: Floats, time: float, frames: int
) -> list[NDArray[np.float64]]:
    """Skeleton-space transforms between the bind pose and the pose at ``time``, both left out."""
    topology = skeleton.GetTopology()
    parents = [topology.GetParent(j) for j in range(len(bind))]
    local = np.array([b if p < 0 else b @ np.linalg.inv(bind[p]) for b, p in zip(bind, parents, strict=True)])
    there = skeleton.ComputeJointLocalTransforms(Usd.TimeCode(time))
    here = Vt.Matrix4dArray([Gf.Matrix4d(*m.ravel().tolist()) for m in local])
    (t0, r0, s0), (t1, r1, s1) = (UsdSkel.DecomposeTransforms(x) for x in (here, there))
    poses = []
    for i in range(1, frames):
        x = i / frames
        w = x * x * (3.0 - 2.0 * x)
        mixed = UsdSkel.MakeTransforms(
            Vt.Vec3fArray([a + (b - a) * w for a, b in zip(t0, t1, strict=True)]),
            Vt.QuatfArray([Gf.Slerp(w, a, b) for a, b in zip(r0, r1, strict=True)]),
            Vt.Vec3hArray([a + (b - a) * w for a, b in zip(s0, s1, strict=True)]),
        )
        poses.append(np.array(UsdSkel.ConcatJointTransforms(topology, mixed), dtype=np.float64))
    return poses


def _skinned(character: Character, points: Floats, skinning: Floats) -> Floats:
    """Linear blend skinning; ``skinning`` are column-vector matrices, shape [j, 4, 4]."""
    k = character.skin_influences
    indices = np.reshape(character.joint_indices, (-1, k)).astype(np.int64)
    weights = np.reshape(character.joint_weights, (-1, k))
    out = np.zeros_like(points)
    for i in range(k):
        m = skinning[indices[:, i]]
        moved = np.einsum("nij,nj->ni", m[:, :3, :3], points) + m[:, :3, 3]
        out += weights[:, i : i + 1] * moved
    return out
