"""Seams as a stage authors them: pairs of points, from whichever dialect."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from ..model import AuthoredSeam
from .dialects import clo
from .marks import SEAM_PREFIX
from .stage import Source


def read_seams(source: Source, prim: Usd.Prim, point_count: int) -> list[AuthoredSeam]:
    """Authored seams in order of name; welded seams need no authoring and are not among them."""
    seams = [_ours(source, prim, name, point_count) for name in _names(prim)]
    for name, sewn in clo.sewing(prim):
        flat = _side(source, prim.GetChild(name), "indices", sewn, point_count)
        seams.append(AuthoredSeam(name, _tidy(flat.reshape(-1, 2))))
    return [seam for seam in seams if len(seam.pairs)]


def _names(prim: Usd.Prim) -> list[str]:
    names = {
        p.GetName().removeprefix(SEAM_PREFIX).rpartition(":")[0]
        for p in prim.GetAuthoredPropertiesInNamespace(SEAM_PREFIX.rstrip(":"))
    }
    return sorted(name for name in names if name)


def _ours(source: Source, prim: Usd.Prim, name: str, point_count: int) -> AuthoredSeam:
    sides = []
    for side in ("edgesA", "edgesB"):
        attribute = f"{SEAM_PREFIX}{name}:{side}"
        value = source.value(prim.GetAttribute(attribute))
        flat = np.array([] if value is None else value, dtype=np.int64)
        sides.append(_side(source, prim, attribute, flat, point_count))
    if len(sides[0]) != len(sides[1]):
        message = f"{len(sides[1])} indices, but edgesA has {len(sides[0])}"
        raise source.bad(message, prim, f"{SEAM_PREFIX}{name}:edgesB")
    offset = prim.GetAttribute(f"{SEAM_PREFIX}{name}:offset")
    laid_on = bool(offset) and offset.HasAuthoredValue()
    return AuthoredSeam(name, _tidy(np.stack(sides, axis=1)), laid_on)


def _side(
    source: Source, prim: Usd.Prim, attribute: str, flat: NDArray[np.int64], point_count: int
) -> NDArray[np.int64]:
    if len(flat) % 2:
        message = f"{len(flat)} indices make no edges of two points each"
        raise source.bad(message, prim, attribute)
    out = np.flatnonzero((flat < 0) | (flat >= point_count))
    if len(out):
        message = f"names point {flat[out[0]]}, but there are {point_count}"
        raise source.bad(message, prim, attribute, out[0])
    return flat


def _tidy(pairs: NDArray[np.int64]) -> NDArray[np.uint32]:
    """Each pair once, sorted, without points that are sewn to themselves."""
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    return np.unique(pairs, axis=0).astype(np.uint32).reshape(-1, 2)
