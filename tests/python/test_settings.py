"""Settings: one definition, in Rust; files and mappings that name what is wrong."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from dressform import BadSettings, Settings, _native, load
from dressform.settings import parse

TOOL = Path(__file__).resolve().parents[2] / "python_bridge/tools/mirror_settings.py"


def test_the_mirror_is_up_to_date():
    done = subprocess.run(
        [sys.executable, TOOL, "--check"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr


def test_defaults_are_the_cores_field_by_field():
    assert json.loads(Settings().core_json()) == json.loads(_native.default_settings_json())


def test_a_file_changes_what_it_names_and_nothing_else(tmp_path):
    file = tmp_path / "settings.toml"
    file.write_text('[transfer]\nband = 1\n[read]\ncolliders = ["Shoe*"]\n')
    settings = load(file)
    assert settings.transfer.band == 1.0
    assert settings.read.colliders == ["Shoe*"]
    assert settings.drape == Settings().drape


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"drape": {"framez": 1}}, "drape.framez: there is no such key"),
        ({"speed": 1}, "speed: there is no such key"),
        ({"drape": {"frames": "6"}}, "drape.frames: input should be a valid integer"),
        ({"drape": {"frames": -1}}, "drape.frames: input should be greater"),
        ({"drape": {"gravity": float("nan")}}, "drape.gravity: input should be a finite number"),
        ({"pattern": {"fit": "baggy"}}, "pattern.fit: input should be 'keep' or 'loose'"),
    ],
)
def test_what_is_wrong_is_named(tables, said):
    with pytest.raises(BadSettings) as caught:
        parse(tables, "my.toml")
    assert f"my.toml {said}" in str(caught.value)


def test_files_that_are_no_settings(tmp_path):
    (tmp_path / "bad.toml").write_text("[drape\n")
    for name in ("bad.toml", "none.toml"):
        with pytest.raises(BadSettings, match=name):
            load(tmp_path / name)
