"""Skin weights: mesh-local joint orders, constant bindings and sums that are off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdSkel

from ..model import Floats, Indices
from .stage import Source, matrix

#: Weights whose sum is further from 1 than this get a note; all are normalised.
SUM_TOLERANCE = 1e-3
#: Below this there is nothing to normalise.
NO_WEIGHT = 1e-6

INDICES = "primvars:skel:jointIndices"
WEIGHTS = "primvars:skel:jointWeights"


def is_skinned(prim: Usd.Prim) -> bool:
    """Whether the mesh carries joint weights, on itself or inherited."""
    find = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance
    return bool(find("skel:jointIndices").HasValue() and find("skel:jointWeights").HasValue())


def geom_bind_transform(prim: Usd.Prim) -> Floats:
    """Skeleton space from the mesh's space at bind time, shape [4, 4]."""
    value = UsdSkel.BindingAPI(prim).GetGeomBindTransformAttr().Get()
    return np.eye(4) if value is None else matrix(value)


def read_skin(
    source: Source, prim: Usd.Prim, point_count: int, joints: list[str]
) -> tuple[int, Indices, Floats]:
    """Influences for each point, indices into ``joints`` and weights that sum to 1, [n * k]."""
    find = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance
    index_var, weight_var = find("skel:jointIndices"), find("skel:jointWeights")
    k = max(index_var.GetElementSize(), 1)
    if weight_var.GetElementSize() != index_var.GetElementSize():
        message = f"elementSize {weight_var.GetElementSize()}, but jointIndices have {k}"
        raise source.bad(message, prim, WEIGHTS)
    indices = np.array(index_var.ComputeFlattened(source.time_of(index_var.GetAttr())), np.int64)
    weights = np.array(weight_var.ComputeFlattened(source.time_of(weight_var.GetAttr())), np.float64)
    constant = index_var.GetInterpolation() == UsdGeom.Tokens.constant
    expected = k if constant else point_count * k
    for name, array in ((INDICES, indices), (WEIGHTS, weights)):
        if array.shape != (expected,):
            message = f"{array.size} values, {expected} expected (elementSize {k})"
            raise source.bad(message, prim, name)
    if constant:
        indices, weights = np.tile(indices, point_count), np.tile(weights, point_count)
    indices = _to_skeleton(source, prim, indices, joints)
    weights = _normalised(source, prim, weights.reshape(-1, k))
    return k, indices.astype(np.uint32), weights.ravel()


def _to_skeleton(
    source: Source, prim: Usd.Prim, indices: NDArray[np.int64], joints: list[str]
) -> NDArray[np.int64]:
    """Through the mesh's own ``skel:joints``, where it has them."""
    own = UsdSkel.BindingAPI(prim).GetJointsAttr().Get()
    names = [str(j) for j in own] if own is not None and len(own) else joints
    out = np.flatnonzero((indices < 0) | (indices >= len(names)))
    if len(out):
        message = f"names joint {indices[out[0]]}, but there are {len(names)}"
        raise source.bad(message, prim, INDICES, out[0])
    if names is joints:
        return indices
    return np.array(_places(source, prim, names, joints), dtype=np.int64)[indices]


def _places(source: Source, prim: Usd.Prim, names: list[str], joints: list[str]) -> list[int]:
    """Where each of the mesh's joints stands in the skeleton: by its path or, where the paths
    differ (another root, a namespace left out), by a name that only one joint of the skeleton has."""
    by_path = {joint: i for i, joint in enumerate(joints)}
    by_name: dict[str, list[int]] = {}
    for i, joint in enumerate(joints):
        by_name.setdefault(joint.rpartition("/")[2], []).append(i)
    places, by_name_alone = [], []
    for i, joint in enumerate(names):
        same_name = by_name.get(joint.rpartition("/")[2], [])
        if joint in by_path:
            places.append(by_path[joint])
        elif len(same_name) == 1:
            places.append(same_name[0])
            by_name_alone.append(joint)
        else:
            what = "is several times in the skeleton" if same_name else "is not in the skeleton"
            raise source.bad(f"joint {joint!r} {what}", prim, "skel:joints", i)
    if by_name_alone:
        source.note(
            f"skel:joints: {len(by_name_alone)} joints were found in the skeleton by name alone "
            f"({by_name_alone[0]!r})",
            prim,
        )
    return places


def _normalised(source: Source, prim: Usd.Prim, weights: Floats) -> Floats:
    bad = np.flatnonzero(~np.isfinite(weights).all(axis=1) | (weights < 0.0).any(axis=1))
    if len(bad):
        message = f"the weights of point {bad[0]} are not all finite and positive: {weights[bad[0]]}"
        raise source.bad(message, prim, WEIGHTS, bad[0] * weights.shape[1])
    total = weights.sum(axis=1)
    empty = np.flatnonzero(total < NO_WEIGHT)
    if len(empty):
        message = f"the weights of point {empty[0]} sum to {total[empty[0]]:.3g}, not 1"
        raise source.bad(message, prim, WEIGHTS, empty[0] * weights.shape[1])
    off = np.abs(total - 1.0)
    if off.max() > SUM_TOLERANCE:
        worst = int(off.argmax())
        count = int((off > SUM_TOLERANCE).sum())
        source.note(
            f"{WEIGHTS}: {count} points do not sum to 1 (point {worst}: {total[worst]:.6g}): "
            "they were normalised",
            prim,
        )
    return weights / total[:, None]
