"""Registers the codeless schemas that lie beside this file in ``schema/``."""

from __future__ import annotations

from pathlib import Path

from pxr import Plug

SCHEMA_DIRECTORY = Path(__file__).resolve().parent / "schema"


def register() -> bool:
    """Makes GarmentAPI and its sisters known to USD; True once they are.

    USD builds its schema registry at its first use. A process that used it before importing
    dressform keeps a registry without these schemas: everything here still works, since nothing
    is read through them, but the caller's own ``HasAPI("GarmentAPI")`` would not.
    """
    Plug.Registry().RegisterPlugins(str(SCHEMA_DIRECTORY))
    return Plug.Registry().GetPluginWithName("dressform") is not None
