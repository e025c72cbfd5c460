"""Between the data classes of :mod:`dressform.model` and the Rust core's dictionaries."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
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

#: Called with the stage's name and the fraction of it that is done, 0 to 1.
Progress = Callable[[str, float], None]

#: Fields that only reading and writing stages need; the core never sees them.
_BOOKKEEPING = {"origin", "pattern_origin", "notes", "file", "frame", "variants"}
_RECORDS = (AuthoredSeam, BlendShape, Character, Collider, Fabric, GarmentSource, Outfit, Panel)


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
    character: Character, meshes: Sequence[SkinnedMesh], settings_json: str = "{}"
) -> list[list[dict[str, Any]]]:
    """How skinned meshes follow a character's body: the certificate's ``posed`` for weights of any source.

    Returns:
        For each mesh, the figures of every pose (keys of ``dressform.result.PoseReport``).

    Raises:
        BadInput: arrays that do not fit together.
        BadSettings: ``posed.poses`` names no pose.
    """
    answer = _native.posed_json(record(character), [vars(m) for m in meshes], settings_json)
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
