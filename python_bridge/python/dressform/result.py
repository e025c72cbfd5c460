"""The result of a fit, with the keys that ``dressform fit --json`` prints.

Lengths are metres, ratios and strains have no unit. Keys that later versions add are kept.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

#: First, fiftieth and ninety-ninth percentile over area.
Percentiles = tuple[float, float, float]


class _Report(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)


class DeviceInfo(_Report):
    """What the stages ran on."""

    kind: str = Field(description="'cpu' or 'gpu'")
    name: str


class Fold(_Report):
    """A crease of the target's skin that is narrower than the grid can follow."""

    center_m: tuple[float, float, float] = Field(description="its middle on the target [m]")
    area_m2: float = Field(description="its area on the source body [m^2]")
    gap_max_m: float = Field(description="largest gap in it [m]")


class TransferReport(_Report):
    """How well the body pair was met (paper section 4.1)."""

    gap_max_m: float
    gap_p99_m: float = Field(description="moved source body to target, over skin near a garment [m]")
    gap_mean_m: float
    body_gap_p99_m: float = Field(description="the same over the whole body [m]")
    active_cells: int
    refined_cells: int = Field(description="finer cells near the skin")
    outer_iterations: int
    cg_iterations: int
    converged: bool
    determinant_min: float = Field(description="smallest local volume ratio where garment vertices lie")
    skin_pairs: int = Field(
        description="triangle pairs of garment and skin that meet and did not on the source, before the drape"
    )
    lift_max_m: float = Field(description="farthest that cloth was lifted out of the skin [m]")
    folds: list[Fold] = Field(description="where the target's skin folds and the gap was not closed for it")


class PatternReport(_Report):
    """How well the panels could follow (paper section 4.2)."""

    iterations: int
    residual: float
    strain_change_p50: float
    strain_change_p99: float
    seam_mismatch_max: float = Field(description="largest relative change of length between sewn chains")
    flipped_triangles: int
    area_ratio: float
    straight_deviation_max: float = Field(
        description="farthest that an originally straight edge strays from its chord, over its length"
    )
    corner_change_max_deg: float = Field(description="largest change of a corner's angle [degrees]")
    mirror_distance_max_m: float = Field(
        description="largest distance between corners of mirrored panels, laid on each other [m]"
    )
    grain_turn_max_deg: float = Field(description="largest mean turn of a panel's grain [degrees]")
    length_residual: float = Field(description="largest relative error of a length that was asked for")
    shape_residual: float = Field(description="largest excess over a bound of the outline's shape")
    converged: bool = Field(description="lengths and bounds are met")
    repaired: str = Field(description="what flipped triangles took, 'none' if nothing")


class Girths(_Report):
    """A girth of a garment and of the body under it [m]."""

    body_m: float = Field(description="convex hull of the body's section: as a tape measure lies")
    garment_m: float = Field(description="the garment's section in its flat pattern: the cloth at rest")
    ease_m: float = Field(description="the garment's less the body's")
    worn_m: float = Field(description="the garment's section as worn")


class GirthEase(_Report):
    """One girth on source and target."""

    girth: str = Field(description="bust, waist, hip, thigh, upper_arm or neck")
    side: str | None = Field(description="left or right for limbs")
    open: bool = Field(description="the garment does not close there")
    source: Girths
    refit: Girths = Field(description="on the target, refitted pattern on the carried shape")
    target: Girths = Field(description="on the target, draped")
    held_m: float | None = Field(description="the ease that a setting asked for")


class EaseReport(_Report):
    """The garment's ease by measurement."""

    girths: list[GirthEase]
    left_out: list[str] = Field(description="girths without a figure, and why")


class DrapeReport(_Report):
    """How the cloth came to rest (paper section 5)."""

    frames: int
    steps: int
    settle_steps: int = Field(description="steps of the settling phase, of growing length")
    pressed: float = Field(description="times the cloth's own bending stiffness as settling started")
    approach_steps: int = Field(description="those of them that only approach rest, to no tolerance")
    residual: float = Field(description="largest net force on a node over the mean weight of a node")
    kinetic_energy_j: float
    converged: bool
    at_rest: bool


class HeldBand(_Report):
    """Panels that were held where they are worn."""

    panels: list[str] = Field(description="labels (or names) of the panels, sewn to one another")
    kind: str = Field(description="'elastic' or 'tether'")
    source_distance_m: float = Field(description="median distance to the source body [m]")
    force_n: float = Field(description="tension of an elastic, or the sum of a tether's forces [N]")
    extension: float = Field(description="mean stretch of an elastic over its natural length")
    moved_mean_m: float = Field(description="mean distance from the transferred place [m]")
    moved_max_m: float


class LeftOutPanel(_Report):
    """A panel that was not simulated."""

    panel: str
    label: str
    why: str
    vertices: int
    distance_max_m: float = Field(description="farthest vertex from the proxy, on the source [m]")


class ProxyReport(_Report):
    """Which panels were left out of transfer and drape, and how they came back (paper section 6)."""

    left_out: list[LeftOutPanel]
    shell_after_all: list[str] = Field(
        description="panels that a label calls details, but which the shell ends without"
    )
    bound_vertices: int
    distance_max_m: float
    offset_least: float = Field(description="least share of its distance that a bound vertex kept")
    offset_most: float
    inside: int = Field(description="bound vertices on the wrong side of the proxy")
    raised: int = Field(description="bound vertices raised over a crease")
    squeezed: int = Field(description="bound vertices pressed together for want of room")


class RigReport(_Report):
    """Where skin weights came from (paper section 7); fractions that sum to 1."""

    matched: float
    inpainted: float
    nearest: float
    influences_max: int
    influence_error_max_m: float = Field(
        description="largest displacement by leaving out influences, each joint turned by 45 degrees [m]"
    )
    ignored: float = Field(description="share of the weight that ignored joints gave to their ancestors")
    own_joints: int = Field(
        description="joints that the garment names itself and the skeleton has; 0 if all may move it"
    )
    turned_pieces: int = Field(description="pieces that face the body, turned for the search")
    refined: float = Field(
        description="fraction of vertices with weights changed to follow the body in poses"
    )
    sunk_m: tuple[float, float] = Field(
        description="depth in the posed body before and after that, averaged over poses and seam groups [m]"
    )


class PoseReport(_Report):
    """How a garment follows its body in one pose, both skinned."""

    pose: str
    inside: float = Field(
        description="fraction of the vertices outside of the body in the bind pose that are inside; "
        "not counted where the posed body overlaps itself"
    )
    depth_max_m: float = Field(description="depth of the deepest of them [m]")
    depth_mean_m: float = Field(description="depth over all counted, zero outside [m]")
    overlapped: float = Field(description="fraction where the posed body overlaps itself")
    faces_inside: float = Field(description="fraction of faces whose centre is inside the body")
    faces_depth_max_m: float
    edge_stretch: Percentiles = Field(description="edge length over its length in the bind pose")
    edge_stretch_max: float


class Certificate(_Report):
    """What was achieved, measured by exact tests and not by the solvers."""

    body_intersections: int
    body_penetration_max_m: float
    layer_intersections: int
    self_intersections: int
    strain_warp: Percentiles
    strain_weft: Percentiles
    strain_shear: Percentiles
    strain_change_p99: float
    fold_angle_rms: float = Field(
        description="root mean square of the angles between neighbouring triangles of a panel [rad]"
    )
    source_fold_angle_rms: float = Field(description="the same on the source: much more is crumpled")
    source_self_intersections: int
    seam_gap_max_m: float
    weight_sum_error_max: float
    seam_weight_error_max: float
    posed: list[PoseReport] = Field(
        default_factory=list, description="the posed check; empty where it is switched off"
    )


class GarmentReport(_Report):
    """One garment, through every stage."""

    name: str
    path: str
    layer: int
    vertices: int
    triangles: int
    panels: int
    seams: int
    proxy: ProxyReport
    transfer: TransferReport
    pattern: PatternReport
    ease: EaseReport
    drape: DrapeReport
    held: list[HeldBand] = Field(description="bands that were held during the drape; empty where none was")
    rig: RigReport
    blend_shapes: list[str] = Field(
        default_factory=list, description="blend shapes of the body that were carried over"
    )
    certificate: Certificate


class Result(_Report):
    """What :func:`dressform.fit` returns."""

    output: str
    version: str
    device: DeviceInfo
    passed: bool = Field(description="no threshold of the certificate is broken")
    broken: list[str] = Field(default_factory=list, description="the broken thresholds, in words")
    notes: list[str] = Field(
        default_factory=list, description="what was inferred, repaired or left out on reading"
    )
    seconds: dict[str, float] = Field(description="wall time for each stage, and 'total' [s]")
    garments: list[GarmentReport]

    @property
    def path(self) -> Path:
        """The root layer that was written."""
        return Path(self.output)

    def to_json(self) -> str:
        """The object that ``--json`` prints."""
        return self.model_dump_json()


def from_report(report: dict[str, Any], **more: Any) -> Result:
    """The core's report with what only the bridge knows."""
    return Result.model_validate({**report, **more})
