"""Pictures of a stage, dressed or not."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from ..errors import BadInput, BadOutput
from ..model import Outfit
from .flat import draw_patterns
from .page import sheet
from .scene import dressed

#: Endings of pictures, by kind.
SHEET_SUFFIXES = (".png",)
FLAT_SUFFIXES = (".png", ".svg", ".pdf")


def draw_stage(
    stage: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    pattern: bool = False,
    names: Sequence[str] = (),
    close: bool = False,
) -> list[Path]:
    """Draws an outfit or a dressed character.

    Args:
        stage: read as ``fit`` reads an outfit.
        output: the picture.
        pattern: draw panels flat; a refitted pattern over the source pattern.
        names: only these garments.
        close: frame the garments and not the body.

    Returns:
        The files: one, or with ``pattern`` one for each garment.

    Raises:
        BadInput: the stage cannot be read, or has no garment of that name.
        BadOutput: the picture's ending is not known.
        NotInstalled: the optional part ``preview`` is missing.
    """
    suffixes = FLAT_SUFFIXES if pattern else SHEET_SUFFIXES
    if Path(output).suffix not in suffixes:
        raise BadOutput(f"the name must end in one of {', '.join(suffixes)}", file=os.fspath(output))
    outfit = _read(stage, names)
    if not pattern:
        return [sheet(dressed(outfit), output, close=close)]
    sources = None
    if any(g.pattern_origin and "garment:pattern" in g.pattern_origin.attribute for g in outfit.garments):
        sources = _read(stage, names, primvar="st").garments
    return draw_patterns(outfit.garments, output, sources=sources)


def _read(stage: str | os.PathLike[str], names: Sequence[str], primvar: str | None = None) -> Outfit:
    from ..usd.garment import read_outfit

    outfit = read_outfit(stage, pattern_primvar=primvar)
    known = [g.name for g in outfit.garments]
    for name in names:
        if name not in known:
            raise BadInput(f"there is no garment {name}, only {', '.join(known)}", file=os.fspath(stage))
    if names:
        outfit.garments = [g for g in outfit.garments if g.name in names]
    return outfit
