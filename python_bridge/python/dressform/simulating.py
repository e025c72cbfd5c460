"""From a dressed stage with an animated skeleton to simulated garments."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from . import native
from .errors import BadInput
from .settings import Settings, parse


def simulate(
    dressed: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    start: float | None = None,
    end: float | None = None,
    lead_in: int = 24,
    settings: Settings | Mapping[str, Any] | None = None,
    device: str = "auto",
    clobber: bool = True,
    progress: native.Progress | None = None,
) -> dict[str, Any]:
    """Simulates the garments of a dressed stage on its animated body, and writes their points.

    Args:
        dressed: a stage that ``fit`` wrote, whose character's skeleton is animated.
        out: the layer to write; it has ``dressed`` as a sublayer.
        start: first time code; the animation's first by default.
        end: last time code.
        lead_in: frames from the bind pose to the animation's first.
        settings: defaults where nothing is given; also nested mappings.
        device: ``auto``, ``cpu``, ``gpu`` or a part of an adapter's name.
        clobber: whether an existing ``out`` is replaced.
        progress: called with the stage's name and the fraction of it that is done.

    Returns:
        ``frames``, ``lead_in``, ``device`` and, for each garment, what the simulation reports.

    Raises:
        BadInput: names file, prim, attribute and element.
        BadOutput: ``out`` cannot be written; an older one is as it was.
    """
    from .usd.garment import read_outfit
    from .usd.motion import read_motion
    from .usd.stage import apply, open_stage
    from .usd.write import check_target
    from .usd.write_simulation import write_simulation

    chosen = settings if isinstance(settings, Settings) else parse(settings or {})
    check_target(out, clobber=clobber)
    outfit = read_outfit(dressed)
    if len(outfit.bodies) != 1:
        raise BadInput(f"its garments are on {len(outfit.bodies)} bodies, not one", file=os.fspath(dressed))
    body = outfit.bodies[0]
    source = open_stage(dressed)
    motion = read_motion(source, body, start=start, end=end, lead_in=lead_in)
    # The garments begin where the motion does.
    for garment in outfit.garments:
        garment.points = apply(motion.world_from_bind, garment.points)
    outfit.bodies = [replace(body, points=motion.points[0])]
    frames, report = native.simulate_arrays(
        outfit,
        outfit.bodies[0],
        motion.points,
        motion.seconds_per_frame,
        chosen.core_json(),
        device,
        progress,
    )
    kept = [f[motion.lead_in :].astype(np.float64) for f in frames]
    write_simulation(out, source, outfit.garments, kept, motion.times, clobber=clobber)
    return {
        "output": os.fspath(out),
        "frames": len(motion.times),
        "lead_in": motion.lead_in,
        **report,
        "notes": [*outfit.notes, *source.notes],
    }
