#!/usr/bin/env python3
"""Four layers on one character: a man's trousers, T-shirt and hoody with a woman's garment between.

    four_layers.py DATA OUT [--fourth Tshirt|Skirt] [--character heavy_man] [--device cpu]

Composes a stage from DATA's two outfits, each garment on the body that it was made on: trousers (0),
the woman's garment (1), T-shirt (2), hoody (3). Fits it and prints each garment's certificate and
CPU seconds; exit code 1 where a threshold was broken, some pair is left or a garment is not at rest.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom


def compose(data: Path, fourth: str, file: Path) -> None:
    """Writes the outfit: garments by reference, their layers as opinions of its own."""
    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    outfits = (data / "outfits").resolve()
    stage.SetDefaultPrim(stage.DefinePrim("/Outfit", "Xform"))
    for layer, (who, name) in enumerate(
        (("man", "Pants"), ("woman", fourth), ("man", "Tshirt"), ("man", "Hoody"))
    ):
        body = stage.DefinePrim(f"/Sources/source_{who}", "Xform")
        body.GetReferences().SetReferences(
            [Sdf.Reference(str(data.resolve() / f"characters/source_{who}.usdc"))]
        )
        garment = stage.DefinePrim(f"/Outfit/{name}_{who}", "Mesh")
        garment.GetReferences().AddReference(str(outfits / f"casual_{who}" / f"{name.lower()}.usdc"))
        garment.CreateRelationship("garment:sourceBody").SetTargets([body.GetPath()])
        garment.CreateAttribute("garment:layer", Sdf.ValueTypeNames.Int).Set(layer)
        if who == "woman":  # made in centimetres, Y up
            placed = UsdGeom.Xformable(garment)
            placed.AddScaleOp().Set((0.01, 0.01, 0.01))
            placed.AddRotateXOp().Set(90.0)
    stage.Save()


def main() -> int:
    """Composes, fits, prints."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--fourth", choices=("Tshirt", "Skirt"), default="Tshirt")
    parser.add_argument("--character", default="heavy_man")
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    outfit = options.out / f"four_{options.fourth}.usda"
    compose(options.data, options.fourth, outfit)
    character = options.data / "characters" / f"{options.character}.usdc"
    dressed = options.out / f"four_{options.fourth}_on_{options.character}.usda"
    command = [sys.executable, "-m", "dressform", "fit", str(outfit), str(character), "-o", str(dressed)]
    done = subprocess.run(
        [*command, "--device", options.device, "--json"], capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 1):
        print(done.stderr, file=sys.stderr)
        return done.returncode
    result = json.loads(done.stdout)
    dressed.with_suffix(".json").write_text(json.dumps(result, indent=1))
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"exit {done.returncode}, {used.ru_utime + used.ru_stime:.0f} CPU s", *result["broken"], sep="\n  ")
    clean = done.returncode == 0
    for g in sorted(result["garments"], key=lambda g: g["layer"]):
        drape, certificate = g["drape"], g["certificate"]
        pairs = {what: certificate[f"{what}_intersections"] for what in ("body", "layer", "self")}
        clean &= not any(pairs.values()) and drape["converged"] and drape["at_rest"]
        print(
            f"{g['layer']} {g['name']}: {pairs}, converged {drape['converged']}, at rest {drape['at_rest']}, "
            f"residual {drape['residual']:.3f}, strain change p99 {certificate['strain_change_p99']:.3f}"
        )
    return 0 if clean else 1


if __name__ == "__main__":
    sys.exit(main())
