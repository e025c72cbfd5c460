"""Checks that every crate we build on has a licence that deny.toml allows, and comes from crates.io.

A quick stand-in for `cargo deny check licenses sources`, which takes minutes to install.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CRATES_IO = "registry+https://github.com/rust-lang/crates.io-index"


def allowed(expression: str, allow: set[str]) -> bool:
    """Whether an SPDX expression can be met by allowed licences; AND binds closer than OR."""
    tokens = re.findall(r"\(|\)|[^\s()]+", expression.replace("/", " OR "))
    value, rest = _either(tokens, allow)
    if rest:
        raise ValueError(f"cannot read the licence '{expression}'")
    return value


def _either(tokens: list[str], allow: set[str]) -> tuple[bool, list[str]]:
    value, tokens = _both(tokens, allow)
    while tokens and tokens[0] == "OR":
        other, tokens = _both(tokens[1:], allow)
        value = value or other
    return value, tokens


def _both(tokens: list[str], allow: set[str]) -> tuple[bool, list[str]]:
    value, tokens = _one(tokens, allow)
    while tokens and tokens[0] == "AND":
        other, tokens = _one(tokens[1:], allow)
        value = value and other
    return value, tokens


def _one(tokens: list[str], allow: set[str]) -> tuple[bool, list[str]]:
    if not tokens:
        raise ValueError("a licence is missing")
    if tokens[0] == "(":
        value, rest = _either(tokens[1:], allow)
        if not rest or rest[0] != ")":
            raise ValueError("a bracket is missing")
        return value, rest[1:]
    if tokens[1:2] == ["WITH"]:
        return " ".join(tokens[:3]) in allow, tokens[3:]
    return tokens[0] in allow, tokens[1:]


def problems(packages: list[dict[str, str]], allow: set[str]) -> list[str]:
    """What is wrong, one sentence for each crate."""
    said = []
    for package in packages:
        name = f"{package['name']} {package['version']}"
        if package["source"] not in (None, CRATES_IO):
            said.append(f"{name}: comes from {package['source']}")
        if not package["license"]:
            said.append(f"{name}: names no licence")
        elif not allowed(package["license"], allow):
            said.append(f"{name}: {package['license']} is not allowed")
    return said


def main() -> int:
    """Prints what is wrong; 1 if anything is."""
    allow = set(tomllib.loads((ROOT / "deny.toml").read_text())["licenses"]["allow"])
    command = ["cargo", "metadata", "--format-version", "1", "--locked"]
    packages = json.loads(subprocess.check_output(command, cwd=ROOT))["packages"]
    said = problems(packages, allow)
    print("\n".join(said) or f"licences: {len(packages)} crates, all allowed")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
