"""No function is too long or has too many positional arguments; kernels give the shapes of their arrays."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("humanoid", "estimator", "viz", "kinemode")
MOST_LINES, MOST_POSITIONAL = 60, 8


class Function(NamedTuple):
    """A function, its location, and whether it is compiled."""

    name: str
    node: ast.FunctionDef | ast.AsyncFunctionDef
    compiled: bool


def functions_of(module: str, source: str) -> Iterator[Function]:
    """All functions of a module, nested ones too, named module.function."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            decorators = {re.split(r"[.(]", ast.unparse(d))[0] for d in node.decorator_list}
            yield Function(f"{module}.{node.name}", node, "jit" in decorators)


def functions(*packages: str) -> list[Function]:
    return [function for package in packages for function in functions_in(package)]


@cache
def functions_in(package: str) -> list[Function]:
    files = sorted((ROOT / package).rglob("*.py"))
    return [function for file in files for function in functions_of(file.stem, file.read_text())]


def lines_of(node: ast.stmt) -> int:
    assert node.end_lineno is not None
    return node.end_lineno - node.lineno + 1


def too_long(function: Function) -> bool:
    """Whether it has too many lines of code. Docstrings do not count, as public functions document every argument."""
    node = function.node
    docstring = 0 if ast.get_docstring(node) is None else lines_of(node.body[0])
    return not function.compiled and lines_of(node) - docstring > MOST_LINES


def too_many_positional(function: Function) -> bool:
    arguments = function.node.args
    positional = [a.arg for a in (*arguments.posonlyargs, *arguments.args)]
    return not function.compiled and len(positional) - (positional[:1] in (["self"], ["cls"])) > MOST_POSITIONAL


def arrays_of(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """The arguments that a kernel uses as arrays: indexed, or queried for their size."""
    used = set()
    for n in ast.walk(node):
        value: ast.expr | None = None
        if isinstance(n, ast.Subscript) or (isinstance(n, ast.Attribute) and n.attr in ("shape", "size", "T")):
            value = n.value
        elif isinstance(n, ast.Call) and ast.unparse(n.func) == "len":
            value = n.args[0]
        if isinstance(value, ast.Name):
            used.add(value.id)
    return [a.arg for a in node.args.args if a.arg in used]


def without_shape(function: Function, others: Iterable[Function] = ()) -> list[str]:
    """Arrays that a kernel's docstring gives no shape: `name (N, 3)`, or several names before one. It may refer to the
    kernels of `others` by name instead."""
    docstrings = {f.node.name: " ".join((ast.get_docstring(f.node) or "").split()) for f in (*others, function)}
    text, named = "", [function.node.name]
    while named:
        docstring = docstrings.pop(named.pop(), "")
        text += f" {docstring}"
        named += re.findall(r"`(?:[\w.]*\.)?(\w+)`", docstring)
    side = r"[A-Za-z0-9_]+(?: ?[-+*] ?[A-Za-z0-9_]+)*"
    shape = rf"\({side}(?:, {side})*,?\)"
    return [a for a in arrays_of(function.node) if not re.search(rf"\b{a}\b[\w\s,`']{{0,80}}?{shape}", text)]


def test_no_function_has_more_than_sixty_lines_of_code() -> None:
    broken = {f.name for f in functions(*PACKAGES, "benchmarks") if too_long(f)}
    assert not broken, f"over {MOST_LINES} lines of code: {sorted(broken)}"


def test_no_function_has_more_than_eight_positional_arguments() -> None:
    broken = {f.name for f in functions(*PACKAGES) if too_many_positional(f)}
    assert not broken, f"over {MOST_POSITIONAL} positional arguments: {sorted(broken)}"


def test_kernels_document_the_shapes_of_their_arrays() -> None:
    kernels = [f for f in functions(*PACKAGES) if f.compiled]
    assert len(kernels) > 50
    silent = {f.name: arrays for f in kernels if (arrays := without_shape(f, kernels))}
    assert not silent, f"kernels whose docstring leaves out shapes: {silent}"


LONG = "def f():\n" + "    x = 1\n" * 60
WIDE = "def f(a, b, c, d, e, f, g, h, i): pass"


@pytest.mark.parametrize(
    ("source", "long", "wide"),
    [
        (LONG, True, False),
        (LONG.replace("    x = 1\n", "", 1), False, False),
        (LONG.replace("x = 1", '"""x."""', 1), False, False),
        (LONG.replace("x = 1", '"""x.\n\n    y."""\n    x = 1', 1), True, False),
        ("@jit\n" + LONG, False, False),
        (f"class A:\n    def m(self):\n        {LONG}".replace("\n    x", "\n            x"), True, False),
        (WIDE, False, True),
        (WIDE.replace("a,", "self,"), False, False),
        (WIDE.replace("i)", "*, i)"), False, False),
        (f"@jit(cache=True)\n{WIDE}", False, False),
    ],
)
def test_planted_violations_are_found(source: str, long: bool, wide: bool) -> None:
    planted = list(functions_of("module", source))
    assert any(map(too_long, planted)) == long
    assert any(map(too_many_positional, planted)) == wide


@pytest.mark.parametrize(
    ("docstring", "silent"),
    [
        ("", ["x", "y"]),
        ("Adds x to y.", ["x", "y"]),
        ("Adds x (n,) to y.", ["y"]),
        ("Adds x (n,). Into (n,) goes y.", ["y"]),
        ("Adds x to y (n, 3 + k).", []),
        ("x, y (n,): numbers [m]. k: how many.", []),
        ("x (of any size), y (n,).", ["x"]),
        ("x (n,); y: see `g`.", []),
        ("x (n,); y: see `h`.", ["y"]),
    ],
)
def test_a_kernel_that_hides_a_shape_is_found(docstring: str, silent: list[str]) -> None:
    source = f'@jit\ndef f(x, y, k):\n    """{docstring}"""\n    y[k] = len(x)\n'
    kernel, other = functions_of("module", source + '@jit\ndef g(y):\n    """y (n,)."""\n    y[0] = 1\n')
    assert without_shape(kernel, [kernel, other]) == silent
