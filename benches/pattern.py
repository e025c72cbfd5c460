#!/usr/bin/env python3
"""The pattern refit on every pair of a data folder: what it costs in strain, what it keeps, how long it takes.

    pattern.py DATA [--cache DIR] [--table docs/pattern.md] [--only OUTFIT:CHARACTER ...]

Garments are transferred and not draped; with a cache a rerun has only the refits to do. The yardstick
of every ratio is the paper's base energy alone, the least change of strain that any pattern can have.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import dressform
import numpy as np
from all_pairs import head as table_head
from all_pairs import pairs
from dressform.model import GarmentSource
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit

#: Tables are written after this line.
MARKER = "<!-- made by benches/pattern.py -->"
STILL = json.dumps({"drape": {"frames": 0, "push_steps": 0, "settle": False}})
#: No term for the outline, no demand.
BASE = {
    "outline_weight": 0.0, "straight_weight": 0.0, "seam_iterations": 0, "mirror": False, "tidy": "never",
}  # fmt: skip
#: Demands on lengths, none on shape.
LENGTHS = {"straight_weight": 0.0, "straight_bound": 100.0, "corner_bound": 180.0, "mirror": False}
#: Rows of the trade-off.
TRADE = {
    "base energy alone": BASE,
    "paper's edges, weight 0.1": BASE | {"outline_weight": 0.1},
    "paper's edges, weight 1": BASE | {"outline_weight": 1.0},
    "paper's edges, weight 10": BASE | {"outline_weight": 10.0},
    "paper's edges, weight 100": BASE | {"outline_weight": 100.0},
    "paper's edges, weight 1000": BASE | {"outline_weight": 1000.0},
    "equal lengths, no outline": LENGTHS | {"outline_weight": 0.0},
    "equal lengths, edges 0.03": LENGTHS,
    "all demands (default)": {},
    "bounds of 0.5% and 1.5 degrees": {"straight_bound": 0.005, "corner_bound": 1.5},
    "bounds of 0.2% and 0.5 degrees": {"straight_bound": 0.002, "corner_bound": 0.5},
}


@dataclass
class Case:
    """A garment carried to a body."""

    name: str
    garment: GarmentSource
    points: Any
    #: Outfit and character, the garment's report, and the CPU seconds of its outfit's transfer and refit.
    pair: str = ""
    report: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0


def refit(case: Case, pattern: dict) -> tuple[dict, float]:
    """The refit's report and its CPU seconds."""
    started = time.process_time()
    result = dressform.refit_arrays(case.garment, case.points, json.dumps({"pattern": pattern}))
    return result.report, time.process_time() - started


def carried(data: Path, cache: str | None, only: list[str]) -> list[Case]:
    """Every garment on every target."""
    cases = []
    for outfit_path, character in pairs(data):
        name = f"{outfit_path.stem}:{character.stem}"
        if character.stem.startswith("source_") or (only and name not in only):
            continue
        outfit, (target, _) = read_outfit(outfit_path), read_character(character)
        started = time.process_time()
        fitted = dressform.fit_arrays(outfit, target, STILL, "cpu", None, cache)
        seconds = time.process_time() - started
        pair, reports = f"{outfit_path.stem} on {character.stem}", fitted.report["garments"]
        for garment, dressed, report in zip(outfit.garments, fitted.garments, reports, strict=True):
            label = f"{outfit_path.stem} {garment.name} on {character.stem}"
            cases.append(Case(label, garment, dressed.points, pair, report, seconds))
        print(name, file=sys.stderr, flush=True)
    return cases


def pair_table(cases: list[Case]) -> list[str]:
    """What the default does to each garment."""
    head = "garment | strain change p50 / p99 | over base alone | mismatch % | straight % | corner deg "
    head += (
        "| mirror mm | grain deg | flips, repair | bounds | steps | residuals: length, shape, step mm | CPU s"
    )
    rows = ["## Every garment on every target", "", *table_head(head)]
    for case in cases:
        base, _ = refit(case, BASE)
        now, seconds = refit(case, {})
        over = [now[f"strain_change_p{p}"] / base[f"strain_change_p{p}"] for p in (50, 99)]
        cells = [
            case.name, f"{now['strain_change_p50']:.3f} / {now['strain_change_p99']:.3f}",
            f"{over[0]:.2f} / {over[1]:.2f}", f"{100 * now['seam_mismatch_max']:.4f}",
            f"{100 * now['straight_deviation_max']:.2f}", f"{now['corner_change_max_deg']:.2f}",
            f"{1e3 * now['mirror_distance_max_m']:.2f}", f"{now['grain_turn_max_deg']:.2f}",
            f"{now['flipped_triangles']}, {now['repaired']}", str(now["bounds_held"]), str(now["iterations"]),
            f"{now['length_residual']:.0e}, {now['shape_residual']:.0e}, {1e3 * now['step_residual_m']:.0e}"
            + ("" if now["converged"] else " (not converged)"),
            f"{seconds:.2f}",
        ]  # fmt: skip
        rows.append("| " + " | ".join(cells) + " |")
    return rows


def outfit_table(cases: list[Case]) -> list[str]:
    """Transfer and refit of each outfit: the worst of its garments."""
    head = "pair | gap p99 / mean mm | outer | CG | CPU s | strain change p50 / p99 | mismatch % | flips"
    rows = ["## Every pair", "", *table_head(head)]
    for pair in dict.fromkeys(case.pair for case in cases):
        worn = [case for case in cases if case.pair == pair]
        flow = worn[0].report["transfer"]
        refits = [case.report["pattern"] for case in worn]

        def worst(key: str, refits: list[dict] = refits) -> float:
            return max(r[key] for r in refits)

        cells = [
            pair, f"{1e3 * flow['gap_p99_m']:.3f} / {1e3 * flow['gap_mean_m']:.3f}",
            str(flow["outer_iterations"]), str(flow["cg_iterations"]), f"{worn[0].seconds:.1f}",
            f"{worst('strain_change_p50'):.3f} / {worst('strain_change_p99'):.3f}",
            f"{100 * worst('seam_mismatch_max'):.4f}", str(sum(r["flipped_triangles"] for r in refits)),
        ]  # fmt: skip
        rows.append("| " + " | ".join(cells) + " |")
    return rows


def trade_table(cases: list[Case]) -> list[str]:
    """Strain against lengths and shape: the worst and the middle garment of each way to solve."""
    head = "way | mismatch % worst (middle) | strain p50 over base worst (middle) | strain p99 over base "
    head += "worst (middle) | straight % worst (middle) | corner deg worst (middle) | not converged"
    rows = ["## Strain against lengths and shape", "", *table_head(head)]
    base = [refit(case, BASE)[0] for case in cases]
    for way, settings in TRADE.items():
        reports = [refit(case, settings)[0] for case in cases]

        def both(values: list[float], digits: int = 2) -> str:
            return f"{max(values):.{digits}f} ({np.median(values):.{digits}f})"

        def over(key: str, reports: list[dict] = reports) -> list[float]:
            return [r[key] / b[key] for r, b in zip(reports, base, strict=True)]

        cells = [
            way, both([100 * r["seam_mismatch_max"] for r in reports], 3),
            both(over("strain_change_p50")), both(over("strain_change_p99")),
            both([100 * r["straight_deviation_max"] for r in reports]),
            both([r["corner_change_max_deg"] for r in reports], 1),
            "" if settings.get("seam_iterations") == 0 else str(sum(not r["converged"] for r in reports)),
        ]  # fmt: skip
        rows.append("| " + " | ".join(cells) + " |")
    return rows


def crumpled_table(cases: list[Case]) -> list[str]:
    """Flips and repairs after noise on the carried points."""
    head = "noise mm | garments | flipped triangles left | repairs"
    rows = ["## Crumpled transfers", "", *table_head(head)]
    for amplitude in (2, 5, 10):
        repairs: dict[str, int] = {}
        flips = 0
        for number, case in enumerate(cases):
            noise = np.random.default_rng(number).uniform(-1, 1, case.points.shape) * amplitude * 1e-3
            report, _ = refit(replace(case, points=case.points + noise), {})
            repairs[report["repaired"]] = repairs.get(report["repaired"], 0) + 1
            flips += report["flipped_triangles"]
        said = ", ".join(f"{count} {name}" for name, count in sorted(repairs.items()))
        rows.append(f"| {amplitude} | {len(cases)} | {flips} | {said} |")
    return rows


def finer(case: Case) -> Case:
    """Every triangle in four; the seams are shared points."""
    g = case.garment
    edges = np.sort(np.stack([g.triangles[:, [0, 1]], g.triangles[:, [1, 2]], g.triangles[:, [2, 0]]], 1), 2)
    unique, middle = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    middle = middle.reshape(-1, 3) + len(g.points)

    def split(corners: Any, between: Any) -> Any:
        (a, b, c), (ab, bc, ca) = (np.moveaxis(x, 1, 0) for x in (corners, between))
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        return np.concatenate([np.stack(part, 1) for part in parts])

    def half(points: Any) -> Any:
        return np.concatenate([points, points[unique].mean(1)])

    uv = g.corner_pattern
    return Case(
        case.name,
        replace(
            g,
            points=half(g.points),
            triangles=split(g.triangles, middle).astype(np.uint32),
            corner_pattern=split(uv, (uv + np.roll(uv, -1, 1)) / 2),
            panel_of_triangle=np.tile(g.panel_of_triangle, 4),
        ),
        half(case.points),
    )


def size_table(case: Case) -> list[str]:
    """CPU time of a welded garment, refined."""
    head = "points | CPU s (median of 3) | us a point | steps | bounds | length residual | converged"
    rows = [f"## Size ({case.name}, refined)", "", *table_head(head)]
    for level in range(4):
        case = finer(case) if level else case
        runs = [refit(case, {}) for _ in range(3)]
        report, seconds = runs[0][0], float(np.median([s for _, s in runs]))
        count = len(case.points)
        cells = [
            f"{count:,}", f"{seconds:.2f}", f"{1e6 * seconds / count:.0f}", str(report["iterations"]),
            str(report["bounds_held"]), f"{report['length_residual']:.0e}", str(report["converged"]).lower(),
        ]  # fmt: skip
        rows.append("| " + " | ".join(cells) + " |")
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--cache")
    parser.add_argument("--table", type=Path)
    parser.add_argument("--only", nargs="*", default=[], metavar="OUTFIT:CHARACTER")
    options = parser.parse_args()
    cases = carried(options.data, options.cache, options.only)
    welded = [case for case in cases if not case.garment.seams]
    parts = [
        outfit_table(cases),
        trade_table(cases),
        crumpled_table(cases),
        size_table(welded[0]),
        pair_table(cases),
    ]
    text = "\n\n".join("\n".join(part) for part in parts) + "\n"
    print(text)
    if options.table:
        prose = options.table.read_text().partition(MARKER)[0]
        options.table.write_text(f"{prose}{MARKER}\n\n{text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
