"""Worker processes that help a `ModeSearch`; nothing but the time it takes depends on how many there are."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from estimator.parallel.board import Board
from estimator.parallel.companion import Companion, check_not_imported_again
from estimator.search.case_message import CaseMessage, SearchRecipe
from estimator.search.frame_search import FrameCase, FrameSearch
from estimator.search.helper import NUMBER, Case, Everywhere, Share, help_out, taken
from estimator.search.mode_search import ModeSearch
from humanoid.support.errors import InputError

MOST = 64
_MOST_PIECES = 8192  # their numbers fit into any system's pipe

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def helped(search: ModeSearch, processes: int) -> Iterator[None]:
    """Within it so many processes do the work of a search, this one among them; what comes out is the same to the last
    bit. One process is this one alone.

    The others end with the block and with this process, however these end. They are spawned: a script that uses them
    needs `if __name__ == "__main__":` around what it runs.

    Raises
    ------
    InputError: a number of processes that cannot be; later, from the search, that one of them has ended by itself.
    """
    if checked_count(processes) == 1:
        yield
        return
    alone = search.sharing
    with Team(search, processes - 1) as team:
        search.sharing = team
        try:
            yield
        finally:
            search.sharing = alone


def checked_count(processes: int) -> int:
    """A number of processes as it was given; InputError where it cannot be."""
    if not 1 <= processes <= MOST:
        raise InputError("workers", f"{processes} processes cannot share the work", remedy=f"1 to {MOST}")
    if processes > 1:
        check_not_imported_again()
    return processes


class Team:
    """This process and its helpers (see `estimator.search.sharing.Sharing`); a context manager that ends them.

    Nobody is dealt a share: the numbers of the pieces lie in a pipe, and everybody takes the next one when done with
    the last. So all are done at the same time, and one that dies leaves nothing locked.
    """

    def __init__(self, search: ModeSearch, helpers: int) -> None:
        self.hands = helpers + 1
        self._recipe = SearchRecipe.of(search)
        self._helpers: list[Companion] = []
        self._case: FrameCase | None = None  # that the helpers know
        self._board = Board()
        self._numbers, self._more = multiprocessing.Pipe(duplex=False)
        os.set_blocking(self._numbers.fileno(), False)

    def __enter__(self) -> Team:
        try:
            for _ in range(self.hands - 1):
                self._helpers.append(Companion(help_out, self._numbers, self._recipe))
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def each(
        self, frame: FrameSearch, work: Callable[[FrameSearch, Item], Result], items: Sequence[Item]
    ) -> list[Result]:
        """See `Sharing`."""
        if not self._helpers or not 1 < len(items) <= _MOST_PIECES:
            return [work(frame, item) for item in items]
        try:
            self._show(frame.case)
            os.write(self._more.fileno(), b"".join(k.to_bytes(NUMBER, "little") for k in range(len(items))))
            self._tell(Share(work, items))
            found: dict[int, Result] = dict(taken(self._numbers, frame, work, items))
            for helper in self._helpers:
                found.update(helper.receive())
        except BaseException:
            self.close()  # answers on their way belong to no question any more
            raise
        return [found[k] for k in range(len(items))]

    def everywhere(self, frame: FrameSearch, work: Callable[[FrameSearch, Item], None], item: Item) -> None:
        """See `Sharing`."""
        if self._helpers:
            self._show(frame.case)
            self._tell(Everywhere(work, item))
        work(frame, item)

    def close(self) -> None:
        """End the helpers and give back what they shared; afterwards this process works alone."""
        helpers, self._helpers = self._helpers, []
        for helper in helpers:
            helper.connection.close()  # all hear of it before the first is waited for
        for helper in helpers:
            helper.close()
        self._board.close()
        self._numbers.close()
        self._more.close()

    def _show(self, case: FrameCase) -> None:
        """Let the helpers know the case, unless they do."""
        if self._case is not case:
            notice = self._board.post(CaseMessage.of(case))
            for helper in self._helpers:
                helper.send(Case(notice))
                if notice.moved:
                    helper.hand_over(self._board.descriptor)
            self._case = case

    def _tell(self, message: Any) -> None:
        for helper in self._helpers:
            helper.send(message)
