"""The Rust core (``python_bridge/src``). Use the package ``dressform`` instead."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

version: str

def devices() -> list[dict[str, Any]]: ...
def open_device(name: str) -> dict[str, str]: ...
def inspect_outfit(outfit: dict[str, Any]) -> list[dict[str, Any]]: ...
def proxy_json(garment: dict[str, Any], settings_json: str) -> str: ...
def inspect_character(character: dict[str, Any]) -> None: ...
def poses(character: dict[str, Any]) -> dict[str, Any]: ...
def posed_json(character: dict[str, Any], garments: list[dict[str, Any]], settings_json: str) -> str: ...
def default_settings_json() -> str: ...
def fit(
    outfit: dict[str, Any],
    character: dict[str, Any],
    settings_json: str,
    device: str,
    progress: Callable[[str, float], None] | None = None,
    cache: str | None = None,
) -> dict[str, Any]: ...
def simulate(
    outfit: dict[str, Any],
    character: dict[str, Any],
    body: NDArray[np.float64],
    seconds_per_frame: float,
    settings_json: str,
    device: str,
    progress: Callable[[str, float], None] | None = None,
) -> dict[str, Any]: ...
