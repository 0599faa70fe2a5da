"""Which source files can change what a compiled function does: its own and all that it imports, directly or not."""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

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
