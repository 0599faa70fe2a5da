"""The code of every search, compiled once after an installation: by two processes, as it takes longer than many
clips."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.cost import Cost
from estimator.energy.descent.compiled_seek import compile_search, is_search_compiled
from estimator.energy.descent.qp import StepSolver
from estimator.numerics.processes import processors
from estimator.search.cost_model import CostModel
from estimator.search.jumps import KinematicJumps
from estimator.synthesis.views import ViewSettings, framing_cameras
from estimator.tracking.smoothing import SmoothSettings, smooth
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.compiled_cache import cache_roots, sources_digest
from kinemode.progress import Reporter

_SUBJECT = "human34"
_FAR = 1e3  # of a gradient whose step no joint limit lets pass
_FRAMES, _RATE = 6, 30.0


def compile_with(progress: Reporter, body: Body) -> None:
    """Compile the search of a body where that was never done on this machine, with a notice.

    What is compiled in the other process is read from the cache that both share. Whatever keeps that from its work, all
    is compiled nevertheless.
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
    q = body.neutral
    SelfCollision(body).penetration(body.at(q))
    active = np.zeros(body.nv, dtype=np.int8)
    StepSolver(body).solve(np.eye(body.nv), np.full(body.nv, _FAR), 0.0, np.ones(body.nv), q, active)
    for _ in KinematicJumps(body).of(q, _camera_before(body)):
        pass


def _camera_before(body: Body) -> Camera:
    """One that sees all of a body at rest."""
    (camera,) = framing_cameras(body.landmarks(body.at(body.neutral))[None], ViewSettings(count=1))
    return camera


@contextmanager
def _in_another_process(function: str) -> Iterator[None]:
    """Have a function of this module called meanwhile, and wait for that; nothing where it could keep nothing, or where
    there is no second processor."""
    if next(cache_roots(), None) is None or processors() < 2 or not sys.executable:
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


def are_made() -> bool:
    """Whether these sources were compiled on this machine before."""
    mark = _mark()
    return mark is not None and mark.exists()


def _mark() -> Path | None:
    root = next(cache_roots(), None)
    return None if root is None else root / f"kernels-{sources_digest(Path(__file__), __name__)}"


def made_kernels() -> None:
    """Track a standing person from keypoints: fit, frames and smoothing leave what they have compiled in the cache,
    from where other processes on this machine take it. Nothing is done where these sources were compiled before."""
    mark = _mark()
    if mark is None or mark.exists():
        return
    track_stand()
    with suppress(OSError):
        mark.touch()


def track_stand() -> None:
    """Track a standing person for a few frames."""
    import kinemode as km  # which imports this module

    body = Body(load_subject(_SUBJECT))
    camera = _camera_before(body)
    pixels = np.tile(camera.project(body.landmarks(body.at(body.neutral))), (_FRAMES, 1, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        km.track(
            body.subject, (), cameras={camera.name: camera}, keypoints=pixels, layout=body.landmark_names, fps=_RATE
        )
