"""No function is too long or has too many positional arguments; kernels give the shapes of their arrays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

from tests.sources import Facts, Function, below, facts_of

PACKAGES = ("humanoid", "estimator", "viz", "kinemode")
MOST_LINES, MOST_POSITIONAL = 60, 8


def too_long(function: Function) -> bool:
    """Whether it has too many lines of code: public functions document every argument, so docstrings do not count."""
    return not function.compiled and function.lines > MOST_LINES


def too_many_positional(function: Function) -> bool:
    return not function.compiled and function.positional > MOST_POSITIONAL


def functions(facts: Mapping[Path, Facts], *folders: str) -> list[Function]:
    return [function for source in below(facts, *folders).values() for function in source.functions]


def without_shape(function: Function, others: Iterable[Function] = ()) -> list[str]:
    """Arrays that a kernel's docstring gives no shape: `name (N, 3)`, or several names before one. It may refer to
    the kernels of `others` by name instead."""
    docstrings = {f.name.rpartition(".")[2]: " ".join(f.docstring.split()) for f in (*others, function)}
    text, named = "", [function.name.rpartition(".")[2]]
    while named:
        docstring = docstrings.pop(named.pop(), "")
        text += f" {docstring}"
        named += re.findall(r"`(?:[\w.]*\.)?(\w+)`", docstring)
    side = r"[A-Za-z0-9_]+(?: ?[-+*] ?[A-Za-z0-9_]+)*"
    shape = rf"\({side}(?:, {side})*,?\)"
    return [a for a in function.arrays if not re.search(rf"\b{a}\b[\w\s,`']{{0,80}}?{shape}", text)]


def test_no_function_has_more_than_sixty_lines_of_code(facts: Mapping[Path, Facts]) -> None:
    broken = {f.name for f in functions(facts, *PACKAGES, "benchmarks") if too_long(f)}
    assert not broken, f"over {MOST_LINES} lines of code: {sorted(broken)}"


def test_no_function_has_more_than_eight_positional_arguments(facts: Mapping[Path, Facts]) -> None:
    broken = {f.name for f in functions(facts, *PACKAGES) if too_many_positional(f)}
    assert not broken, f"over {MOST_POSITIONAL} positional arguments: {sorted(broken)}"


def test_kernels_document_the_shapes_of_their_arrays(facts: Mapping[Path, Facts]) -> None:
    kernels = [f for f in functions(facts, *PACKAGES) if f.compiled]
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
    planted = facts_of("module", source).functions
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
    kernels = facts_of("module", source + '@jit\ndef g(y):\n    """y (n,)."""\n    y[0] = 1\n').functions
    kernel, other = sorted(kernels)
    assert without_shape(kernel, [kernel, other]) == silent
