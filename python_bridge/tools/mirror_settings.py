"""Writes ``dressform/core_settings.py``: the core's settings as pydantic models.

Rust has the only definition. Fields, types and docs (with their units) are read from the structs
in ``src/``, defaults from the built core itself. ``--check`` fails if the file is not what this
would write; a test runs it.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src"
TARGET = ROOT / "python_bridge/python/dressform/core_settings.py"
HEAD = '''"""Settings of the core, mirrored from the Rust structs; do not edit.

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
'''
NUMBERS = {"f64": "Number", "f32": "Number", "bool": "bool", "String": "str", "i32": "int", "i64": "int"}
NUMBERS["Vec<String>"] = "list[str]"
NUMBERS |= dict.fromkeys(("usize", "u8", "u16", "u32", "u64"), "Count")


@dataclass
class Item:
    """A struct or an enum of unit variants, as its source has it."""

    kind: str
    doc: str
    #: Name, doc and type (structs) or name, doc and "" (enums).
    members: list[tuple[str, str, str]]
    module: Path


def find(name: str, folder: Path) -> Item:
    """The item ``name`` in a module: its own file or a file of its folder."""
    if folder.with_suffix(".rs").is_file():
        files = [folder.with_suffix(".rs")]
    else:
        files = sorted(
            folder.glob("*.rs"), key=lambda file: (file.name not in ("mod.rs", "params.rs"), file.name)
        )
    for file in files:
        text = file.read_text()
        head = rf"((?:^///[^\n]*\n)*)((?:^#\[[^\n]*\]\n)*)^pub (struct|enum) {name} \{{\n(.*?)^\}}"
        if found := re.search(head, text, re.M | re.S):
            snake = "snake_case" in found[2] or "lowercase" in found[2]
            members = _members(found[4], struct=found[3] == "struct", snake=snake)
            return Item(found[3], _doc(found[1]), members, file)
    raise SystemExit(f"{name}: no struct or enum in {folder}")


def _members(body: str, *, struct: bool, snake: bool) -> list[tuple[str, str, str]]:
    if struct:
        pattern = r"((?:^ *///.*\n)*)(?:^ *#\[.*\]\n)*^ *pub (\w+): ([^\n]+),$"
        return [(name, _doc(doc), kind) for doc, name, kind in re.findall(pattern, body, re.M)]
    pattern = r"((?:^ *///.*\n)*)(?:^ *#\[.*\]\n)*^ *(\w+),$"
    found = re.findall(pattern, body, re.M)
    return [(_snake(name) if snake else name, _doc(doc), "") for doc, name in found]


def _doc(lines: str) -> str:
    return " ".join(line.strip().removeprefix("///").strip() for line in lines.splitlines())


def _snake(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def _resolve(kind: str, module: Path) -> tuple[Path, str]:
    """Module and name of a type as it is written in ``module``."""
    *path, name = kind.split("::")
    text = module.read_text()
    base = module.parent if module.name in ("mod.rs", "lib.rs") else module.with_suffix("")
    if not path:
        for group in re.findall(r"use ([\w:]+)::\{([^}]*)\};", text) + re.findall(
            r"use ([\w:]+)::(\w+);", text
        ):
            if re.search(rf"\b{name}\b", group[1]):
                path = group[0].split("::")
                break
        else:
            return (module.parent if module.name == "mod.rs" else module.with_suffix("")), name
    if path[0] == "crate":
        return SOURCE.joinpath(*path[1:]), name
    if path[0] in ("super", "self"):
        path = path[1:]
    for start in (base, module.parent, SOURCE):
        folder = start.joinpath(*path)
        if folder.is_dir() or folder.with_suffix(".rs").is_file():
            return folder, name
    raise SystemExit(f"{kind}: no such module, seen from {module}")


class Writer:
    """Classes in the order in which Python needs them."""

    def __init__(self) -> None:
        self.classes: list[str] = []
        self.common: set[str] = set()

    def struct(self, name: str, item: Item, defaults: dict[str, Any]) -> None:
        """Adds the class of a struct, and the classes that it holds before it."""
        lines = [f"class {name}(CoreModel):", *_docstring(item.doc)]
        if {m[0] for m in item.members} != set(defaults):
            raise SystemExit(
                f"{name}: {sorted({m[0] for m in item.members} ^ set(defaults))} is in source or core alone"
            )
        for key, doc, kind in item.members:
            lines += self.field(name, key, doc, kind, item, defaults[key])
        self.classes.append("\n".join(lines))

    def field(self, owner: str, key: str, doc: str, kind: str, item: Item, default: Any) -> list[str]:
        """The lines of one field."""
        optional = re.fullmatch(r"Option<(.*)>", kind)
        inner = optional[1] if optional else kind
        if inner in NUMBERS:
            hint = NUMBERS[inner]
            value = _value(default, len(f"    {key}: {hint} = "))
        else:
            folder, name = _resolve(inner, item.module)
            found = find(name, folder)
            if found.kind == "enum":
                hint = "Literal[" + ", ".join(f'"{m[0]}"' for m in found.members) + "]"
                value = repr(default).replace("'", '"')
                doc += " " + " ".join(f'"{m[0]}": {m[1]}' for m in found.members)
            else:
                stem = owner.removesuffix("Settings")
                hint = f"{'' if stem == 'Core' else stem}{''.join(p.title() for p in key.split('_'))}Settings"
                # A struct that several fields have in common is one class, named for itself.
                common = sum(kind == other for _, _, other in item.members) > 1
                if common:
                    hint = f"{'' if stem == 'Core' else stem}{name}Settings"
                if not (common and hint in self.common):
                    self.struct(hint, found, default)
                self.common.add(hint)
                value = f"{hint}()"
        comment = _wrap(doc, "    #: ")
        return [*comment, f"    {key}: {hint}{' | None' if optional else ''} = {value}"]


def _value(default: Any, column: int) -> str:
    """A literal as the formatter would have it, where ``column`` characters stand before it."""
    if not isinstance(default, list):
        return repr(default)
    line = json.dumps(default)
    if column + len(line) <= 110:
        return line
    return "[\n" + "".join(f"        {json.dumps(item)},\n" for item in default) + "    ]"


def _docstring(doc: str) -> list[str]:
    return [f'    """{doc}"""', ""]


def _wrap(text: str, lead: str) -> list[str]:
    import textwrap

    return textwrap.wrap(text, 110, initial_indent=lead, subsequent_indent=lead, break_long_words=False)


def generate() -> str:
    """The file's text."""
    from dressform import _native

    writer = Writer()
    writer.struct(
        "CoreSettings", find("Settings", SOURCE / "pipeline"), json.loads(_native.default_settings_json())
    )
    return HEAD + "".join(f"\n\n{text}\n" for text in writer.classes)


def main() -> int:
    """Writes or checks the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="fail if the file is out of date")
    text = generate()
    if not parser.parse_args().check:
        TARGET.write_text(text)
        return 0
    if TARGET.is_file() and TARGET.read_text() == text:
        return 0
    print(
        f"{TARGET.relative_to(ROOT)} is out of date: run {Path(__file__).relative_to(ROOT)}", file=sys.stderr
    )
    return 1


if __name__ == "__main__":
    sys.exit(main())
