#!/usr/bin/env python3
"""An armpit in raised arms: weights of the nearest skin against ours, as numbers and a picture.

    armpit.py [PICTURE]

The sample's T-shirt on its source body. Prints, for each, the largest and the 99th percentile of
the edges' stretch and the largest L1 jump of weights along an edge; draws both with PICTURE.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from dressform import rigging
from dressform.model import Character, Floats, GarmentSource
from dressform.preview.vtk import polydata, pyvista
from dressform.usd.garment import read_outfit

SAMPLE = Path(__file__).resolve().parents[1] / "samples/outfits/casual_woman.usda"
#: Degrees that arms and collar bones are turned by, up.
RAISED = {"upperarm01": 85.0, "clavicle": 20.0}
#: Without cone, distance, smoothing and refinement the search is the nearest point.
NEAREST = {
    "cone": 180.0,
    "distance": 10.0,
    "reach": 0.0,
    "jump": 2.0,
    "ignore": [],
    "influences": 64,
    "refine": 0,
}


def raised(body: Character) -> Floats:
    """Skinning matrices of the pose, shape [joints, 4, 4]; X is to the left."""
    matrices = np.tile(np.eye(4), (len(body.joints), 1, 1))
    for j, (path, parent) in enumerate(zip(body.joints, body.joint_parents, strict=True)):
        name, _, side = path.rpartition("/")[2].rpartition("_")
        angle = np.radians(RAISED.get(name, 0.0) * (1.0 if side == "L" else -1.0))
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        center = body.world_from_joint[j, :3, 3]
        turn[:3, 3] = center - turn[:3, :3] @ center
        matrices[j] = turn if parent < 0 else matrices[parent] @ turn
    return matrices


def skinned(points: Floats, weights: Floats, matrices: Floats) -> Floats:
    """Linear blend skinning."""
    blend = np.einsum("nj,jrc->nrc", weights, matrices[:, :3])
    return np.einsum("nrc,nc->nr", blend, np.c_[points, np.ones(len(points))])


def edges(garment: GarmentSource) -> np.ndarray:
    """Pairs of points, each once."""
    tri = garment.triangles.astype(np.int64)
    both = np.concatenate([tri[:, [0, 1]], tri[:, [1, 2]], tri[:, [2, 0]]])
    return np.unique(np.sort(both, axis=1), axis=0)


def main() -> None:
    """Prints the figures; draws the picture."""
    outfit = read_outfit(SAMPLE, garments=["/Outfit/Tshirt"])
    (shirt,) = outfit.garments
    body = outfit.bodies[shirt.body]
    matrices = raised(body)
    shape = (len(body.points), body.skin_influences)
    own = rigging.Rigged(shape[1], body.joint_indices.reshape(shape), body.joint_weights.reshape(shape), {})
    posed_body = skinned(body.points, own.dense(len(body.joints)), matrices)
    pairs = edges(shirt)
    rest = np.linalg.norm(shirt.points[pairs[:, 0]] - shirt.points[pairs[:, 1]], axis=1)
    prepared = rigging.prepare_body(body)
    pictures = []
    for name, settings in (("nearest skin", NEAREST), ("ours", {})):
        rigged = rigging.rig_arrays(
            prepared, shirt.points, shirt.triangles, settings_json=json.dumps({"rig": settings})
        )
        weights = rigged.dense(len(body.joints))
        posed = skinned(shirt.points, weights, matrices)
        stretch = np.linalg.norm(posed[pairs[:, 0]] - posed[pairs[:, 1]], axis=1) / rest
        jump = np.abs(weights[pairs[:, 0]] - weights[pairs[:, 1]]).sum(axis=1).max()
        figures = {"stretch_max": stretch.max(), "stretch_p99": np.percentile(stretch, 99), "jump": jump}
        print(name, json.dumps({key: round(float(value), 3) for key, value in figures.items()}), flush=True)
        at_point = np.zeros(len(shirt.points))
        np.maximum.at(at_point, pairs.ravel(), np.repeat(stretch, 2))
        pictures.append((name, posed, at_point))
    for file in sys.argv[1:2]:
        draw(file, shirt, body, posed_body, pictures)


def draw(
    file: str,
    shirt: GarmentSource,
    body: Character,
    posed_body: Floats,
    pictures: list[tuple[str, Floats, Floats]],
) -> None:
    """Both, side by side, from the front, with the stretch as colour."""
    plotter = pyvista().Plotter(off_screen=True, shape=(1, len(pictures)), window_size=(900, 440))
    for column, (name, posed, stretch) in enumerate(pictures):
        plotter.subplot(0, column)
        plotter.add_mesh(polydata(posed_body, body.triangles), color="#c9b8a8")
        cloth = polydata(posed, shirt.triangles)
        cloth["stretch"] = stretch
        bar = {"vertical": True, "n_labels": 3, "title_font_size": 12, "label_font_size": 11}
        plotter.add_mesh(cloth, scalars="stretch", cmap="inferno_r", clim=(1.0, 4.0), scalar_bar_args=bar)
        plotter.add_text(name, font_size=10)
        plotter.camera_position = [(0.75, 1.15, 1.5), (0.12, 1.27, 0.0), (0.0, 1.0, 0.0)]
        plotter.camera.zoom(1.6)
    plotter.screenshot(file)


if __name__ == "__main__":
    main()
