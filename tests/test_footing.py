"""How well a trajectory keeps to its floor, for trajectories with known faults."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builders import body_of

from estimator.inference.contacts import FootPoints
from estimator.inference.ground import Ground
from estimator.retargeting.metrics import Footing, footing_of
from estimator.runs.contact import Contact
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import ROOT_PLACE_Q

UP = np.array([0.0, 0.0, 1.0])
BODY = body_of("human34")
COUNT = 20


def stood(fps: float, moves: np.ndarray) -> tuple[Any, Contact]:
    """A run of a person standing on the floor, displaced by moves (T, 3) [m], and the contact of all points."""
    feet = FootPoints.of(BODY)
    assert feet is not None
    q = np.tile(BODY.neutral, (COUNT, 1))
    height = float(FloorDistances(BODY, UP, 0.0).lowest(BODY.placed(q))[0])
    q[:, ROOT_PLACE_Q] += moves
    points = BODY.landmarks_of(BODY.placed(q))[:, feet.landmark]
    above = np.zeros(feet.kind.max() + 1)
    above[feet.kind] = points[0, :, 2] - moves[0, 2] - height
    floor, ones = Ground(UP, height, 0.0, above), np.ones(points.shape[:2])
    time = np.arange(COUNT) / fps
    contact = Contact(time, feet.names, points, ones, floor, np.ones(len(feet.names)))
    return SimpleNamespace(body=BODY, q=q), contact


def footing(fps: float, moves: np.ndarray) -> Footing:
    run, contact = stood(fps, moves)
    return footing_of(run, contact)


def moved(frames: slice, along: np.ndarray) -> np.ndarray:
    """Displacements in those frames alone."""
    moves = np.zeros((COUNT, 3))
    moves[frames] = along
    return moves


def test_standing_still_has_no_fault() -> None:
    assert footing(30.0, np.zeros((COUNT, 3))) == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-6)


def test_sinking_has_its_share_and_depth() -> None:
    low = footing(30.0, moved(slice(4, 9), -0.03 * UP))
    assert low == pytest.approx((0.25, 0.03, 0.0, 0.75), abs=1e-6)
    high = footing(30.0, moved(slice(4, 9), 0.03 * UP))
    assert high == pytest.approx((0.0, 0.0, 0.0, 0.75), abs=1e-6)


@pytest.mark.parametrize("fps", [15.0, 30.0, 60.0, 120.0])
def test_what_stands_and_moves_skates_at_any_rate(fps: float) -> None:
    """A centimetre in a thirtieth of a second, or in one frame if that is longer."""
    for speed, share in ((0.27, 0.0), (0.33, 1.0)):
        way = speed * np.arange(COUNT)[:, None] / fps * np.array([1.0, 0.0, 0.0])
        expected = share if fps > 20.0 else 1.0  # it moves 18 mm in a frame
        assert footing(fps, way).skating == pytest.approx(expected)


def test_what_does_not_stand_may_move() -> None:
    run, contact = stood(30.0, 0.05 * np.arange(COUNT)[:, None] * np.array([1.0, 0.0, 0.0]))
    standing = contact.standing.copy()
    standing[::2] = 0.0  # none stood a frame before
    assert np.isnan(footing_of(run, replace(contact, standing=standing)).skating)
    nowhere = footing_of(run, replace(contact, floor=None))
    assert np.isnan([nowhere.penetrating, nowhere.deepest, nowhere.near]).all()
    assert nowhere.skating == 1.0


def test_what_ought_to_stand_is_judged_where_it_is() -> None:
    run, contact = stood(30.0, moved(slice(0, 10), 0.05 * UP))
    ought = np.zeros(contact.standing.shape, dtype=bool)
    ought[5:15, 0] = True
    assert footing_of(run, contact, ought).near == pytest.approx(0.5)
