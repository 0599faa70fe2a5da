"""What the tests of the source code ask of a file, read from it in one walk: all files are parsed once a session."""

from __future__ import annotations

import ast
import contextlib
import hashlib
import os
import pickle
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from benchmarks.support.common import ROOT

FOLDERS = ("humanoid", "estimator", "viz", "kinemode", "benchmarks", "tests", "examples")
KEPT = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "kinemode" / "sources.pickle"


class Function(NamedTuple):
    """A function, those inside others too.

    name: of the module and of itself. lines: without its docstring. positional: how many arguments can be given by
    place, self aside. compiled: whether it is a kernel; docstring; arrays: the arguments that a kernel uses as arrays.
    """

    name: str
    lines: int
    positional: int
    compiled: bool
    docstring: str
    arrays: tuple[str, ...]


class Class(NamedTuple):
    """A class: its bases as they are written, and the names of its own functions."""

    name: str
    bases: tuple[str, ...]
    methods: tuple[str, ...]


class Facts(NamedTuple):
    """Of one file.

    named: names of classes, functions, arguments and fields, and their lines. stored: names of variables and arguments,
    likewise. texts: all strings, likewise. imported: `a.b` of `import a.b`, and of `from a import b`.
    """

    named: list[tuple[str, int]]
    stored: list[tuple[str, int]]
    texts: list[tuple[str, int]]
    functions: list[Function]
    classes: list[Class]
    imported: list[str]


def facts_of(module: str, source: str) -> Facts:
    """Of a module's source."""
    facts = Facts([], [], [], [], [], [])
    for node in nodes_of(ast.parse(source)):
        if isinstance(node, ast.Constant):
            if isinstance(node.value, str):
                facts.texts.append((node.value, node.lineno))
        elif isinstance(node, ast.Name):
            if isinstance(node.ctx, ast.Store):
                facts.stored.append((node.id, node.lineno))
        elif isinstance(node, ast.arg):
            facts.named.append((node.arg, node.lineno))
            facts.stored.append((node.arg, node.lineno))
        elif isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            facts.named.append((node.name, node.lineno))
            if isinstance(node, ast.ClassDef):
                facts.classes.append(_class(node))
            else:
                facts.functions.append(_function(module, node))
        elif isinstance(node, ast.AnnAssign):
            if isinstance(node.target, ast.Name):
                facts.named.append((node.target.id, node.lineno))
        elif isinstance(node, ast.Import):
            facts.imported.extend(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            facts.imported.extend(f"{node.module}.{alias.name}" for alias in node.names)
    return facts


def facts_of_all() -> Mapping[Path, Facts]:
    """Of all files of the repository's folders of code; `tests/conftest.py` has it as a fixture.

    They are kept for the next session, as compiled kernels and what mypy knows are, by what the files contain.
    """
    reader = f"{sys.version} {Path(__file__).read_text(encoding='utf-8')}"
    kept, facts, now = _kept(), {}, {}
    for path in (path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))):
        source = path.read_text(encoding="utf-8")
        digest = hashlib.sha256(f"{reader} {path.stem} {source}".encode()).digest()
        facts[path] = now[digest] = kept[digest] if digest in kept else facts_of(path.stem, source)
    if now.keys() != kept.keys():
        with contextlib.suppress(OSError):
            KEPT.parent.mkdir(parents=True, exist_ok=True)
            part = KEPT.with_suffix(f".{os.getpid()}")
            part.write_bytes(pickle.dumps(now))
            part.replace(KEPT)
    return facts


def _kept() -> dict[bytes, Facts]:
    """By digest; none where they cannot be read."""
    try:
        kept: dict[bytes, Facts] = pickle.loads(KEPT.read_bytes())
    except Exception:  # of a file that is damaged, or of another version, anything may be raised
        return {}
    return kept


def below(facts: Mapping[Path, Facts], *folders: str) -> dict[Path, Facts]:
    """Those of the files in some folders of the repository."""
    within = tuple(f"{ROOT / folder}/" for folder in folders)
    return {path: source for path, source in facts.items() if str(path).startswith(within)}


def nodes_of(tree: ast.AST) -> Iterator[ast.AST]:
    """As `ast.walk`, in another order and in less time."""
    left = [tree]
    while left:
        node = left.pop()
        yield node
        for value in node.__dict__.values():
            if isinstance(value, ast.AST):
                left.append(value)
            elif type(value) is list:
                left.extend(inner for inner in value if isinstance(inner, ast.AST))


def _class(node: ast.ClassDef) -> Class:
    methods = tuple(inner.name for inner in node.body if isinstance(inner, ast.FunctionDef))
    return Class(node.name, tuple(map(ast.unparse, node.bases)), methods)


def _function(module: str, node: ast.FunctionDef | ast.AsyncFunctionDef) -> Function:
    decorators = {re.split(r"[.(]", ast.unparse(d))[0] for d in node.decorator_list}
    compiled, docstring = "jit" in decorators, ast.get_docstring(node)
    lines = _lines(node) - (0 if docstring is None else _lines(node.body[0]))
    places = [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
    positional = len(places) - (places[:1] in (["self"], ["cls"]))
    arrays = arrays_of(node) if compiled else ()
    return Function(f"{module}.{node.name}", lines, positional, compiled, docstring or "", arrays)


def _lines(node: ast.stmt) -> int:
    assert node.end_lineno is not None
    return node.end_lineno - node.lineno + 1


def arrays_of(node: ast.FunctionDef | ast.AsyncFunctionDef) -> tuple[str, ...]:
    """The arguments of a kernel that it uses as arrays: indexed, or queried for their size."""
    used = set()
    for n in nodes_of(node):
        value: ast.expr | None = None
        if isinstance(n, ast.Subscript) or (isinstance(n, ast.Attribute) and n.attr in ("shape", "size", "T")):
            value = n.value
        elif isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id == "len":
            value = n.args[0]
        if isinstance(value, ast.Name):
            used.add(value.id)
    return tuple(a.arg for a in node.args.args if a.arg in used)
