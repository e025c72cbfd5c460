"""Plain data between the USD bridge and the Rust core.

The classes mirror ``src/model/*.rs``. Everything is in SI units, in world space, right-handed
and Y up; indices are ``uint32``, coordinates ``float64``. Matrices are row-major with the
translation in the last column: ``world_point = matrix @ [x, y, z, 1]``.

What the core does not need, but writing back does (face counts, index maps, the stage's frame),
stands in :class:`MeshOrigin` and :class:`StageFrame` beside the arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.uint32]

#: Names of the core's fabric presets (``src/model/fabric.rs``).
FABRIC_PRESETS = ("cotton", "silk", "wool", "denim", "leather", "jersey")
#: Roles of a panel (``src/model/garment.rs``).
PANEL_ROLES = ("auto", "shell", "detail")
#: Fields of the core's ``Fabric`` that a stage may give, all in SI units.
FABRIC_FIELDS = (
    "density",
    "stretch_warp",
    "stretch_weft",
    "shear",
    "bending_warp",
    "bending_weft",
    "bending_shear",
    "friction",
    "thickness",
)


@dataclass(frozen=True)
class StageFrame:
    """Up axis and unit of a stage, and the way from there to our world."""

    up_axis: str = "Y"
    meters_per_unit: float = 1.0

    @property
    def world_from_stage(self) -> Floats:
        """Metres and Y up from the stage's units and up axis, shape [4, 4]."""
        turn = np.eye(4)
        if self.up_axis == "Z":  # (x, y, z) -> (x, z, -y): a rotation, nothing is mirrored
            turn[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
        scale = np.diag([self.meters_per_unit] * 3 + [1.0])
        return turn @ scale

    @property
    def stage_from_world(self) -> Floats:
        """The inverse of :attr:`world_from_stage`, shape [4, 4]."""
        turn = self.world_from_stage / self.meters_per_unit
        inverse = np.eye(4)
        inverse[:3, :3] = turn[:3, :3].T / self.meters_per_unit
        return inverse


@dataclass
class MeshOrigin:
    """Where a mesh came from, and how to get back there from its triangles."""

    file: str
    path: str
    frame: StageFrame
    #: World (metres, Y up) from the mesh's local space, shape [4, 4].
    world_from_local: Floats
    #: As the stage has them, n-gons and all.
    face_vertex_counts: NDArray[np.int64]
    face_vertex_indices: NDArray[np.int64]
    #: Face that each triangle is a part of, shape [t].
    face_of_triangle: Indices
    #: Index into ``face_vertex_indices`` (and every faceVarying value) of each corner, shape [t, 3].
    corner_of_triangle: Indices
    #: Triangles turned over against the mesh's own winding, shape [t] (or empty: none).
    turned: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))


@dataclass
class Collider:
    """A further mesh that cloth must not pass: shoes, hair, props."""

    path: str
    points: Floats
    triangles: Indices


@dataclass
class BlendShape:
    """Offsets that a weight adds to points of a mesh."""

    name: str
    #: Points that it moves, shape [n].
    points: Indices
    #: World offsets at its full weight [m], shape [n, 3].
    offsets: Floats
    #: The weight at which it has its full effect; not 1 for an in-between.
    weight: float = 1.0


@dataclass
class Character:
    """A body mesh with its skeleton and skin weights, in its bind pose."""

    name: str
    #: Path of the body mesh in its stage.
    path: str
    #: Body surface [m], shape [n, 3] and [m, 3].
    points: Floats
    triangles: Indices
    #: Influences for each point, k.
    skin_influences: int
    #: Shape [n * k]; every point's weights sum to 1.
    joint_indices: Indices
    joint_weights: Floats
    #: Joint paths as USD names them; weights index this list.
    joints: list[str]
    #: Parent of each joint, -1 for a root.
    joint_parents: list[int]
    #: World transform of each joint in the bind pose, shape [j, 4, 4].
    world_from_joint: Floats
    colliders: list[Collider] = field(default_factory=list)
    #: Blend shapes of the body, where they were asked for.
    blend_shapes: list[BlendShape] = field(default_factory=list)
    #: Bookkeeping: the stage's frame and the body's maps.
    origin: MeshOrigin | None = None
    #: Path of the skeleton and of the prim that holds the whole character (the SkelRoot or above).
    skeleton_path: str = ""
    root_path: str = ""
    #: Variants that were selected on reading, ``{prim path: {variant set: variant}}``.
    variants: dict[str, dict[str, str]] = field(default_factory=dict)


@dataclass
class Fabric:
    """A preset by name, and whatever the stage says itself (keys of ``FABRIC_FIELDS``, SI)."""

    preset: str = "cotton"
    #: Name for the report.
    name: str = "cotton"
    values: dict[str, float] = field(default_factory=dict)


@dataclass
class Panel:
    """A pattern piece."""

    name: str
    label: str = ""
    #: What it is to the simulation: ``auto``, ``shell`` or ``detail`` (see the core's ``Role``).
    role: str = "auto"
    fabric: Fabric = field(default_factory=Fabric)
    #: From +v to the warp, counter-clockwise [degrees]; ``corner_pattern`` is already turned.
    grain_angle: float = 0.0
    #: True where the stage has the piece from its inside; ``corner_pattern`` is mirrored back.
    mirrored: bool = False


@dataclass
class AuthoredSeam:
    """A seam as a stage authors it, between points of the source mesh."""

    name: str
    #: Shape [k, 2]; with an offset, the first lies on top of the second.
    pairs: Indices
    offset: bool = False


@dataclass
class PatternOrigin:
    """How the panel coordinates stood in the stage."""

    #: Attribute they were read from.
    attribute: str
    #: Metres for one unit of that attribute.
    meters_per_unit: float
    #: True where no attribute said so and the lengths had to tell.
    inferred: bool = False


@dataclass
class GarmentSource:
    """A garment as the stage has it: the source mesh, triangulated, with 2D corners."""

    name: str
    path: str
    #: From the body outwards.
    layer: int
    #: Index into :attr:`Outfit.bodies`.
    body: int
    #: World-space source mesh [m], shape [n, 3] and [t, 3].
    points: Floats
    triangles: Indices
    #: Panel coordinates of each triangle's corners [m], x warp, y weft, shape [t, 3, 2].
    corner_pattern: Floats
    #: Shape [t].
    panel_of_triangle: Indices
    panels: list[Panel]
    seams: list[AuthoredSeam]
    #: Joints that move the garment (``skel:joints``), by path or name in any order; empty: all that move
    #: its body.
    joints: list[str] = field(default_factory=list)
    origin: MeshOrigin | None = None
    pattern_origin: PatternOrigin | None = None


@dataclass
class Outfit:
    """Garments in stage order and the source bodies that they were authored on."""

    name: str
    garments: list[GarmentSource]
    bodies: list[Character]
    file: str = ""
    frame: StageFrame = field(default_factory=StageFrame)
    #: What was repaired, inferred or left out, one sentence each.
    notes: list[str] = field(default_factory=list)
    #: Variants that were selected on reading, ``{prim path: {variant set: variant}}``.
    variants: dict[str, dict[str, str]] = field(default_factory=dict)


@dataclass
class DressedGarment:
    """What the pipeline gives back for one garment of the outfit (same order)."""

    #: Points of the source mesh in the dressed state [m], world, shape [n, 3].
    points: Floats
    #: Refitted panel coordinates of each triangle's corners [m], shape [t, 3, 2].
    corner_pattern: Floats
    #: Shape [n * k], indices into the *target* character's joints.
    joint_indices: Indices
    joint_weights: Floats
    influences: int
    #: The report's ``certificate`` object.
    certificate: dict[str, Any] = field(default_factory=dict)
    #: The body's blend shapes that move it, over the points of the source mesh.
    blend_shapes: list[BlendShape] = field(default_factory=list)
