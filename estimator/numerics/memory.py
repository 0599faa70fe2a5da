"""Memory that processes share. It has no name: nothing is left of it when the last of them is gone, however it went."""

from __future__ import annotations

import mmap
import os
import tempfile

from humanoid.support.errors import InputError

_CHUNK = 1 << 20


class SharedMemory:
    """Memory of this process and of those that are handed its `descriptor`, an open file. size: in bytes."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self.size = os.fstat(descriptor).st_size
        self.data = memoryview(mmap.mmap(descriptor, self.size))

    @classmethod
    def of_size(cls, size: int) -> SharedMemory:
        """New memory, all of it ours before it is written to: where there is too little, writing would be a bus error.

        Raises
        ------
        InputError: there is too little.
        """
        descriptor = _nameless_file()
        try:
            _reserve(descriptor, size)
            return cls(descriptor)
        except BaseException as error:
            os.close(descriptor)
            if not isinstance(error, OSError):
                raise
            problem = f"{size / 1e6:.0f} MB to share with worker processes cannot be reserved: {error.strerror}"
            raise InputError("workers", problem, remedy="--workers 1 does without, or make more memory free") from None

    def close(self) -> None:
        """Let go of it; arrays that lie in it keep it until they are gone."""
        os.close(self.descriptor)
        self.data = memoryview(b"")


def _nameless_file() -> int:
    """An open file in memory, for which no /dev/shm can be too small; on the disk where there are no such files."""
    if hasattr(os, "memfd_create"):
        try:
            return os.memfd_create("kinemode")
        except OSError:  # forbidden in a sandbox
            pass
    try:
        with tempfile.TemporaryFile() as file:
            return os.dup(file.fileno())
    except OSError as error:
        remedy = "TMPDIR names another folder for temporary files, --workers 1 does without"
        raise InputError("workers", f"no memory can be shared: {error}", remedy=remedy) from None


def _reserve(descriptor: int, size: int) -> None:
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
        return
    done = 0
    while done < size:  # macOS; a disk that fills up may take a part first
        done += os.pwrite(descriptor, bytes(min(_CHUNK, size - done)), done)
