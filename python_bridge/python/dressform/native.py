"""Between the data classes of :mod:`dressform.model` and the Rust core's dictionaries."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native
from .model import (
    AuthoredSeam,
    BlendShape,
    Character,
    Collider,
    DressedGarment,
    Fabric,
    Floats,
    GarmentSource,
    Indices,
    Outfit,
    Panel,
)
from .settings import Settings, parse

#: Called with the stage's name and the fraction of it that is done, 0 to 1.
Progress = Callable[[str, float], None]

#: Fields that only reading and writing stages need; the core never sees them.
_BOOKKEEPING = {"origin", "pattern_origin", "notes", "file", "frame", "variants"}
_RECORDS = (AuthoredSeam, BlendShape, Character, Collider, Fabric, GarmentSource, Outfit, Panel)


@dataclass
class Draped:
    """A draped garment."""

    #: Points of the source mesh [m], shape [n, 3].
    points: Floats
    #: The drape's account, by the report's names (``drape`` in a fit's report).
    info: dict[str, Any]


@dataclass
class Fitted:
    """What the core gives back: arrays for each garment, and the report."""

    garments: list[DressedGarment]
    report: dict[str, Any]


def fit_arrays(
    outfit: Outfit,
    character: Character,
    settings_json: str = "{}",
    device: str = "auto",
    progress: Progress | None = None,
    cache: str | None = None,
) -> Fitted:
    """Fits an outfit to a character: arrays in and out, no USD.

    Args:
        outfit: garments on their source bodies, metres, Y up.
        character: the target.
        settings_json: settings that differ from the defaults, as JSON.
        device: ``auto``, ``cpu``, ``gpu`` or a part of an adapter's name.
        progress: called from this thread while the core runs.
        cache: a folder that keeps the flows between bodies for other processes.

    Raises:
        BadInput: arrays that do not fit together; names garment, field and element.
        BadSettings: an unknown key or a wrong value.
        NoDevice: no such device, or it failed.
        InternalFault: a bug of the core.
    """
    answer = _native.fit(record(outfit), record(character), settings_json, device, progress, cache)
    weights = {shape.name: shape.weight for shape in character.blend_shapes}
    return Fitted([_dressed(g, weights) for g in answer["garments"]], json.loads(answer["report"]))


def simulate_arrays(
    outfit: Outfit,
    character: Character,
    body: Floats,
    seconds_per_frame: float,
    settings_json: str = "{}",
    device: str = "auto",
    progress: Progress | None = None,
) -> tuple[list[NDArray[np.float32]], dict[str, Any]]:
    """Simulates a dressed outfit on a body in motion: arrays in and out, no USD.

    Args:
        outfit: dressed garments on the body at the first frame, metres, Y up.
        character: the character.
        body: its points at every frame [m], shape [frames, points, 3].
        seconds_per_frame: time from a frame to the next [s].
        settings_json: settings that differ from the defaults, as JSON.
        device: ``auto``, ``cpu``, ``gpu`` or a part of an adapter's name.
        progress: called from this thread while the core runs.

    Returns:
        Each garment's points [m], shape [frames, points, 3], and the report.

    Raises:
        BadInput: arrays that do not fit together.
        BadSettings: an unknown key or a wrong value.
        NoDevice: no such device, or it failed.
        InternalFault: a bug of the core.
    """
    body = np.ascontiguousarray(body, dtype=np.float64)
    answer = _native.simulate(
        record(outfit), record(character), body, seconds_per_frame, settings_json, device, progress
    )
    report = {"device": answer["device"], "garments": json.loads(answer["garments"])}
    return answer["frames"], report


def drape_arrays(
    garment: GarmentSource,
    points: Floats | None = None,
    *,
    corner_pattern: Floats | None = None,
    colliders: Sequence[tuple[Floats, Indices]] = (),
    layers: Sequence[tuple[Floats, Indices]] = (),
    pinned: Sequence[int] = (),
    settings: Settings | Mapping[str, Any] | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> Draped:
    """Drapes one garment over surfaces: the drape stage of a fit by itself, no USD.

    Args:
        garment: the garment on its source body, metres, Y up.
        points: where it starts [m], shape [n, 3]; where its source has it by default.
        corner_pattern: its panels [m], shape [t, 3, 2]; those of the source by default.
        colliders: solids as (points, triangles), closed or not; eyes and teeth are best left out.
        layers: finished lower garments, triangles facing outward.
        pinned: points that stay where they start.
        settings: of a fit; the table ``drape`` is what counts.
        device: ``auto``, ``cpu``, ``gpu`` or a part of an adapter's name.
        progress: called from this thread while the core runs.

    Raises:
        BadInput: arrays that do not fit together; names garment, field and element.
        BadSettings: an unknown key or a wrong value.
        NoDevice: no such device, or it failed.
        InternalFault: a bug of the core.
    """
    chosen = settings if isinstance(settings, Settings) else parse(settings or {})
    meshes = [[{"points": p, "triangles": t} for p, t in group] for group in (colliders, layers)]
    scene = {
        "points": garment.points if points is None else points,
        "corner_pattern": corner_pattern,
        "colliders": meshes[0],
        "layers": meshes[1],
        "pinned": np.asarray(pinned, dtype=np.uint32),
    }
    alone = replace(garment, body=0)  # it is told apart from its body here
    answer = _native.drape(record(alone), scene, chosen.core_json(), device, progress)
    return Draped(answer["points"], json.loads(answer["info"]))


def winding_numbers(points: Floats, triangles: Indices, queries: Floats) -> Floats:
    """Hierarchical winding numbers of a mesh around ``queries`` [m], shape [q].

    1 inside and 0 outside of a closed mesh, in between near the holes of an open one; within 1e-3 of
    the sum of solid angles.
    """
    mesh = {"points": points, "triangles": triangles}
    numbers: Floats = _native.winding_numbers(mesh, {"points": queries})
    return numbers


def grid_distances(
    points: Floats,
    triangles: Indices,
    queries: Floats,
    *,
    threshold: float = 0.5,
    spacing: float = 5e-3,
    band: float = 2e-2,
) -> Floats:
    """Signed distances [m] of a narrow-band grid, negative inside; NaN outside of the band.

    Inside is where the winding number exceeds ``threshold``: 0.5 for closed meshes, 0.25 for garments.
    """
    mesh = {"points": points, "triangles": triangles}
    values: Floats = _native.grid_distances(mesh, {"points": queries}, threshold, spacing, band)
    return values


def intersections(points: Floats, triangles: Indices, other: tuple[Floats, Indices] | None = None) -> Indices:
    """Pairs of triangles that intersect, by exact predicates, shape [k, 2]: of two meshes or, without
    ``other``, of one with itself (pairs that share points count if they meet beyond what they share).
    """
    second = None if other is None else {"points": other[0], "triangles": other[1]}
    pairs: Indices = _native.intersections({"points": points, "triangles": triangles}, second)
    return pairs


def outer_skin(points: Floats, triangles: Indices) -> tuple[Floats, Indices]:
    """The part of a body that cloth can lie on: without eyes, teeth and tongue, and without skin
    inside of the body where it crosses itself. Points [m], shape [n, 3], and triangles.
    """
    skin = _native.outer_skin({"points": points, "triangles": triangles})
    return skin["points"], skin["triangles"]


def record(value: Any) -> Any:
    """A data class as a dictionary, arrays untouched and bookkeeping left out."""
    if isinstance(value, _RECORDS):
        names = (f.name for f in fields(value) if f.name not in _BOOKKEEPING)
        return {name: record(getattr(value, name)) for name in names}
    if isinstance(value, list):
        return [record(v) for v in value]
    return value


@dataclass
class Refitted:
    """A refitted pattern and what the refit says about it."""

    #: Panel coordinates of each triangle's corners [m], shape [t, 3, 2].
    corner_pattern: Any
    #: By the names of the report's ``pattern``.
    report: dict[str, Any]
    #: Wall time of the refit alone.
    seconds: float


def refit_arrays(garment: GarmentSource, points: Any, settings_json: str = "{}") -> Refitted:
    """Refits a garment's pattern to its mesh's points on another body; no body is needed.

    Args:
        garment: the garment on its source.
        points: where its points are now [m], shape [n, 3].
        settings_json: settings that differ from the defaults, as JSON.

    Raises:
        BadInput: arrays that do not fit together.
        BadSettings: an unknown key or a wrong value.
    """
    alone = replace(garment, body=0)
    answer = _native.refit(record(alone), points, settings_json)
    return Refitted(answer["corner_pattern"], json.loads(answer["report"]), answer["seconds"])


def body_girths(character: Character) -> dict[str, Any]:
    """A body's girths by name (``thigh_left``): their length ``girth_m`` [m] and where the tape lies
    (``origin``, ``normal``), or why one was not found."""
    girths: dict[str, Any] = _native.body_girths(record(character))
    return girths


def proxy_info(garment: GarmentSource, settings_json: str = "{}") -> dict[str, Any]:
    """Which panels a fit would leave out of its simulation and why, by the report's names.

    Raises:
        BadInput: no panel would be left, or a detail has no proxy near.
    """
    alone = replace(garment, body=0)  # which body it was made on does not matter here
    info: dict[str, Any] = json.loads(_native.proxy_json(record(alone), settings_json))
    return info


@dataclass
class SkinnedMesh:
    """A mesh that hangs on a character's skeleton, in its bind pose."""

    #: World, metres, Y up, shape [n, 3].
    points: Floats
    #: Shape [t, 3].
    triangles: Indices
    #: Influences for each point, k.
    skin_influences: int
    #: Shape [n * k], indices into the character's joints.
    joint_indices: Indices
    #: Shape [n * k]; every point's weights sum to 1.
    joint_weights: Floats


def poses(character: Character) -> dict[str, Floats]:
    """The poses of the posed check that a skeleton allows.

    Returns:
        By name, the skinning matrix of every joint (world from bind pose to pose), shape [j, 4, 4].

    Raises:
        BadInput: the skeleton is no tree.
    """
    return _native.poses(record(character))


def posed_check(
    character: Character,
    meshes: Sequence[SkinnedMesh],
    settings_json: str = "{}",
    poses: dict[str, Floats] | None = None,
) -> list[list[dict[str, Any]]]:
    """How skinned meshes follow a character's body: the certificate's ``posed`` for weights of any source.

    Args:
        character: whose body it is.
        meshes: what hangs on it.
        settings_json: settings that differ from the defaults, as JSON: ``{"posed": {...}}``.
        poses: other poses than the check's own, as :func:`poses` gives them.

    Returns:
        For each mesh, the figures of every pose (keys of ``dressform.result.PoseReport``).

    Raises:
        BadInput: arrays that do not fit together.
        BadSettings: ``posed.poses`` names no pose.
    """
    own = None if poses is None else [(n, np.ascontiguousarray(m, np.float64)) for n, m in poses.items()]
    answer = _native.posed_json(record(character), [vars(m) for m in meshes], settings_json, own)
    figures: list[list[dict[str, Any]]] = json.loads(answer)
    return figures


def _dressed(garment: dict[str, Any], shape_weights: dict[str, float]) -> DressedGarment:
    report = json.loads(garment["report"])
    return DressedGarment(
        points=garment["points"],
        corner_pattern=garment["corner_pattern"],
        joint_indices=garment["joint_indices"],
        joint_weights=garment["joint_weights"],
        influences=garment["influences"],
        certificate=report["certificate"],
        blend_shapes=[BlendShape(**s, weight=shape_weights[s["name"]]) for s in garment["blend_shapes"]],
    )


def version() -> str:
    """The core's version."""
    return _native.version
