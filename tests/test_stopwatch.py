"""Time is counted once, for the innermost part."""

from __future__ import annotations

from benchmarks.support.stopwatch import Stopwatch


class Work:
    """Advances its own clock, `now` [s]."""

    now = 0.0

    def outer(self) -> None:
        Work.now += 2.0
        self.inner()
        self.inner()

    def inner(self) -> None:
        Work.now += 3.0


def test_every_part_counts_without_the_parts_inside_it() -> None:
    watch, original = Stopwatch(lambda: Work.now), Work.outer
    with watch.installed({"outer": [(Work, "outer")], "inner": [(Work, "inner")]}):
        Work().outer()
        Work().inner()
    assert watch.seconds == {"outer": 2.0, "inner": 9.0}
    assert Work.outer is original
    Work().inner()
    assert watch.seconds == {"outer": 2.0, "inner": 9.0}
