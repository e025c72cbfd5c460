"""Skin weights for any sewn mesh on a skinned body: arrays in and out, no USD."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from .model import Character, Floats, Indices
from .native import record

PreparedBody = _native.PreparedBody


@dataclass
class Rigged:
    """Skin weights of a mesh's points."""

    #: Influences for each point, k.
    influences: int
    #: Shape [n, k], indices into the character's joints; the largest weight first.
    joint_indices: Indices
    #: Shape [n, k]; every point's weights sum to 1.
    joint_weights: Floats
    #: The report's ``rig`` object.
    report: dict[str, Any]

    def dense(self, joint_count: int) -> Floats:
        """Weights over all joints, shape [n, joint_count]."""
        weights = np.zeros((len(self.joint_weights), joint_count))
        rows = np.arange(len(weights))[:, None]
        np.add.at(weights, (rows, self.joint_indices.astype(np.int64)), self.joint_weights)
        return weights


def prepare_body(character: Character) -> PreparedBody:
    """What every garment on one character needs: made once, used often.

    Raises:
        BadInput: arrays that do not fit together; names the field and the element.
    """
    return _native.PreparedBody(record(character))


def rig_arrays(
    body: Character | PreparedBody,
    points: ArrayLike,
    triangles: ArrayLike,
    seams: ArrayLike | None = None,
    settings_json: str = "{}",
) -> Rigged:
    """Skin weights for cloth as it lies on a body (paper section 7).

    Args:
        body: the character in its bind pose, or what :func:`prepare_body` made of it.
        points: shape [n, 3], metres, Y up, in the world of the body.
        triangles: shape [m, 3].
        seams: pairs of points that get the same weights, shape [s, 2].
        settings_json: settings that differ from the defaults, as JSON: ``{"rig": {...}}``.

    Raises:
        BadInput: arrays that do not fit together; names field and element.
        BadSettings: an unknown key or a wrong value.
        InternalFault: a bug of the core.
    """
    answer = _native.rig(_prepared(body), _cloth(points, triangles, seams), settings_json)
    k = answer["influences"]
    return Rigged(
        influences=k,
        joint_indices=answer["joint_indices"].reshape(-1, k),
        joint_weights=answer["joint_weights"].reshape(-1, k),
        report=json.loads(answer["report"]),
    )


def match_arrays(
    body: Character | PreparedBody,
    points: ArrayLike,
    triangles: ArrayLike,
    seams: ArrayLike | None = None,
    settings_json: str = "{}",
) -> tuple[NDArray[np.bool_], Floats]:
    """The search of :func:`rig_arrays` alone: which points have a match, and where it is.

    Returns:
        A flag for each point, and body points, shape [n, 3] (not a number without a match) [m].
    """
    answer = _native.rig_matches(_prepared(body), _cloth(points, triangles, seams), settings_json)
    return answer["matched"], answer["points"]


def _prepared(body: Character | PreparedBody) -> PreparedBody:
    return prepare_body(body) if isinstance(body, Character) else body


def _cloth(points: ArrayLike, triangles: ArrayLike, seams: ArrayLike | None) -> dict[str, Any]:
    none = np.zeros((0, 2), dtype=np.int64)
    return {
        "points": np.asarray(points),
        "triangles": np.asarray(triangles),
        "seams": none if seams is None else np.asarray(seams),
    }
