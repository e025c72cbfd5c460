"""The command line: exit codes, and what goes to which stream."""

import json
import subprocess
import sys

import pytest
from dressform import _native
from pxr import Usd, UsdGeom


def dressform(*arguments, **options):
    command = [sys.executable, "-m", "dressform.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, **options)


def test_version_is_the_cores():
    assert dressform("version").stdout.strip() == _native.version


@pytest.mark.parametrize(
    "arguments", [["fit"], ["fit", "a.usda", "b.usda"], ["fit", "--speed"], ["dance"], ["check"]]
)
def test_usage_is_2(arguments):
    done = dressform(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr


def test_devices_lists_the_cpu():
    done = dressform("devices", "--json")
    assert done.returncode == 0
    assert "cpu" in [device["kind"] for device in json.loads(done.stdout)]


def test_check_of_the_sample_is_good(samples):
    done = dressform("check", samples / "outfits/casual_woman.usda", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["ok"]
    assert {g["name"] for g in found["garments"]} == {"Tshirt", "Skirt"}


def test_check_for_people(samples):
    done = dressform("check", samples / "characters/thin_woman.usdc")
    assert done.returncode == 0, done.stderr
    assert "good" in done.stdout


@pytest.mark.parametrize("json_flag", [[], ["--json"]])
def test_a_stage_that_is_not_there_is_3(tmp_path, json_flag):
    done = dressform("check", tmp_path / "none.usda", *json_flag)
    assert done.returncode == 3
    assert "none.usda" in done.stdout


def test_a_character_that_is_text_is_3(samples, tmp_path):
    (tmp_path / "text.usda").write_text("no stage")
    out = tmp_path / "out.usda"
    done = dressform("fit", samples / "outfits/casual_woman.usda", tmp_path / "text.usda", "-o", out)
    assert done.returncode == 3
    assert "text.usda" in done.stderr
    assert "Traceback" not in done.stderr
    assert not out.exists()


def test_a_body_of_another_topology_is_3_and_names_the_file(samples, tmp_path):
    stage = Usd.Stage.Open(str(samples / "characters/thin_woman.usdc"))
    stage.Export(str(tmp_path / "other.usda"))
    stage = Usd.Stage.Open(str(tmp_path / "other.usda"))
    mesh = max(
        (UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)),
        key=lambda m: len(m.GetPointsAttr().Get()),
    )
    indices = list(mesh.GetFaceVertexIndicesAttr().Get())
    indices[9], indices[10] = indices[10], indices[9]
    mesh.GetFaceVertexIndicesAttr().Set(indices)
    stage.Save()
    out = tmp_path / "out.usda"
    done = dressform("fit", samples / "outfits/casual_woman.usda", tmp_path / "other.usda", "-o", out)
    assert done.returncode == 3
    said = " ".join(done.stderr.split())
    for part in ("other.usda", str(mesh.GetPath()), "faceVertexIndices", "9"):
        assert part in said, done.stderr
    assert not out.exists()


def test_an_unknown_device_is_4(samples, tmp_path):
    done = dressform(
        "fit", samples / "outfits/casual_woman.usda", samples / "characters/thin_woman.usdc",
        "-o", tmp_path / "out.usda", "--device", "no such adapter", "--json",
    )  # fmt: skip
    assert done.returncode == 4
    assert "no such adapter" in done.stderr
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_setting_is_3_and_named(samples, tmp_path):
    (tmp_path / "s.toml").write_text("[drape]\nframez = 6\n")
    done = dressform(
        "fit", samples / "outfits/casual_woman.usda", samples / "characters/thin_woman.usdc",
        "-o", tmp_path / "out.usda", "--settings", tmp_path / "s.toml",
    )  # fmt: skip
    assert done.returncode == 3
    assert "s.toml drape.framez: there is no such key" in done.stderr


def test_no_clobber_keeps_what_is_there(samples, tmp_path):
    out = tmp_path / "out.usda"
    out.write_text("mine")
    done = dressform(
        "fit", samples / "outfits/casual_woman.usda", samples / "characters/thin_woman.usdc",
        "-o", out, "--no-clobber",
    )  # fmt: skip
    assert done.returncode == 3
    assert "out.usda" in done.stderr
    assert out.read_text() == "mine"


def test_sample_is_copied_once(tmp_path):
    done = dressform("sample", tmp_path / "s")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "s/outfits/casual_woman.usda").is_file()
    assert dressform("check", tmp_path / "s/outfits/casual_woman.usda").returncode == 0
    again = dressform("sample", tmp_path / "s")
    assert again.returncode == 3
    assert "exists already" in again.stderr


def test_a_bug_is_5_and_short(monkeypatch, capfd):
    from dressform import cli, sample

    def fault(folder):
        raise RuntimeError("boom")

    monkeypatch.setattr(sample, "copy_sample", fault)
    assert cli.run(["sample", "x"]) == 5
    streams = capfd.readouterr()
    assert "internal fault: RuntimeError: boom" in streams.err
    assert "Traceback" not in streams.err
    assert streams.out == ""
    monkeypatch.setenv("DRESSFORM_TRACEBACK", "1")
    assert cli.run(["sample", "x"]) == 5
    assert "Traceback" in capfd.readouterr().err
