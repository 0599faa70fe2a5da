"""Libraries that only some users need: optional extras of the package, loaded where they are used."""

from __future__ import annotations

import importlib
from types import ModuleType

from humanoid.support.errors import InputError


def optional(module: str, extra: str, purpose: str) -> ModuleType:
    """A module of the extra kinemode[`extra`].

    Raises
    ------
    InputError: it is not installed, or cannot be loaded; with what it is needed for (`purpose`), and the remedy.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        why = "is not installed" if isinstance(error, ModuleNotFoundError) else f"cannot be loaded: {error}"
        raise InputError(
            module, f"{why}; it is needed for {purpose}", remedy=f"pip install 'kinemode[{extra}]'"
        ) from None
