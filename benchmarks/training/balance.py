"""Where the centre of mass of people is over their feet: the numbers of `cost.terms.balance`.

People are captured on human34 (CMU) or tracked by a laboratory's markers (OpenCap's and two others), and seen by a
virtual camera, whose noisy keypoints show which feet stand, as in tracking. The spread about the middle of what stands
is fitted by likelihood, with equal weights of people, and tested on people left out. Beside that: distances from
the convex hull of the feet, also of the extrapolated centre of mass (Hof et al., J. Biomech. 38, 2005), and how far the
modelled centre of mass is from the centre of pressure that force plates measure.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import Delaunay, QhullError
from scipy.special import expit

import kinemode as km
from benchmarks.accuracy.trunk_view_clips import FPS, level_phone
from benchmarks.support.common import Data, Json, data_folder, in_processes, save
from benchmarks.support.measured_people import measured_files, measured_run
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, subject_of
from estimator.data.formats.opensim import read_mot
from estimator.data.observation import Observation
from estimator.data.standing import with_standing
from estimator.dynamics.contact_forces import GRAVITY
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import Body, points_of_each
from humanoid.shape.segment_masses import mass_points
from humanoid.subject.landmarks import foot_landmarks
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

PLATES = ("squats1", "static1")
"""Trials in which all the weight is on plates and people hardly accelerate."""
_NOISE_PX, _FIRST = 1.5, 3
_ENOUGH, _WHOLE = 20, 200  # instants: fewer are not used for a person, more count as so many
_SITS = 0.5
_STARTS = ((np.log(0.02), np.log(0.5), np.log(8.0), -3.0), (np.log(0.04), 0.0, np.log(3.0), -2.0))


class Instants(NamedTuple):
    """Instants in which something stands. person: who. feet (N,): how many stand. offset (N, 2) [m]: of the centre of
    mass from the middle of the support. scatter (N, 3) [m2]: xx, xy, yy of its points. outside, extrapolated (N,) [m]:
    of the centre of mass and the extrapolated one from their hull. seated (N,): see `Observation`."""

    person: str
    feet: np.ndarray
    offset: np.ndarray
    scatter: np.ndarray
    outside: np.ndarray
    extrapolated: np.ndarray
    seated: np.ndarray

    def at(self, some: np.ndarray) -> Instants:
        """Some of them."""
        return Instants(self.person, *(part[some] for part in self[1:]))


def main(*, data: Data = None, jobs: int = 1, json: Json = None) -> None:
    """Fit the spread of the centre of mass about the feet, and print it with people left out.

    Parameters
    ----------
    jobs
        Clips at a time, each in a process of its own.
    """
    folder = data_folder(data)
    files = captured_files(data)
    if folder is None or not files:
        print(NO_CAPTURED_FILES)
        return
    trials = measured_files(folder)
    clips = in_processes(instants_of, [*files, *trials], jobs)
    people = {who: _joined(who, [c for c in clips if c.person == who]) for who in sorted({c.person for c in clips})}
    figures: dict[str, Any] = {}
    made = report.table("spread of the centre of mass", "feet", "width [m]", "spread", "tail", "held", "left out")
    hulls = report.table("outside the hull [m]: median, 90, 95, 99 %", "feet", "centre of mass", "extrapolated")
    for feet in (2, 1):
        own = {who: p.at((p.feet == feet) & (p.seated < _SITS)) for who, p in people.items()}
        own = {who: p for who, p in own.items() if len(p.feet) >= _ENOUGH}
        fit = fitted(own)
        left_out = np.mean([log_density(fitted({k: v for k, v in own.items() if k != w}), own[w]).mean() for w in own])
        made.add_row(f"{feet}", *(f"{x:.3g}" for x in natural(fit)), f"{left_out:.2f}")
        every = _joined("all", list(own.values()))
        rows = [np.quantile(x, (0.5, 0.9, 0.95, 0.99)) for x in (every.outside, every.extrapolated)]
        hulls.add_row(f"{feet}", *(", ".join(f"{x:.3f}" for x in row) for row in rows))
        figures[f"{feet} feet"] = {"fit": natural(fit), "log density of people left out": left_out, "outside": rows}
        if feet == 2:
            sitting = {who: p.at((p.feet == 2) & (p.seated >= _SITS)) for who, p in people.items()}
            figures["held, seated"] = held_share(fit, {w: p for w, p in sitting.items() if len(p.feet) >= _ENOUGH})
    report.console().print(made)
    report.console().print(hulls)
    seated = ", ".join(f"{who} {share:.2f}" for who, share in figures["held, seated"].items())
    report.print_lines([f"held, with low hips that rest, by person: {seated}"])
    for path in trials:
        if path.stem in PLATES:
            off = off_plates(path)
            figures[f"plates, {path.stem}"] = off
            report.print_lines(
                [f"{path.stem}: from the centre of pressure {1e3 * off[0]:.0f} +- {1e3 * off[1]:.0f} mm"]
            )
    save(json, {"measure": "balance", **figures})


def instants_of(path: Path) -> Instants:
    """Instants of a captured clip, or of a laboratory's trial by its markers."""
    if path.suffix == ".bvh":
        body, mocap = Body(load_subject("human34")), load_mocap(path)
        time = np.arange(0.0, mocap.seconds - 1.0 / FPS, 1.0 / FPS)
        return _instants(subject_of(path.stem), body, retarget(body, mocap, time).q, time)
    run, rows = measured_run(path, FPS)
    return _instants(path.parent.name, run.body, run.q[rows], run.time[rows])


def centres_of_mass(body: Body, q: np.ndarray) -> np.ndarray:
    """(T, 3) [m] at configurations q (T, nq)."""
    masses = mass_points(body)
    assert masses is not None
    points = points_of_each(body.placed(q), masses.joint, masses.local)
    return np.asarray(np.einsum("m,tmi->ti", masses.share, points))


def _instants(person: str, body: Body, q: np.ndarray, time: np.ndarray) -> Instants:
    rng, names = np.random.default_rng(len(q)), body.landmark_names
    landmarks, centre = body.landmarks_of(body.placed(q)), centres_of_mass(body, q)
    velocity = np.gradient(centre, time, axis=0)
    path = centre[:, :2]
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    camera = level_phone(path.mean(axis=0), 4.0 + 0.5 * float(np.ptp(path, axis=0).max()), azimuth)
    pixels = np.array([camera.project(points) for points in landmarks])
    pixels += _NOISE_PX * rng.normal(size=pixels.shape)
    ones = np.ones((1, len(names)))
    seen = [Observation(t, float(time[t]), (camera,), p[None], ones, (_NOISE_PX,)) for t, p in enumerate(pixels)]
    seen = with_standing(seen, names)
    feet = [names.index(name) for name in foot_landmarks(names)]
    rows: list[tuple[float, ...]] = []
    for t in range(_FIRST, len(q)):
        standing = seen[t].standing
        assert standing is not None
        stands = [k for k in feet if standing[k] >= 0.5]
        if not stands:
            continue
        support, height = landmarks[t, stands, :2], centre[t, 2] - landmarks[t, stands, 2].mean()
        pace = velocity[t, :2] * np.sqrt(max(height, 0.3) / GRAVITY)
        S = np.cov(support.T, bias=True) if len(stands) > 1 else np.zeros((2, 2))
        count = len({names[k].partition("_")[0] for k in stands})
        away = [_outside(support, point) for point in (centre[t, :2], centre[t, :2] + pace)]
        rows.append((count, *(centre[t, :2] - support.mean(axis=0)), S[0, 0], S[0, 1], S[1, 1], *away, seen[t].seated))
    a = np.array(rows).reshape(-1, 9)
    return Instants(person, a[:, 0], a[:, 1:3], a[:, 3:6], a[:, 6], a[:, 7], a[:, 8])


def _outside(points: np.ndarray, place: np.ndarray) -> float:
    """Distance (m) of a place (2,) from the convex hull of points (P, 2)."""
    try:
        if len(points) > 2 and Delaunay(points).find_simplex(place) >= 0:
            return 0.0
    except QhullError:  # points in a line
        pass
    least = np.inf
    for a in points:
        for b in points:
            length = float((b - a) @ (b - a))
            t = np.clip((place - a) @ (b - a) / length, 0.0, 1.0) if length > 0.0 else 0.0
            least = min(least, float(np.linalg.norm(a + t * (b - a) - place)))
    return least


def _joined(person: str, several: list[Instants]) -> Instants:
    return Instants(person, *(np.concatenate(parts) for parts in zip(*(s[1:] for s in several), strict=True)))


def natural(x: np.ndarray) -> list[float]:
    """width [m], spread, tail and held of the numbers that are fitted."""
    return [*np.exp(x[:3]).tolist(), float(expit(x[3]))]


def log_density(x: np.ndarray, seen: Instants) -> np.ndarray:
    """Log density of each offset [1/m2], by the mixture of `estimator.energy.balance.Balance`."""
    width, spread, tail, held = natural(x)
    a, b, c = width**2 * np.array([[1.0], [0.0], [1.0]]) + spread**2 * seen.scatter.T
    det = a * c - b * b
    dx, dy = seen.offset.T
    square = (dx * dx * c - 2.0 * dx * dy * b + dy * dy * a) / det
    density = 0.5 * (1.0 - held) * np.exp(-0.5 * square) + held / tail * (1.0 + square / tail) ** -2.0
    return np.asarray(np.log(density / (np.pi * np.sqrt(det))))


def fitted(people: Mapping[str, Instants]) -> np.ndarray:
    """The numbers (4,) of greatest likelihood, see `natural`; with equal weights of people."""

    def loss(x: np.ndarray) -> float:
        return -sum(min(1.0, len(p.feet) / _WHOLE) * float(log_density(x, p).mean()) for p in people.values())

    options = {"maxiter": 2000, "xatol": 1e-3, "fatol": 1e-4}
    ends = [minimize(loss, start, method="Nelder-Mead", options=options) for start in _STARTS]
    return np.asarray(min(ends, key=lambda end: float(end.fun)).x)


def held_share(x: np.ndarray, people: Mapping[str, Instants]) -> dict[str, float]:
    """Share of each person's instants in which something else holds the body, the other numbers being known."""
    grid = np.linspace(-6.0, 6.0, 121)
    return {
        who: float(expit(max(grid, key=lambda h: float(log_density(np.array([*x[:3], h]), p).mean()))))
        for who, p in people.items()
    }


def off_plates(path: Path) -> tuple[float, float]:
    """Horizontal distance [m] of the mean centre of mass of a trial from the centre of pressure, and its standard
    deviation."""
    run = km.track("human34", points=path)
    measured, times = read_mot(path.with_name(f"{path.stem}_grf.mot"))
    column = dict(zip(measured.names, measured.values.T, strict=True))
    plates = [name[:-2] for name in measured.names if name.endswith("_vy")]  # as ground_force_1_
    force = np.array([column[f"{p}vy"] for p in plates])
    places = np.array([[column[f"{p}p{axis}"] for p in plates] for axis in "xz"])
    pressure = (force * places).sum(axis=1) / np.maximum(force.sum(axis=0), 1.0)
    there = np.stack([np.interp(run.time, times, x) for x in (pressure[0], -pressure[1])], axis=1)
    off = (centres_of_mass(run.body, run.q)[:, :2] - there)[np.isfinite(run.q).all(axis=1)]
    return float(np.linalg.norm(off.mean(axis=0))), float(np.linalg.norm(off.std(axis=0)))
