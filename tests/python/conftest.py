"""Fixtures: the sample of the repository, and small made-up scenes (see ``scenes``)."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
if importlib.util.find_spec("dressform") is None:  # not installed: from the source tree
    sys.path.insert(0, str(REPOSITORY / "python_bridge" / "python"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from dressform.model import Character, Outfit  # noqa: E402
from dressform.usd.character import read_character  # noqa: E402
from dressform.usd.garment import read_outfit  # noqa: E402

SAMPLES = REPOSITORY / "samples"


@pytest.fixture(scope="session")
def samples() -> Path:
    return SAMPLES


@pytest.fixture(scope="session")
def sample_outfit() -> Outfit:
    return read_outfit(SAMPLES / "outfits" / "casual_woman.usda")


@pytest.fixture(scope="session")
def sample_target() -> Character:
    return read_character(SAMPLES / "characters" / "thin_woman.usdc")[0]


@pytest.fixture(scope="session")
def outside_data() -> Path:
    """The larger data set, where the environment names one."""
    folder = os.environ.get("DRESSFORM_DATA")
    if not folder:
        pytest.skip("DRESSFORM_DATA is not set")
    return Path(folder)
