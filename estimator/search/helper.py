"""The side of a helping process: it waits for work, takes pieces while there are any, and answers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from typing import Any, NamedTuple

from estimator.parallel.board import BoardReader, Notice
from estimator.search.case_message import SearchRecipe
from estimator.search.frame_search import FrameSearch

NUMBER = 2  # bytes of the number of a piece


class Case(NamedTuple):
    """A new frame: a `CaseMessage` on the board. It is not answered; the board's descriptor follows if it has moved."""

    notice: Notice


class Everywhere(NamedTuple):
    """Work that every process has to do. It is not answered."""

    work: Callable[[FrameSearch, Any], None]
    item: Any


class Share(NamedTuple):
    """Work of which each takes what it can. The answer is a list of numbers and results."""

    work: Callable[[FrameSearch, Any], Any]
    items: Sequence[Any]


def taken(
    numbers: Connection, frame: FrameSearch, work: Callable[[FrameSearch, Any], Any], items: Sequence[Any]
) -> Iterator[tuple[int, Any]]:
    """Numbers and results of the pieces that this process gets hold of; `numbers` is read without waiting."""
    while True:
        try:
            number = os.read(numbers.fileno(), NUMBER)
        except BlockingIOError:
            return
        if not number:  # the leader is gone
            return
        k = int.from_bytes(number, "little")
        yield k, work(frame, items[k])


def help_out(connection: Connection, numbers: Connection, recipe: SearchRecipe) -> None:
    """Serve until the other side is gone."""
    board = BoardReader()
    with suppress(EOFError):
        _serve(connection, numbers, recipe, board)
    board.close()  # now that nothing looks at it


def _serve(connection: Connection, numbers: Connection, recipe: SearchRecipe, board: BoardReader) -> None:
    search = recipe.search()
    frame: FrameSearch | None = None
    while True:
        message = connection.recv()
        if isinstance(message, Case):
            frame = None  # it looks at the board
            case = board.read(message.notice, partial(recv_handle, connection)).case(search.model)
            frame = FrameSearch(search.model, search.seeker, search.settings, case)
            del case
            continue
        assert frame is not None
        if isinstance(message, Everywhere):
            message.work(frame, message.item)
        else:
            connection.send(list(taken(numbers, frame, message.work, message.items)))
