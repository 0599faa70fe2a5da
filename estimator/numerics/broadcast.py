"""Large things shown to other processes: their arrays lie in shared memory and are copied once, by who shows them."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any, NamedTuple

from estimator.numerics.memory import SharedMemory

SMALL = 4096  # bytes; arrays up to this size travel with the notice
_LINE = 64  # bytes; arrays begin where those of numpy's own may


class Notice(NamedTuple):
    """What tells other processes where a thing is: the thing without its large arrays, and first byte and size of each
    of them in the shared memory. moved: that is another one than before, and its descriptor comes next."""

    content: bytes
    moved: bool
    spans: tuple[tuple[int, int], ...]


class Broadcaster:
    """Shows one thing at a time; a context manager that gives the memory back."""

    def __init__(self) -> None:
        self._memory: SharedMemory | None = None

    def show(self, thing: Any) -> Notice:
        """Put a picklable thing in place of the last one, which no process may be reading any more.

        Raises
        ------
        InputError: there is not enough memory to share.
        """
        large: list[memoryview] = []

        def stays_in_content(buffer: pickle.PickleBuffer) -> bool:
            raw = buffer.raw()
            if raw.nbytes <= SMALL:
                return True  # it stays in the content
            large.append(raw)
            return False

        content = pickle.dumps(thing, protocol=5, buffer_callback=stays_in_content)
        spans, end = [], 0
        for raw in large:
            spans.append((end, raw.nbytes))
            end += -(-raw.nbytes // _LINE) * _LINE
        before = self._memory
        memory = self._large_enough(end)
        for raw, (first, size) in zip(large, spans, strict=True):
            memory.data[first : first + size] = raw
        return Notice(content, memory is not before, tuple(spans))

    @property
    def descriptor(self) -> int:
        """The open file of the memory, to be handed to all readers when a notice says `moved`."""
        assert self._memory is not None
        return self._memory.descriptor

    def close(self) -> None:
        """Give the memory back; who reads it keeps it until they let go."""
        if self._memory is not None:
            self._memory.close()
            self._memory = None

    def __enter__(self) -> Broadcaster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _large_enough(self, size: int) -> SharedMemory:
        if self._memory is None or self._memory.size < size:
            self.close()
            self._memory = SharedMemory.of_size(max(size, _LINE))
        return self._memory


class Receiver:
    """Reads what another process shows."""

    def __init__(self) -> None:
        self._memory: SharedMemory | None = None

    def read(self, notice: Notice, descriptor: Callable[[], int]) -> Any:
        """The thing; its large arrays lie in the shared memory, not to be written to, and change with the next one.

        descriptor: receives that of the memory, where it has moved.
        """
        if notice.moved:
            self.close()
            self._memory = SharedMemory(descriptor())
        assert self._memory is not None
        whole = self._memory.data
        return pickle.loads(notice.content, buffers=[whole[first : first + size] for first, size in notice.spans])

    def close(self) -> None:
        """Let go of the memory; it stays as long as something that was read."""
        if self._memory is not None:
            self._memory.close()
            self._memory = None
