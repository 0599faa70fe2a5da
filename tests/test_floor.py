"""The floor: distances to it, terms that keep the body above it, and the size of a standing person in one camera."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import meshcat
import numpy as np
import pinocchio as pin
import pytest
from builders import body_of, camera_at, observe, random_pose
from meshcat.animation import Animation
from test_fixed_lag import FPS as RATE, Track, tracked
from test_foot_contact import walk
from test_run_file import header, state_of, walk as random_walk
from test_stances import FPS, watched

import kinemode as km
from estimator.data.cameras.camera import parallel_camera
from estimator.data.floor import OFF
from estimator.data.formats.cameras import declared_floor, write_cameras
from estimator.data.formats.checked_arrays import DamageError
from estimator.energy.descent.contact import clearance_rows
from estimator.energy.interpenetration import AboveFloor
from estimator.fitting.fit import size_by_floor
from estimator.inference.contacts import FootPoints, floor_of, foot_contact, height_above, is_believed
from estimator.inference.ground import Ground
from estimator.runs.contact import contact_of_points
from estimator.runs.run_arrays import check_smoothed, joined, smoothed_parts
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.synthesis.motion import authored_motion
from estimator.tracking.smoothing import Smoothed, smooth_track
from estimator.tracking.smoothing.stances import Stances
from humanoid.collision.floor import Clearances, FloorDistances
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_PLACE_Q, ROOT_TURN_Q, Body
from humanoid.shape.solids import solids_of
from humanoid.support.errors import InputError
from viz.preview.beside import add_floor, add_stances
from viz.preview.recorder import CommandRecorder

SLOPE = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def whole() -> Track:
    """A person before one camera."""
    body = body_of("human34")
    return tracked(body, authored_motion(body, 0.4 + np.arange(8) / RATE), (15,), {})


@pytest.mark.parametrize("name", ["human34", "example-robot-data:talos"])
def test_distances_have_their_gradients(name: str) -> None:
    body, rng = body_of(name), np.random.default_rng(2)
    floor, step = FloorDistances(body, SLOPE, -0.6), 1e-6
    q = body.clamp(pin.integrate(body.model, body.neutral, 0.3 * rng.normal(size=body.nv)))
    contacts = floor.near(body.at(q), np.inf)
    assert floor.penetration(body.at(q)) == pytest.approx(max(0.0, -contacts.distance.min()))
    for i in range(body.nv):
        ends = [
            floor.near(body.at(pin.integrate(body.model, q, s * step * np.eye(body.nv)[i])), np.inf) for s in (1, -1)
        ]
        slope = (ends[0].distance - ends[1].distance) / (2.0 * step)
        np.testing.assert_allclose(contacts.gradient[:, i], slope, atol=1e-8)
    near = floor.near(body.at(q), 0.1)
    np.testing.assert_array_equal(near.distance, contacts.distance[contacts.distance < 0.1])


@pytest.mark.parametrize("name", ["human34", "human30"])
def test_lowest_points_are_those_of_coal(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Capsules, balls and ellipsoids have closed forms, which coal's queries agree with: above the floor and below."""
    body, rng = body_of(name), np.random.default_rng(8)
    posed = body.at(body.clamp(pin.integrate(body.model, body.neutral, 0.5 * rng.normal(size=body.nv))))
    floor = FloorDistances(body, SLOPE, float(posed.translations[1] @ SLOPE))
    assert floor.round_pieces is not None
    closed = floor.near(posed, np.inf)
    monkeypatch.setattr(floor, "round_pieces", None)
    known = floor.near(posed, np.inf)
    assert known.distance.min() < -0.1 < 0.1 < known.distance.max()
    np.testing.assert_allclose(closed.distance, known.distance, atol=1e-12)
    np.testing.assert_allclose(closed.gradient, known.gradient, atol=1e-12)


@pytest.mark.parametrize(("nu", "exact"), [(None, False), (64.0, True)])
def test_compiled_and_measured_floors_cost_the_same(nu: float | None, exact: bool) -> None:
    body, rng = body_of("human34"), np.random.default_rng(9)
    q = body.clamp(pin.integrate(body.model, body.neutral, 0.3 * rng.normal(size=body.nv)))
    lowest = float(FloorDistances(body, SLOPE, 0.0).near(body.at(q), np.inf).distance.min())
    terms = [AboveFloor(FloorDistances(body, SLOPE, lowest + 0.1), 0.005, nu) for _ in range(2)]
    terms[1].recorded = False
    results = []
    for term in terms:
        gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
        value = term.accumulate(body.at(q), gradient, hessian, exact)
        results.append((value, gradient, hessian))
    for compiled, known in zip(*results, strict=True):
        np.testing.assert_allclose(compiled, known, rtol=1e-10, atol=1e-10 * np.abs(known).max())
    assert results[0][0] > 0.0


def test_what_stands_on_a_floor_touches_it() -> None:
    """The lowest distance is that of the lowest point; a foot that lies touches with both ends."""
    body = body_of("human34")
    posed = body.at(pin.neutral(body.model))
    lowest = FloorDistances(body, UP, 0.0).near(posed, np.inf).distance.min()
    floor = FloorDistances(body, UP, lowest)
    touching = floor.near(posed, 1e-6).distance
    assert len(touching) == 4
    np.testing.assert_allclose(touching, 0.0, atol=1e-6)
    feet = FootPoints.of(body)
    assert feet is not None
    points = body.landmarks(posed)[feet.landmark]
    np.testing.assert_allclose(points[:, 2] - feet.above[feet.kind], lowest, atol=1e-6)


def test_a_hand_without_a_wrist_may_be_below_it() -> None:
    """In a handstand the forearms' ends are lowest: real hands bend, the subject's are straight."""
    body = body_of("human34")
    q = pin.neutral(body.model)
    q[ROOT_TURN_Q] = 1.0, 0.0, 0.0, 0.0  # half a turn about x
    for side in ("left", "right"):
        q[body.model.idx_qs[body.model.getJointId(f"{side}_shoulder_flexion")]] = np.pi
    posed = body.at(q)
    wrists = body.landmarks(posed)[[body.landmark_names.index(f"{side}_wrist") for side in ("left", "right")], 2]
    below = wrists.mean() - FloorDistances(body, UP, 0.0).near(posed, np.inf).distance.min()
    assert abs(below) < 0.03  # a hand is 17 cm long
    hands = {solid.link for solid in solids_of(body) if solid.link.endswith("_hand")}
    assert hands == {"left_hand", "right_hand"}  # the subject has them


def test_both_clearances_are_rows_of_one_step() -> None:
    body = body_of("human34")
    posed = body.at(body.neutral)
    parts = SelfCollision(body), FloorDistances(body, UP, -0.8)
    both = Clearances(parts)
    rows = clearance_rows(both, posed, 0.1)
    assert rows is not None
    counts = [len(part.near(posed, 0.1).distance) for part in parts]
    assert min(counts) > 0
    assert rows[0].shape == (sum(counts), body.nv)
    assert both.penetration(posed) == parts[1].penetration(posed) > 0.0
    assert Clearances(()).penetration(posed) == 0.0


def test_size_is_seen_by_the_floor() -> None:
    """A person modelled too small and proportionally too near, with the same image."""
    adult = body_of("human34")
    camera = camera_at(20.0)
    centre = camera.origin_world
    for size in (0.55, 0.9, 1.08):
        person = Body(adult.subject.resized(size))
        standing = person.neutral
        floor = float(FloorDistances(person, UP, 0.0).near(person.at(standing), np.inf).distance.min())
        looks_alike = standing.copy()
        looks_alike[ROOT_PLACE_Q] = centre + (standing[ROOT_PLACE_Q] - centre) / size
        in_the_air = looks_alike.copy()
        in_the_air[2] += 0.2
        poses = np.array([looks_alike, looks_alike, in_the_air])
        seen = [observe(adult, q, [camera]) for q in poses]
        by_floor = size_by_floor(adult, poses, seen, floor)
        assert by_floor is not None
        assert by_floor.believed
        assert by_floor.seen == pytest.approx(size, abs=1e-6)
        assert min(1.0, size) < by_floor.factor < max(1.0, size)
        assert by_floor.factor == pytest.approx(size, rel=0.02)
        far = size_by_floor(adult, poses, seen, floor - 2.5)
        assert far is not None
        assert (far.believed, far.factor) == (False, 1.0)
        assert size_by_floor(adult, poses, seen, float(centre[2]) - 0.1) is None


def test_a_parallel_camera_and_a_fixed_body_see_no_size() -> None:
    body = body_of("human34")
    flat = parallel_camera("flat", (640, 480), 180.0, np.zeros(3))
    assert size_by_floor(body, body.neutral[None], [observe(body, body.neutral, [flat])], -2.0) is None
    arm = body_of("arm8")
    assert size_by_floor(arm, arm.neutral[None], [observe(arm, arm.neutral, [camera_at(20.0)])], -2.0) is None


def test_a_known_floor_is_at_the_feet_and_off_means_none() -> None:
    points, time, _ = walk(30.0)
    kind = np.array([0, 1, 0, 1])
    above = np.array([0.05, 0.01])
    known = foot_contact(points, time, kind, UP, above=above, floor=0.02)
    assert known.floor is not None
    np.testing.assert_allclose(known.floor.heights(points, kind), points[..., 2] - 0.02 - above[kind])
    off = foot_contact(points, time, kind, UP, floor="off")
    assert off.floor is None
    assert np.abs(off.standing - known.standing).mean() < 0.1
    nobody = foot_contact(points, time, kind, UP, seen=np.zeros(points.shape[:2], dtype=bool))
    assert nobody.floor is None
    half = np.arange(4) < 2
    apart = points + np.where(half, 0.0, 0.4)[:, None] * UP
    alone = foot_contact(apart, time, kind, UP, seen=np.tile(half, (len(time), 1)))
    assert alone.floor is not None
    assert alone.floor.height + alone.floor.above == pytest.approx(above, abs=0.01)


def test_what_stands_is_held_on_a_known_floor_alone() -> None:
    """A given floor is used where feet already stand on it; feet below it, on a lower stair, have none."""
    body, times = body_of("human34"), np.arange(60) / FPS
    q = np.tile(pin.neutral(body.model), (60, 1))
    seen = watched(body, q, times)
    stances = Stances.of(body, q, seen)
    assert stances is not None
    assert stances.floor is not None
    lowest = float(FloorDistances(body, UP, 0.0).near(body.at(q[0]), np.inf).distance.min())
    assert stances.floor.height == pytest.approx(lowest, abs=0.005)
    raised = Stances.of(body, q, seen, lowest + 0.03)
    assert raised is not None
    np.testing.assert_allclose(
        raised.places - stances.places, np.broadcast_to([0.0, 0.0, 0.03], raised.places.shape), atol=1e-6
    )
    q[53:, 2] -= 0.17
    stairs = Stances.of(body, q, watched(body, q, times))
    assert stairs is not None
    assert stairs.floor is None


def test_parts_below_it_cost_and_others_do_not() -> None:
    body = body_of("human34")
    posed = body.at(random_pose(body, np.random.default_rng(0), share=0.4))
    lowest = float(FloorDistances(body, SLOPE, 0.0).near(posed, np.inf).distance.min())
    free, sunk = (AboveFloor(FloorDistances(body, SLOPE, lowest + d), 0.005, None) for d in (-1e-6, 0.01))
    assert free.value(posed) == 0.0
    assert sunk.value(posed) >= 0.5 * (0.01 / 0.005) ** 2 - 1e-9


def test_the_floor_of_the_camera_file_and_of_the_user(tmp_path: Path) -> None:
    path = tmp_path / "cameras.json"
    write_cameras(path, [camera_at(20.0)])
    assert declared_floor(path) is None
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"units": "mm", "floor": 30}))
    assert declared_floor(path) == pytest.approx(0.03)
    path.write_text(json.dumps(content | {"floor": "low"}))
    with pytest.raises(InputError, match="floor"):
        declared_floor(path)
    for wrong, problem in (("low", "'low' is unknown"), (np.nan, "must be -1000 to 1000 m"), (1e9, "must be")):
        with pytest.raises(InputError, match=f"floor: {problem}"):
            km.track("human34", None, keypoints=tmp_path / "cameras.json", cameras=path, floor=wrong)
    for floor in (None, "off", 0.25):
        assert RunHeader.from_json(header(3, floor=floor).to_json(), "a.run").floor == floor
    text = header(3, floor=0.25).to_json().replace('"floor": 0.25', '"floor": "high"')
    with pytest.raises(InputError, match="floor"):
        RunHeader.from_json(text, "a.run")
    assert header(3, floor=0.25).differences(header(3)) == ("floor",)


def test_a_smoothed_person_is_above_a_known_floor(whole: Track) -> None:
    """Hard constraints, within the tolerance of overlaps; without a floor there are none."""
    body = whole.body
    free = smooth_track(whole.search, whole.seen, whole.results, floor=OFF).q
    lowest = min(FloorDistances(body, UP, 0.0).near(body.at(q), np.inf).distance.min() for q in free)
    floor = FloorDistances(body, UP, float(lowest) + 0.04)
    above = smooth_track(whole.search, whole.seen, whole.results, floor=float(lowest) + 0.04).q
    assert max(floor.penetration(body.at(q)) for q in free) == pytest.approx(0.04)
    assert max(floor.penetration(body.at(q)) for q in above) < whole.search.settings.contact.tolerance + 1e-6
    assert np.abs(above - free).max() < 0.5


def test_a_floor_far_from_the_person_is_left_out(whole: Track) -> None:
    free, far = (smooth_track(whole.search, whole.seen, whole.results, floor=f).q for f in (None, 5.0))
    np.testing.assert_array_equal(free, far)
    floor = floor_of(whole.body, whole.seen[0].cameras, 5.0)
    assert floor is not None
    assert not is_believed(height_above(floor, whole.body, free))
    assert is_believed(height_above(floor, whole.body, np.full((2, whole.body.nq), np.nan)))
    assert floor_of(whole.body, whole.seen[0].cameras, OFF) is None


def test_the_floor_stays_with_the_trajectory(tmp_path: Path) -> None:
    body, path = body_of("human34"), tmp_path / "a.run"
    floor = Ground(SLOPE, -0.9, 0.01, np.array([0.01, 0.012, 0.008]))
    with RunWriter.create(path, header(4, subject_urdf=body.subject.urdf, subject_base=body.subject.base)) as writer:
        for result in random_walk(body, 4):
            writer.append(result, state_of(result))
        assert km.open_run(path).floor is None
        writer.put_smoothed(Smoothed(np.tile(body.neutral, (4, 1)), floor))
        writer.finish()
    kept = km.open_run(path).floor
    assert kept is not None
    np.testing.assert_array_equal(kept.normal, floor.normal)
    np.testing.assert_array_equal(kept.above, floor.above)
    assert (kept.height, kept.std) == (floor.height, floor.std)
    floor_used = km.contact(path).floor
    assert floor_used is not None
    assert floor_used.height == kept.height
    arrays = joined(smoothed_parts(Smoothed(np.tile(body.neutral, (4, 1)), floor)))
    check_smoothed(arrays, body)
    check_smoothed({"q": arrays["q"]}, body)
    for name, wrong in (
        ("normal", 2.0 * SLOPE),
        ("height", np.array(np.nan)),
        ("above", np.zeros(2)),
        ("std", np.ones(1)),
    ):
        with pytest.raises(DamageError, match=f"floor_{name}"):
            check_smoothed(arrays | {f"floor_{name}": wrong}, body)


def test_the_preview_has_the_floor_and_discs_under_what_stands() -> None:
    points, time, _ = walk(30.0)
    names = ("left_heel", "left_big_toe", "right_heel", "right_big_toe")
    contact = contact_of_points(time, names, points)
    assert contact.floor is not None
    recorder = CommandRecorder()
    root, animation, rows = meshcat.Visualizer(window=recorder), Animation(default_framerate=30.0), list(range(20))
    add_floor(root, points[0, 0], 0.0, contact.floor)
    add_stances(root, animation, contact, rows)
    for k, name in enumerate(names):
        tracks = animation.clips[root["standing"][name].path].tracks
        np.testing.assert_array_equal(tracks["scale"].values[:, 0] > 0.4, contact.standing[rows, k] > 0.5)
        on_floor = tracks["position"].values @ contact.floor.normal - contact.floor.height
        np.testing.assert_allclose(on_floor, contact.floor.above[k % 2], atol=1e-6)


def test_feet_without_keypoints_have_a_remark() -> None:
    points, time, _ = walk(30.0)
    contact = contact_of_points(time, ("left_heel", "left_big_toe", "right_heel", "right_big_toe"), points)
    assert contact.remark == ""
    unseen = replace(contact, seen=np.full(4, 0.01))
    assert "no heels and toes" in unseen.remark
    assert unseen.remark in repr(unseen)
