"""Settings of a fit: read from TOML or made in Python.

:class:`Settings` has the core's tables (``transfer``, ``pattern``, ``drape``, ``rig``,
``thresholds``; see :mod:`dressform.core_settings`) and ``read``, which only the bridge knows.
Lengths are metres, times seconds; unknown keys are errors.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from .core_settings import CoreModel, CoreSettings
from .errors import BadSettings

#: Variant selections: prim path to variant set to variant.
Variants = dict[str, dict[str, str]]


class ReadSettings(CoreModel):
    """What to take from the stages."""

    #: Paths of the garments to fit; empty: all that are marked as garments.
    garments: list[str] = []
    #: The source body's stage, for outfits that do not hold their body.
    source_body: str | None = None
    #: Primvar that holds the panel coordinates, where it is not the usual one.
    pattern_primvar: str | None = None
    #: Path of the character's body mesh, where it is not the largest skinned mesh.
    body: str | None = None
    #: Further meshes of the character that cloth must not pass: paths, names or patterns.
    colliders: list[str] = []
    #: Variants to select in the outfit.
    outfit_variants: Variants = {}
    #: Variants to select in the character.
    character_variants: Variants = {}


class Settings(CoreSettings):
    """Everything that changes a result."""

    #: What to take from the stages.
    read: ReadSettings = ReadSettings()

    def core_json(self) -> str:
        """The part that the core takes, as JSON."""
        return self.model_dump_json(exclude={"read"})


def load(file: str | os.PathLike[str]) -> Settings:
    """Reads settings from TOML; keys that are left out keep their defaults.

    Raises:
        BadSettings: not a readable TOML file, an unknown key or a wrong value.
    """
    name = os.fspath(file)
    try:
        tables = tomllib.loads(Path(file).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadSettings(error.strerror or "it cannot be read", file=name) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadSettings(f"this is not TOML: {error}", file=name) from error
    return parse(tables, name)


def parse(tables: Mapping[str, Any], file: str = "settings") -> Settings:
    """Settings from nested mappings.

    Raises:
        BadSettings: an unknown key or a wrong value; names all of them.
    """
    try:
        return Settings.model_validate(dict(tables))
    except ValidationError as error:
        problems = error.errors(include_url=False)
    first = problems[0]
    said = [_say(p) for p in problems]
    message = "; ".join([said[0].partition(": ")[2], *said[1:]])
    raise BadSettings(message, file=file, attribute=_key(first))


def _key(problem: Mapping[str, Any]) -> str:
    return ".".join(str(part) for part in problem["loc"])


def _say(problem: Mapping[str, Any]) -> str:
    if problem["type"] == "extra_forbidden":
        return f"{_key(problem)}: there is no such key"
    message = problem["msg"]
    return f"{_key(problem)}: {message[:1].lower()}{message[1:]}, not {problem['input']!r}"
