"""Fixtures made once for all tests: by the first request, and again after a failure."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.made_once import made_once


def test_the_first_makes_it_and_a_failure_is_everybodys_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    def fail(folder: Path) -> int:
        (folder / "begun").touch()
        raise ValueError("cannot be made")

    for _ in range(2):
        with pytest.raises(ValueError, match="cannot be made"):
            made_once(tmp_path_factory, "test_made_once", fail)
    assert made_once(tmp_path_factory, "test_made_once", lambda folder: len(list(folder.iterdir()))) == 0
    assert made_once(tmp_path_factory, "test_made_once", fail) == 0  # it exists already
