"""Skeletons: joints, parents and bind transforms in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdSkel

from ..model import Floats
from .stage import Source, matrix

#: A joint whose rest transform is further from its bind transform than this is worth a note [m].
REST_DIFFERS = 1e-3
#: Determinant below which a transform cannot be inverted.
SMALLEST_VOLUME = 1e-30


@dataclass
class SkeletonData:
    """A skeleton in its bind pose."""

    path: str
    joints: list[str]
    parents: list[int]
    #: World (metres, Y up) from the skeleton's space, shape [4, 4].
    world_from_skeleton: Floats
    #: World from joint in the bind pose, shape [j, 4, 4].
    world_from_joint: Floats


def bound_skeleton(source: Source, prim: Usd.Prim) -> Usd.Prim | None:
    """The skeleton that a mesh is bound to, on itself or inherited; None where there is none."""
    owner = prim
    while owner and not owner.IsPseudoRoot():
        rel = UsdSkel.BindingAPI(owner).GetSkeletonRel()
        if rel and rel.HasAuthoredTargets():
            targets = rel.GetForwardedTargets()
            if len(targets) > 1:
                names = ", ".join(f"<{t}>" for t in targets)
                raise source.bad(f"names several skeletons: {names}", owner, "skel:skeleton")
            return _target(source, owner, targets)
        owner = owner.GetParent()
    return None


def _target(source: Source, owner: Usd.Prim, targets: list[Sdf.Path]) -> Usd.Prim:
    skeleton = source.stage.GetPrimAtPath(targets[0]) if targets else None
    if not skeleton or not skeleton.IsA(UsdSkel.Skeleton):
        name = targets[0] if targets else "nothing"
        raise source.bad(f"points at <{name}>, which is no Skeleton", owner, "skel:skeleton")
    return skeleton


def read_skeleton(source: Source, prim: Usd.Prim) -> SkeletonData:
    """Joints in the order in which weights index them, with bind transforms in the world."""
    skeleton = UsdSkel.Skeleton(prim)
    joints = [str(j) for j in skeleton.GetJointsAttr().Get() or []]
    if not joints:
        raise source.bad("the skeleton has no joints", prim, "joints")
    topology = UsdSkel.Topology(joints)
    valid, reason = topology.Validate()
    if not valid:
        raise source.bad(f"the joints make no tree: {reason}", prim, "joints")
    bind = skeleton.GetBindTransformsAttr().Get()
    if bind is None or len(bind) != len(joints):
        found = 0 if bind is None else len(bind)
        message = f"{found} transforms for {len(joints)} joints"
        raise source.bad(message, prim, "bindTransforms")
    matrices = np.array(bind, dtype=np.float64).transpose(0, 2, 1)
    finite = np.isfinite(matrices).all(axis=(1, 2), keepdims=True)
    volume = np.linalg.det(np.where(finite, matrices, 0.0))
    broken = np.flatnonzero(np.abs(volume) < SMALLEST_VOLUME)
    if len(broken):
        raise source.bad("the transform cannot be inverted", prim, "bindTransforms", broken[0])
    world = source.world_from_local(prim)
    data = SkeletonData(
        path=str(prim.GetPath()),
        joints=joints,
        parents=[int(topology.GetParent(j)) for j in range(len(joints))],
        world_from_skeleton=world,
        world_from_joint=world @ matrices,
    )
    _note_rest(source, prim, data)
    return data


def _note_rest(source: Source, prim: Usd.Prim, data: SkeletonData) -> None:
    """Fitting happens in the bind pose: say so where the stage shows another one."""
    rest = UsdSkel.Skeleton(prim).GetRestTransformsAttr().Get()
    if rest is None or len(rest) != len(data.joints):
        return
    posed: list[Floats] = []
    for joint, parent in enumerate(data.parents):
        local = matrix(rest[joint])
        posed.append(local if parent < 0 else posed[parent] @ local)
    away = (data.world_from_skeleton @ np.array(posed))[:, :3, 3] - data.world_from_joint[:, :3, 3]
    worst = int(np.argmax(np.linalg.norm(away, axis=1)))
    if np.linalg.norm(away[worst]) > REST_DIFFERS:
        source.note(
            f"the rest pose differs from the bind pose (joint {data.joints[worst]!r}): "
            "the bind pose is taken",
            prim,
        )
