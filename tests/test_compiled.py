"""Compiled functions: numba's cache on disk watches only the file of the function it compiles."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("humanoid", "estimator", "viz", "kinemode")


def compiled_in(tree: ast.Module) -> dict[str, ast.FunctionDef]:
    """The functions of a module that carry @jit."""
    found = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            names = {d.id for d in node.decorator_list if isinstance(d, ast.Name)}
            if "jit" in names:
                found[node.name] = node
    return found


def foreign_kernels(trees: dict[str, ast.Module]) -> list[str]:
    """Where a compiled function uses one of another module, which a stale cache could be."""
    kernels = {module: set(compiled_in(tree)) for module, tree in trees.items()}
    faults = []
    for module, tree in trees.items():
        imported = {
            alias.asname or alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module in kernels
            for alias in node.names
            if alias.name in kernels[node.module]
        }
        for name, function in compiled_in(tree).items():
            used = {n.id for n in ast.walk(function) if isinstance(n, ast.Name)} & imported
            faults += [f"{module}.{name} uses {other}" for other in sorted(used)]
    return faults


def modules() -> dict[str, ast.Module]:
    files = [f for package in PACKAGES for f in sorted((ROOT / package).rglob("*.py"))]
    return {".".join(f.relative_to(ROOT).with_suffix("").parts): ast.parse(f.read_text()) for f in files}


def test_compiled_functions_use_only_their_own_file() -> None:
    trees = modules()
    assert sum(len(compiled_in(tree)) for tree in trees.values()) > 10  # the search sees them
    assert foreign_kernels(trees) == []


@pytest.mark.parametrize("used", [True, False])
def test_the_check_sees_a_planted_use(used: bool) -> None:
    body = "low(1.0)" if used else "1.0"
    trees = {
        "a": ast.parse("@jit\ndef low(x):\n    return x\n"),
        "b": ast.parse(f"from a import low\n@jit\ndef high():\n    return {body}\n"),
    }
    assert foreign_kernels(trees) == (["b.high uses low"] if used else [])
