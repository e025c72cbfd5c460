"""Outside judges of the layers we write: UsdValidation and NVIDIA's asset validator."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import dressing
import pytest
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from dressform.usd.write import write_dressed
from pxr import Usd, UsdValidation


@pytest.fixture(scope="module", params=["thin_woman", "heavy_woman"])
def written(request, tmp_path_factory, samples):
    out = tmp_path_factory.mktemp("judged") / "dressed.usda"
    outfit = read_outfit(samples / "outfits" / "casual_woman.usda")
    target, _ = read_character(samples / "characters" / f"{request.param}.usdc")
    write_dressed(out, outfit, target, dressing.dress(outfit, target))
    return out, samples / "characters" / f"{request.param}.usdc"


def test_usd_validation_is_clean(written):
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    for file in (written[0], *written[0].parent.glob("*.usdc")):
        found = context.Validate(Usd.Stage.Open(str(file)))
        assert [(e.GetName(), e.GetMessage()) for e in found] == []


def judged(file: Path, report: Path) -> set[tuple[str, str, str]]:
    """Failures and errors of NVIDIA's validator: severity, rule, message."""
    tool = Path(sys.executable).with_name("nvidia_usd_validate")
    command = [str(tool if tool.exists() else shutil.which("nvidia_usd_validate")), str(file)]
    subprocess.run([*command, "--json-output", str(report)], capture_output=True, check=False)
    issues = [issue for rule in json.loads(report.read_text())["rules"] for issue in rule["issues"]]
    return {
        (issue["severity"], issue["rule"]["name"], issue["message"])
        for issue in issues
        if issue["severity"] in ("FAILURE", "ERROR")
    }


def test_the_judge_finds_what_is_wrong(tmp_path):
    """The reading of the report would see a failure if there were one."""
    pytest.importorskip("usd_validation_nvidia", reason="usd-validation-nvidia is not installed")
    stage = Usd.Stage.CreateNew(str(tmp_path / "bad.usda"))
    stage.DefinePrim("/A/B").SetMetadata("kind", "component")
    stage.GetRootLayer().Save()
    assert "KindChecker" in {rule for _, rule, _ in judged(tmp_path / "bad.usda", tmp_path / "bad.json")}


def test_nvidia_validator_has_no_failure(written, tmp_path):
    pytest.importorskip("usd_validation_nvidia", reason="usd-validation-nvidia is not installed")
    out, character = written
    theirs = judged(character, tmp_path / "character.json")
    assert judged(out, tmp_path / "dressed.json") - theirs == set()
