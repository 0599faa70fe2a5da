"""Compiled functions: kept between runs, never served stale, by any number of processes."""

from __future__ import annotations

import errno
import fcntl
import importlib
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from numba.core.caching import IndexDataCacheFile

from humanoid.support import compiled
from humanoid.support.compiled_cache import (
    KEPT,
    PACKAGES,
    UNUSED,
    cache_roots,
    imported_files,
    imported_names,
    source_folder,
    sources_digest,
)
from tests.sources import Facts, below
from tests.waiting import DEADLINE

ROOT = Path(__file__).parent.parent
KERNEL = """
from humanoid.support.compiled import jit
from toy.inner.values import (  # in brackets,
    SCALE,  # one a line
)

@jit
def scaled(x):
    return SCALE * x
"""


class Toy:
    """A package with a kernel, a constant of another file compiled into it, and a file that does not matter."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "toy"
        for path, text in (("kernel.py", KERNEL), ("inner/values.py", "from . import deep\nSCALE = deep.TEN / 5.0\n")):
            self.write(path, text)
        self.write("inner/deep.py", "TEN = 10.0\n")
        self.write("apart.py", "")

    def write(self, path: str, text: str) -> None:
        file = self.folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        at = len(text)  # a different time [s] at any resolution of the file system
        os.utime(file, (at, at))

    def kernel(self) -> ModuleType:
        """The kernel's module as a new process would import it."""
        for name in [name for name in sys.modules if name.partition(".")[0] == "toy"]:
            del sys.modules[name]
        importlib.invalidate_caches()
        return importlib.import_module("toy.kernel")

    def run(self, x: float) -> tuple[float, int]:
        """The kernel's result for a number, and how many functions were loaded from the disk."""
        scaled = self.kernel().scaled
        return scaled(x), sum(scaled.stats.cache_hits.values())


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Toy]:
    monkeypatch.setenv("KINEMODE_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield Toy(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "toy"]:
        del sys.modules[name]


def test_a_constant_of_another_file_is_not_served_stale(toy: Toy) -> None:
    assert toy.run(3.0) == (6.0, 0)
    assert toy.run(3.0) == (6.0, 1)
    toy.write("inner/values.py", "SCALE = 7.0  # no longer\n")
    assert toy.run(3.0) == (21.0, 0)
    toy.write("apart.py", "SCALE = 'somebody else'\n")
    assert toy.run(3.0) == (21.0, 1)


def test_whether_a_function_was_compiled_is_known(toy: Toy) -> None:
    assert not compiled.is_compiled(toy.kernel().scaled)
    toy.run(3.0)
    assert compiled.is_compiled(toy.kernel().scaled)  # by an earlier process
    toy.write("inner/values.py", "SCALE = 7.0  # no longer\n")
    scaled = toy.kernel().scaled
    assert not compiled.is_compiled(scaled)
    scaled(3.0)
    assert compiled.is_compiled(scaled)


def test_another_checkout_of_the_same_sources_is_served(toy: Toy, monkeypatch: pytest.MonkeyPatch) -> None:
    assert toy.run(3.0) == (6.0, 0)
    elsewhere = toy.folder.parent / "elsewhere"
    shutil.copytree(toy.folder, elsewhere / "toy")
    os.utime(elsewhere / "toy" / "kernel.py")  # written at another time
    monkeypatch.setenv("NUMBA_CACHE_LOCATOR_CLASSES", "InTreeCacheLocator")
    monkeypatch.syspath_prepend(str(elsewhere))
    kernel = toy.kernel()
    assert Path(kernel.__file__ or "").is_relative_to(elsewhere)
    assert toy.run(3.0) == (6.0, 1)
    assert not list(elsewhere.rglob("*.nbi"))
    (index,) = (toy.folder.parent / "cache").rglob("*.nbi")
    assert (index.parent / "saving").exists()  # where both wait for each other


def test_the_digest_is_of_all_that_is_imported(toy: Toy) -> None:
    file = toy.folder / "kernel.py"
    ours = {ROOT / "humanoid" / "support" / name for name in ("compiled.py", "compiled_cache.py", "locks.py")}
    assert imported_files(file, "toy.kernel") - ours == {
        file,
        toy.folder / "inner" / "values.py",
        toy.folder / "inner" / "deep.py",
    }
    before = sources_digest(file, "toy.kernel")
    toy.write("inner/deep.py", "TEN = 10.0 + 1e-9\n")
    assert sources_digest(file, "toy.kernel") != before


def test_every_import_of_ours_is_seen(facts: Mapping[Path, Facts]) -> None:
    """Imports are found without parsing; here they are parsed."""
    count = 0
    for file, source in below(facts, *PACKAGES).items():
        assert set(source.imported) <= set(imported_names(file.read_text(encoding="utf-8"))), file
        count += len(source.imported)
    assert count > 500
    odd = "import a.b as x, c  # d, e\nfrom . import f\nfrom ..g import \\\n    h as i\nif 1: from j.k import (l,\n m)"
    assert {"a.b", "c", ".f", "..g.h", "j.k.l", "j.k.m"} <= set(imported_names(odd))
    assert not {"d", "e"} & set(imported_names(odd))


def test_processes_that_save_at_once_do_not_mix_their_code(toy: Toy, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both read the index before either writes it, unless one has to wait for the other."""
    load, lock, meeting, met = IndexDataCacheFile._load_index, fcntl.flock, threading.Barrier(2), set()
    saved: list[tuple[Any, ...]] = []

    def meet() -> None:
        """Each once: when it has read the index, or when it has to wait."""
        if threading.get_ident() not in met:
            met.add(threading.get_ident())
            meeting.wait(DEADLINE)

    def flock(handle: int, how: int) -> None:
        try:
            lock(handle, how | fcntl.LOCK_NB)
        except BlockingIOError:
            meet()
            lock(handle, how)

    with monkeypatch.context() as patched:
        patched.setattr(compiled._SharedCache, "save_overload", lambda *args: saved.append(args))
        assert (toy.kernel().scaled(3), toy.kernel().scaled(0.5)) == (6.0, 1.0)
    with monkeypatch.context() as patched:
        patched.setattr(IndexDataCacheFile, "_load_index", lambda self: (load(self), meet())[0])
        patched.setattr(fcntl, "flock", flock)
        threads = [threading.Thread(target=cache.save_overload, args=rest) for cache, *rest in saved]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    again = toy.kernel().scaled
    assert (again(3), again(0.5)) == (6.0, 1.0)
    assert sum(again.stats.cache_hits.values()) == len(saved) == 2


def test_a_cache_that_fails_costs_time_only(toy: Toy, monkeypatch: pytest.MonkeyPatch) -> None:
    assert toy.run(3.0) == (6.0, 0)
    (index,) = (toy.folder.parent / "cache").rglob("*.nbi")
    index.write_bytes(b"")  # as a crash of the machine leaves it
    assert toy.run(3.0) == (6.0, 0)
    assert toy.run(3.0) == (6.0, 1)  # repaired

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(IndexDataCacheFile, "save", full)
    assert toy.kernel().scaled(3) == 6.0


def test_where_it_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("KINEMODE_CACHE", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    last = tmp_path / f"kinemode-compiled-{os.getuid()}"
    monkeypatch.setenv("HOME", "/somewhere/somebody")
    assert list(cache_roots()) == [Path("/somewhere/somebody/.cache/kinemode"), last]
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert next(cache_roots()) == Path("/somewhere/somebody/.cache/kinemode")
    monkeypatch.setenv("XDG_CACHE_HOME", "/caches")
    assert next(cache_roots()) == Path("/caches/kinemode")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/numbas")
    assert next(cache_roots()) == Path("/numbas/kinemode")
    monkeypatch.setenv("KINEMODE_CACHE", "/ours")
    assert list(cache_roots()) == [Path("/ours"), last]
    for name in ("KINEMODE_CACHE", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # no home, not even in the list of users
    assert list(cache_roots()) == [last]
    last.chmod(0o777)  # anybody could plant code
    assert list(cache_roots()) == []


@pytest.mark.parametrize("closed", [["KINEMODE_CACHE"], ["KINEMODE_CACHE", "TMPDIR"]])
def test_a_folder_without_write_permission(toy: Toy, closed: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Then the next one is used, and in the end none; code is never stored beside the sources, where it would go
    stale."""
    base = toy.folder.parent
    (base / "file").touch()
    for name in ("KINEMODE_CACHE", "TMPDIR"):
        monkeypatch.setenv(name, str(base / "file" / "cache" if name in closed else base / name))
    (base / "TMPDIR").mkdir(exist_ok=True)
    monkeypatch.setattr("tempfile.tempdir", os.environ["TMPDIR"])
    hits = [toy.run(3.0), toy.run(3.0)]
    assert hits == [(6.0, 0), (6.0, 0 if "TMPDIR" in closed else 1)]
    assert not list(toy.folder.rglob("__pycache__"))


def test_a_read_only_cache(toy: Toy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It exists from an earlier run, and the next one is used."""
    assert toy.run(3.0) == (6.0, 0)
    source_folder.cache_clear()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    temporary_file = tempfile.TemporaryFile

    def refused(*, dir: Path | str) -> Any:
        if Path(dir).is_relative_to(tmp_path / "cache"):
            raise OSError(errno.EROFS, "Read-only file system")
        return temporary_file(dir=dir)

    monkeypatch.setattr(tempfile, "TemporaryFile", refused)
    assert [toy.run(3.0), toy.run(3.0)] == [(6.0, 0), (6.0, 1)]


def now(folder: Path) -> float:
    """The time [s] by the file system's clock, which stamps the folders."""
    (folder / "clock").touch()
    return (folder / "clock").stat().st_mtime


def test_old_folders_are_removed_but_none_of_the_last_day(tmp_path: Path) -> None:
    clock, tmp_path = tmp_path, tmp_path / "cache"

    def aged(folders: list[Path], days: float) -> None:
        for i, folder in enumerate(folders):
            last = now(clock) - days * UNUSED + i
            os.utime(folder, (last, last))

    folders = [source_folder(tmp_path, "a.module", f"digest{i}") for i in range(KEPT + 3)]
    other = source_folder(tmp_path, "a.module_too", "digest")
    aged([*folders, other], 0.9)
    folders.append(source_folder(tmp_path, "a.module", "new"))
    assert sorted(tmp_path.iterdir()) == sorted([*folders, other])
    aged([*folders, other], 1.1)
    newest = source_folder(tmp_path, "a.module", "newest")
    kept = folders[1 - KEPT :]
    assert sorted(tmp_path.iterdir()) == sorted([*kept, newest, other])
    source_folder.cache_clear()  # as in a new process
    aged([folders[-1]], 1.1)
    assert source_folder(tmp_path, "a.module", "new").stat().st_mtime > now(clock) - UNUSED


def test_a_folder_that_is_removed_meanwhile_costs_time_only(toy: Toy) -> None:
    assert toy.run(3.0) == (6.0, 0)
    scaled = toy.kernel().scaled
    shutil.rmtree(toy.folder.parent / "cache")
    assert (scaled(3.0), scaled(3)) == (6.0, 6.0)
    source_folder.cache_clear()
    assert toy.run(3.0) == (6.0, 0)
    assert toy.run(3.0) == (6.0, 1)


def test_a_process_of_more_than_a_day_keeps_its_folder(toy: Toy, monkeypatch: pytest.MonkeyPatch) -> None:
    scaled = toy.kernel().scaled
    scaled(3.0)
    monkeypatch.setattr(compiled._SharedCache, "save_overload", lambda *_: None)  # which marks it, too
    (folder,) = (toy.folder.parent / "cache").iterdir()
    long_ago = now(toy.folder) - 2.0 * UNUSED
    os.utime(folder, (long_ago, long_ago))
    scaled(3)  # looks for another signature
    assert folder.stat().st_mtime > long_ago + UNUSED
