"""Names and libraries that are imported when they are first used; of libraries the optional extras of the package."""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

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


def lazy_names(package: str) -> tuple[list[str], Callable[[str], Any]]:
    """The names of a package and its `__getattr__` (PEP 562): what it re-exports (`import X as
    X`, PEP 484) for type checkers is imported when it is first used."""
    source = Path(sys.modules[package].__file__ or "").read_text(encoding="utf-8")
    nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
    modules = {alias.name: str(node.module) for node in nodes for alias in node.names if alias.asname == alias.name}

    def get(name: str) -> Any:
        if name not in modules:
            known = ", ".join(sorted(modules))
            raise AttributeError(f"module '{package}' has no attribute '{name}'; it has {known}")
        value = getattr(importlib.import_module(modules[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return sorted(modules), get
