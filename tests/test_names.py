"""Variables have meaningful names."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MEANINGLESS = {"found", "one"}


def silent_names(source: str) -> list[tuple[int, str]]:
    """Lines and names of variables and arguments without meaning."""
    named = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            named.append((node.lineno, node.id))
        elif isinstance(node, ast.arg):
            named.append((node.lineno, node.arg))
    return [(line, name) for line, name in named if name in MEANINGLESS]


@pytest.mark.parametrize("folder", ["humanoid", "estimator", "viz", "kinemode", "tests", "benchmarks"])
def test_no_variable_has_an_empty_name(folder: str) -> None:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert len(files) > 20
    silent = [f"{f.relative_to(ROOT)}:{line}: {name}" for f in files for line, name in silent_names(f.read_text())]
    assert silent == []


def test_one_would_be_seen() -> None:
    source = "def f(one):\n    found = [one for one in g(found=1)]\n    return thing.found"
    assert sorted(silent_names(source)) == [(1, "one"), (2, "found"), (2, "one")]
