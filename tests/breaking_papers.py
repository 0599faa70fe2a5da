"""Whether the tests that docs/papers names notice when the functions beside them return something wrong.

    python -m tests.breaking_papers css "The search (section 4)"      a table of a page; without it, all of them

One pytest session collects the tests of some rows. For every fault a child of it is forked, in which the function is
broken before any fixture is made, so that nothing broken is left over and nothing correct is reused. What is broken is
the result (`Breaker`). Of a class the methods are broken in turn, and what its constructor leaves; of a module its
functions; of a protocol the methods of its implementations; of a constant its value. Compiled functions are called by
compiled ones, so those are broken in a session without compilation.
"""

from __future__ import annotations

import copy
import functools
import importlib
import inspect
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FunctionType, MappingProxyType, ModuleType
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.support.common import ROOT
from tests.waiting import DEADLINE

PAGES = sorted((ROOT / "docs" / "papers").glob("*.md"))
PACKAGES = ("humanoid", "estimator", "viz", "kinemode", "benchmarks", "tests")
DOTTED = re.compile(r"`((?:humanoid|estimator|viz|kinemode|benchmarks)(?:\.\w+)+)`")
TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")
DECIMAL = re.compile(r"-?\d+\.\d+")
DEEPEST = 5
"""Objects within objects that are still broken."""
UNEVEN, MISSING, COUNTED = "uneven", "missing", "counted"


class Row(NamedTuple):
    """A row of a table: the heading above it, its first cell, dotted names, and tests as `file::name`."""

    section: str
    what: str
    functions: tuple[str, ...]
    tests: tuple[str, ...]


def tables(page: str) -> Iterator[tuple[str, list[str]]]:
    """The section and the cells of all rows of the page's tables, without headers."""
    section = ""
    for line in page.splitlines():
        if line.startswith("#"):
            section = line.lstrip("# ")
        elif line.startswith("|"):
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if cells[0] != "in the paper" and not set(cells[0]) <= set("-: "):
                yield section, cells


def rows_of(page: str) -> list[Row]:
    """The rows of a page's text that have three cells."""
    return [
        Row(section, cells[0], tuple(DOTTED.findall(cells[1])), tuple("::".join(t) for t in TEST.findall(cells[2])))
        for section, cells in tables(page)
        if len(cells) == 3
    ]


def reached(name: str) -> tuple[Any, Any]:
    """The module or class that has what a dotted name is, and that itself; of a field its description. LookupError if
    there is no such name."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        module = ".".join(parts[:length])
        try:
            owner, value = None, importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is not None and not module.startswith(error.name):
                raise  # the module exists, but an import of it fails
            continue
        for attribute in parts[length:]:
            fields = getattr(value, "__dataclass_fields__", {})
            if not hasattr(value, attribute) and attribute not in fields:
                raise LookupError(name)
            owner, value = value, getattr(value, attribute, fields.get(attribute))
        return owner, value
    raise LookupError(name)


def is_compiled(name: str) -> bool:
    return hasattr(reached(name)[1], "py_func")


# What is broken


class Breaker:
    """Wrong copies of values: numbers are scaled and shifted unevenly, indices moved on and truth values negated, in
    arrays, sequences and fields of objects alike.

    how: `MISSING` has numbers that are zero instead, and sequences within a result without their last; `COUNTED` leaves
    everything as it is. calls: of what is broken. error: of the breaking itself, which no test is to take for a fault.
    """

    def __init__(self, how: str = UNEVEN) -> None:
        self.how, self.calls, self.error, self._changes = how, 0, "", 0

    def around(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function with a wrong result; where it returns nothing, with wrong arrays in its arguments."""

        @functools.wraps(function)
        def wrong(*args: Any, **kwargs: Any) -> Any:
            self.calls += 1
            result = function(*args, **kwargs)
            if result is None and self.how != COUNTED:
                for array in (a for a in (*args, *kwargs.values()) if isinstance(a, np.ndarray) and a.flags.writeable):
                    array[...] = self._attempted(self.wrong, array)
                return None
            return self._attempted(self.wrong, result)

        return wrong

    def around_constructor(self, function: Callable[..., Any], field: str = "") -> Callable[..., Any]:
        """`__init__` that leaves wrong fields behind, or one wrong field."""

        @functools.wraps(function)
        def wrong(this: Any, *args: Any, **kwargs: Any) -> None:
            self.calls += 1
            function(this, *args, **kwargs)
            self._attempted(self._break_fields, this, this, 0, field)

        return wrong

    def break_constant(self, value: Any) -> None:
        """Break an object in place."""
        self.calls += 1
        if isinstance(value, dict):
            wrong = self.wrong(value)
            value.clear()
            value.update(wrong)
        else:
            self._break_fields(value, value, 0)

    def _attempted(self, do: Callable[..., Any], value: Any, *more: Any) -> Any:
        try:
            return do(value, *more)
        except Exception:
            self.error = traceback.format_exc()
            return value

    def wrong(self, value: Any, depth: int = 0) -> Any:
        """A wrong copy of a value; the value itself where there is nothing in it to be wrong."""
        if (
            self.how == COUNTED
            or depth > DEEPEST
            or value is None
            or isinstance(value, (bytes, Path, type, ModuleType))
        ):
            return value
        if isinstance(value, str):
            return DECIMAL.sub(lambda number: f"{self._number(float(number[0])):.6f}", value)
        if isinstance(value, pin.Model):
            return self._model(value)
        if isinstance(value, (bool, np.bool_)):
            return self._changed(type(value)(not value))
        if isinstance(value, (int, np.integer)) and not hasattr(value, "name"):
            return self._changed(type(value)(int(not value) if self.how == MISSING else value + 1))
        if isinstance(value, (float, np.floating)):
            return type(value)(self._number(value))
        if isinstance(value, np.ndarray):
            return self._array(value, depth)
        if isinstance(value, tuple) and hasattr(value, "_make"):
            return type(value)._make(self.wrong(each, depth + 1) for each in value)
        if isinstance(value, (list, tuple, set, frozenset)):
            rest = list(value)[:-1] if self._shortens(value, depth) else value
            return type(value)(self.wrong(each, depth + 1) for each in rest)
        if isinstance(value, (dict, MappingProxyType)):
            pairs = list(value.items())[: -1 if self._shortens(value, depth) else None]
            return type(value)({key: self.wrong(each, depth + 1) for key, each in pairs})
        if inspect.isgenerator(value):
            return (self.wrong(each, depth + 1) for each in value)
        if inspect.isroutine(value) or isinstance(value, functools.partial):
            return self.around(value)
        return self._object(value, depth)

    def _changed(self, value: Any) -> Any:
        self._changes += 1
        return value

    def _shortens(self, value: Any, depth: int) -> bool:
        """A function's own tuple is as long as its callers need it."""
        return self.how == MISSING and len(value) > 1 and (depth > 0 or not isinstance(value, tuple))

    def _number(self, value: float) -> float:
        """Never wrong by the same: what is compared with another result of the function has to differ too."""
        self._changes += 1
        if self.how == MISSING:
            return float(not value)
        return 1.37 * value + 0.21 * float(np.cos(self._changes))

    def _model(self, model: pin.Model) -> pin.Model:
        """One with other limits and other lengths."""
        wrong = model.copy()
        wrong.lowerPositionLimit = self._array(model.lowerPositionLimit, 0)
        for placement in wrong.jointPlacements:
            placement.translation = self._array(placement.translation, 0)
        return wrong

    def _array(self, value: np.ndarray, depth: int) -> np.ndarray:
        if not value.size:
            return value
        if value.dtype == object or value.dtype.names:
            wrong = value.copy()
            for place in np.ndindex(value.shape):
                wrong[place] = self.wrong(value[place], depth + 1)
            return wrong
        if value.dtype == bool:
            return self._changed(~value)
        if self.how == MISSING and np.issubdtype(value.dtype, np.number):
            return self._changed(np.zeros_like(value) if value.any() else np.ones_like(value))
        if np.issubdtype(value.dtype, np.inexact):
            uneven = 0.21 * np.cos(self._changes + np.arange(value.size)).reshape(value.shape)
            return self._changed((1.37 * value + uneven).astype(value.dtype))
        if np.issubdtype(value.dtype, np.integer):
            moved = np.roll(value, 1)
            return self._changed(value + value.dtype.type(1) if np.array_equal(moved, value) else moved)
        return value

    def _object(self, value: Any, depth: int) -> Any:
        try:
            wrong = copy.copy(value)
        except Exception:  # objects of other libraries, files, locks
            return value
        self._break_fields(wrong, value, depth)
        return wrong

    def _break_fields(self, wrong: Any, value: Any, depth: int, field: str = "") -> None:
        names = [
            *getattr(value, "__dict__", ()),
            *(s for c in type(value).__mro__ for s in getattr(c, "__slots__", ())),
        ]
        for name in names:
            if not name.startswith("__") and field in ("", name) and hasattr(value, name):
                try:
                    object.__setattr__(wrong, name, self.wrong(getattr(value, name), depth + 1))
                except (AttributeError, TypeError):
                    continue


class Fault(NamedTuple):
    """Functions that are broken together, in their result; or a constructor, in all that it leaves in an object or in
    one field; or a constant, in its value."""

    functions: tuple[FunctionType, ...] = ()
    constructor: FunctionType | None = None
    field: str = ""
    constant: Any = None

    def plant(self, breaker: Breaker) -> None:
        """Break them for the rest of this process."""
        for function in self.functions:
            _replace(function, breaker.around)
        if self.constructor is not None:
            _replace(self.constructor, functools.partial(breaker.around_constructor, field=self.field))
        if self.constant is not None:
            breaker.break_constant(self.constant)


def faults(name: str) -> list[Fault]:
    """All ways to break what a dotted name is."""
    owner, value = reached(name)
    if isinstance(value, ModuleType):
        own = [n for n, f in vars(value).items() if getattr(f, "__module__", "") == name and not n.startswith("_")]
        return [fault for n in own for fault in faults(f"{name}.{n}")]
    if isinstance(value, type):
        return faults_of_class(value)
    if isinstance(owner, type):
        attribute = name.rpartition(".")[2]
        classes = _implementers(owner) if getattr(owner, "_is_protocol", False) else [owner]
        methods = {_function(inspect.getattr_static(each, attribute, None)) for each in classes} - {None}
        return [Fault(tuple(methods)) if methods else Fault(constructor=owner.__init__, field=attribute)]
    if hasattr(value, "py_func"):
        return []  # compiled: its callers have its code, not its name
    function = _function(value)
    return [Fault(constant=value)] if function is None else [Fault((function,))]


def faults_of_class(value: type) -> list[Fault]:
    """Its public methods in turn, then what its constructor leaves."""
    members = [member for name, member in vars(value).items() if not name.startswith("_") or name == "__call__"]
    ways = [Fault((function,)) for function in map(_function, members) if function is not None]
    if issubclass(value, tuple):
        ways.append(Fault((value.__new__,)))
    elif isinstance(value.__init__, FunctionType):
        ways.append(Fault(constructor=value.__init__))
    return ways


def _function(member: Any) -> FunctionType | None:
    """The plain function behind a method, a property, a cache."""
    for inner in ("__func__", "fget", "func"):
        member = getattr(member, inner, member)
    while hasattr(member, "__wrapped__") and not hasattr(member, "py_func"):
        member = member.__wrapped__
    return member if isinstance(member, FunctionType) else None


def _implementers(protocol: type) -> list[type]:
    """The classes of ours that have all methods of a protocol."""
    methods = [n for n, f in vars(protocol).items() if isinstance(f, FunctionType) and not n.startswith("_")]
    modules = [module for name, module in list(sys.modules.items()) if name.split(".")[0] in PACKAGES]
    held = [each for module in modules for each in vars(module).values() if isinstance(each, type)]
    return [c for c in held if c is not protocol and all(hasattr(c, n) for n in methods)]


def _replace(function: FunctionType, around: Callable[[Callable[..., Any]], Callable[..., Any]]) -> None:
    """Give a function the code of another, so that everyone who holds it calls that."""
    correct = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    correct.__kwdefaults__, correct.__dict__ = function.__kwdefaults__, dict(function.__dict__)
    signature, broken = inspect.signature(function), around(correct)

    def anything(*args: Any, **kwargs: Any) -> Any:
        call: Any = "the broken function"
        return call(*args, **kwargs)

    code = anything.__code__
    constants = tuple(broken if each == "the broken function" else each for each in code.co_consts)
    function.__code__ = code.replace(co_consts=constants, co_freevars=function.__code__.co_freevars)
    function.__signature__ = signature  # type: ignore[attr-defined]


# Which tests notice


class Outcome(NamedTuple):
    """Of a test with some faults: whether it failed, and how often each of them was met."""

    noticed: bool
    calls: Sequence[int]


class Faults:
    """A plugin of pytest that runs the collected tests with faults, as `use` requests, instead of as they are."""

    def __init__(self, use: Callable[[Faults], None]) -> None:
        self._items: dict[str, list[pytest.Item]] = {}
        self._use, self._failed = use, False

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        for item in session.items:
            self._items.setdefault(item.nodeid.partition("[")[0], []).append(item)
        self._use(self)
        return True

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._failed |= report.failed

    def notices(self, test: str, name: str) -> bool:
        """Whether a test fails for one of the faults of what a dotted name is."""
        left = faults(name)
        if len(left) > 4:  # one run, in which nothing is wrong, shows which are met at all
            calls = self.outcome(test, left, COUNTED).calls
            left = [fault for fault, count in zip(left, calls, strict=True) if count]
        for how in (UNEVEN, MISSING):
            for fault in list(left):
                noticed, (calls,) = self.outcome(test, [fault], how)
                if noticed:
                    return True
                if not calls:
                    left.remove(fault)
        return False

    def outcome(self, test: str, planted: Sequence[Fault], how: str) -> Outcome:
        """Of a test with faults, in a process of its own. AssertionError if it fails without any, or they cannot be
        planted."""
        reading, writing = os.pipe()
        child = os.fork()
        if not child:
            os.close(reading)
            signal.alarm(int(DEADLINE))  # a test that never ends is killed
            try:
                text = json.dumps(self._outcome(test, planted, how))
            except BaseException:
                text = json.dumps(traceback.format_exc())
            os.write(writing, text.encode())
            os._exit(0)
        os.close(writing)
        with os.fdopen(reading) as pipe:
            text = pipe.read()
        os.waitpid(child, 0)
        result = json.loads(text) if text else (True, [1 for _ in planted])  # it did not survive the test
        assert not isinstance(result, str), result
        noticed, calls = result
        assert not noticed or (any(calls) and how != COUNTED), f"fails without a fault: {test}"
        return Outcome(noticed, calls)

    def _outcome(self, test: str, planted: Sequence[Fault], how: str) -> Outcome:
        breakers, items = [Breaker(how) for _ in planted], self._items[test]
        with tempfile.TemporaryDirectory() as folder:
            os.environ["PYTEST_DEBUG_TEMPROOT"] = folder  # fixtures that are made once are made here
            for fault, breaker in zip(planted, breakers, strict=True):
                fault.plant(breaker)
            for item, following in zip(items, [*items[1:], None], strict=True):
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if self._failed:
                    break
        errors = [breaker.error for breaker in breakers if breaker.error]
        assert not errors, errors[0]
        return Outcome(self._failed, [breaker.calls for breaker in breakers])


Pair = tuple[str, str, str]
"""The first cell of a row, one of its functions, and one of its tests."""


def noticing(rows: Sequence[Row], tried: Faults) -> Iterator[Pair]:
    """Pairs in which the test notices: one for every function of a row, and one for every test that is left."""
    notices = functools.cache(tried.notices)
    for row in rows:
        useful = set()
        for name in row.functions:
            for test in row.tests:
                if notices(test, name):
                    useful.add(test)
                    yield row.what, name, test
                    break
        for test in row.tests:
            if test not in useful and (name := next((n for n in row.functions if notices(test, n)), "")):
                yield row.what, name, test


def session(rows: Sequence[Row]) -> list[Pair]:
    """The pairs of `noticing`, by a session of pytest in this process."""
    pairs: list[Pair] = []
    plugin = Faults(lambda tried: pairs.extend(noticing(rows, tried)))
    names = sorted({test for row in rows for test in row.tests})
    options = ["-o", "addopts=", "-p", "no:cacheprovider", "-p", "no:terminal", "-p", "no:xdist"]
    code = pytest.main([*options, *names], plugins=[plugin])
    assert code == pytest.ExitCode.OK, f"{code!r}: {names}"
    return pairs


def noticed(rows: Sequence[Row], compiled: bool) -> list[Pair]:
    """The same for the functions that are compiled, or for the others, in a process of its own."""
    rows = [row._replace(functions=tuple(n for n in row.functions if is_compiled(n) == compiled)) for row in rows]
    rows = [row for row in rows if row.functions]
    if not rows:
        return []
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")} | {"PYTHONPATH": str(ROOT)}
    if compiled:
        environment["NUMBA_DISABLE_JIT"] = "1"
    done = subprocess.run(
        [sys.executable, "-m", "tests.breaking_papers"], input=json.dumps(rows), stdout=subprocess.PIPE, text=True,
        cwd=ROOT, env=environment, check=True,
    )  # fmt: skip
    return [(what, name, test) for what, name, test in json.loads(done.stdout.splitlines()[-1])]


def unnoticed(rows: Sequence[Row]) -> list[str]:
    """The functions that no test of their row notices when they are broken, and the tests that notice none of their
    row's functions."""
    pairs = noticed(rows, compiled=False) + noticed(rows, compiled=True)
    useful = {(what, each) for what, *both in pairs for each in both}
    return [
        f"{row.what}: {each}" for row in rows for each in (*row.functions, *row.tests) if (row.what, each) not in useful
    ]


def main(arguments: Sequence[str]) -> None:
    if not arguments:  # `noticed`
        rows = [Row(section, what, tuple(names), tuple(tests)) for section, what, names, tests in json.load(sys.stdin)]
        print("\n" + json.dumps(session(rows)))
        return
    page, *sections = arguments
    rows = rows_of((ROOT / "docs" / "papers" / f"{page}.md").read_text(encoding="utf-8"))
    print(*unnoticed([row for row in rows if not sections or row.section in sections]), sep="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
