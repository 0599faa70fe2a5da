"""The cache of compiled code: a folder for every state of the sources that can change what a compiled function does."""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shutil
import stat
import tempfile
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

KEPT = 4  # folders of one module, the one in use included: a few checkouts and branches side by side
UNUSED = 24 * 3600.0  # [s] since a process last took code from a folder, before which it stays


def cache_roots() -> Iterator[Path]:
    """Folders that may hold the cache, the best first: that of KINEMODE_CACHE, NUMBA_CACHE_DIR or the user's cache,
    then one among the temporary files."""
    given, numbas = os.environ.get("KINEMODE_CACHE"), os.environ.get("NUMBA_CACHE_DIR")
    if given or numbas:
        first: Path | None = Path(given) if given else Path(numbas or "", "kinemode")
    else:
        first = _users_cache()
    if first is not None:
        yield first
    last = _temporary_folder()
    if last is not None:
        yield last


@functools.cache
def source_folder(root: Path, module: str, digest: str) -> Path:
    """The folder for what is compiled from one state of a module's sources.

    Older ones of the module that have not been used for a day are removed. Raises OSError where the folder cannot be
    made.
    """
    folder = root.absolute() / f"{module}-{digest}"
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()  # OSError where it cannot be written to
    os.utime(folder)  # when it was last used
    if new:
        _tidy(folder, module)
    return folder


def _tidy(used: Path, module: str) -> None:
    """Remove all but the last used folders of a module."""
    with suppress(OSError):  # another process does the same
        others = sorted((path.stat().st_mtime, path) for path in used.parent.glob(f"{module}-*") if path != used)
        for last, folder in others[: 1 - KEPT]:
            if last < time.time() - UNUSED:
                gone = folder.rename(used.with_name(f"removed-{uuid.uuid4().hex}"))
                shutil.rmtree(gone, ignore_errors=True)


def _users_cache() -> Path | None:
    given = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(given):
        return Path(given, "kinemode")
    home = os.path.expanduser("~")
    return Path(home, ".cache", "kinemode") if os.path.isabs(home) else None


def _temporary_folder() -> Path | None:
    """A folder that only this user can write to: the cache is code, so no other user may plant it."""
    user = os.getuid()
    folder = Path(tempfile.gettempdir()) / f"kinemode-compiled-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(about.st_mode) and not about.st_mode & 0o022
    return folder if private and about.st_uid in (user, 0) else None


PACKAGES = ("humanoid", "estimator", "viz", "kinemode")

# ten times faster than parsing; what only looks like an import, such as in a docstring, does no harm
_IMPORT = re.compile(r"\bfrom\s+([\w.]+)\s+import\s*(\([^)]*\)|[^\n;]*)|\bimport\s+([^\n;]*)")


def sources_digest(file: Path, module: str) -> str:
    """A digest of a module's file and of the first-party files it imports, over any number of steps.

    First-party are kinemode's packages and the module's own top-level package. Raises OSError where a file cannot be
    read.
    """
    digest = hashlib.sha256()
    for path in sorted(imported_files(file, module)):
        digest.update(_read(path, path.stat().st_mtime_ns)[0])
    return digest.hexdigest()[:20]


def imported_files(file: Path, module: str) -> set[Path]:
    """The files behind `sources_digest`.

    The `__init__.py` of a package counts where something is imported from the package itself.
    """
    roots = dict.fromkeys(PACKAGES, Path(__file__).parent.parent.parent)
    top, *inner = module.split(".")
    roots.setdefault(top, file.parents[len(inner) + (file.name == "__init__.py")])
    folders = tuple(roots.items())
    seen, waiting = set(), [file]
    while waiting:
        path = waiting.pop()
        if path not in seen:
            seen.add(path)
            waiting += _direct(path, path.stat().st_mtime_ns, folders)
    return seen


@functools.lru_cache(maxsize=1024)
def _direct(path: Path, changed: int, folders: tuple[tuple[str, Path], ...]) -> tuple[Path, ...]:
    """The files that a file imports itself. folders: of top-level packages, by name."""
    roots = dict(folders)
    return tuple(file for name in _read(path, changed)[1] for file in _files(*_placed(name, path, roots)))


@functools.lru_cache(maxsize=1024)
def _read(path: Path, changed: int) -> tuple[bytes, tuple[str, ...]]:
    """Digest of a file and the names it imports; read again where it has changed since."""
    content = path.read_bytes()
    return hashlib.sha256(content).digest(), tuple(sorted(set(imported_names(content.decode(errors="replace")))))


def imported_names(source: str) -> Iterator[str]:
    """Dotted names that a source imports: modules, and modules with a name from them; leading dots as they stand."""
    for match in _IMPORT.finditer(source.replace("\\\n", " ")):
        module, names, modules = match.groups()
        if module is None:
            yield from _first_words(modules)
            continue
        yield module
        lines = (line.partition("#")[0] for line in names.strip("()").splitlines())
        yield from (module + "." * (not module.endswith(".")) + name for name in _first_words(",".join(lines)))


def _first_words(listed: str) -> Sequence[str]:
    """`a.b as c, d  # why` -> a.b, d."""
    return [part.split()[0] for part in listed.partition("#")[0].split(",") if part.strip()]


def _placed(name: str, importer: Path, roots: Mapping[str, Path]) -> tuple[Path | None, str]:
    """The folder that an imported name is relative to, None for another's package, and the name without dots."""
    plain = name.lstrip(".")
    level = len(name) - len(plain)
    return (importer.parents[level - 1] if level else roots.get(plain.partition(".")[0])), plain


def _files(folder: Path | None, name: str) -> tuple[Path, ...]:
    """The file that a dotted name is, if it is one."""
    if folder is None:
        return ()
    base = folder.joinpath(*name.split("."))
    return tuple(path for path in (base / "__init__.py", base.parent / f"{base.name}.py") if path.is_file())
