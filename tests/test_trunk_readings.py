"""The two readings of a trunk in one picture: the jump between them, their names, and room for both."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from builders import bent, body_of, camera_at, inside, observe

from estimator.data.cameras.camera import parallel_camera
from estimator.search.cost_model import CostModel
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Candidate, Hypothesis
from estimator.search.jumps import KinematicJumps
from estimator.search.jumps.readings import ACROSS, AWAY, TOWARDS, reading_shifts, trunk_readings
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import ModeSearchSettings
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.smoothing.readings import bridged, reading_bars, reading_weights
from humanoid.kinematics.body import Body
from humanoid.subject.example_robots import installed
from humanoid.subject.subject import load_subject

BODY = body_of("human34")
NAMES = BODY.landmark_names
FRONT = camera_at(0.0, distance=3.5)
LEGS = [NAMES.index(f"{side}_{part}") for side in ("left", "right") for part in ("hip", "knee", "ankle", "heel")]
LIMBS = [NAMES.index(f"{s}_{p}") for s in ("left", "right") for p in ("shoulder", "elbow", "wrist", "hip", "knee")]


def leaning(lean: float, heading: float = 0.0) -> np.ndarray:
    """Knees and hips bent, the trunk leaning forwards [rad], facing x turned by the heading [rad]."""
    angles = (("hip_flexion", 0.9 + lean), ("knee_flexion", 1.2), ("elbow_flexion", 0.8))
    q = bent(BODY, **{f"{side}_{joint}": angle for side in ("left", "right") for joint, angle in angles})
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, lean, heading)).coeffs()
    return q


@pytest.mark.parametrize("name", ["talos", "g1", "human"])
def test_the_trunk_of_other_bodies_turns_about_the_hips_too(name: str) -> None:
    if name not in installed():
        pytest.skip("example-robot-data is not installed")
    body = Body(load_subject(f"example-robot-data:{name}"))
    anatomy = KinematicJumps(body).anatomy
    assert anatomy.trunk is not None
    about = anatomy.parts[anatomy.trunk].about
    assert {body.landmark_names[k] for k in about} == {"left_hip", "right_hip"}
    assert KinematicJumps(body_of("arm8")).anatomy.trunk is None


@pytest.mark.parametrize(("lean", "heading"), [(0.6, 0.0), (0.5, 0.3), (-0.3, 0.0), (0.6, np.pi)])
def test_the_other_reading_mirrors_the_trunk_and_leaves_the_legs_where_they_are(lean: float, heading: float) -> None:
    q = leaning(lean, heading)
    other = KinematicJumps(BODY).trunk_turned(q, FRONT)
    assert other is not None
    assert inside(BODY, other)
    before, after = (BODY.landmarks(BODY.at(x)) for x in (q, other))
    off = np.linalg.norm(FRONT.project(after) - FRONT.project(before), axis=1)
    assert np.max(off[LIMBS]) < 25.0  # for a person of 300 px: a quadrilateral is mirrored only approximately
    if heading in (0.0, np.pi):
        assert np.max(np.linalg.norm(after[LEGS] - before[LEGS], axis=1)) < 0.06
    assert trunk_readings(BODY, np.array([q, other]), FRONT).tolist() == (
        [TOWARDS, AWAY] if lean * np.cos(heading) > 0.0 else [AWAY, TOWARDS]
    )


def test_a_parallel_camera_mirrors_exactly() -> None:
    """There depth changes no pixel, and mirroring twice leads back."""
    camera = parallel_camera("flat", (640, 480), 180.0, np.zeros(3))
    q, jumps = leaning(0.5), KinematicJumps(BODY)
    other = jumps.trunk_turned(q, camera)
    assert other is not None
    again = jumps.trunk_turned(other, camera)
    assert again is not None
    points = [BODY.landmarks(BODY.at(x))[LIMBS] for x in (q, other, again)]
    np.testing.assert_allclose(camera.project(points[1]), camera.project(points[0]), atol=2.0)
    arms_apart = [k for k, index in enumerate(LIMBS) if NAMES[index].endswith(("shoulder", "hip", "knee"))]
    np.testing.assert_allclose(points[2][arms_apart], points[0][arms_apart], atol=0.02)


def test_an_upright_trunk_has_one_reading() -> None:
    upright = pin.neutral(BODY.model)
    level = camera_at(0.0, distance=20.0, height=0.25, aim=(0.0, 0.0, 0.25))
    assert trunk_readings(BODY, upright[None], level).tolist() == [ACROSS]
    assert KinematicJumps(BODY).trunk_turned(upright, level) is None
    assert trunk_readings(body_of("upper13"), body_of("upper13").neutral[None], FRONT).tolist() == [""]


def test_interpretations_have_the_other_reading() -> None:
    q = leaning(0.6)
    first = [x for x, _ in zip(KinematicJumps(BODY).interpretations(q, FRONT), range(120), strict=False)]
    assert {TOWARDS, AWAY} <= set(trunk_readings(BODY, np.array(first), FRONT).tolist())


def test_rest_positions_count_by_their_share_between_readings_alone() -> None:
    """Within a reading nothing shifts; the gap between the best of both follows the evidence; a single one is
    unchanged."""
    readings = np.array([TOWARDS, AWAY, AWAY, ACROSS, TOWARDS])
    energy, rest = np.array([10.0, 14.0, 15.0, 12.0, 11.0]), np.array([2.0, 9.0, 7.0, 1.0, 4.0])
    shifts = reading_shifts(readings, energy, rest, 0.1)
    np.testing.assert_allclose(shifts[[0, 3, 4]], 0.0)
    assert shifts[1] == shifts[2]
    evidence = energy - 0.9 * rest
    gap = evidence[readings == AWAY].min() - evidence[readings == TOWARDS].min()
    assert (energy + shifts)[[1, 2]].min() - energy[[0, 4]].min() == pytest.approx(gap)
    mirrored = reading_shifts(
        np.where(readings == AWAY, TOWARDS, np.where(readings == TOWARDS, AWAY, ACROSS)), energy, rest, 0.1
    )
    np.testing.assert_allclose(mirrored, shifts)
    np.testing.assert_allclose(reading_shifts(readings, energy, rest, 1.0), 0.0, atol=1e-12)
    assert not reading_shifts(readings[:1], energy[:1], rest[:1], 0.1).any()
    assert not reading_shifts(readings, np.where(readings == ACROSS, 1.0, energy), rest, 0.1).any()


def test_room_is_kept_for_the_other_reading_however_little_it_weighs() -> None:
    """The last of the best is replaced; not with two cameras, nor where the best trunk is upright, nor if switched
    off."""
    model, jumps = CostModel(BODY), KinematicJumps(BODY)
    q = leaning(0.6)
    other = jumps.trunk_turned(q, FRONT)
    assert other is not None
    near = [BODY.integrate(q, np.r_[np.zeros(6 + k), 0.8, np.zeros(BODY.nv - 7 - k)]) for k in (6, 12, 13)]
    searched = [candidate(x, energy) for energy, x in enumerate([q, *near])] + [candidate(other, 90.0)]

    def kept(*cameras: object, readings: bool = True, best: np.ndarray | None = None) -> list[float]:
        search = ModeSearch(model, ModeSearchSettings(readings=readings))
        case = FrameProblem(search.associations(observe(BODY, q, cameras)))
        first = [] if best is None else [candidate(best, -1.0)]
        return [c.energy for c in search.best_of_readings([*first, *searched], case, 3)]

    assert kept(FRONT) == [0.0, 1.0, 90.0]
    assert kept(FRONT, camera_at(90.0)) == [0.0, 1.0, 2.0]
    assert kept(FRONT, readings=False) == [0.0, 1.0, 2.0]
    assert kept(FRONT, best=pin.neutral(BODY.model)) == [-1.0, 0.0, 1.0]


def candidate(q: np.ndarray, energy: float) -> Candidate:
    """A candidate with a given energy."""
    return Candidate(Hypothesis(q, 0), q, BODY.landmarks(BODY.at(q)), float(energy))


def test_a_frame_without_the_other_reading_is_searched_for_it() -> None:
    """Tracked from one reading, the mixture has both after the next frame, and weights that count the rest position by
    its share."""
    tracker, q = make_tracker("css", BODY, settings_for("css")), leaning(0.6)
    seen = [
        observe(BODY, q, (FRONT,), noise=1.0, rng=np.random.default_rng(t), index=t, time=t / 30.0) for t in range(3)
    ]
    rng = np.random.default_rng(0)
    state, _ = tracker.init(rng, seen[0])
    alone = replace(state.mixture, modes=state.mixture.modes[:1], weights=np.ones(1), log_scores=np.zeros(1))
    state, _ = tracker.step(rng, replace(state, mixture=alone), seen[1])
    readings = trunk_readings(BODY, np.array([m.q for m in state.mixture.modes]), FRONT)
    assert {TOWARDS, AWAY} <= set(readings.tolist())


def test_weights_of_readings_are_those_of_the_frame_and_within_one_those_of_the_trajectories() -> None:
    readings, weight = np.array([TOWARDS, AWAY, TOWARDS]), np.array([0.6, 1e-200, 0.4])
    weights = reading_weights(readings, np.array([3.0, 5.0, 4.0]), weight)
    assert weights.sum() == pytest.approx(1.0)
    assert weights[1] == pytest.approx(1.0 / (1.0 + np.exp(2.0)))
    assert weights[0] / weights[2] == pytest.approx(1.5)
    alone = np.array([TOWARDS, ACROSS, TOWARDS])
    np.testing.assert_array_equal(reading_weights(alone, np.array([3.0, 5.0, 4.0]), weight), weight)


def test_a_path_has_the_better_reading_of_each_stretch() -> None:
    """Over the whole stretch: one frame that disagrees, or lacks a reading, changes nothing."""
    both, missing = np.array([TOWARDS, AWAY]), np.array([TOWARDS, ACROSS])
    readings = [missing, both, both, missing, both, missing, missing, missing, missing, missing, missing, both]
    gaps = [0.0, -3.0, 1.0, 0.0, -1.0, *[0.0] * 6, 2.0]
    bars = reading_bars(readings, [np.array([5.0, 5.0 + gap]) for gap in gaps], np.arange(12) / 30.0)
    assert bars is not None
    assert [int(np.argmax(bar)) if bar.any() else None for bar in bars] == [None, 0, 0, None, 0, *[None] * 6, 1]
    assert reading_bars([missing] * 2, [np.zeros(2)] * 2, np.arange(2.0)) is None


def test_a_leap_between_readings_becomes_a_movement() -> None:
    """On its upright side; frames far from it are unchanged."""
    times = np.arange(30) / 30.0
    q = np.array([leaning(0.1) if t < 15 else leaning(-0.6) for t in range(30)])
    readings = trunk_readings(BODY, q, FRONT)
    assert {TOWARDS, AWAY} == set(readings.tolist())
    path = bridged(BODY, q, readings, times, FRONT)
    np.testing.assert_array_equal(path[15:], q[15:])
    np.testing.assert_array_equal(path[:3], q[:3])
    steps = [np.abs(BODY.difference(a, b)).max() for a, b in pairwise(path)]
    assert max(steps) < 0.15 * np.abs(BODY.difference(q[14], q[15])).max()
