"""A motion on a body as a run file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from estimator.data.observation import Observation
from estimator.retargeting.contacts import SourceContacts
from estimator.retargeting.doubts import Doubts
from estimator.retargeting.motion import RetargetedMotion
from estimator.retargeting.source import SourceMotion
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import HARD, TRACKED, FrameResult
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

SOURCE_POINTS, SOURCE_NAMES = "source_points", "source_names"
"""Extra arrays of a frame: the source's landmarks (L, 3) [m] in the body's scale on the same floor, and their names."""
STANDING, STANDING_NAMES = "standing", "standing_names"
"""The same: which points of the source's soles stand (P,) bool, and their names."""


def write_motion_run(
    path: Path,
    header: RunHeader,
    body: Body,
    motion: RetargetedMotion,
    source: SourceMotion,
    *,
    doubts: Doubts,
    overwrite: bool,
) -> None:
    """Write a complete run of a motion, with the source beside it; frames that something speaks against are "hard".

    Raises InputError where the file exists and is not to be replaced, or cannot be written.
    """
    nowhere = np.zeros((0, len(body.landmark_names), 2)), np.zeros((0, len(body.landmark_names)))
    with RunWriter.create(path, header, overwrite) as writer:
        writer.put_observations([Observation(i, float(t), (), *nowhere) for i, t in enumerate(motion.times)])
        hard = ~motion.keeps | doubts.frames
        for result in _frames(body, motion, source, hard):
            writer.append(result, {})
        writer.put_findings(doubts.findings, [int(t) for t in np.flatnonzero(hard)])
        writer.finish()


def _frames(body: Body, motion: RetargetedMotion, source: SourceMotion, hard: np.ndarray) -> Iterator[FrameResult]:
    """The motion and what was carried through beside it; they were made, so that none has a covariance."""
    floor = np.array([0.0, 0.0, motion.contacts.floor or 0.0])
    points, names = motion.targets.scale * (source.points - floor), np.array(source.names)
    velocity = np.zeros((len(motion.q), body.nv))
    for t in range(1, len(motion.q)):
        velocity[t] = body.velocity(motion.q[t - 1], motion.q[t], float(motion.times[t] - motion.times[t - 1]))
    for t in range(len(motion.q)):
        q, weight, energy, overlap = _hypotheses(motion, t)
        count = len(q)
        yield FrameResult(
            t, float(motion.times[t]), HARD if hard[t] else TRACKED, q, weight, energy,
            np.zeros((count, body.nv, body.nv)), np.full(count, 0 if t else -1), np.zeros(count), overlap,
            ("",) * count, np.repeat(velocity[t : t + 1], count, axis=0),
            extra={
                SOURCE_POINTS: points[t], SOURCE_NAMES: names,
                STANDING: motion.contacts.standing[t], STANDING_NAMES: np.array(motion.contacts.names, dtype="U20"),
            },
        )  # fmt: skip


def _hypotheses(motion: RetargetedMotion, t: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The hypotheses of a frame: q (K, nq), weight, energy and overlap (K,); the motion itself first."""
    q, energy, overlap = motion.q[t : t + 1], motion.energy[t : t + 1], motion.overlap[t : t + 1]
    if motion.others is None:
        return q, np.ones(1), energy, overlap
    there = np.isfinite(motion.others.q[t]).all(axis=1)
    weight = motion.others.weight[t][np.r_[True, there]]
    q = np.concatenate([q, motion.others.q[t][there]])
    energy = np.concatenate([energy, motion.others.energy[t][there]])
    return q, weight / weight.sum(), energy, np.repeat(overlap, len(q))


def source_of(run: Run) -> tuple[SourceMotion, SourceContacts]:
    """The motion that a run was made from, in the body's scale with the floor at z = 0, and its contacts, as
    `write_motion_run` kept them.

    Raises InputError for a run without them.
    """
    extra = [result.extra for result in run.streamed()]
    if not extra or any(key not in e for e in extra for key in (SOURCE_POINTS, SOURCE_NAMES, STANDING, STANDING_NAMES)):
        raise InputError(run.file, "has no motion that it was made from")
    names, feet = (tuple(str(name) for name in extra[0][key]) for key in (SOURCE_NAMES, STANDING_NAMES))
    source = SourceMotion(names, np.array([e[SOURCE_POINTS] for e in extra]), run.time, run.file.name)
    standing = np.array([e[STANDING] for e in extra])
    floor = run.header.floor if isinstance(run.header.floor, float) else None
    return source, SourceContacts(feet, feet, standing, floor, np.zeros(len(feet)))
