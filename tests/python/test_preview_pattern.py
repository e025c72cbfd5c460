"""Panels drawn flat: which borders are sewn, and a file for each garment."""

from __future__ import annotations

import copy
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from dressform.model import Outfit
from dressform.preview import draw_patterns
from dressform.preview.sewing import borders


def test_the_two_sides_of_a_seam_share_a_number(sample_outfit: Outfit):
    for garment in sample_outfit.garments:
        runs = borders(garment)
        sides: dict[int, list] = {}
        for run in runs:
            flat = garment.corner_pattern[run.corners[:, 0], run.corners[:, 1]]
            length = np.linalg.norm(np.diff(flat, axis=0), axis=1).sum()
            sides.setdefault(run.chain, []).append((run.panel, length))
            assert set(garment.panel_of_triangle[run.corners[:, 0]]) == {run.panel}
        assert sides.pop(-1), "hems are sewn to nothing"
        for chain, parts in sides.items():
            panels = sorted({panel for panel, _ in parts})
            assert len(panels) == 2, (garment.name, chain, parts)
            a, b = (sum(length for p, length in parts if p == panel) for panel in panels)
            assert 0.8 < a / b < 1.25, (garment.name, chain, a, b)


def test_a_picture_for_each_garment_that_does_not_change(sample_outfit: Outfit, tmp_path: Path):
    wide = copy.deepcopy(sample_outfit.garments)
    for garment in wide:
        garment.corner_pattern *= [1.0, 1.1]
    written = draw_patterns(wide, tmp_path / "p.svg", sources=sample_outfit.garments)
    assert [path.name for path in written] == [f"p-{garment.name}.svg" for garment in wide]
    for path in written:
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
    again = draw_patterns(wide[:1], tmp_path / "one.svg", sources=sample_outfit.garments[:1])
    assert again == [tmp_path / "one.svg"]
    assert again[0].read_bytes() == written[0].read_bytes()
