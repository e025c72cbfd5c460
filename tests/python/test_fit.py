"""The main job through the command line and through Python, cut short by settings."""

import json
import os
import signal
import subprocess
import sys
import time

import dressform
import numpy as np
import pytest
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from pxr import Usd

#: One untangling step: enough to go through every stage.
SHORT = {"drape": {"frames": 1, "steps_per_frame": 1, "max_newton": 2, "push_steps": 0, "settle": False}}
STAGES = {"read", "transfer", "pattern", "drape", "rig", "certify", "write", "total"}


@pytest.fixture(scope="module")
def fitted(samples, tmp_path_factory):
    """One garment, through the command line: exit code, streams and the root layer."""
    folder = tmp_path_factory.mktemp("fit")
    lines = [f"{key} = {json.dumps(value)}" for key, value in SHORT["drape"].items()]
    text = "\n".join(["[drape]", *lines, '[read]\ngarments = ["/Outfit/Skirt"]', ""])
    (folder / "short.toml").write_text(text)
    out = folder / "out.usda"
    command = [
        sys.executable, "-m", "dressform", "fit", samples / "outfits/casual_woman.usda",
        samples / "characters/thin_woman.usdc", "-o", out, "--settings", folder / "short.toml",
        "--device", "cpu", "--json",
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False), out


def test_json_is_one_object_with_every_stage(fitted):
    done, out = fitted
    assert done.returncode in (0, 1), done.stderr
    answer = json.loads(done.stdout)
    assert answer["passed"] is (done.returncode == 0)
    assert bool(answer["broken"]) is (done.returncode == 1)
    assert answer["output"] == str(out)
    assert answer["device"]["kind"] == "cpu"
    assert set(answer["seconds"]) == STAGES
    (skirt,) = answer["garments"]
    assert (skirt["name"], skirt["vertices"], skirt["triangles"], skirt["panels"]) == ("Skirt", 2414, 4489, 4)
    assert skirt["seams"] == 6
    assert sum(skirt["rig"][key] for key in ("matched", "inpainted", "nearest")) == pytest.approx(1.0)
    dressform.Result.model_validate(answer)


def test_every_pose_is_in_the_report_and_in_the_layer(fitted):
    done, out = fitted
    (skirt,) = json.loads(done.stdout)["garments"]
    posed = skirt["certificate"]["posed"]
    assert len(posed) >= 12
    assert all(0.0 <= f["inside"] < 0.1 and f["edge_stretch"][1] > 0.5 for f in posed)
    stage = Usd.Stage.Open(str(out))
    prim = stage.GetPrimAtPath("/thin_woman/Outfit/Skirt")
    names = prim.GetAttribute("garment:certificate:posed:poses").Get()
    assert list(names) == [f["pose"] for f in posed]


def test_what_was_written_reads_back(fitted):
    _, out = fitted
    (skirt,) = read_outfit(out).garments
    assert skirt.points.shape == (2414, 3)
    assert read_character(out)[0].name


def test_arrays_without_usd(samples):
    outfit = read_outfit(samples / "outfits/casual_woman.usda", garments=["/Outfit/Skirt"])
    target, _ = read_character(samples / "characters/thin_woman.usdc")
    seen = []
    fitted = dressform.fit_arrays(
        outfit, target, json.dumps(SHORT), "cpu", lambda stage, part: seen.append((stage, part))
    )
    (skirt,) = fitted.garments
    assert skirt.points.shape == outfit.garments[0].points.shape
    assert skirt.corner_pattern.shape == outfit.garments[0].corner_pattern.shape
    assert np.isfinite(skirt.points).all()
    assert {"transfer", "pattern", "drape", "rig", "certify"} <= {stage for stage, _ in seen}
    assert all(0.0 <= part <= 1.0 for _, part in seen)


def test_an_exception_in_progress_comes_back(samples):
    outfit = read_outfit(samples / "outfits/casual_woman.usda", garments=["/Outfit/Skirt"])
    target, _ = read_character(samples / "characters/thin_woman.usdc")

    def stop(stage, part):
        raise LookupError(stage)

    with pytest.raises(LookupError, match="transfer"):
        dressform.fit_arrays(outfit, target, "{}", "cpu", stop)


#: Tells of each stage, so that the interrupt comes while the core runs.
SCRIPT = """
import sys
from dressform import cli, report
report.Progress.__call__ = lambda self, stage, part: print(stage, file=sys.stderr, flush=True)
sys.exit(cli.run(sys.argv[1:]))
"""


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX's")
def test_interrupt_is_quick_and_leaves_nothing(samples, tmp_path):
    command = [
        sys.executable, "-c", SCRIPT, "fit", samples / "outfits/casual_woman.usda",
        samples / "characters/thin_woman.usdc", "-o", tmp_path / "out.usda", "--device", "cpu",
    ]  # fmt: skip
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as job:
        assert any("transfer" in line for line in job.stderr)
        started = time.monotonic()
        job.send_signal(signal.SIGINT)
        assert job.wait(timeout=60) == 130
        assert time.monotonic() - started < 10.0
    assert list(tmp_path.iterdir()) == []
