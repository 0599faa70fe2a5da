"""What worker processes do, and the messages that tell them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from typing import Any, NamedTuple, Protocol, TypeVar

from estimator.numerics.broadcast import Notice, Receiver

NUMBER = 2  # bytes of the number of a piece

Context = TypeVar("Context")


class WorkerJob(Protocol[Context]):
    """What a pool's work is about: pieces of work are functions of a context, which every process has for itself, and
    of an item. Contexts follow each other, as the frames of a clip do.

    A job is picklable and reaches each worker process once, when it starts.
    """

    def message(self, context: Context) -> Any:
        """In the leading process: all that the others need to make an equal context, as plain data that can be
        pickled. Its large arrays travel through shared memory, once for all workers."""
        ...

    def opener(self) -> Callable[[Any], Context]:
        """In a worker process, once: what makes contexts of messages. A message's large arrays are not to be written
        to, and are gone with the next message, as its context has to be."""
        ...


class NewContext(NamedTuple):
    """A new context: where its message is. It is not answered; the memory's descriptor follows if it has moved."""

    notice: Notice


class Everywhere(NamedTuple):
    """Work that every process has to do. It is not answered."""

    work: Callable[[Any, Any], None]
    item: Any


class SharedItems(NamedTuple):
    """Work of which each process takes what it can. The answer is a list of numbers and results."""

    work: Callable[[Any, Any], Any]
    items: Sequence[Any]


def taken(
    numbers: Connection, context: Context, work: Callable[[Context, Any], Any], items: Sequence[Any]
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
        yield k, work(context, items[k])


def serve(connection: Connection, numbers: Connection, job: WorkerJob[Any]) -> None:
    """What a worker process runs: do what the messages say until the other side is gone."""
    receiver = Receiver()
    with suppress(EOFError):
        _serve(connection, numbers, job, receiver)
    receiver.close()  # now that nothing looks at its memory


def _serve(connection: Connection, numbers: Connection, job: WorkerJob[Any], receiver: Receiver) -> None:
    opened = job.opener()
    context: Any = None
    while True:
        message = connection.recv()
        if isinstance(message, NewContext):
            context = None  # it looks at the memory
            context = opened(receiver.read(message.notice, partial(recv_handle, connection)))
        elif isinstance(message, Everywhere):
            message.work(context, message.item)
        else:
            connection.send(list(taken(numbers, context, message.work, message.items)))
