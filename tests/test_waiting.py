"""No outcome depends on how fast the machine is, nor on how the suite was started."""

from __future__ import annotations

import ast
import os
import re
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.waiting import DEADLINE, default_signals, ended, kinemode_process, until

TESTS = Path(__file__).resolve().parent
CLOCKS = {"time", "monotonic", "perf_counter", "process_time", "thread_time", "sleep"}
CLOCKS |= {f"{name}_ns" for name in CLOCKS - {"sleep"}}
WAITS = {"wait", "join", "communicate", "acquire", "settimeout", "poll"}
IN_PROGRAMS = re.compile(r"\b(?:sleep|monotonic|perf_counter|process_time)\(")

JUSTIFIED: dict[str, str] = {
    "waiting.py until": "the one place that polls: it gives up at the deadline, and passes as soon as it can",
}
"""Places, file and function, that may do it, and why no outcome depends on it."""


def found_in(source: str) -> Iterator[tuple[str, str]]:
    """(function, finding): clocks, sleeps, and waits shorter than the deadline, also in programs in strings."""
    for function, node in _nodes(ast.parse(source), "module"):
        if isinstance(node, ast.ImportFrom) and node.module == "time":
            yield from ((function, f"from time import {a.name}") for a in node.names if a.name in CLOCKS)
        elif isinstance(node, ast.Attribute) and node.attr in CLOCKS and getattr(node.value, "id", "") == "time":
            yield function, f"time.{node.attr}"
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and IN_PROGRAMS.search(node.value):
            yield function, f"a program with {node.value.strip()[:40]!r}"
        elif isinstance(node, ast.Call) and (short := _short_wait(node)) is not None:
            yield function, f"a wait of {short:g} s"


def _nodes(tree: ast.AST, function: str) -> Iterator[tuple[str, ast.AST]]:
    """Every node with the outermost function or class it is in; docstrings are not programs."""
    left = [(tree, function)]
    while left:
        node, within = left.pop()
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
                continue
            named = isinstance(child, ast.FunctionDef | ast.ClassDef) and within == "module"
            inside = child.name if named else within  # type: ignore[attr-defined]
            yield inside, child
            left.append((child, inside))


def _short_wait(call: ast.Call) -> float | None:
    """Seconds that a call waits, if given as a number below the deadline."""
    given = [k.value for k in call.keywords if k.arg and k.arg.endswith("timeout")]
    if isinstance(call.func, ast.Attribute) and call.func.attr in WAITS:
        given += call.args[:1]
    numbers = [n.value for n in given if isinstance(n, ast.Constant) and isinstance(n.value, int | float)]
    return min((float(n) for n in numbers if not isinstance(n, bool) and n < DEADLINE), default=None)


def test_no_test_depends_on_the_speed_of_the_machine() -> None:
    places: dict[str, list[str]] = {}
    for path in sorted(TESTS.glob("*.py")):
        if path.name != Path(__file__).name:
            for function, what in found_in(path.read_text(encoding="utf-8")):
                places.setdefault(f"{path.name} {function}", []).append(what)
    assert {place: what for place, what in places.items() if place not in JUSTIFIED} == {}
    assert set(JUSTIFIED) <= set(places)  # none is obsolete


@pytest.mark.parametrize(
    "line",
    ["time.sleep(0.1)", "from time import perf_counter", "began = time.monotonic()", "process.wait(5)",
     "thread.join(timeout=3)", "run('x', timeout=60)", "queue.get(timeout=1.5)", "run(['-c', 'import t; t.sleep(3)'])",
     "connect('x', connect_timeout=9)"],
)  # fmt: skip
def test_what_depends_on_it_is_found(line: str) -> None:
    assert [function for function, _ in found_in(f"def test():\n    {line}\n")] == ["test"]


@pytest.mark.parametrize(
    "line", ["process.wait(DEADLINE)", "values.get('a', 3)", "', '.join(names)", "thread.join()", "run(timeout=900)"]
)
def test_what_does_not_depend_on_it_is_not_found(line: str) -> None:
    assert list(found_in(f"def test():\n    {line}\n")) == []


def test_a_command_ends_by_ctrl_c_though_the_suite_ignores_it() -> None:
    with default_signals():
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell does for what it starts with &
        try:
            process = kinemode_process(["view", os.devnull, "--help"])
            with default_signals():
                assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
                with pytest.raises(KeyboardInterrupt):
                    signal.raise_signal(signal.SIGINT)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        finally:
            signal.signal(signal.SIGINT, before)
    status = Path(f"/proc/{process.pid}/status")
    ignored = re.search(r"SigIgn:\s*(\w+)", status.read_text()) if status.exists() else None  # Linux only
    assert ignored is None or not int(ignored[1], 16) & 1 << (signal.SIGINT - 1)
    code, out, _ = ended(process)
    assert (code, "--html" in out) == (0, True)


def test_waiting_ends_as_soon_as_the_condition_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([False, False, True])
    until(lambda: next(answers), "the third answer")
    monkeypatch.setattr(sys.modules["tests.waiting"], "DEADLINE", 0.0)
    with pytest.raises(AssertionError, match="not within 0 s: anything"):
        until(lambda: False, "anything")
