"""Time is counted once, for the innermost part."""

from __future__ import annotations

from time import process_time

import pytest

from benchmarks.stopwatch import Stopwatch


def spend(seconds: float) -> None:
    end = process_time() + seconds
    while process_time() < end:
        pass


class Work:
    def outer(self) -> None:
        spend(0.02)
        self.inner()
        self.inner()

    def inner(self) -> None:
        spend(0.03)


def test_every_part_counts_without_the_parts_inside_it() -> None:
    watch, original = Stopwatch(), Work.outer
    with watch.installed({"outer": [(Work, "outer")], "inner": [(Work, "inner")]}):
        Work().outer()
        Work().inner()
    assert watch.seconds["outer"] == pytest.approx(0.02, abs=0.008)
    assert watch.seconds["inner"] == pytest.approx(0.09, abs=0.008)
    assert Work.outer is original
    Work().inner()
    assert watch.seconds["inner"] == pytest.approx(0.09, abs=0.008)
