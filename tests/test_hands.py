"""Hands that stand on the floor, on request."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from builders import body_of, camera_at, observe
from test_run_file import header, state_of, walk as random_walk

import kinemode as km
from estimator.energy.cost import Cost
from estimator.inference.contacts import HandPoints
from estimator.inference.ground import Ground
from estimator.runs.run_file import RunWriter
from estimator.tracking.smoothing.stances import Stances

FPS = 30.0
FLOOR = Ground(np.array([0.0, 0.0, 1.0]), 0.0, 0.0, np.zeros(3))


def test_what_rests_low_stands_and_what_rests_high_or_moves_does_not() -> None:
    time, hands = np.arange(30) / FPS, HandPoints.of(body_of("human34"))
    assert hands is not None
    assert hands.names == ("left_wrist", "right_wrist")
    low, high, swept = np.tile([0.3, 0.0, 0.05], (30, 1)), np.tile([0.3, 0.0, 0.8], (30, 1)), np.zeros((30, 3))
    swept[:, 0], swept[:, 2] = 2.0 * time, 0.06
    assert hands.standing(np.stack([low, high], axis=1), time, FLOOR)[5:25, 0].min() > 0.9
    assert hands.standing(np.stack([high, swept], axis=1), time, FLOOR).max() < 0.1
    assert not hands.standing(np.stack([low, low], axis=1), time, None).any()


def test_hands_are_held_on_request() -> None:
    """A standing person on a floor at the height of the hands, which therefore count as standing too."""
    body = body_of("human34")
    q, times = np.tile(body.neutral, (12, 1)), np.arange(12) / FPS
    camera = camera_at(20.0, distance=3.5, height=1.0, aim=(0.0, 0.0, 0.9))
    seen = [observe(body, pose, (camera,), index=i, time=t) for i, (pose, t) in enumerate(zip(q, times, strict=True))]
    wrist = list(body.landmark_names).index("left_wrist")
    height = float(body.landmarks(body.at(body.neutral))[wrist, 2]) - 0.05
    free, held = Stances.of(body, q, seen, height), Stances.of(body, q, seen, height, hands=True)
    assert free is not None
    assert held is not None
    assert wrist not in free.landmark
    column = list(held.landmark).index(wrist)
    assert held.weight[2:-2, column].min() > 0.8
    costs = held.held(body, [Cost(body, [])] * 12, 0.015)
    raised = body.neutral.copy()
    raised[body.q_names.index("left_elbow_flexion")] += 0.8
    assert costs[6].value_at(raised) > costs[6].value_at(body.neutral) + 1.0


def test_contact_reports_hands_on_request(tmp_path: Path) -> None:
    file = tmp_path / "a.run"
    with RunWriter.create(file, header(8)) as writer:
        for result in random_walk(body_of("human34"), 8):
            writer.append(result, state_of(result))
    run = km.open_run(file)
    assert km.contact(run).hands is None
    contact_found = km.contact(run, hands=True, plot=tmp_path / "a.png")
    assert contact_found.hands is not None
    assert contact_found.hand_names == ("left_wrist", "right_wrist")
    assert contact_found.hands.shape == (len(run), 2)
    assert all(s.point in contact_found.hand_names for s in contact_found.hand_stances)
    with contact_found.write(tmp_path / "a.csv").open() as file:
        heads = next(csv.reader(file))
    assert heads[-2:] == ["left_wrist stands", "right_wrist stands"]
    assert (tmp_path / "a.png").stat().st_size > 1000
