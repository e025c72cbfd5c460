#!/usr/bin/env python3
"""Ten made tangles, each from a seed: what starts crossed, inside or pinched must end clean.

    tangles.py DATA [--only N ...] [--frames 1] [--seeds 0] [--keep FOLDER] [--peers]

Garments of DATA's outfits on their own bodies (they start clean there), disturbed: arms and sleeves
lowered into the torso, an upper layer drawn below the lower one, garments in a body that is up to 10 cm
larger, cloth pressed into the folds of a very heavy body, a skirt's back through its front.
Clean: no triangle pair of cloth and body, cloth and layer, or cloth and itself, by the exact test
(and by the peers' judges, with --peers), and every time step after the pushes converged.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import dressform
import numpy as np
from dressform.model import Character, GarmentSource, Outfit
from dressform.native import drape_arrays, intersections, outer_skin
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from scipy.spatial import cKDTree

Mesh = tuple[np.ndarray, np.ndarray]


@dataclass
class Tangle:
    """A garment, where it starts, and what it is draped over."""

    name: str
    garment: GarmentSource
    start: np.ndarray
    colliders: list[Mesh]
    layers: list[Mesh] = field(default_factory=list)
    corner_pattern: np.ndarray | None = None


def welded(garment: GarmentSource, points: np.ndarray) -> Mesh:
    """The mesh with sewn points merged (those sewn with an offset stay apart)."""
    label = np.arange(len(points))
    for seam in garment.seams:
        if not seam.offset:
            for a, b in seam.pairs:
                label[label == label[b]] = label[a]
    return points[label], label[garment.triangles].astype(np.uint32)


def points_of(garment: GarmentSource, *labels: str) -> np.ndarray:
    """Whether each point belongs to a panel with one of these words in its label."""
    panels = [i for i, p in enumerate(garment.panels) if any(word in p.label for word in labels)]
    chosen = np.zeros(len(garment.points), dtype=bool)
    chosen[garment.triangles[np.isin(garment.panel_of_triangle, panels)]] = True
    return chosen


def arm_shares(body: Character) -> np.ndarray:
    """How far each point of a body follows its arms: skin weights of the arms' joints, shape [n, 2]."""
    shares = np.zeros((len(body.points), 2))
    joints = body.joint_indices.reshape(len(body.points), -1)
    weights = body.joint_weights.reshape(len(body.points), -1)
    for side, mark in enumerate(("L", "R")):
        roots = [i for i, j in enumerate(body.joints) if j.split("/")[-1] == f"upperarm01_{mark}"]
        arm = set(roots)
        for i, parent in enumerate(body.joint_parents):
            if parent in arm:
                arm.add(i)
        shares[:, side] = np.where(np.isin(joints, list(arm)), weights, 0.0).sum(axis=1)
    return shares


def lowered(
    points: np.ndarray, shares: np.ndarray, body: Character, angle: float, swing: float
) -> np.ndarray:
    """Arms turned about the shoulders, down by ``angle`` and forward by ``swing`` [rad]."""
    for side, mark in enumerate(("L", "R")):
        root = next(i for i, j in enumerate(body.joints) if j.split("/")[-1] == f"upperarm01_{mark}")
        pivot = body.world_from_joint[root][:3, 3]
        x, y, z = (points - pivot).T
        sign = np.sign(pivot[0])
        a, b = -sign * angle * shares[:, side], -sign * swing * shares[:, side]
        x, y = np.cos(a) * x - np.sin(a) * y, np.sin(a) * x + np.cos(a) * y
        x, z = np.cos(b) * x + np.sin(b) * z, -np.sin(b) * x + np.cos(b) * z
        points = pivot + np.stack([x, y, z], 1)
    return points


def bodies(outfit: Outfit) -> list[Mesh]:
    return [outer_skin(b.points, b.triangles) for b in outfit.bodies]


def normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    face = np.cross(
        points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    )
    sums = np.zeros_like(points)
    for k in range(3):
        np.add.at(sums, triangles[:, k], face)
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)


def pressed(
    points: np.ndarray, triangles: np.ndarray, centre: np.ndarray, reach: float, depth: float
) -> np.ndarray:
    """Cloth within ``reach`` of ``centre`` pressed in by up to ``depth`` [m]."""
    distance = np.linalg.norm(points - centre, axis=1)
    share = np.exp(-((distance / reach) ** 2))[:, None]
    return points - normals(points, triangles) * share * depth


def tangles(data: Path, cache: Path, seeds: int = 0) -> list[Callable[[], Tangle]]:
    """The ten, made when they are asked for; ``seeds`` is added to the seed of each."""
    man, woman = (read_outfit(data / "outfits" / f"casual_{who}.usda") for who in ("man", "woman"))
    named = {(o.name, g.name): g for o in (man, woman) for g in o.garments}
    pick = lambda outfit, name: named[(outfit.name, name)]  # noqa: E731
    man_body, woman_body = bodies(man), bodies(woman)

    def sleeves(outfit: Outfit, name: str, angle: float, swing: float, seed: int) -> Tangle:
        """Arms and sleeves lowered into the torso: the body crosses itself, and so does the cloth."""
        random = np.random.default_rng(seed)
        angle, swing = angle * random.uniform(0.9, 1.1), swing * random.uniform(0.9, 1.1)
        garment, body = pick(outfit, name), outfit.bodies[0]
        shares = arm_shares(body)
        nearest = cKDTree(body.points).query(garment.points)[1]
        start = lowered(garment.points, shares[nearest], body, angle, swing)
        posed = lowered(body.points, shares, body, angle, swing)
        return Tangle(f"arms in {name} lowered by {angle:.2f} and {swing:.2f} rad", garment, start,
                      [outer_skin(posed, body.triangles)])  # fmt: skip

    def deep(outfit: Outfit, name: str, seed: int) -> Tangle:
        """A garment where it sits on its own body, in one that is up to 10 cm larger."""
        random = np.random.default_rng(seed)
        body = read_character(data / "characters" / "very_heavy_man.usdc")[0]
        garment = pick(outfit, name)
        start = garment.points + random.uniform(-0.01, 0.01, 3)
        return Tangle(f"{name} inside of a very heavy man", garment, start,
                      [outer_skin(body.points, body.triangles)])  # fmt: skip

    def swapped(outfit: Outfit, body: list[Mesh], upper: str, lower: str, depth: float, seed: int) -> Tangle:
        random = np.random.default_rng(seed)
        garment, below = pick(outfit, upper), pick(outfit, lower)
        start = garment.points - normals(*welded(garment, garment.points)) * depth * random.uniform(0.9, 1.1)
        return Tangle(f"{upper} {depth * 1e3:.0f} mm in, below {lower}", garment, start, body,
                      [welded(below, below.points)])  # fmt: skip

    def pinched(name: str, seed: int) -> Tangle:
        garment, start, corners, body = transferred(data, "casual_man", "very_heavy_man", name, cache)
        random = np.random.default_rng(seed)
        flank = np.flatnonzero((np.abs(start[:, 0]) > 0.12) & (start[:, 1] < np.quantile(start[:, 1], 0.8)))
        for centre in random.choice(flank, 6, replace=False):
            start = pressed(start, garment.triangles, start[centre], 0.05, 0.03)
        return Tangle(f"{name} pressed into the folds of a very heavy man", garment, start, body,
                      corner_pattern=corners)  # fmt: skip

    def through(seed: int) -> Tangle:
        garment = pick(woman, "Skirt")
        random = np.random.default_rng(seed)
        points = garment.points.copy()
        back = points_of(garment, "skirt_back")
        low = np.clip((np.quantile(points[:, 1], 0.6) - points[:, 1]) / 0.2, 0.0, 1.0)
        side = np.exp(-((points[:, 0] / 0.1) ** 2))
        forward = points[points_of(garment, "skirt_front"), 2].mean() - points[back, 2].mean()
        points[:, 2] += np.where(back, low * side * forward * random.uniform(1.1, 1.2), 0.0)
        return Tangle("a skirt's back through its front", garment, points, [])

    return [
        lambda: sleeves(man, "Hoody", 0.45, 0.0, seeds + 1),
        lambda: sleeves(man, "Tshirt", 0.45, 0.3, seeds + 2),
        lambda: sleeves(woman, "Tshirt", 0.5, 0.1, seeds + 3),
        lambda: swapped(man, man_body, "Hoody", "Tshirt", 0.012, seeds + 4),
        lambda: swapped(woman, woman_body, "Tshirt", "Skirt", 0.01, seeds + 5),
        lambda: deep(man, "Pants", seeds + 6),
        lambda: deep(man, "Hoody", seeds + 7),
        lambda: pinched("Hoody", seeds + 8),
        lambda: pinched("Pants", seeds + 9),
        lambda: through(seeds + 10),
    ]


def transferred(
    data: Path, outfit: str, character: str, name: str, cache: Path
) -> tuple[GarmentSource, np.ndarray, np.ndarray, list[Mesh]]:
    """A garment carried to a character and refitted, not draped; kept in a folder."""
    target = read_character(data / "characters" / f"{character}.usdc")[0]
    source = read_outfit(data / "outfits" / f"{outfit}.usda")
    file = cache / f"{outfit}_{character}.npz"
    if not file.exists():
        still = dressform.Settings.model_validate({"drape": {"frames": 0, "push_steps": 0, "settle": False}})
        fitted = dressform.fit_arrays(source, target, still.core_json(), "cpu")
        arrays = {}
        for garment, dressed in zip(source.garments, fitted.garments, strict=True):
            arrays |= {
                f"{garment.name}.points": dressed.points,
                f"{garment.name}.corners": dressed.corner_pattern,
            }
        cache.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(file, **arrays)
    kept = np.load(file)
    garment = next(g for g in source.garments if g.name == name)
    skin = [outer_skin(target.points, target.triangles)]
    return garment, kept[f"{name}.points"], kept[f"{name}.corners"], skin


def counts(tangle: Tangle, points: np.ndarray) -> dict[str, int]:
    """Intersecting pairs by the exact test."""
    mesh = welded(tangle.garment, points)
    return {
        "body": sum(len(intersections(*mesh, other)) for other in tangle.colliders),
        "layer": sum(len(intersections(*mesh, other)) for other in tangle.layers),
        "self": len(intersections(*mesh)),
    }


def judged(tangle: Tangle, points: np.ndarray, folder: Path) -> dict:
    """Pairs with the first collider and with itself as libigl and CGAL count them."""
    from fixtures import peer

    mesh, file = welded(tangle.garment, points), folder / "judged.npz"
    body = tangle.colliders[0] if tangle.colliders else (np.eye(3) + 9.0, np.array([[0, 1, 2]]))
    np.savez_compressed(file, target_v=body[0], body_f=body[1], garment_v=mesh[0], garment_f=mesh[1])
    found = peer("judges.py", file, "--body", "target", "--no-ipc")
    return {"body": found["garment_body"]["pairs"], "self": found["garment_self"]["pairs"],
            "inside": found["penetration"]["vertices"]}  # fmt: skip


def main() -> int:
    """One line a tangle; exit code 1 if one is not clean."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="*", type=int, default=[])
    parser.add_argument("--frames", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=0, help="added to each seed: other tangles of the kinds")
    parser.add_argument("--keep", type=Path, default=Path("out/tangles"))
    parser.add_argument("--peers", action="store_true")
    options = parser.parse_args()
    options.keep.mkdir(parents=True, exist_ok=True)
    clean = 0
    made = tangles(options.data, options.keep, options.seeds)
    wanted = options.only or range(1, len(made) + 1)
    for number in wanted:
        tangle = made[number - 1]()
        before = counts(tangle, tangle.start)
        started = time.process_time()
        draped = drape_arrays(
            tangle.garment, tangle.start, corner_pattern=tangle.corner_pattern, colliders=tangle.colliders,
            layers=tangle.layers, settings={"drape": {"frames": options.frames, "settle": False}}, device="cpu",
        )  # fmt: skip
        seconds = time.process_time() - started
        after = counts(tangle, draped.points)
        info = draped.info
        fine = not any(after.values()) and info["converged"]
        clean += fine
        np.savez_compressed(
            options.keep / f"{number}.npz", start=tangle.start, draped=draped.points, triangles=tangle.garment.triangles,
            **{f"body{i}_{k}": m[j] for i, m in enumerate(tangle.colliders) for j, k in enumerate("vf")},
            **{f"layer{i}_{k}": m[j] for i, m in enumerate(tangle.layers) for j, k in enumerate("vf")},
        )  # fmt: skip
        line = {"before": before, "inside": info["inside_before"], "after": after, "converged": info["converged"],
                "pushes": info["push_steps"], "newton": info["newton_iterations"], "cpu_s": round(seconds, 1)}  # fmt: skip
        if options.peers:
            line["judges"] = judged(tangle, draped.points, options.keep)
        print(f"{number:2} {'clean' if fine else 'NOT CLEAN'} {tangle.name}: {json.dumps(line)}", flush=True)
    print(f"{clean} of {len(wanted)} clean")
    return 0 if clean == len(wanted) else 1


if __name__ == "__main__":
    raise SystemExit(main())
