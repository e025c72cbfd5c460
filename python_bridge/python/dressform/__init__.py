"""dressform fits outfits to characters: transfer, pattern refit, drape, rig, as USD layers.

    import dressform

    result = dressform.fit("outfit.usda", "character.usdc", "dressed.usda")
    print(result.passed, result.garments[0].certificate.body_intersections)

Arrays without USD: :func:`dressform.fit_arrays` over the data classes of :mod:`dressform.model`,
:func:`dressform.drape_arrays` for the drape and :func:`dressform.rig_arrays` for skin weights alone.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._native import version as __version__

if TYPE_CHECKING:
    from .errors import (
        BadInput,
        BadOutput,
        BadSettings,
        DressformError,
        InternalFault,
        NoDevice,
        NotInstalled,
    )
    from .fitting import fit
    from .native import Draped, Fitted, Refitted, body_girths, drape_arrays, fit_arrays, refit_arrays
    from .result import Result
    from .rigging import Rigged, prepare_body, rig_arrays
    from .settings import Settings, load

#: Where each name lives; loaded when it is first asked for, so that the command line starts fast.
_HOMES = {
    "BadInput": "errors",
    "BadOutput": "errors",
    "BadSettings": "errors",
    "Draped": "native",
    "DressformError": "errors",
    "Fitted": "native",
    "InternalFault": "errors",
    "NoDevice": "errors",
    "NotInstalled": "errors",
    "Refitted": "native",
    "Result": "result",
    "Rigged": "rigging",
    "Settings": "settings",
    "body_girths": "native",
    "drape_arrays": "native",
    "fit": "fitting",
    "fit_arrays": "native",
    "load": "settings",
    "prepare_body": "rigging",
    "refit_arrays": "native",
    "rig_arrays": "rigging",
}

__all__ = [
    "BadInput",
    "BadOutput",
    "BadSettings",
    "Draped",
    "DressformError",
    "Fitted",
    "InternalFault",
    "NoDevice",
    "NotInstalled",
    "Refitted",
    "Result",
    "Rigged",
    "Settings",
    "__version__",
    "body_girths",
    "drape_arrays",
    "fit",
    "fit_arrays",
    "load",
    "prepare_body",
    "refit_arrays",
    "rig_arrays",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value
