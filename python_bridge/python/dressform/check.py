"""``dressform check``: reads a stage as fitting would and says what it found.

Every part is read by itself, so that one report names as many problems as there are parts.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

from . import native
from .errors import BadInput
from .model import Character, GarmentSource
from .settings import Settings
from .usd.character import character_under, skinned_meshes
from .usd.garment import Bodies, read_garment
from .usd.marks import is_garment
from .usd.skeleton import bound_skeleton
from .usd.stage import Source, open_stage


def check(
    file: str | os.PathLike[str],
    variants: Mapping[str, Mapping[str, str]] | None = None,
    settings: Settings | None = None,
) -> dict[str, Any]:
    """Reads and validates a stage: an outfit, a character or both.

    Returns:
        ``ok`` (False if a problem is an error), ``file``, ``up_axis``, ``meters_per_unit``,
        ``bodies``, ``skeletons``, ``garments`` (with ``panels``, ``seams`` and, under ``proxy``,
        which panels a fit with these settings would not simulate) and ``problems``,
        each with ``severity`` (``error`` or ``warning``), ``file``, ``prim``, ``attribute``,
        ``element`` and ``message``. Plain data, ready for JSON; lengths in metres.
    """
    report: dict[str, Any] = {
        "ok": False,
        "file": os.fspath(file),
        "up_axis": None,
        "meters_per_unit": None,
        "bodies": [],
        "skeletons": [],
        "garments": [],
        "problems": [],
    }
    try:
        source = open_stage(file, variants)
    except BadInput as error:
        report["problems"].append(_error(error))
        return report
    report["up_axis"] = source.frame.up_axis
    report["meters_per_unit"] = source.frame.meters_per_unit
    errors = _Errors()
    report["skeletons"] = _skeletons(source)
    report["garments"] = _garments(source, errors, (settings or Settings()).core_json())
    report["bodies"] = _bodies(source, errors)
    if not (report["bodies"] or report["garments"] or errors.found):
        errors.found.append(BadInput("there is neither a body nor a garment", file=source.file))
    warnings = [_warning(source, note) for note in source.notes]
    report["problems"] = [_error(error) for error in errors.found] + warnings
    report["ok"] = not errors.found
    return report


class _Errors:
    """Errors met so far, each once."""

    def __init__(self) -> None:
        self.found: list[BadInput] = []

    def attempt(self, read: Any, *arguments: Any) -> Any:
        """The result, or None after keeping the error."""
        try:
            return read(*arguments)
        except BadInput as error:
            if str(error) not in [str(e) for e in self.found]:
                self.found.append(error)
            return None


def _skeletons(source: Source) -> list[dict[str, Any]]:
    found = []
    for prim in source.prims():
        if prim.IsA(UsdSkel.Skeleton):
            joints = UsdSkel.Skeleton(prim).GetJointsAttr().Get() or []
            found.append({"path": str(prim.GetPath()), "joints": len(joints)})
    return found


def _garments(source: Source, errors: _Errors, settings: str) -> list[dict[str, Any]]:
    bodies = Bodies(source, None)
    found = []
    for prim in [p for p in source.prims() if is_garment(p)]:
        body = errors.attempt(bodies.of, prim)
        points = None if body is None else bodies.found[body].points
        garment = errors.attempt(read_garment, source, prim, points)
        if garment is not None:
            path = None if body is None else bodies.found[body].path
            proxy = errors.attempt(_proxy, source, garment, settings)
            found.append({**_garment(prim, garment, path), "proxy": proxy})
    return found


def _proxy(source: Source, garment: GarmentSource, settings: str) -> dict[str, Any]:
    try:
        info = native.proxy_info(garment, settings)
    except BadInput as error:
        raise type(error)(
            error.message.removeprefix(f"{garment.path}: "), file=source.file, prim=garment.path
        ) from None
    return {key: info[key] for key in ("left_out", "shell_after_all")}


def _garment(prim: Usd.Prim, garment: GarmentSource, body: str | None) -> dict[str, Any]:
    state = prim.GetAttribute("garment:state").Get()
    origin, pattern = garment.origin, garment.pattern_origin
    return {
        "name": garment.name,
        "path": garment.path,
        "state": str(state) if state else "authored",
        "layer": garment.layer,
        "body": body,
        "points": len(garment.points),
        "faces": len(origin.face_vertex_counts) if origin else 0,
        "triangles": len(garment.triangles),
        "pattern": None if pattern is None else vars(pattern).copy(),
        "panels": _panels(garment),
        "seams": [{"name": s.name, "pairs": len(s.pairs), "offset": s.offset} for s in garment.seams],
        "welded_seam_points": _welded(garment),
    }


def _panels(garment: GarmentSource) -> list[dict[str, Any]]:
    a = garment.corner_pattern[:, 1] - garment.corner_pattern[:, 0]
    b = garment.corner_pattern[:, 2] - garment.corner_pattern[:, 0]
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2.0
    return [
        {
            "name": panel.name,
            "label": panel.label,
            "triangles": int((garment.panel_of_triangle == i).sum()),
            "area_m2": float(area[garment.panel_of_triangle == i].sum()),
            "fabric": panel.fabric.preset,
            "grain_angle": panel.grain_angle,
        }
        for i, panel in enumerate(garment.panels)
    ]


def _welded(garment: GarmentSource) -> int:
    """Points with several panel positions: seams that are welded in 3D."""
    cell = np.round(garment.corner_pattern / 1e-6).astype(np.int64)
    panel = np.repeat(garment.panel_of_triangle.astype(np.int64), 3)
    key = np.column_stack([garment.triangles.ravel().astype(np.int64), panel, cell.reshape(-1, 2)])
    _, times = np.unique(np.unique(key, axis=0)[:, 0], return_counts=True)
    return int((times > 1).sum())


def _bodies(source: Source, errors: _Errors) -> list[dict[str, Any]]:
    """The largest skinned mesh of each skeleton."""
    largest: dict[str, Usd.Prim] = {}
    for mesh in skinned_meshes(source, source.stage.GetPseudoRoot()):
        skeleton = errors.attempt(bound_skeleton, source, mesh)
        key = str(skeleton.GetPath()) if skeleton else f"none of {mesh.GetPath()}"
        if key not in largest or _size(mesh) > _size(largest[key]):
            largest[key] = mesh
    found = []
    for mesh in largest.values():
        character = errors.attempt(character_under, source, mesh, str(mesh.GetPath()))
        if character is not None:
            found.append(_body(character))
    return found


def _size(mesh: Usd.Prim) -> int:
    return len(UsdGeom.Mesh(mesh).GetPointsAttr().Get() or [])


def _body(character: Character) -> dict[str, Any]:
    return {
        "path": character.path,
        "points": len(character.points),
        "triangles": len(character.triangles),
        "skeleton": character.skeleton_path,
        "joints": len(character.joints),
        "influences": character.skin_influences,
        "height_m": float(np.ptp(character.points[:, 1])),
    }


def _error(error: BadInput) -> dict[str, Any]:
    return {
        "severity": "error",
        "file": error.file,
        "prim": error.prim,
        "attribute": error.attribute,
        "element": error.element,
        "message": error.message,
    }


def _warning(source: Source, note: str) -> dict[str, Any]:
    prim, message = "", note
    if note.startswith("<") and ">: " in note:
        prim, message = note[1:].split(">: ", 1)
    return {
        "severity": "warning",
        "file": source.file,
        "prim": prim,
        "attribute": "",
        "element": None,
        "message": message,
    }
