"""The one way functions are compiled: numba with its cache on disk, wherever a cache can be written.

Numba's own cache watches only the file of the function it compiles, though what the function takes from other files,
constants and other kernels, is compiled into it. So code is kept in a folder named by a digest of the function's file
and of all that it imports (see `compiled_cache`).
"""

from __future__ import annotations

import inspect
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import config
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

from humanoid.support.compiled_cache import cache_roots, source_folder, sources_digest
from humanoid.support.locks import locked

Function = TypeVar("Function", bound=Callable[..., Any])

_entering = threading.Lock()  # one thread at a time
_digests: dict[str, tuple[object, str]] = {}


def jit(function: Function) -> Function:
    """Compile for plain arrays and numbers, `@jit` without brackets; compiled code is kept between runs.

    It is kept in the user's cache folder, or where that cannot be written to (an installation by root, a container
    without a home) among the temporary files; where that is not writable either, every process compiles again.
    KINEMODE_CACHE names another folder.
    """
    compiled = numba.njit(nogil=True, error_model="numpy")(function)
    if isinstance(compiled, Dispatcher):  # not with NUMBA_DISABLE_JIT
        cache = _cache(function)
        if cache is not None:
            cast(Any, compiled)._cache = cache
    return cast(Function, compiled)


def is_compiled(function: Callable[..., Any]) -> bool:
    """Whether a function's code is available, compiled by this process or cached by an earlier one, for some
    arguments."""
    if not isinstance(function, Dispatcher) or function.signatures:
        return True
    cache = cast(Any, function)._cache
    return isinstance(cache, _SharedCache) and Path(cast(Any, cache)._cache_file._index_path).exists()


def _cache(function: Callable[..., Any]) -> FunctionCache | None:
    """Where a function's code is cached; None without a folder."""
    try:
        digest = _digest(function)
    except (OSError, TypeError):  # typed in at a prompt
        return None
    for root in cache_roots():
        with suppress(OSError, RuntimeError), _entering:  # what numba raises is of the second kind
            return _SharedCache(function, source_folder(root, function.__module__, digest))
    return None


def _digest(function: Callable[..., Any]) -> str:
    """Digest of the sources behind a function; made once for all functions of a module, and again where that is
    reloaded."""
    module = function.__module__
    spec = getattr(function, "__globals__", {}).get("__spec__")
    known = _digests.get(module)
    if known is None or spec is None or known[0] is not spec:
        known = _digests[module] = spec, sources_digest(Path(inspect.getfile(function)).absolute(), module)
    return known[1]


class _SharedCache(FunctionCache):
    """Numba's cache of one function, for several processes that compile at once, and for full or failing disks.

    Numba reads the index, adds to it and writes it back. Of two processes that do so at once for different types of
    arguments, both can choose the same file for their code, and the one is then served the other's.
    """

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        shared, settings = cast(Any, self), cast(Any, config)
        users, settings.CACHE_DIR = settings.CACHE_DIR, str(folder)
        try:
            super().__init__(function)
        finally:
            settings.CACHE_DIR = users
        # numba adds the place of the source file and its time of writing: the folder's name is enough, and every
        # checkout and environment with these sources shares it
        shared._cache_path = str(folder)
        shared._cache_file = IndexDataCacheFile(str(folder), shared._impl.filename_base, source_stamp="")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Code for a signature, None where there is none or it cannot be read."""
        try:
            os.utime(self.cache_path)  # marks it as in use: a process may live longer than the folders of others
            return super().load_overload(sig, target_context)
        except Exception:  # a file that a crash of the machine left empty can raise anything
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep code for a signature, if the disk lets us."""
        with suppress(OSError), locked(Path(self.cache_path) / "saving"):
            super().save_overload(sig, data)
