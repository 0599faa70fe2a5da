"""Lists too long for the memory: items that were used last are in it, the others lie in a temporary file."""

from __future__ import annotations

import io
import pickle
import tempfile
from array import array
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from typing import IO, Any, Generic, TypeVar, overload

T = TypeVar("T")

_Key = tuple[int, int]
_PROTOCOL = 5  # arrays are not copied on the way
_REFUSED = (OSError, pickle.PicklingError, TypeError, AttributeError)  # a full disk, or an unpicklable object


class Spill:
    """Keeps the items of some lists, `kept` of them in memory.

    The file has no name, and is removed with this object or its process; it is made when there are more items. One that
    cannot be written stays in memory. shared: objects that items refer to without having them for themselves; so are
    all of the types `shared_types`. Changes of an item after it was put into a list may be lost.
    """

    def __init__(self, kept: int, shared: Iterable[object] = (), shared_types: tuple[type, ...] = ()) -> None:
        self._kept, self._types = kept, shared_types
        self._shared = {id(each): each for each in shared}
        self._recent: OrderedDict[_Key, Any] = OrderedDict()
        self._unwritten: set[_Key] = set()
        self._stuck: dict[_Key, Any] = {}  # cannot be written
        self._lists: list[_Places] = []
        self._file: IO[bytes] | None = None
        self._end = 0

    def list(self, items: Iterable[T] = ()) -> SpilledList[T]:
        """A new list."""
        self._lists.append(_Places())
        made: SpilledList[T] = SpilledList(self, len(self._lists) - 1)
        for item in items:
            made.append(item)
        return made

    def put(self, key: _Key, item: object) -> None:
        """Keep an item: key is the number of its list, and its place in it, at most the place after the last."""
        self._lists[key[0]].cover(key[1])
        self._stuck.pop(key, None)
        self._unwritten.add(key)
        self._remember(key, item)

    def get(self, key: _Key) -> Any:
        """The item."""
        if key in self._recent:
            self._recent.move_to_end(key)
            return self._recent[key]
        if key in self._stuck:
            return self._stuck[key]
        item = self._read(key)
        self._remember(key, item)
        return item

    def _remember(self, key: _Key, item: object) -> None:
        self._recent[key] = item
        self._recent.move_to_end(key)
        while len(self._recent) > self._kept:
            old, gone = self._recent.popitem(last=False)
            if old in self._unwritten:
                self._unwritten.remove(old)
                self._write(old, gone)

    def _write(self, key: _Key, item: object) -> None:
        try:
            data = self._pickled(item)
            places, i = self._lists[key[0]], key[1]
            start = places.start[i] if len(data) <= places.room[i] else self._end
            self._file = self._file or tempfile.TemporaryFile(prefix="kinemode-")  # noqa: SIM115 - as long as this object
            self._file.seek(start)
            self._file.write(data)
            self._file.flush()
        except _REFUSED:
            self._stuck[key] = item
            return
        if start == self._end:
            self._end += len(data)
            places.start[i], places.room[i] = start, len(data)

    def _read(self, key: _Key) -> Any:
        places, i = self._lists[key[0]], key[1]
        assert self._file is not None
        self._file.seek(places.start[i])
        unpickler = _Unpickler(io.BytesIO(self._file.read(places.room[i])))
        unpickler.shared = self._shared
        return unpickler.load()

    def _pickled(self, item: object) -> bytes:
        stream = io.BytesIO()
        pickler = _Pickler(stream, _PROTOCOL)
        pickler.shared, pickler.types = self._shared, self._types
        pickler.dump(item)
        return stream.getvalue()


class _Items(Sequence[T], Generic[T]):
    """A number of items by their places; a slice is a plain list, all of which is in memory."""

    def __init__(self, count: int) -> None:
        self._count = count

    def _item(self, i: int) -> T:
        """The item in a place."""
        raise NotImplementedError

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> list[T]: ...
    def __getitem__(self, index: int | slice) -> T | list[T]:
        if isinstance(index, slice):
            return [self._item(i) for i in range(*index.indices(self._count))]
        return self._item(range(self._count)[index])


class SpilledList(_Items[T]):
    """One of a `Spill`'s lists."""

    def __init__(self, spill: Spill, number: int) -> None:
        super().__init__(0)
        self._spill, self._number = spill, number

    def _item(self, i: int) -> T:
        item: T = self._spill.get((self._number, i))
        return item

    def __setitem__(self, index: int, item: T) -> None:
        self._spill.put((self._number, range(self._count)[index]), item)

    def append(self, item: T) -> None:
        """Put an item after the last one."""
        self._spill.put((self._number, self._count), item)
        self._count += 1


class MadeList(_Items[T]):
    """Items that are made on access, by their places."""

    def __init__(self, count: int, make: Callable[[int], T]) -> None:
        super().__init__(count)
        self._make = make

    def _item(self, i: int) -> T:
        return self._make(i)


class _Places:
    """Offsets of a list's items in the file, and their sizes in bytes; 0 for one never written."""

    def __init__(self) -> None:
        self.start, self.room = array("q"), array("q")

    def cover(self, i: int) -> None:
        """Have a place for item i."""
        if i == len(self.start):
            self.start.append(0)
            self.room.append(0)


class _Pickler(pickle.Pickler):
    shared: dict[int, object]
    types: tuple[type, ...]

    def persistent_id(self, obj: object) -> int | None:
        """The number of a shared object, by which it is then referred to."""
        if id(obj) in self.shared:
            return id(obj)
        if isinstance(obj, self.types):
            self.shared[id(obj)] = obj  # kept, or its number could become another's
            return id(obj)
        return None


class _Unpickler(pickle.Unpickler):
    shared: dict[int, object]

    def persistent_load(self, pid: int) -> object:
        """The item of that number."""
        return self.shared[pid]
