"""Feet that rest on something other than the floor: a stool, a wall, the air above a person upside down."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from builders import body_of
from scipy.spatial.transform import Rotation

import kinemode as km
from estimator.inference.contacts import FeetOnFloor, FootPoints, feet_on_floor
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body

UP, COUNT, RATE = np.array([0.0, 0.0, 1.0]), 16, 30.0
ON_THE_BACK, UPSIDE_DOWN = (0.0, -90.0, 0.0), (180.0, 0.0, 0.0)


def posed(turn: tuple[float, float, float], **legs: float) -> tuple[Body, np.ndarray]:
    """A person who moves only the arms (T, nq), the lowest landmark at height 0."""
    body = body_of("human34")
    q = np.tile(body.neutral, (COUNT, 1))
    q[:, 3:7] = Rotation.from_euler("xyz", turn, degrees=True).as_quat()
    for side in ("left", "right"):
        q[:, body.q_names.index(f"{side}_elbow_flexion")] = 0.5 + 0.3 * np.sin(np.arange(COUNT) / 5.0)
        for joint, angle in legs.items():
            q[:, body.q_names.index(f"{side}_{joint}")] = angle
    q[:, 2] -= body.landmarks_of(body.placed(q))[..., 2].min()
    return body, q


def on_floor(body: Body, q: np.ndarray) -> FeetOnFloor:
    feet = FootPoints.of(body)
    assert feet is not None
    points = body.landmarks_of(body.placed(q))[:, feet.landmark]
    return feet_on_floor(body, feet, q, points, np.arange(COUNT) / RATE, UP, None, None)


RAISED = [
    (ON_THE_BACK, {"hip_flexion": 1.55, "knee_flexion": 1.5}),
    (ON_THE_BACK, {"hip_flexion": 1.2, "knee_flexion": 0.9}),
    (ON_THE_BACK, {"hip_flexion": 1.6, "knee_flexion": 0.05}),
    ((0.0, 0.0, 0.0), {"hip_flexion": 1.9, "knee_flexion": 0.1}),
    (UPSIDE_DOWN, {"hip_flexion": 0.1, "knee_flexion": 0.1}),
]


@pytest.mark.parametrize(("turn", "legs"), RAISED)
def test_what_raised_feet_rest_on_is_not_the_floor(turn: tuple[float, float, float], legs: dict[str, float]) -> None:
    body, q = posed(turn, **legs)
    contact = on_floor(body, q)
    assert contact.floor is None
    assert contact.raised is not None
    assert (FloorDistances(body, UP, contact.raised.height).lowest(body.placed(q)) < -0.04).all()
    assert (contact.standing > 0.5).any()  # they are at rest nevertheless


@pytest.mark.parametrize("bent", [0.0, 0.05, 1.4])
def test_standing_people_are_never_below_the_floor(bent: float) -> None:
    """For any ankle angle, with heels and toes not all level."""
    body, q = posed((0.0, 0.0, 0.0), hip_flexion=0.9 * bent, knee_flexion=bent, ankle_dorsiflexion=0.3 * bent)
    contact = on_floor(body, q)
    assert contact.floor is not None
    assert contact.raised is None
    lowest = FloorDistances(body, contact.floor.normal, contact.floor.height).lowest(body.placed(q))
    assert -1e-6 < np.median(lowest) < 0.02


def test_legs_on_a_stool_are_tracked_as_without_a_floor(tmp_path: Path) -> None:
    body, q = posed(*RAISED[0][:1], **RAISED[0][1])
    points = body.landmarks_of(body.placed(q))
    np.savez(tmp_path / "p.npz", points=points, names=np.array(body.landmark_names), fps=RATE, unit="m", up="z")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = km.track("human34", points=tmp_path / "p.npz", fit="off")
    assert any("no floor was put under them" in str(w.message) for w in caught)
    assert run.floor is None
    joints = body.bounded_q
    assert np.degrees(np.abs(run.q[:, joints] - q[:, joints])).mean() < 0.5
    of_run = km.contact(run)
    assert of_run.floor is None
    assert "not used as a floor" in of_run.remark
