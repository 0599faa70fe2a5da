"""Which parameters of a test `make test` leaves to `make test-all`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def later(values: Iterable[Any], *long: Any, thorough: Iterable[Any] = ()) -> list[Any]:
    """Values, or tuples of several, for `pytest.mark.parametrize`; those in `long` are long examples, which
    quicker ones cover too, those in `thorough` further cases. AssertionError if one does not exist."""
    values, further = list(values), list(thorough)
    assert {*long, *further} <= set(values)
    marks = [
        [pytest.mark.paper] if value in long else [pytest.mark.thorough] if value in further else [] for value in values
    ]
    return [
        pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=mark)
        for value, mark in zip(values, marks, strict=True)
    ]
