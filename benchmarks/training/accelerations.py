"""Accelerations in captured motion: how large they are, how long they last, and that they come in bursts.

The settings of the smoothing (`SmoothSettings`) are rounded from these. Everything is tried on people it was not
learned from: the log density of the accelerations of one by what all others have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln

from benchmarks.support.common import Data, Json, save
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, subject_of
from estimator.inference.motion import MotionPrior
from estimator.runs.filtering import extension, low_pass
from estimator.search.cost_model import CostModel
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from estimator.tracking.smoothing.pace import limbs_of
from estimator.tracking.smoothing.settings import SmoothSettings
from humanoid.kinematics.body import ROOT_PLACE_V, Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

FPS, FINE = 30.0, 2  # velocities are those between frames of a camera, from so many samples each
CUTOFF = 10.0  # Hz: faster is the noise of the capture
MEMORIES = (0.0, 0.05, 0.08, 0.12, 0.15)  # s
SPANS = (0.05, 0.1, 0.25)  # s
_FEWEST = 1.0  # s of a clip
_ROUNDS = 12  # of expectation maximisation


class Capture(NamedTuple):
    """person: number. v (T, nv): velocities between successive frames [per second]."""

    person: str
    v: np.ndarray


@dataclass(frozen=True)
class Model:
    """memory [s]: see `MotionPrior`. span [s]: see `SmoothSettings.pace_span`; 0 for an even pace."""

    memory: float
    span: float


def main(*, data: Data = None, seconds: float = 6.0, json: Json = None) -> None:
    """Measure the accelerations of captured motion, and how well people's are foretold by the others'.

    Parameters
    ----------
    seconds
        At most so much of each clip.
    """
    files = captured_files(data)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    body, settings = Body(load_subject("human34")), SmoothSettings()
    captures = [c for c in (captured(body, f, seconds) for f in files) if len(c.v) >= _FEWEST * FPS]
    people = tuple(dict.fromkeys(c.person for c in captures))
    models = [Model(memory, 0.0) for memory in MEMORIES] + [Model(settings.memory, span) for span in SPANS]
    densities = {
        f"memory {m.memory:g} s, pace within {m.span:g} s": foretold(body, captures, people, m) for m in models
    }
    shown = report.table("log density of an acceleration of people left out [nats]", "model", "mean")
    for name, value in densities.items():
        shown.add_row(name, f"{value:.3f}")
    report.console().print(shown)
    shipped = Model(settings.memory, settings.pace_span)
    every = learned(body, captures, shipped)
    without = np.array([learned(body, [c for c in captures if c.person != who], shipped) for who in people])
    ours = settings.motion(CostModel(body)).acceleration_std
    rows = report.table("standard deviations at pace 1", "degree of freedom", "shipped", "learned", "one left out")
    for d, name in enumerate(body.v_names):
        low, high = without[:, d].min(), without[:, d].max()
        rows.add_row(name, f"{ours[d]:.1f}", f"{every[d]:.1f}", f"{low:.1f} to {high:.1f}")
    report.console().print(rows)
    stds = dict(zip(body.v_names, every.tolist(), strict=True))
    save(json, {"measure": "accelerations", "log_density": densities, "std": stds})


def captured(body: Body, path: Path, seconds: float) -> Capture:
    """A captured motion on the body."""
    mocap, rate = load_mocap(path), FINE * FPS
    q = retarget(body, mocap, np.arange(0.0, min(mocap.seconds, seconds), 1.0 / rate)).q
    v = np.array([body.velocity(a, b, 1.0 / rate) for a, b in pairwise(q)])
    extended = extension(CUTOFF, rate)
    v = low_pass(np.pad(v, ((extended, extended), (0, 0)), mode="edge"), CUTOFF, rate, extended)
    count = len(v) // FINE
    return Capture(subject_of(path.stem), v[: count * FINE].reshape(count, FINE, -1).mean(axis=1))


def news_of(body: Body, capture: Capture, model: Model) -> np.ndarray:
    """The innovations of the accelerations (T, nv)."""
    prior = MotionPrior(np.ones(body.nv), np.ones(body.nv), memory=model.memory)
    return prior.news(capture.v, np.full(len(capture.v), 1.0 / FPS))


def learned(body: Body, captures: Sequence[Capture], model: Model) -> np.ndarray:
    """Standard deviations (nv,) of the Lorentzian at pace 1, everybody counting alike."""
    news = [news_of(body, c, model) for c in captures]
    people = [c.person for c in captures]
    clips = np.array([1.0 / people.count(who) / len(n) for who, n in zip(people, news, strict=True)])
    weight = np.concatenate([np.full(len(n), w) for n, w in zip(news, clips, strict=True)])
    weight /= weight.sum()
    square, nu = np.square(np.concatenate(news)), SmoothSettings().nu
    variance = np.median(square, axis=0)
    for _ in range(_ROUNDS):
        pace = np.concatenate([paces(body, n / np.sqrt(variance), model.span) for n in news])
        even = square / np.square(pace)
        variance = weight @ (even / (1.0 + even / variance / nu))
    return np.asarray(np.sqrt(variance))


def paces(body: Body, news: np.ndarray, span: float) -> np.ndarray:
    """Pace (T, nv) of each frame from its neighbours, by innovations (T, nv) in terms of their deviation."""
    pace = np.ones_like(news)
    if span == 0.0:
        return pace
    settings, limbs, frame = SmoothSettings(), limbs_of(body), np.arange(len(news)) / FPS
    near = np.exp(-0.5 * np.square((frame[:, None] - frame) / span))
    np.fill_diagonal(near, 0.0)  # a frame does not foretell itself
    for _ in range(3):
        square = np.square(news) / (1.0 + np.square(news / pace) / settings.nu)
        for limb in np.unique(limbs):
            own = limbs == limb
            count = settings.pace_count
            variance = (count + near @ square[:, own].sum(axis=1)) / (count + near.sum(axis=1) * own.sum())
            pace[:, own] = np.sqrt(variance)[:, None]
    return pace


def foretold(body: Body, captures: Sequence[Capture], people: Sequence[str], model: Model) -> float:
    """Mean log density of an acceleration, given those before it and the pace of its neighbours, of people left out;
    everybody counts alike. The root's place is not used, as skeletons jump there."""
    asked = np.ones(body.nv, bool)
    asked[ROOT_PLACE_V] = False
    left = MotionPrior(np.ones(1), np.ones(1), memory=model.memory).left(1.0 / FPS)
    nu, by_person = SmoothSettings().nu, []
    # the Lorentzian is Student's density with nu - 1 degrees of freedom
    constant = gammaln(nu / 2.0) - gammaln((nu - 1.0) / 2.0) - 0.5 * np.log(nu * np.pi)
    for who in people:
        std = learned(body, [c for c in captures if c.person != who], model)
        clips = []
        for capture in captures:
            if capture.person == who:
                news = news_of(body, capture, model)[1:] / std
                pace = paces(body, news, model.span)
                log = constant - 0.5 * nu * np.log1p(np.square(news / pace) / nu) - np.log(pace * std)
                clips.append(log[:, asked].mean() - 0.5 * np.log(1.0 - left * left))
        by_person.append(np.mean(clips))
    return float(np.mean(by_person))
