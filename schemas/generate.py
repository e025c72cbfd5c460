"""Generates the registered form of ``schema.usda`` and puts it into the Python package.

``python schemas/generate.py`` rewrites the checked-in files; ``--to DIR`` writes elsewhere, which
is how the test compares. Needs usd-core and jinja2.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGE_COPY = HERE.parent / "python_bridge" / "python" / "dressform" / "usd" / "schema"
FILES = ("generatedSchema.usda", "plugInfo.json")

# A codeless schema has no library: the plugin is a resource that stands beside its files.
TOKENS = {
    "@PLUG_INFO_LIBRARY_PATH@": "",
    "@PLUG_INFO_RESOURCE_PATH@": ".",
    "@PLUG_INFO_ROOT@": ".",
}


def plug_info(generated: str) -> str:
    """plugInfo.json with comments stripped, tokens filled in and keys in a fixed order."""
    lines = [line for line in generated.splitlines() if not line.lstrip().startswith("#")]
    text = "\n".join(lines)
    for token, value in TOKENS.items():
        text = text.replace(token, value)
    info = json.loads(text)
    for plugin in info["Plugins"]:
        plugin["Type"] = "resource"
        plugin.pop("LibraryPath", None)
    return json.dumps(info, indent=4, sort_keys=True) + "\n"


def generate(target: Path) -> None:
    """Runs usdGenSchema on ``schema.usda`` and writes ``FILES`` into ``target``."""
    with tempfile.TemporaryDirectory() as work:
        command = [sys.executable, "-m", "pxr.Usd.usdGenSchema", str(HERE / "schema.usda"), work]
        done = subprocess.run(command, capture_output=True, text=True, cwd=work, check=False)
        if done.returncode != 0:
            raise SystemExit(f"usdGenSchema failed:\n{done.stdout}{done.stderr}")
        target.mkdir(parents=True, exist_ok=True)
        shutil.copy(Path(work) / "generatedSchema.usda", target / "generatedSchema.usda")
        generated = (Path(work) / "plugInfo.json").read_text(encoding="utf-8")
        (target / "plugInfo.json").write_text(plug_info(generated), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--to", type=Path, default=PACKAGE_COPY)
    generate(parser.parse_args().to)


if __name__ == "__main__":
    main()
