"""A result of two files that appears as a whole or not at all.

Both files are made in a hidden folder beside their place, flushed to the disk and renamed: first
the arrays, under a name made of their own content, then the root layer, which alone makes them
part of a result. A failure at any point leaves the old result and removes what was begun.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import BadOutput

LAYER_SUFFIXES = (".usda", ".usdc", ".usd")
_CONTENT_NAME = re.compile(r"\.garments-[0-9a-f]{16}\.usdc$")


@contextmanager
def workshop(out: Path) -> Iterator[Path]:
    """A private folder beside ``out``; gone afterwards, whatever happens.

    Folders above ``out`` are made, and taken away again after a failure.
    """
    made = [p for p in (out.parent, *out.parent.parents) if not p.exists()]
    folder: Path | None = None
    done = False
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=".dressform-", dir=out.parent))
        yield folder
        done = True
    except OSError as error:
        raise BadOutput(f"cannot be written: {error.strerror or error}", file=str(out)) from error
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        for parent in [] if done else made:
            if parent.is_dir():
                try:
                    parent.rmdir()
                except OSError:
                    break


def content_name(out: Path, file: Path) -> str:
    """``<stem>.garments-<hash of the bytes>.usdc``."""
    digest = hashlib.sha256(file.read_bytes()).hexdigest()[:16]
    return f"{out.stem}.garments-{digest}.usdc"


def flush(path: Path) -> None:
    """To the disk, not just to the system; with the permissions that a new file would have."""
    mask = os.umask(0)
    os.umask(mask)
    path.chmod(0o666 & ~mask)
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def install(arrays: Path, arrays_to: Path, root: Path, out: Path) -> None:
    """Renames both files into place, the root last."""
    flush(arrays)
    flush(root)
    new = not arrays_to.exists()
    os.replace(arrays, arrays_to)
    try:
        os.replace(root, out)
    except OSError:
        if new:
            arrays_to.unlink(missing_ok=True)
        raise
    _flush_folder(out.parent)


def remove_old_arrays(out: Path, names: set[str]) -> None:
    """Takes away what the replaced root referred to, if it carries a name of ours."""
    for name in names:
        mine = name.startswith(f"{out.stem}.garments-") and _CONTENT_NAME.search(name)
        if mine and Path(name).name == name:
            (out.parent / name).unlink(missing_ok=True)


def _flush_folder(folder: Path) -> None:
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
