"""Faults of files of points in space that a person is tracked by."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import kinemode as km
from benchmarks.robustness.fault_verdicts import Result, Trial
from benchmarks.robustness.floor_scenes import FPS
from benchmarks.robustness.place_faults import (
    Fault,
    Places,
    elsewhere_at_first,
    frozen,
    gap_filled,
    labels_jump,
    legs_missing,
    pictures_twice,
    point_stuck,
    sides_exchanged,
    turned_over,
    with_fault,
    zeros,
)
from humanoid.kinematics.body import Body

NOISE = 0.003  # m
AWAY = np.array([0.3, 0.2, 0.1])  # m: from the origin, where missing points are


def millimetres(rng: np.random.Generator, places: Places) -> None:
    places.at[...] *= 1e3


FAULTS: tuple[Fault, ...] = (
    gap_filled,
    zeros,
    elsewhere_at_first,
    labels_jump,
    pictures_twice,
    frozen,
    legs_missing,
    sides_exchanged,
    millimetres,
    point_stuck,
    turned_over,
)


def noisy_points(body: Body, q: np.ndarray, rng: np.random.Generator) -> Places:
    """The landmarks of q (T, nq) with noise."""
    points = body.landmarks_of(body.placed(q)) + AWAY
    return Places(points + NOISE * rng.normal(size=points.shape), tuple(body.landmark_names))


def trial(body: Body, q: np.ndarray, fault: Fault, rng: np.random.Generator) -> Trial:
    """One fault of the points of q (T, nq)."""
    places = noisy_points(body, q, rng)
    wrong, up = with_fault(places, fault, rng), None if fault is turned_over else "z"
    return Trial(
        "points",
        lambda folder: _tracked(body, q, places, "z", folder),
        lambda folder: _tracked(body, q, wrong, up, folder),
    )


def _tracked(body: Body, q: np.ndarray, places: Places, up: str | None, folder: Path) -> Result:
    """Options as a user would give them, with the up axis unless that is the fault."""
    path = folder / "points.npz"
    np.savez(path, points=places.at, names=np.array(places.names), fps=FPS, unit="m")
    return Result.of_joints(km.track(body.subject.source, points=path, up=up, fit="off"), q)
