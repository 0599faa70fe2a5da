"""The code of every search is compiled once, by two processes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from builders import body_of

from kinemode import compilation
from kinemode.compilation import compile_with

ROOT = Path(__file__).parent.parent
SCRIPT = """
import gc
from numba.core import types
from numba.core.dispatcher import Dispatcher
from kinemode.compilation import track_stand
from kinemode.compilation import compile_energy, compile_smoothing, compile_steps_and_jumps

def plain(kind):
    return kind.copy(readonly=False, layout="C") if isinstance(kind, types.Array) else kind

compile_energy(), compile_steps_and_jumps(), compile_smoothing()
track_stand()
kernels = [each for each in gc.get_objects() if isinstance(each, Dispatcher) and each.signatures]
own = [each for each in kernels if each.py_func.__module__.startswith(("estimator", "humanoid"))]
for each in own:
    if len({tuple(map(plain, signature)) for signature in each.signatures}) < len(each.signatures):
        print("twice:", each.py_func.__module__, each.py_func.__name__)
print(len(own), "kernels")
"""


def test_nothing_is_compiled_twice() -> None:
    """The second process does not compile for array types other than the search's, nor for read-only arrays beside
    writable ones."""
    command, environment = [sys.executable, "-c", SCRIPT], os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "twice" not in done.stdout
    assert int(done.stdout.split()[0]) > 20  # for kernels compiled before only entry points are loaded


@pytest.mark.parametrize("python", [sys.executable, "/no/python/here", ""])
def test_a_search_is_compiled_whatever_becomes_of_the_other_process(
    python: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = list[tuple[str, int, int]]()

    @contextmanager
    def progress(stage: str) -> Iterator[object]:
        yield lambda done, of: loaded.append((stage, done, of))

    monkeypatch.setattr(compilation, "is_search_compiled", lambda _: False)
    monkeypatch.setattr(sys, "executable", python)
    compile_with(progress, body_of("human34"))  # type: ignore[arg-type]
    assert [each[1:] for each in loaded] == [(0, 2), (1, 2), (2, 2)]
