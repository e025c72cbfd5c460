"""A result is there as a whole or not at all, and an older one survives every failure."""

from __future__ import annotations

import os
import subprocess
import sys

import dressing
import pytest
import scenes
from conftest import REPOSITORY
from dressform.errors import BadOutput
from dressform.usd import atomic
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from dressform.usd.write import check_target, write_dressed
from pxr import Usd


@pytest.fixture
def inputs(tmp_path):
    folder = tmp_path / "inputs"
    folder.mkdir()
    outfit = read_outfit(scenes.saved(scenes.outfit_stage(folder / "outfit.usda")))
    target, _ = read_character(scenes.saved(scenes.character_stage(folder / "hero.usda", girth=1.2)))
    return outfit, target, dressing.dress(outfit, target)


def contents(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.is_file()}


def test_a_parent_that_is_a_file(tmp_path, inputs):
    (tmp_path / "file").write_text("x")
    with pytest.raises(BadOutput) as caught:
        write_dressed(tmp_path / "file" / "sub" / "out.usda", *inputs)
    assert "file/sub/out.usda" in str(caught.value) and "cannot be written" in str(caught.value)
    assert (tmp_path / "file").read_text() == "x"


def test_a_target_is_checked_before_anything_is_computed(tmp_path):
    (tmp_path / "file").write_text("x")
    assert check_target(tmp_path / "new" / "out.usda") == tmp_path / "new" / "out.usda"
    assert not (tmp_path / "new").exists()
    for bad in ("file/out.usda", "out.txt", "file/sub/out.usdc"):
        with pytest.raises(BadOutput):
            check_target(tmp_path / bad)


@pytest.mark.parametrize("name", ["out", "out.obj", "out.usdz"])
def test_names_that_are_no_layer(tmp_path, inputs, name):
    with pytest.raises(BadOutput, match="must end in"):
        write_dressed(tmp_path / name, *inputs)


def test_a_folder_in_the_way(tmp_path, inputs):
    (tmp_path / "out.usda").mkdir()
    with pytest.raises(BadOutput, match="folder"):
        write_dressed(tmp_path / "out.usda", *inputs)


def test_inputs_are_refused_as_output(tmp_path, inputs):
    outfit, target, _ = inputs
    link = tmp_path / "link.usda"
    link.symlink_to(outfit.file)
    for file in (outfit.file, target.origin.file, link):
        before = contents(tmp_path / "inputs")
        with pytest.raises(BadOutput, match="never changed"):
            write_dressed(file, *inputs)
        assert contents(tmp_path / "inputs") == before


def test_no_clobber(tmp_path, inputs):
    out = tmp_path / "out" / "dressed.usda"
    write_dressed(out, *inputs, clobber=False)
    before = contents(out.parent)
    with pytest.raises(BadOutput, match="exists already"):
        write_dressed(out, *inputs, clobber=False)
    assert contents(out.parent) == before


def test_replacing_leaves_no_old_arrays(tmp_path, inputs):
    outfit, target, results = inputs
    out = tmp_path / "out" / "dressed.usda"
    write_dressed(out, outfit, target, results)
    old = contents(out.parent)
    results[0].points = results[0].points + 0.001
    write_dressed(out, outfit, target, results)
    new = contents(out.parent)
    assert len(new) == 2 and set(new) != set(old)
    assert Usd.Stage.Open(str(out)).GetCompositionErrors() == []


def test_arrays_that_another_root_may_use_stay(tmp_path, inputs):
    outfit, target, results = inputs
    folder = tmp_path / "out"
    write_dressed(folder / "dressed.usda", outfit, target, results)
    write_dressed(folder / "dressed.usdc", outfit, target, results)
    results[0].points = results[0].points + 0.001
    write_dressed(folder / "dressed.usda", outfit, target, results)
    for name in ("dressed.usda", "dressed.usdc"):
        stage = Usd.Stage.Open(str(folder / name))
        assert (
            stage.GetCompositionErrors() == []
            and stage.GetPrimAtPath("/Hero/Outfit/Shirt").GetAttribute("points").Get()
        )


@pytest.mark.parametrize("fails_at", [0, 1])
def test_a_rename_that_fails_leaves_the_old_result(tmp_path, inputs, monkeypatch, fails_at):
    outfit, target, results = inputs
    out = tmp_path / "out" / "dressed.usda"
    write_dressed(out, outfit, target, results)
    before = contents(out.parent)
    results[0].points = results[0].points + 0.001
    calls, real = [], os.replace

    def replace(a, b):
        calls.append(b)
        if len(calls) - 1 == fails_at:
            raise OSError(28, "No space left on device")
        real(a, b)

    monkeypatch.setattr(atomic.os, "replace", replace)
    with pytest.raises(BadOutput, match="No space left"):
        write_dressed(out, outfit, target, results)
    assert contents(out.parent) == before and len(list(out.parent.iterdir())) == 2


LIMITED = """
import resource, signal, sys
sys.path[:0] = sys.argv[5:]
import conftest, dressing
from dressform.errors import BadOutput
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from dressform.usd.write import write_dressed
outfit, target = read_outfit(sys.argv[1]), read_character(sys.argv[2])[0]
results = dressing.dress(outfit, target)
results[0].points = results[0].points + 0.001
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[4]),) * 2)
try:
    write_dressed(sys.argv[3], outfit, target, results)
except BadOutput as error:
    print(error)
    sys.exit(3)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX limits")
@pytest.mark.parametrize("limit", [0, 512, 8192])
def test_a_disk_that_fills_up(tmp_path, inputs, limit):
    """A limit on file size stands for a full disk: writes fall short from some byte on."""
    outfit, target, results = inputs
    out = tmp_path / "out" / "dressed.usda"
    write_dressed(out, outfit, target, results)
    before = contents(out.parent)
    here = str(REPOSITORY / "tests" / "python")
    command = [sys.executable, "-c", LIMITED, outfit.file, target.origin.file, str(out), str(limit), here]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 3, done.stderr
    assert str(out) in done.stdout
    assert contents(out.parent) == before and len(list(out.parent.iterdir())) == 2


def test_wrong_results_are_a_bug_and_write_nothing(tmp_path, inputs):
    outfit, target, results = inputs
    out = tmp_path / "out" / "dressed.usda"
    results[0].points = results[0].points[:-1]
    with pytest.raises(ValueError, match="points have shape"):
        write_dressed(out, outfit, target, results)
    assert not out.parent.exists()
