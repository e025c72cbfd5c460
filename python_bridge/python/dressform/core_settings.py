"""Settings of the core, mirrored from the Rust structs; do not edit.

Written by ``python_bridge/tools/mirror_settings.py``.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

#: A whole number that counts something.
Count = Annotated[int, Field(ge=0)]
#: A finite number.
Number = Annotated[float, Field(allow_inf_nan=False)]


class CoreModel(BaseModel):
    """Unknown keys are errors, and so are values of another kind."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class ProxySettings(CoreModel):
    """Settings of the proxies."""

    #: Whether detail panels are left out of transfer and drape and bound back; without, every panel is
    #: simulated.
    enabled: bool = True
    #: Labels of panels that are details. A pattern must match whole words of a label (of the panel's name
    #: where it has no label), whatever the case; `*` and `?` stand for letters.
    leave_out: list[str] = [
        "pocket",
        "strap",
        "trim",
        "patch",
        "label",
        "tag",
        "badge",
        "emblem",
        "logo",
        "applique",
        "button",
        "snap",
        "rivet",
        "buckle",
        "zip",
        "zipper",
        "belt loop",
        "epaulette",
        "braid",
        "ribbon",
        "piping",
        "tape",
        "reflector",
        "reflective",
    ]
    #: Labels of panels that are simulated whatever else speaks against it.
    keep: list[str] = []
    #: Whether a panel that lies within `thickness` of others, and is sewn onto a larger one, is a detail
    #: whatever its label.
    automatic: bool = True
    #: Farthest that a panel may lie from others to be a detail without a label [m].
    thickness: Number = 0.005
    #: Farthest that a vertex of a detail may be from the proxy [m]; beyond it is an error.
    reach: Number = 0.03


class TransferSettings(CoreModel):
    """Settings of the transfer."""

    #: Side of a grid cell [m].
    cell: Number = 0.02
    #: Width of the narrow band outside of the body [m]; at least two cells.
    band: Number = 0.16
    #: The band's stiffness fades out within this of its outer end [m]; not wider than the band.
    fade: Number = 0.1
    #: Viscosity; its unit is that of `1 / gamma`.
    nu: Number = 100.0
    #: Compliance of the volume term.
    gamma: Number = 0.01
    #: Penalty of the boundary condition, over `nu`'s unit [1/m^2].
    beta: Number = 1000000.0
    #: Boundary quadrature points along each axis of a cut cell.
    quadrature: Count = 2
    #: Most iterations of the inner loop.
    inner_iterations: Count = 30
    #: The inner loop ends when no node moves farther than this [m].
    inner_tolerance: Number = 0.0001
    #: Most conjugate gradient iterations for each increment of the inner loop. One is best: the inner loop
    #: combines increments as well as the conjugate gradients would.
    cg_iterations: Count = 1
    #: Their tolerance, relative to the increment's own right-hand side.
    cg_tolerance: Number = 0.1
    #: Solve every inner loop until its residual, judged in double precision on the host, is below 1e-8 of
    #: that of no displacement: a reference for tests, at several times the cost.
    exact: bool = False
    #: Outer iterations with the whole band. The next one solves the last of them once more with cells
    #: `refinement` times smaller in `refined_band`; those after it close what is left at the skin.
    coarse_iterations: Count = 1
    #: Width outside of the body of the band of finer cells [m]; at least two of their size. With 3 cm cloth
    #: beyond is twice as far from the field of fine cells.
    refined_band: Number = 0.05
    #: How many times smaller the cells near the skin are; 1 leaves refinement out.
    refinement: Count = 4
    #: Most iterations of the outer loop.
    outer_iterations: Count = 10
    #: The outer loop ends when the 99th percentile of the outer skin's gap is below [m].
    gap_p99: Number = 0.0004
    #: The 99th percentile of the gap near garments up to which the transfer counts as converged [m].
    gap_accepted: Number = 0.002
    #: Skin within this distance of a garment counts for the garment's gap [m].
    near: Number = 0.08
    #: A target whose limbs are turned against the source's by more than this is taken to the source's pose
    #: first, and its garments are brought back [degrees]; 180 never does so.
    unpose: Number = 15.0


class PatternSettings(CoreModel):
    """Settings of the pattern refit."""

    #: Fit of the garment. "keep": As tight or loose as on the source: the source's stretch is kept. "loose":
    #: Without stretch on the carried shape.
    fit: Literal["keep", "loose"] = "keep"
    #: Weight of the outline's shape against the cloth's strain (dimensionless).
    outline_weight: Number = 0.03
    #: Weight of the straightness of originally straight runs, which may turn as a whole (dimensionless).
    straight_weight: Number = 1.0
    #: Most that an originally straight run may deviate from its chord, over the chord's length.
    straight_bound: Number = 0.0098
    #: Most that a corner of the outline may change its angle [degrees].
    corner_bound: Number = 2.99
    #: Whether panels that mirror one another stay mirror images, where the target makes their edges less than
    #: 5% different.
    mirror: bool = True
    #: Pull of every vertex towards its original place (dimensionless): settles where each panel lies, nothing
    #: else.
    anchor_weight: Number = 1e-08
    #: Change of relative length difference between sewn chains that is good enough.
    seam_tolerance: Number = 0.0001
    #: Most steps that may be spent on lengths and bounds.
    seam_iterations: Count = 30
    #: Which inner vertices are smoothed by the Dirichlet energy afterwards. "crumpled": Those near triangles
    #: that the transfer crumpled or the layout turned over. "all": All of them, as in the paper: smoother,
    #: but far more strain. "never": None.
    tidy: Literal["crumpled", "all", "never"] = "crumpled"


class EaseHoldHeldGirthSettings(CoreModel):
    """One held girth: one of three ways to say its ease, or none."""

    #: The ease itself [m]; negative is tighter than the body.
    absolute: Number | None = None
    #: The ease over the target body's girth.
    relative: Number | None = None
    #: The ease that the garment has on its source body. "free": It is not held. "absolute": In metres.
    #: "relative": Over the body's girth.
    source: Literal["free", "absolute", "relative"] = "free"


class EaseHoldSettings(CoreModel):
    """The ease to hold, girth by girth."""

    #: Fullest girth of the chest below the armpits.
    bust: EaseHoldHeldGirthSettings = EaseHoldHeldGirthSettings()
    #: Narrowest girth between hips and chest.
    waist: EaseHoldHeldGirthSettings = EaseHoldHeldGirthSettings()
    #: Fullest girth about hip joints and seat.
    hip: EaseHoldHeldGirthSettings = EaseHoldHeldGirthSettings()
    #: Each leg below the crotch.
    thigh: EaseHoldHeldGirthSettings = EaseHoldHeldGirthSettings()
    #: Each upper arm.
    upper_arm: EaseHoldHeldGirthSettings = EaseHoldHeldGirthSettings()
    #: The neck.
    neck: EaseHoldHeldGirthSettings = EaseHoldHeldGirthSettings()


class EaseSettings(CoreModel):
    """Settings of the ease by measurement."""

    #: Names of the garments whose ease is held; empty: all.
    garments: list[str] = []
    #: Girths whose ease is held, each where a garment covers it.
    hold: EaseHoldSettings = EaseHoldSettings()


class DrapeClothSettings(CoreModel):
    """How a cloth is made from a garment."""

    #: Bending stiffness of a seam over that of the cloth around it (dimensionless): a seam has its allowances
    #: pressed to it, so three plies.
    seam_bending: Number = 3.0
    #: Whether panels keep the curvature that they have on the source body.
    curved_panels: bool = False


class DrapeHoldSettings(CoreModel):
    """Settings of holding."""

    #: When panels are held: `auto` where their band lies on the body on the source, `always` wherever a label
    #: matches, `never`. "auto": Where their band lies on the body on the source. "always": Wherever a label
    #: matches. "never": Nowhere.
    when: Literal["auto", "always", "never"] = "auto"
    #: Labels of panels that an elastic holds (matched as those of details are). A band that is no closed ring
    #: is tethered instead.
    elastic: list[str] = ["waistband", "cuff"]
    #: Labels of panels that are tethered to their transferred place.
    tether: list[str] = ["strap", "collar stand"]
    #: Largest median distance to the source body of a band that lies on it [m]: a thickness or two above the
    #: contact distance that the source was draped with.
    reach: Number = 0.006
    #: How far the elastic is stretched around the body's girth (a tenth: 0.1).
    elastic_stretch: Number = 0.1
    #: Tension of the elastic for each unit of stretch and each metre of the band's height [N/m].
    elastic_stiffness: Number = 500.0
    #: Stiffness of tethers for each unit of cloth area [N/m^3].
    tether_stiffness: Number = 100000.0


class DrapeSettings(CoreModel):
    """Settings of the drape."""

    #: Frames of the untangling phase (1/24 s each).
    frames: Count = 6
    #: Time steps in a frame.
    steps_per_frame: Count = 4
    #: Share of the velocity that each untangling step takes away.
    damping: Number = 0.9
    #: Whether a settling phase follows.
    settle: bool = True
    #: Most steps of the settling phase.
    settle_steps: Count = 60
    #: How many times stiffer in bending than its own the cloth starts to settle where the transfer has
    #: changed it; folds it squeezed or spread are pressed out so. 1 leaves them.
    press: Number = 64.0
    #: Share of the velocity that each step behind a moving body takes away.
    follow_damping: Number = 0.05
    #: At rest when the largest net force on a node is below this many mean node weights.
    rest_tolerance: Number = 0.1
    #: A step has converged when the largest unbalanced force on a node is below this many mean node weights.
    tolerance: Number = 0.05
    #: Most Newton iterations in a step.
    max_newton: Count = 120
    #: Relative residual of the linear solves.
    cg_tolerance: Number = 0.1
    #: Most conjugate-gradient iterations in a solve.
    max_cg: Count = 2000
    #: Distance at which bodies and other solids resist [m] (paper: eps_sdf, 0.2 cm).
    body_distance: Number = 0.002
    #: Distance at which finished lower garments resist [m].
    layer_distance: Number = 0.002
    #: Distance at which parts of the garment resist each other [m].
    self_distance: Number = 0.002
    #: Contact stiffness for each unit of cloth area [N/m^3] (paper: 2,500,000).
    contact_stiffness: Number = 2500000.0
    #: Sliding speed up to which friction only sticks [m/s].
    friction_speed: Number = 0.001
    #: Gravity along -Y [m/s^2].
    gravity: Number = 9.81
    #: Most pushes that untangle a start (and, if anything crosses after the phases, an end).
    push_steps: Count = 24
    #: Rest shape of the cloth.
    cloth: DrapeClothSettings = DrapeClothSettings()
    #: Bands that are held.
    hold: DrapeHoldSettings = DrapeHoldSettings()


class RigSettings(CoreModel):
    """Settings of the rig."""

    #: Most influences for a vertex. Without it 4, or 8 where 4 would move a vertex of the garment by more
    #: than `influence_error`.
    influences: Count | None = None
    #: Displacement by leaving out influences that is worth 8 of them: when every joint in turn is turned by
    #: 45 degrees about any axis, the root of the summed mean squares [m].
    influence_error: Number = 0.001
    #: Farthest body point that a cloth point can be matched to [m].
    distance: Number = 0.08
    #: Largest angle between the normals of cloth and body at a match [degrees].
    cone: Number = 45.0
    #: Rounds of averaging the cloth's normals with their neighbours'.
    smoothing: Count = 2
    #: Length along the cloth over which weights are evened out, where it lies `gap` from the skin; with the
    #: power 3/2 of the distance elsewhere [m].
    reach: Number = 0.05
    #: Distance from the skin that `reach` is meant for [m].
    gap: Number = 0.016
    #: Largest change of the weights along an edge, as the sum of absolute differences (2 at most): where more
    #: is left, the ends are averaged with their neighbours.
    jump: Number = 0.6
    #: Rounds of refining weights against the poses of the posed check; 0 leaves it out.
    refine: Count = 5
    #: Joints whose weight goes to their nearest kept ancestor. A pattern must match whole words of a joint's
    #: name, whatever the case; `*` and `?` stand for letters; `NAME/*` means all joints below. A garment of
    #: which they hold more than a quarter is made for them and keeps them.
    ignore: list[str] = ["hand/*", "wrist/*", "foot/*", "ankle/*", "head/*", "finger", "thumb", "toe", "eye"]


class BlendShapesSettings(CoreModel):
    """Settings of blend shapes."""

    #: Whether blend shapes of the body that move a garment are carried to it.
    enabled: bool = False
    #: Garment points that a shape moves less are left out of it [m].
    smallest: Number = 0.0001


class PosedSettings(CoreModel):
    """Settings of the posed check."""

    #: Whether garments are posed with their body and judged.
    enabled: bool = True
    #: Names of the poses; empty: all that the skeleton allows.
    poses: list[str] = []


class ThresholdsSettings(CoreModel):
    """Limits; one that is broken makes a result not pass."""

    #: Triangle pairs of garment and body beyond what the source outfit had.
    body_intersections_added: Count = 0
    #: Triangle pairs between garments beyond what the source outfit had.
    layer_intersections_added: Count = 0
    #: Triangle pairs within a garment beyond what the source outfit had.
    self_intersections_added: Count = 0
    #: Depth of a vertex inside the body [m].
    body_penetration_max_m: Number = 0.002
    #: Transfer gap at 99 percent of the area [m].
    gap_p99_m: Number = 0.002
    #: Flipped triangles in the refitted pattern.
    flipped_triangles: Count = 0
    #: Relative difference in length of sewn chains.
    seam_mismatch_max: Number = 0.005
    #: Deviation of a sewn vertex from where it is sewn [m].
    seam_gap_max_m: Number = 0.0001
    #: Deviation of a vertex's weights from a sum of 1.
    weight_sum_error_max: Number = 1e-05
    #: Difference of a weight across a seam.
    seam_weight_error_max: Number = 1e-06
    #: Vertices of details on the wrong side of the proxy that they are bound to.
    details_inside: Count = 0
    #: Change of the distance between a detail's vertex and the proxy, relative to itself.
    detail_offset_change: Number = 0.1
    #: Whether the transfer must have converged.
    transfer_converged: bool = True
    #: Whether every step of the drape must have converged.
    drape_converged: bool = True


class CoreSettings(CoreModel):
    """Every setting of every stage."""

    #: Detail panels.
    proxy: ProxySettings = ProxySettings()
    #: 3D transfer.
    transfer: TransferSettings = TransferSettings()
    #: Pattern refit.
    pattern: PatternSettings = PatternSettings()
    #: Ease by measurement.
    ease: EaseSettings = EaseSettings()
    #: Draper.
    drape: DrapeSettings = DrapeSettings()
    #: Rig.
    rig: RigSettings = RigSettings()
    #: Blend shapes of the body.
    blend_shapes: BlendShapesSettings = BlendShapesSettings()
    #: Check of the weights in poses.
    posed: PosedSettings = PosedSettings()
    #: What makes a result pass.
    thresholds: ThresholdsSettings = ThresholdsSettings()
