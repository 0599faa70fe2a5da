"""Variables have meaningful names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.sources import FOLDERS, ROOT, Facts, below, facts_of

MEANINGLESS = {"found", "one"}


def silent_names(facts: Facts) -> list[tuple[int, str]]:
    """Lines and names of variables and arguments without meaning."""
    return [(line, name) for name, line in facts.stored if name in MEANINGLESS]


@pytest.mark.parametrize("folder", [folder for folder in FOLDERS if folder != "examples"])
def test_no_variable_has_an_empty_name(folder: str, facts: Mapping[Path, Facts]) -> None:
    files = below(facts, folder)
    assert len(files) > 20
    silent = [
        f"{f.relative_to(ROOT)}:{line}: {name}" for f, source in files.items() for line, name in silent_names(source)
    ]
    assert silent == []


def test_one_would_be_seen() -> None:
    source = "def f(one):\n    found = [one for one in g(found=1)]\n    return thing.found"
    assert sorted(silent_names(facts_of("a", source))) == [(1, "one"), (2, "found"), (2, "one")]
