"""Opening stages: what can go wrong before a single attribute is read, and the stage's frame."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom

from ..errors import BadInput
from ..model import Floats, StageFrame


class Source:
    """An open stage with its file, its frame and the notes taken while reading it."""

    def __init__(self, stage: Usd.Stage, file: str) -> None:
        self.stage = stage
        self.file = file
        self.notes: list[str] = []
        self.frame = self._frame()

    def note(self, text: str, prim: Usd.Prim | Sdf.Path | str = "") -> None:
        """Keeps a sentence for the report, once."""
        path = prim.GetPath() if isinstance(prim, Usd.Prim) else prim
        text = f"<{path}>: {text}" if path else text
        if text not in self.notes:
            self.notes.append(text)

    def bad(
        self,
        message: str,
        prim: Usd.Prim | str = "",
        attribute: str = "",
        element: int | np.integer | None = None,
    ) -> BadInput:
        """The error to raise for something in this stage."""
        path = str(prim.GetPath()) if isinstance(prim, Usd.Prim) else str(prim)
        at = None if element is None else int(element)
        return BadInput(message, file=self.file, prim=path, attribute=attribute, element=at)

    def _frame(self) -> StageFrame:
        up_axis = str(UsdGeom.GetStageUpAxis(self.stage))
        unit = float(UsdGeom.GetStageMetersPerUnit(self.stage))
        if up_axis not in ("Y", "Z"):
            raise self.bad(f"upAxis is {up_axis!r}, only Y and Z are known", "/", "upAxis")
        if not (np.isfinite(unit) and unit > 0.0):
            raise self.bad(f"metersPerUnit is {unit}", "/", "metersPerUnit")
        if not UsdGeom.StageHasAuthoredMetersPerUnit(self.stage):
            self.note(f"metersPerUnit is not authored: USD's default of {unit} is taken")
        return StageFrame(up_axis, unit)

    def prims(self, root: Usd.Prim | None = None) -> Iterator[Usd.Prim]:
        """Active, defined prims below ``root`` (or all), instances' inside included."""
        start = root if root is not None else self.stage.GetPseudoRoot()
        yield from Usd.PrimRange(start, Usd.TraverseInstanceProxies())

    def time_of(self, attribute: Usd.Attribute) -> Usd.TimeCode:
        """Default time, or the earliest for what only has samples."""
        samples = attribute.GetNumTimeSamples()
        if samples == 0:
            return Usd.TimeCode.Default()
        has_default = attribute.Get(Usd.TimeCode.Default()) is not None
        which = "the default value" if has_default else "the earliest sample"
        self.note(
            f"{attribute.GetName()} has {samples} time samples: {which} is taken",
            attribute.GetPrim(),
        )
        return Usd.TimeCode.Default() if has_default else Usd.TimeCode.EarliestTime()

    def value(self, attribute: Usd.Attribute) -> Any:
        """The value at :meth:`time_of`, or None."""
        return attribute.Get(self.time_of(attribute)) if attribute else None

    def stage_from_local(self, prim: Usd.Prim) -> Floats:
        """The prim's local-to-world matrix in stage units, column-vector convention, [4, 4]."""
        time = Usd.TimeCode.Default()
        for p in prim.GetPath().GetPrefixes():
            ops = UsdGeom.Xformable(self.stage.GetPrimAtPath(p))
            if ops and ops.TransformMightBeTimeVarying():
                time = Usd.TimeCode.EarliestTime()
                self.note("the transform is animated: its earliest time is taken", p)
        return matrix(UsdGeom.XformCache(time).GetLocalToWorldTransform(prim))

    def world_from_local(self, prim: Usd.Prim) -> Floats:
        """World (metres, Y up) from the prim's local space, shape [4, 4]."""
        return self.checked(self.frame.world_from_stage @ self.stage_from_local(prim), prim)

    def checked(self, transform: Floats, prim: Usd.Prim) -> Floats:
        """The transform, if it can be turned back."""
        if not np.isfinite(transform).all() or abs(np.linalg.det(transform[:3, :3])) < 1e-30:
            raise self.bad("the transform to the world cannot be inverted", prim, "xformOpOrder")
        return transform


def matrix(gf: Gf.Matrix4d) -> Floats:
    """A USD matrix (row vectors) as ours (column vectors)."""
    return np.array(gf, dtype=np.float64).T


def gf_matrix(ours: Floats) -> Gf.Matrix4d:
    """Our matrix as USD's."""
    return Gf.Matrix4d(*np.asarray(ours, dtype=np.float64).T.ravel().tolist())


def apply(transform: Floats, points: Floats) -> Floats:
    """``transform @ [p, 1]`` for every point, shape [n, 3]."""
    return np.ascontiguousarray(points @ transform[:3, :3].T + transform[:3, 3], dtype=np.float64)


def open_stage(
    file: str | os.PathLike[str], variants: Mapping[str, Mapping[str, str]] | None = None
) -> Source:
    """Opens a stage for reading; nothing of it is ever saved.

    Args:
        file: any USD layer.
        variants: ``{prim path: {variant set: variant}}`` to select, in the session only.

    Raises:
        BadInput: the file is missing, not USD, does not compose or lacks a variant.
    """
    name = os.fspath(file)
    if not os.path.exists(name):
        raise BadInput("the file does not exist", file=name)
    if os.path.isdir(name):
        raise BadInput("this is a folder, not a USD file", file=name)
    try:
        layer = Sdf.Layer.FindOrOpen(os.path.abspath(name))
        stage = Usd.Stage.Open(layer) if layer else None
    except Tf.ErrorException as error:
        raise BadInput(f"USD cannot open it: {_reason(error)}", file=name) from error
    if stage is None:
        raise BadInput("USD cannot open it: not a USD file", file=name)
    for used in stage.GetUsedLayers():  # USD keeps layers open: read what is on the disk now
        if not (used.dirty or used.anonymous):
            used.Reload()
    broken = stage.GetCompositionErrors()
    if broken:
        raise BadInput(f"the stage does not compose: {str(broken[0]).strip()}", file=name)
    source = Source(stage, name)
    for path, choices in (variants or {}).items():
        _select(source, path, choices)
    return source


def copy_variants(variants: Mapping[str, Mapping[str, str]] | None) -> dict[str, dict[str, str]]:
    """The selections as plain dictionaries."""
    return {path: dict(choices) for path, choices in (variants or {}).items()}


def _select(source: Source, path: str, choices: Mapping[str, str]) -> None:
    prim = source.stage.GetPrimAtPath(path)
    if not prim:
        raise source.bad("there is no such prim to select a variant on", path)
    with Usd.EditContext(source.stage, source.stage.GetSessionLayer()):
        for name, variant in choices.items():
            known = prim.GetVariantSet(name).GetVariantNames()
            if variant not in known:
                raise source.bad(f"variant {variant!r} is not one of {known}", prim, name)
            prim.GetVariantSet(name).SetVariantSelection(variant)


def _reason(error: Tf.ErrorException) -> str:
    lines = [str(e.commentary) for e in error.args if hasattr(e, "commentary")]
    return (lines[0] if lines else str(error)).strip().splitlines()[0]
