"""The code of every search, compiled once after an installation: by two processes, as it takes longer than many
clips."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

from estimator.energy.cost import Cost
from estimator.energy.descent.compiled_seek import compile_search, is_search_compiled
from estimator.energy.descent.qp import StepSolver
from estimator.search.cost_model import CostModel
from estimator.search.jumps import KinematicJumps
from estimator.synthesis.views import ViewSettings, framing_cameras
from estimator.tracking.smoothing import SmoothSettings, smooth
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.compiled_folder import cache_roots
from kinemode.terminal.progress import Reporter

_SUBJECT = "human34"
_FAR = 1e3  # of a gradient whose step no joint limit lets pass


def compile_with(progress: Reporter, body: Body) -> None:
    """Compile the search of a body where that was never done on this machine, and say so.

    What is compiled in the other process is read from the cache that both share. Whatever keeps that from its work, all
    is compiled all the same.
    """
    if is_search_compiled(body):
        return
    with progress("compiling, once after an installation") as report:
        report(0, 2)
        with _in_another_process(compile_energy.__name__):
            compile_steps_and_jumps()
        report(1, 2)
        with _in_another_process(compile_smoothing.__name__):
            compile_search(body)
        report(2, 2)


def compile_energy() -> None:
    """Compile all terms of the energy."""
    body = Body(load_subject(_SUBJECT))
    Cost(body, []).at(body.neutral)


def compile_smoothing() -> None:
    """Compile the smoothing of a clip, which needs the energy, and the values of the terms that every frame has."""
    body = Body(load_subject(_SUBJECT))
    model, times = CostModel(body), np.arange(3) / 30.0
    cost, q = model.cost(None), np.tile(body.neutral, (len(times), 1))
    smooth(body, [cost] * len(times), times, q, SmoothSettings().motion(model))
    cost.values_at(q)


def compile_steps_and_jumps() -> None:
    """Compile what measures contacts, solves steps and turns limbs: the energy and the search need the first two."""
    body = Body(load_subject(_SUBJECT))
    q, posed = body.neutral, body.at(body.neutral)
    (camera,) = framing_cameras(body.landmarks(posed)[None], ViewSettings(count=1))
    SelfCollision(body).penetration(posed)
    active = np.zeros(body.nv, dtype=np.int8)
    StepSolver(body).solve(np.eye(body.nv), np.full(body.nv, _FAR), 0.0, np.ones(body.nv), q, active)
    for _ in KinematicJumps(body).of(q, camera):
        pass


@contextmanager
def _in_another_process(function: str) -> Iterator[None]:
    """Have a function of this module called meanwhile, and wait for that; nothing where it could keep nothing, or where
    there is no second processor."""
    if next(cache_roots(), None) is None or (os.cpu_count() or 1) < 2 or not sys.executable:
        yield
        return
    command = [sys.executable, "-c", f"from {__name__} import {function}; {function}()"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    other: subprocess.Popen[bytes] | None = None
    with suppress(OSError):
        other = subprocess.Popen(
            command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
    try:
        yield
        if other is not None:
            other.wait()
    finally:
        if other is not None and other.poll() is None:
            other.kill()
