"""Run files of poses that are given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import guessed_camera
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import FrameResult
from humanoid.subject.subject import Subject


def made_run(
    file: Path,
    subject: Subject,
    q: np.ndarray,
    *,
    weight: Sequence[float] = (1.0,),
    std: float = 0.05,
    times: np.ndarray | None = None,
    status: Sequence[str] | None = None,
) -> Run:
    """A finished run with hypotheses q (T, K, nq) that all have the same weight and the same deviation [rad, m]; frames
    whose q are NaN have no hypotheses."""
    count, modes = q.shape[:2]
    times = np.arange(count) / 30.0 if times is None else times
    status = ["tracked"] * count if status is None else list(status)
    camera, nv = guessed_camera("a", (640, 480)), subject.model.nv
    header = RunHeader(
        subject.urdf,
        subject.source,
        subject.base,
        (camera,),
        {"a": None},
        {"a": (640, 480)},
        times,
        "css",
        {},
        0,
        "0.1",
    )
    with RunWriter.create(file, header) as writer:
        for t in range(count):
            k = modes if np.isfinite(q[t]).all() else 0
            parent = np.arange(k) if t and np.isfinite(q[t - 1]).all() else np.full(k, -1)
            covariance, none = np.tile(std**2 * np.eye(nv), (k, 1, 1)), np.zeros(k)
            result = FrameResult(
                t, float(times[t]), status[t], q[t, :k], np.array(weight)[:k], none, covariance, parent, none, none,
                ("as_detected",) * k,
            )  # fmt: skip
            writer.append(result, {"q": q[t, :k]})
        writer.finish()
    return Run.open(file)
