"""Large things shown to other processes: their arrays lie in shared memory and are copied once, by who posts them."""

from __future__ import annotations

import pickle
from multiprocessing.shared_memory import SharedMemory
from typing import Any, NamedTuple

SMALL = 4096  # bytes; arrays up to this size travel with the notice
_LINE = 64  # bytes; arrays begin where those of numpy's own may


class Notice(NamedTuple):
    """What tells other processes where a thing is: the thing without its large arrays, the name of the shared memory,
    and first byte and size of each of them there."""

    content: bytes
    memory: str
    spans: tuple[tuple[int, int], ...]


class Board:
    """Holds one thing at a time; a context manager that gives the memory back."""

    def __init__(self) -> None:
        self._memory: SharedMemory | None = None

    def post(self, thing: Any) -> Notice:
        """Put up a picklable thing in place of the last one, which nobody may be reading any more."""
        large: list[memoryview] = []

        def kept_back(buffer: pickle.PickleBuffer) -> bool:
            raw = buffer.raw()
            if raw.nbytes <= SMALL:
                return True  # it stays in the content
            large.append(raw)
            return False

        content = pickle.dumps(thing, protocol=5, buffer_callback=kept_back)
        spans, end = [], 0
        for raw in large:
            spans.append((end, raw.nbytes))
            end += -(-raw.nbytes // _LINE) * _LINE
        memory = self._large_enough(end)
        assert memory.buf is not None
        for raw, (first, size) in zip(large, spans, strict=True):
            memory.buf[first : first + size] = raw
        return Notice(content, memory.name, tuple(spans))

    def close(self) -> None:
        """Give the memory back; who reads it keeps it until they let go."""
        if self._memory is not None:
            self._memory.close()
            self._memory.unlink()
            self._memory = None

    def __enter__(self) -> Board:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _large_enough(self, size: int) -> SharedMemory:
        if self._memory is None or self._memory.size < size:
            self.close()
            self._memory = SharedMemory(create=True, size=max(size, _LINE))
        return self._memory


class BoardReader:
    """Reads what another process has posted."""

    def __init__(self) -> None:
        self._memory: SharedMemory | None = None
        self._left: list[SharedMemory] = []

    def read(self, notice: Notice) -> Any:
        """The thing; its large arrays lie in the shared memory, not to be written to, and change with the next one."""
        if self._memory is None or self._memory.name != notice.memory:
            self.close()
            self._memory = SharedMemory(notice.memory)
        whole = self._memory.buf
        assert whole is not None
        return pickle.loads(notice.content, buffers=[whole[first : first + size] for first, size in notice.spans])

    def close(self) -> None:
        """Let go of the memory, as soon as nothing that was read is left."""
        if self._memory is not None:
            self._left.append(self._memory)
            self._memory = None
        self._left = [memory for memory in self._left if not _closed(memory)]


def _closed(memory: SharedMemory) -> bool:
    try:
        memory.close()
    except BufferError:  # arrays still look at it
        return False
    return True
