"""Who does the pieces of work on a frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from estimator.search.frame_search import FrameSearch

Item = TypeVar("Item")
Result = TypeVar("Result")


class Sharing(Protocol):
    """Does pieces of work: methods of `FrameSearch`. hands: how many do them at the same time."""

    hands: int

    def each(
        self, frame: FrameSearch, work: Callable[[FrameSearch, Item], Result], items: Sequence[Item]
    ) -> list[Result]:
        """What the work makes of every item, in their order."""
        ...

    def everywhere(self, frame: FrameSearch, work: Callable[[FrameSearch, Item], None], item: Item) -> None:
        """Do it wherever there are hands."""
        ...


class Alone:
    """This process does it all."""

    hands = 1

    def each(
        self, frame: FrameSearch, work: Callable[[FrameSearch, Item], Result], items: Sequence[Item]
    ) -> list[Result]:
        """See `Sharing`."""
        return [work(frame, item) for item in items]

    def everywhere(self, frame: FrameSearch, work: Callable[[FrameSearch, Item], None], item: Item) -> None:
        """See `Sharing`."""
        work(frame, item)
