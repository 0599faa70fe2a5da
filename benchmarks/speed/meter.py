"""Time spent inside the libraries, by wrapping their called functions.

`Meter.installed()` replaces the entry points of Pinocchio, coal and proxsuite and the compiled kernels by ones that
add up their time. A wrapper costs time too: a part of it lands in what it measures, the rest in the caller; both are
measured on an empty function and taken away.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any

import coal
import pinocchio as pin
from numba.core.dispatcher import Dispatcher
from proxsuite import proxqp

_PINOCCHIO = ("computeJointJacobians", "integrate", "difference", "dDifference", "dIntegrate", "forwardKinematics")
KINDS = ("pinocchio", "coal", "proxsuite", "compiled kernels")


class Meter:
    """Seconds and calls by kind, and calls by name."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.calls: Counter[str] = Counter()
        self.names: Counter[str] = Counter()
        self.by_name: defaultdict[str, float] = defaultdict(float)
        self.inside, self.around = self._own_cost()

    def timed(self, kind: str, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, with its time added to `kind` and `name`."""
        seconds, calls, names, by_name = self.seconds, self.calls, self.names, self.by_name

        def measured(*args: Any, **kwargs: Any) -> Any:
            start = perf_counter()
            result = call(*args, **kwargs)
            passed = perf_counter() - start
            seconds[kind] += passed
            by_name[name] += passed
            calls[kind] += 1
            names[name] += 1
            return result

        return measured

    def clear(self) -> None:
        """Forget everything measured so far."""
        for counter in (self.seconds, self.calls, self.names, self.by_name):
            counter.clear()

    def corrected(self, wall: float) -> tuple[dict[str, float], float]:
        """Seconds of each kind, and of all together, without what measuring cost."""
        kinds = {k: max(0.0, self.seconds[k] - self.inside * self.calls[k]) for k in KINDS}
        return kinds, wall - self.around * sum(self.calls.values())

    def _own_cost(self, count: int = 100_000) -> tuple[float, float]:
        """Seconds that a wrapper adds to what it measures, and to everything, per call."""
        probe = self.timed("probe", "probe", _nothing)
        start = perf_counter()
        for _ in range(count):
            probe(None)
        wrapped = perf_counter() - start
        start = perf_counter()
        for _ in range(count):
            _nothing(None)
        bare = perf_counter() - start
        inside = (self.seconds["probe"] - bare) / count
        self.clear()
        return max(0.0, inside), (wrapped - bare) / count

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Everything made and called inside is measured; compiled functions have to be warm."""
        undo: list[tuple[Any, str, Any]] = []

        def replace(owner: Any, name: str, new: Any) -> None:
            undo.append((owner, name, getattr(owner, name)))
            setattr(owner, name, new)

        for name in _PINOCCHIO:
            replace(pin, name, self.timed("pinocchio", name, getattr(pin, name)))
        query = coal.ComputeDistance
        replace(coal, "ComputeDistance", lambda a, b: self.timed("coal", "ComputeDistance", query(a, b)))
        qp = proxqp.dense.QP
        replace(proxqp.dense, "QP", lambda *sizes: _Solver(self, qp(*sizes)))
        for module in [m for n, m in sys.modules.items() if n.split(".")[0] in ("humanoid", "estimator")]:
            for name, value in list(vars(module).items()):
                if isinstance(value, Dispatcher):
                    kernel = f"{value.py_func.__module__.rsplit('.', 1)[-1]}.{value.py_func.__name__}"
                    replace(module, name, self.timed("compiled kernels", kernel, value))
        try:
            yield
        finally:
            for owner, name, old in reversed(undo):
                setattr(owner, name, old)


def _nothing(argument: object) -> None:
    return None


class _Solver:
    """A ProxQP object whose calls are measured."""

    def __init__(self, meter: Meter, solver: Any) -> None:
        self._solver = solver
        for name in ("init", "update", "solve"):
            setattr(self, name, meter.timed("proxsuite", name, getattr(solver, name)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solver, name)
