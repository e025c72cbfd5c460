#!/usr/bin/env python3
"""Whose weights follow the body: ours, the nearest point's, or plain inpainting's.

    DRESSFORM_PEERS=... posed.py DATA [--only OUTFIT:CHARACTER ...] [--drape] [--influences N]
        [--cache FOLDER] [--json FILE]

Every garment of DATA on every character is transferred and rigged (or taken, draped, from a FOLDER that
all_pairs.py wrote, and rigged), then posed three times on the same geometry, with nothing but the
weights exchanged. The rivals are
``rig_igl.py`` of DRESSFORM_PEERS: weights of the nearest body point, and weight inpainting
[Abdrashitov 2023] with its default thresholds; both keep all their influences, ours are capped.
Prints a table, means over the poses. Ours is refined against these very poses; so the sums are given
for others too: half-way to each of them, and one's arms with another's trunk and legs.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from all_pairs import pairs
from dressform import fit_arrays, prepare_body, rig_arrays
from dressform.model import Character, GarmentSource
from dressform.native import SkinnedMesh, posed_check, poses
from dressform.usd.character import read_character
from dressform.usd.garment import read_outfit
from scipy.spatial.transform import Rotation

STILL = {"drape": {"frames": 0, "push_steps": 0, "settle": False}, "posed": {"enabled": False}}
METHODS = ("ours", "nearest", "inpaint")
#: Weights below this are left out of a rival's influences.
NEGLIGIBLE = 1e-7


def welded(garment: GarmentSource, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each point the first one that it is sewn to without an offset, and those in use."""
    first = np.arange(len(points))
    pairs = [s.pairs for s in garment.seams if not s.offset]
    for _ in range(8):  # chains of sewn points are short
        for pair in pairs:
            low = np.minimum(first[pair[:, 0]], first[pair[:, 1]])
            np.minimum.at(first, pair[:, 0].astype(np.int64), low)
            np.minimum.at(first, pair[:, 1].astype(np.int64), low)
    used, index = np.unique(first, return_inverse=True)
    return used, index


def dense(character: Character) -> np.ndarray:
    """The body's weights, shape [n, j]."""
    k = character.skin_influences
    weights = np.zeros((len(character.points), len(character.joints)))
    rows = np.repeat(np.arange(len(character.points)), k)
    np.add.at(weights, (rows, character.joint_indices.ravel()), character.joint_weights.ravel())
    return weights


def sparse(weights: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
    """Influences, indices and weights of dense ones, all that are not negligible."""
    k = int((weights > NEGLIGIBLE).sum(axis=1).max())
    order = np.argsort(-weights, axis=1)[:, :k]
    kept = np.take_along_axis(weights, order, axis=1)
    kept[kept <= NEGLIGIBLE] = 0.0
    kept /= kept.sum(axis=1, keepdims=True)
    return k, order.ravel().astype(np.uint32), kept.ravel()


def rivals(
    peer: Any, character: Character, points: np.ndarray, triangles: np.ndarray
) -> dict[str, np.ndarray]:
    """Dense weights of the welded garment."""
    body, faces = character.points, character.triangles.astype(np.int64)
    weights, cloth = dense(character), triangles.astype(np.int64)
    nearest = peer.nearest_igl(body, faces, weights, points)[0]
    inpainted = peer.inpaint(body, faces, weights, points, cloth, None, 0.05, 30.0, False, True, {})[0]
    return {"nearest": nearest, "inpaint": inpainted}


#: Influences of each point, indices and weights [n * k].
Skin = tuple[int, np.ndarray, np.ndarray]


def judge(
    peer: Any, character: Character, garment: GarmentSource, points: np.ndarray, skin: Skin
) -> Iterator[dict[str, list[dict[str, Any]]]]:
    """Figures of every pose for every method: in the check's poses, and in others."""
    used, index = welded(garment, points)
    triangles = index[garment.triangles.astype(np.int64)].astype(np.uint32)
    triangles = triangles[[len(set(t)) == 3 for t in triangles.tolist()]]
    k, joints, weights = skin
    ours = (k, joints.reshape(-1, k)[used].ravel(), weights.reshape(-1, k)[used].ravel())
    skins = {"ours": ours}
    skins |= {name: sparse(w) for name, w in rivals(peer, character, points[used], triangles).items()}
    meshes = [SkinnedMesh(points[used], triangles, *skins[m]) for m in METHODS]
    for chosen in (None, other_poses(character)):
        yield dict(zip(METHODS, posed_check(character, meshes, "{}", chosen), strict=True))


def fitted(
    outfit_file: Path, character: Character, settings: dict[str, Any], cache: str | None
) -> Iterator[tuple[GarmentSource, np.ndarray, Skin]]:
    """Every garment, transferred and rigged."""
    outfit = read_outfit(outfit_file)
    made = fit_arrays(outfit, character, json.dumps(settings), "cpu", None, cache)
    for garment, d in zip(outfit.garments, made.garments, strict=True):
        yield garment, d.points, (d.influences, d.joint_indices, d.joint_weights)


def dressed(
    file: Path, character: Character, settings: dict[str, Any]
) -> Iterator[tuple[GarmentSource, np.ndarray, Skin]]:
    """Every garment of a dressed character, rigged anew; details by themselves."""
    body = prepare_body(character)
    for garment in read_outfit(file).garments:
        none = [np.zeros((0, 2), dtype=np.int64)]
        seams = np.concatenate(none + [s.pairs.astype(np.int64) for s in garment.seams if not s.offset])
        rigged = rig_arrays(body, garment.points, garment.triangles, seams, json.dumps(settings))
        yield garment, garment.points, (rigged.influences, rigged.joint_indices, rigged.joint_weights)


#: Whose arms go with whose trunk and legs.
MIXED = (
    ("arms_up", "legs_apart"),
    ("reach", "step"),
    ("arms_crossed", "twist"),
    ("hands_on_hips", "bend"),
    ("arms_forward", "step"),
    ("arms_up", "squat"),
    ("t", "sit"),
    ("arms_crossed", "lean"),
)


def other_poses(character: Character) -> dict[str, np.ndarray]:
    """Poses that are not the check's own: every joint half-way there, and mixtures."""
    parents, centers = character.joint_parents, character.world_from_joint[:, :3, 3]
    above = np.eye(3)

    def turns(matrices: np.ndarray) -> np.ndarray:
        return np.stack([
            (matrices[p, :3, :3] if p >= 0 else above).T @ m[:3, :3]
            for p, m in zip(parents, matrices, strict=True)
        ])  # fmt: skip

    def pose(rotations: np.ndarray) -> np.ndarray:
        matrices = np.tile(np.eye(4), (len(parents), 1, 1))
        for j, p in enumerate(parents):  # parents come first
            matrices[j, :3, :3] = rotations[j]
            matrices[j, :3, 3] = centers[j] - rotations[j] @ centers[j]
            matrices[j] = (matrices[p] if p >= 0 else np.eye(4)) @ matrices[j]
        return matrices

    local = {name: turns(matrices) for name, matrices in poses(character).items()}
    half = {
        f"half {name}": pose(Rotation.from_rotvec(0.5 * Rotation.from_matrix(r).as_rotvec()).as_matrix())
        for name, r in local.items()
    }
    moved = {name: np.abs(r - above).max(axis=(1, 2)) > 1e-9 for name, r in local.items()}
    mixed = {f"{a} and {b}": pose(np.where(moved[a][:, None, None], local[a], local[b])) for a, b in MIXED}
    return half | mixed


def summary(figures: list[dict[str, Any]]) -> dict[str, float]:
    """Means over the poses; the stretch of edges as what is beyond 1 either way."""
    mean = lambda key: float(np.mean([f[key] for f in figures]))  # noqa: E731
    spread = [f["edge_stretch"][2] - f["edge_stretch"][0] for f in figures]
    return {
        "inside": mean("inside"),
        "depth_mean_mm": 1e3 * mean("depth_mean_m"),
        "depth_max_mm": 1e3 * max(f["depth_max_m"] for f in figures),
        "stretch_spread": float(np.mean(spread)),
        "stretch_max": max(f["edge_stretch_max"] for f in figures),
        "faces_inside": mean("faces_inside"),
    }


#: Figures of a table's row: heading, key of a summary, format, factor.
COLUMNS = (
    ("inside %", "inside", "{:.2f}", 100.0),
    ("mean depth mm", "depth_mean_mm", "{:.3f}", 1.0),
    ("deepest mm", "depth_max_mm", "{:.1f}", 1.0),
    ("stretch p99 - p1", "stretch_spread", "{:.3f}", 1.0),
    ("largest stretch", "stretch_max", "{:.2f}", 1.0),
    ("faces inside %", "faces_inside", "{:.2f}", 100.0),
)
#: Figures that are compared.
COMPARED = ("inside", "depth_mean_mm", "stretch_spread")


def row(name: str, garment: str, means: dict[str, dict[str, float]]) -> str:
    """A garment's line of the table."""
    cells = [*name.split(":"), garment]
    for _, key, form, factor in COLUMNS:
        cells.append(" / ".join(form.format(factor * means[m][key]) for m in METHODS))
    return "| " + " | ".join(cells) + " |"


def worse(means: dict[str, dict[str, float]]) -> list[str]:
    """Where ours is worse than a rival, in words."""
    return [
        f"{key} {means['ours'][key]:.4g}, {m} {means[m][key]:.4g}"
        for key in COMPARED
        for m in METHODS[1:]
        if means["ours"][key] > means[m][key] * 1.001 + 1e-6
    ]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="*", default=[], metavar="OUTFIT:CHARACTER")
    parser.add_argument("--dressed", type=Path, metavar="FOLDER", help="what all_pairs.py wrote")
    parser.add_argument("--settings", default="{}", help="of the rig, as JSON")
    parser.add_argument("--cache", help="folder that keeps the flows between bodies")
    parser.add_argument("--json", type=Path, help="all figures of all poses")
    return parser.parse_args()


def main() -> int:
    """Prints the table, the sums, and where ours is worse."""
    options = arguments()
    sys.path.insert(0, os.environ["DRESSFORM_PEERS"])
    import rig_igl as peer

    rig = {"rig": json.loads(options.settings)}
    names = ["outfit", "character", "garment", *(heading for heading, *_ in COLUMNS)]
    print("| " + " | ".join(names) + " |\n|" + " --- |" * len(names), flush=True)
    everything: list[dict[str, Any]] = [{}, {}]
    losses: list[list[str]] = [[], []]
    for outfit_file, character_file in pairs(options.data):
        name = f"{outfit_file.stem}:{character_file.stem}"
        if options.only and name not in options.only:
            continue
        character, _ = read_character(character_file)
        if options.dressed:
            file = options.dressed / f"{outfit_file.stem}_on_{character_file.stem}.usda"
            rigged = dressed(file, character, rig)
        else:
            rigged = fitted(outfit_file, character, STILL | rig, options.cache)
        for garment, points, skin in rigged:
            for k, figures in enumerate(judge(peer, character, garment, points, skin)):
                means = {m: summary(f) for m, f in figures.items()}
                everything[k][f"{name}:{garment.name}"] = figures
                losses[k] += [f"{name} {garment.name}: {loss}" for loss in worse(means)]
                if k == 0:
                    print(row(name, garment.name, means), flush=True)
    for k, what in enumerate(("the check's poses", "other poses")):
        print(f"\nIn {what}, ours / nearest / inpaint; sums of {len(everything[k])} garments:")
        for _, key, _, _ in COLUMNS:
            sums = [sum(summary(f[m])[key] for f in everything[k].values()) for m in METHODS]
            print(f"{key}: " + " / ".join(f"{s:.4g}" for s in sums))
        print(f"Ours is worse in {len(losses[k])}:", *losses[k], sep="\n")
    if options.json:
        options.json.write_text(json.dumps(everything, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
