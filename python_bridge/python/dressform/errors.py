"""Errors of the Python side. Each class carries the exit code that the command line answers with."""

from __future__ import annotations


class DressformError(Exception):
    """Base of every error that dressform raises on purpose."""

    exit_code = 5


class BadInput(DressformError):
    """Something in a file cannot be used; says where.

    Args:
        message: what is wrong and, where there is one, the way out.
        file: the stage or layer.
        prim: path of the prim.
        attribute: name of the attribute or relationship.
        element: index of the first bad element of the attribute.
    """

    exit_code = 3

    def __init__(
        self,
        message: str,
        *,
        file: str = "",
        prim: str = "",
        attribute: str = "",
        element: int | None = None,
    ) -> None:
        self.message = message
        self.file = str(file)
        self.prim = str(prim)
        self.attribute = attribute
        self.element = element
        super().__init__(f"{where(self.file, self.prim, attribute, element)}: {message}")


class BadOutput(BadInput):
    """The result cannot be written where it was asked for."""


def where(file: str, prim: str = "", attribute: str = "", element: int | None = None) -> str:
    """``file <prim>.attribute[element]``, as much of it as is known."""
    spot = f"<{prim}>" if prim else ""
    if attribute:
        spot += f".{attribute}" if prim else attribute
    if element is not None:
        spot += f"[{element}]"
    return " ".join(part for part in (file, spot) if part) or "input"


class BadSettings(BadInput):
    """The settings name an unknown key, or a value of the wrong kind or out of range."""


class NoDevice(DressformError):
    """No adapter fits, or the one that was opened is refused, lost or out of memory."""

    exit_code = 4


class InternalFault(DressformError):
    """A bug of dressform's own."""

    exit_code = 5


class NotInstalled(DressformError):
    """An optional part is missing; says what to install."""

    exit_code = 2
