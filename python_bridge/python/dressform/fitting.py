"""From stages to a dressed stage: read, fit, write."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from typing import Any

from . import native
from .errors import BadInput
from .model import Outfit
from .result import Result, from_report
from .settings import Settings, parse

#: Names the folder of the cache where none is given.
CACHE_VARIABLE = "DRESSFORM_CACHE"


def fit(
    outfit: str | os.PathLike[str],
    character: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    settings: Settings | Mapping[str, Any] | None = None,
    device: str = "auto",
    clobber: bool = True,
    progress: native.Progress | None = None,
    cache: str | os.PathLike[str] | None = None,
) -> Result:
    """Fits an outfit to a character and writes the dressed character.

    Args:
        outfit: a stage with one or more garments.
        character: a stage with a body mesh and a skeleton.
        out: the root layer to write (``.usda`` or ``.usdc``); arrays go to a crate file beside it.
        settings: defaults where nothing is given; also nested mappings.
        device: ``auto``, ``cpu``, ``gpu`` or a part of an adapter's name.
        clobber: whether an existing ``out`` is replaced.
        progress: called with the stage's name and the fraction of it that is done.
        cache: a folder that keeps the flows between bodies for other processes, ``$DRESSFORM_CACHE`` by
            default; without it they are kept for this process alone.

    Returns:
        The result, written whether or not a threshold was broken: see ``passed``.

    Raises:
        BadInput: names file, prim, attribute and element.
        BadSettings: an unknown key or a wrong value.
        BadOutput: ``out`` cannot be written; an older one is as it was.
        NoDevice: no such device, or it failed.
        InternalFault: a bug.
    """
    from .usd.character import read_character, require_same_topology
    from .usd.garment import read_outfit
    from .usd.write import check_target, write_dressed

    chosen = settings if isinstance(settings, Settings) else parse(settings or {})
    tell = progress or (lambda stage, fraction: None)
    started = time.perf_counter()
    check_target(out, clobber=clobber)
    tell("read", 0.0)
    options = chosen.read
    source = read_outfit(
        outfit,
        garments=options.garments,
        source_body=options.source_body,
        pattern_primvar=options.pattern_primvar,
        variants=options.outfit_variants or None,
    )
    target, notes = read_character(
        character,
        body=options.body,
        colliders=options.colliders,
        variants=options.character_variants or None,
        blend_shapes=chosen.blend_shapes.enabled,
    )
    # The core checks this too, but knows no files.
    for body in source.bodies:
        require_same_topology(body, target)
    read = time.perf_counter() - started
    tell("read", 1.0)

    folder = os.fspath(cache or "") or os.environ.get(CACHE_VARIABLE) or None
    try:
        fitted = native.fit_arrays(source, target, chosen.core_json(), device, tell, folder)
    except BadInput as error:
        raise _with_file(error, source) from None
    report = fitted.report

    before = time.perf_counter()
    tell("write", 0.0)
    more = write_dressed(
        out,
        source,
        target,
        fitted.garments,
        passed=report["passed"],
        broken=report["broken"],
        clobber=clobber,
    )
    tell("write", 1.0)
    done = time.perf_counter()
    seconds = {**report["seconds"], "read": read, "write": done - before, "total": done - started}
    return from_report(
        report,
        output=os.fspath(out),
        version=native.version(),
        seconds=seconds,
        notes=[*source.notes, *notes, *report["notes"], *more],
    )


def _with_file(error: BadInput, outfit: Outfit) -> BadInput:
    """The core's error with the file, which it does not know, if it is about a garment."""
    for garment in outfit.garments:
        lead = f"{garment.path}: "
        if not error.file and error.message.startswith(lead):
            return type(error)(error.message.removeprefix(lead), file=outfit.file, prim=garment.path)
    return error
