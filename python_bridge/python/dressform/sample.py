"""The sample that comes with the source repository."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from .errors import BadInput, BadOutput

_HERE = Path(__file__).resolve()
#: Beside the package in an installed copy that carries it, else in the repository.
FOLDERS = (_HERE.parent / "samples", _HERE.parents[3] / "samples")


def copy_sample(folder: str | os.PathLike[str]) -> list[Path]:
    """Copies the sample into a folder, which is made; nothing that is there is replaced.

    Raises:
        BadInput: this copy of dressform came without the sample.
        BadOutput: a file of that name exists already, or cannot be written.
    """
    source = next((f for f in FOLDERS if (f / "outfits").is_dir()), None)
    if source is None:
        raise BadInput(
            "this copy of dressform came without it; it is in the source repository", file="sample"
        )
    target = Path(folder)
    files = sorted(p.relative_to(source) for p in source.rglob("*") if p.is_file())
    for file in files:
        if (target / file).exists():
            raise BadOutput("it exists already and is not replaced", file=str(target / file))
    try:
        for file in files:
            (target / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / file, target / file)
    except OSError as error:
        raise BadOutput(error.strerror or "it cannot be written", file=str(target)) from error
    return [target / file for file in files]
