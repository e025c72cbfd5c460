"""Panel coordinates: which attribute, which unit, and the turn to warp and weft.

A stage's panels lie in the (u, v) plane, seen from outside, grain up. Inside, x is the warp and
y the weft: with grain angle a (counter-clockwise from +v to the warp) the warp direction is
(-sin a, cos a) and the weft follows a quarter turn later, (-cos a, -sin a). That is a proper
rotation: for a = 0 it is x = v, y = -u. A swap of u and v would mirror every panel.
"""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from ..model import Floats, MeshOrigin, Panel, PatternOrigin
from .dialects import clo, physics
from .stage import Source

#: `st` is in millimetres unless something says otherwise.
MILLIMETRE = 1e-3
#: 3D over 2D length beyond which (or below whose inverse) the unit cannot be right.
WRONG_UNIT = 3.0
#: Units to prefer over the bare ratio, when one of them explains it this well.
KNOWN_UNITS = (1.0, 1e-1, 1e-2, 1e-3, 0.0254, 0.3048)
KNOWN_WITHIN = 1.25


def read_pattern(
    source: Source, prim: Usd.Prim, origin: MeshOrigin, points: Floats, primvar: str | None = None
) -> tuple[Floats, PatternOrigin]:
    """(u, v) of each triangle's corners in metres, shape [t, 3, 2], not yet turned.

    Looked for in this order: ``primvars:garment:pattern``, a flat rest shape of the physics
    dialects, ``primvars:st``, the only other set of texture coordinates.

    Args:
        points: world points, to judge the unit by.
        primvar: name of the primvar to read instead of looking for one.
    """
    own = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("garment:pattern").HasValue()
    rest = None if own or primvar else physics.rest_corners(source, prim, origin)
    if rest is not None:
        name, uv = rest
        unit, said = float(np.cbrt(abs(np.linalg.det(origin.world_from_local[:3, :3])))), True
    else:
        var = _primvar(source, prim, primvar)
        name = str(var.GetName())
        uv = _flattened(source, prim, var, origin)[origin.corner_of_triangle]
        unit, said = _unit(source, prim, var)
        scale = None if own else clo.rest_position_scale(prim)
        if scale is not None:
            uv, unit, said = uv * np.array(scale), source.frame.meters_per_unit, False
    corners = points[origin.face_vertex_indices[origin.corner_of_triangle]]
    return _in_metres(source, prim, corners, uv, PatternOrigin(name, unit, not said))


def _in_metres(
    source: Source, prim: Usd.Prim, corners: Floats, uv: Floats, said: PatternOrigin
) -> tuple[Floats, PatternOrigin]:
    """Applies the unit, or a better one where it was only assumed and cannot be right."""
    name, unit = said.attribute, said.meters_per_unit
    ratio = _length_ratio(corners, uv * unit)
    plausible = 1.0 / WRONG_UNIT < ratio < WRONG_UNIT
    inferred = said.inferred and not plausible
    if inferred and np.isfinite(ratio):
        better = _known_unit(unit * ratio)
        source.note(
            f"{name}: no unit is authored and {unit:g} m cannot be right (3D lengths are "
            f"{ratio:.3g} times those of the panels): {better:g} m was inferred",
            prim,
        )
        unit = better
    elif not plausible:
        source.note(
            f"{name}: lengths in 3D are {ratio:.3g} times those of the panels; the authored unit "
            f"of {unit:g} m stands",
            prim,
        )
    return uv * unit, PatternOrigin(name, unit, inferred)


def panel_from_uv(panels: list[Panel]) -> Floats:
    """What turns (u, v) to (warp, weft) in each panel, shape [panels, 2, 2].

    A rotation, but for panels that the stage shows from their inside: there the weft is turned
    over, so that every panel is seen from outside. Orthogonal, so the transpose turns back.
    """
    a = np.radians([panel.grain_angle for panel in panels])
    side = np.where([panel.mirrored for panel in panels], -1.0, 1.0)
    c, s = _exact(np.cos(a)), _exact(np.sin(a))
    return np.stack([np.stack([-s, c], -1), np.stack([-c * side, -s * side], -1)], -2)


def _exact(value: Floats) -> Floats:
    """Quarter turns without the rounding of pi."""
    return np.where(np.abs(value) < 1e-15, 0.0, value)


def _primvar(source: Source, prim: Usd.Prim, name: str | None) -> UsdGeom.Primvar:
    api = UsdGeom.PrimvarsAPI(prim)
    if name is not None:
        var = api.FindPrimvarWithInheritance(name.removeprefix("primvars:"))
        if not var.HasValue():
            raise source.bad("there is no such primvar", prim, name)
        return var
    for candidate in ("garment:pattern", "st"):
        var = api.FindPrimvarWithInheritance(candidate)
        if var.HasValue():
            return var
    others = [v for v in api.GetPrimvars() if v.HasValue() and _is_planar(v)]
    if len(others) == 1:
        source.note(f"{others[0].GetName()} is taken for the panels", prim)
        return others[0]
    message = "there are no panels: neither primvars:garment:pattern nor st is authored"
    if others:
        message += f" (and of {', '.join(v.GetName() for v in others)} none can be chosen)"
    raise source.bad(message, prim, "primvars:st")


def _is_planar(var: UsdGeom.Primvar) -> bool:
    return var.GetTypeName().role == "TextureCoordinate" and len(var.Get()[0:1]) == 1


def _flattened(source: Source, prim: Usd.Prim, var: UsdGeom.Primvar, origin: MeshOrigin) -> Floats:
    """The primvar's value at every face corner in metres-less units, shape [corners, 2]."""
    name = str(var.GetName())
    values = np.array(source.value(var.GetAttr()), dtype=np.float64)
    if values.ndim != 2 or values.shape[1] < 2:
        raise source.bad("panel coordinates need two components", prim, name)
    if var.IsIndexed():
        indices = np.array(source.value(var.GetIndicesAttr()), dtype=np.int64)
        out = np.flatnonzero((indices < 0) | (indices >= len(values)))
        if len(out):
            message = f"is {indices[out[0]]}, but there are {len(values)} values"
            raise source.bad(message, prim, f"{name}:indices", out[0])
        values, name = values[indices], f"{name}:indices"
    corners = origin.face_vertex_indices
    points = int(corners.max()) + 1
    kind = var.GetInterpolation()
    if kind == UsdGeom.Tokens.faceVarying:
        if len(values) != len(corners):
            message = f"{len(values)} values for {len(corners)} face corners"
            raise source.bad(message, prim, name)
    elif kind in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
        if len(values) < points:
            raise source.bad(f"{len(values)} values for {points} points", prim, name)
        values = values[corners]
    else:
        raise source.bad(f"interpolation {kind!r} cannot hold panels", prim, name)
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        raise source.bad("the panel coordinate is not finite", prim, name, bad[0])
    return values[:, :2]


def _unit(source: Source, prim: Usd.Prim, var: UsdGeom.Primvar) -> tuple[float, bool]:
    """Metres for one unit of the primvar, and whether the stage says so."""
    if var.GetPrimvarName() == "garment:pattern":
        return 1.0, True
    attribute = prim.GetAttribute("garment:stMetersPerUnit")
    authored = attribute.Get() if attribute and attribute.HasAuthoredValue() else None
    where = "garment:stMetersPerUnit"
    if authored is None:
        authored, where = prim.GetCustomDataByKey("stMetersPerUnit"), "customData:stMetersPerUnit"
    if authored is None:
        return MILLIMETRE, False
    if not isinstance(authored, (int, float)) or not np.isfinite(authored) or authored <= 0.0:
        raise source.bad(f"is {authored!r}, not a length above 0", prim, where)
    return float(authored), True


def _length_ratio(corners: Floats, uv: Floats) -> float:
    """Sum of the triangles' edge lengths in 3D over the same in 2D."""
    length = [np.linalg.norm(c - np.roll(c, 1, axis=1), axis=2).sum() for c in (corners, uv)]
    return float(length[0] / length[1]) if length[1] > 0.0 else float("inf")


def _known_unit(unit: float) -> float:
    best = min(KNOWN_UNITS, key=lambda known: abs(np.log(unit / known)))
    return best if abs(np.log(unit / best)) < np.log(KNOWN_WITHIN) else unit
