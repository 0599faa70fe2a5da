"""A lifted pose beside the keypoints: read from files, passed to observations, weak evidence of a pose."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from estimator.data.cameras.camera import Camera, guessed_camera, parallel_camera
from estimator.data.formats.keypoints import KeypointTrack, load_keypoints, load_people, write_keypoints
from estimator.data.observation import LiftedPose, Observation
from estimator.data.sequence import assemble
from estimator.data.timing import at_places
from estimator.energy.lifted import ACROSS, ALONG, BONES, lifted_directions
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.search.first_pose import start_modes
from estimator.search.mode_search import ModeSearch
from estimator.tracking.registry import settings_for
from humanoid.subject.landmarks import FORMATS, mirror_index
from humanoid.support.errors import InputError
from kinemode.detection.clip import write_people
from tests.builders import body_of, camera_at, observe, random_pose

BODY = body_of("human34")
NAMES = BODY.landmark_names


def drawn(layout: str, seed: int) -> dict[str, list[list[float]]]:
    """Keypoints and world of a person in an image of 640 x 480."""
    rng, count = np.random.default_rng(seed), len(FORMATS[layout])
    points = np.column_stack([rng.uniform(50, 400, (count, 2)), rng.uniform(0.3, 1.0, count)])
    return {"keypoints": points.tolist(), "world": rng.uniform(-0.9, 0.9, (count, 3)).tolist()}


def written(path: Path, frames: list[Any], layout: str = "coco17") -> Path:
    path.write_text(json.dumps({"format": layout, "image_size": [640, 480], "fps": 30.0, "frames": frames}))
    return path


@pytest.mark.parametrize("layout", ["coco17", "mediapipe33"])
def test_the_world_stays_with_its_keypoints(tmp_path: Path, layout: str) -> None:
    """For any person and first frame, and after the file is written again; a frame without a world has none."""
    frames = [{n: drawn(layout, 10 * t + n) for n in (0, 3)} for t in range(3)]
    del frames[1][3]["world"]
    write_people(tmp_path / "a.json", layout, [f"k{j}" for j in range(len(FORMATS[layout]))], frames)
    people = load_people(tmp_path / "a.json")
    for number, first in ((0, 0), (3, 0), (3, 1)):
        track = people.one(str(number), first=first)
        assert track.world is not None
        for pixels, world, frame in zip(track.pixels, track.world, frames[first:], strict=True):
            np.testing.assert_array_equal(pixels, np.array(frame[number]["keypoints"])[:, :2])
            np.testing.assert_array_equal(world, frame[number].get("world", np.full((len(world), 3), np.nan)))
        write_keypoints(tmp_path / "b.json", track)
        np.testing.assert_array_equal(load_keypoints(tmp_path / "b.json").world, track.world)
    bare = [{"keypoints": frame[0]["keypoints"]} for frame in frames]
    assert load_keypoints(written(tmp_path / "c.json", bare, layout)).world is None


@pytest.mark.parametrize(
    ("world", "message"),
    [
        ([[0.0, 0.0, 0.0]] * 16, "17 x 3 numbers are needed, found 16 x 3"),
        ([[0.0, 0.0]] * 17, "17 x 3 numbers are needed, found 17 x 2"),
        ([[0.0, 0.0, 0.0]] * 16 + [[0.0, float("nan"), 0.0]], "not finite"),
        ([[0.0, 0.0, 0.0]] * 16 + [[0.0, 0.0, -3.5]], r"has 3\.5 m from the hips, at most 3 m is taken"),
        ("near", "numbers are needed, found text"),
    ],
)
def test_an_invalid_world_is_refused_with_its_place(tmp_path: Path, world: Any, message: str) -> None:
    person = {**drawn("coco17", 0), "world": world}
    path = written(tmp_path / "a.json", [drawn("coco17", 1), person])
    with pytest.raises(InputError, match=rf"a\.json: frame 1, person 0, world: .*{message}"):
        load_keypoints(path)
    written(path, [{"people": [{"id": 4, **drawn("coco17", 2)}, {"id": 5, **person}]}])
    with pytest.raises(InputError, match=rf"a\.json: frame 0, person 1, world: .*{message}"):
        load_keypoints(path)


def test_a_member_like_it_is_still_refused(tmp_path: Path) -> None:
    content = drawn("coco17", 0)
    content["worlds"] = content.pop("world")
    with pytest.raises(InputError, match=r"frame 0: the member 'worlds' is unknown .did you mean world"):
        load_keypoints(written(tmp_path / "a.json", [content]))


def tracked(*seeds: int | None, layout: str = "mediapipe33") -> KeypointTrack:
    """A frame for each seed, without a world for None."""
    people = [drawn(layout, seed or 0) for seed in seeds]
    points = np.array([person["keypoints"] for person in people])
    world = np.array([person["world"] for person in people])
    world[[seed is None for seed in seeds]] = np.nan
    return KeypointTrack(layout, FORMATS[layout], points[..., :2], points[..., 2], (640, 480), world=world)


def observed(*tracks: KeypointTrack, times: np.ndarray) -> list[Observation]:
    names = [f"cam{c}" for c in range(len(tracks))]
    cameras = {name: guessed_camera(name, (640, 480)) for name in names}
    return assemble(BODY, dict(zip(names, tracks, strict=True)), cameras, times)


@pytest.mark.parametrize("layout", ["mediapipe33", "coco17"])
def test_an_observation_has_the_world_of_its_only_camera(layout: str) -> None:
    track, times = tracked(1, None, 2, layout=layout), np.arange(4) / 30.0
    observations = observed(track, times=times)
    assert [o.lifted is not None for o in observations] == [True, False, True, False]
    mirror = mirror_index(NAMES)
    for t in (0, 2):
        lifted, other = observations[t].lifted, observations[t].exchanged(mirror).lifted
        assert lifted is not None
        assert other is not None
        assert track.world is not None
        for i, name in enumerate(NAMES):
            there = name in track.names
            expected = track.world[t, track.names.index(name)] if there else np.full(3, np.nan)
            np.testing.assert_array_equal(lifted.points[i], expected)
            np.testing.assert_array_equal(other.points[mirror[i]], expected)
    assert all(o.lifted is None for o in observed(track, track, times=times))


def test_of_frames_that_are_alike_one_counts() -> None:
    """The first, and the one 0.3 s later; every frame if processed alone."""
    times = np.array([0.0, 0.1, 0.15, 0.3, 0.5, 1.0])
    observations = observed(tracked(1, 2, None, 3, 4, 5), times=times)
    shares = [o.lifted.share for o in observations if o.lifted is not None]
    assert shares == [1.0, 0.0, 1.0, 0.0, 1.0]
    assert {o.alone.lifted.share for o in observations if o.alone.lifted is not None} == {1.0}


def test_between_two_frames_the_nearer_ones_counts() -> None:
    track = tracked(1, 2, 3)
    placed = at_places(track, np.array([0.2, 0.8, np.nan, 2.0]), np.arange(3) / 30.0)
    assert track.world is not None
    nothing = np.full_like(track.world[0], np.nan)
    np.testing.assert_array_equal(placed.world, [track.world[0], track.world[1], nothing, track.world[2]])
    bare = at_places(replace(track, world=None), np.array([0.2, 0.8]), np.arange(3) / 30.0)
    assert bare.world is None


AHEAD = camera_at(0.0)
ASIDE = camera_at(200.0, aim=(0.9, -1.1, 0.4))  # sees the person near its picture's edge
FLAT = parallel_camera("flat", (640, 480), 180.0, np.zeros(3), azimuth=1.9)


def lifted_by(camera: Camera, q: np.ndarray, scale: float = 1.0, body: Any = BODY) -> Observation:
    """Keypoints of a pose and the result of a perfect network: the person as seen on the optical axis, of another
    size."""
    seen = observe(body, q, (camera,))
    points = body.landmarks(body.at(q)) @ camera.R_camera_world.T
    if not camera.parallel:
        ends = [i for i, name in enumerate(body.landmark_names) if any(name in bone for bone in BONES)]
        ray = camera.directions(seen.pixels[0, ends].mean(axis=0))
        axis = np.cross(ray, [0.0, 0.0, 1.0])
        axis *= np.arctan2(np.linalg.norm(axis), ray[2]) / np.linalg.norm(axis)
        points = points @ pin.exp3(axis).T
    return replace(seen, lifted=LiftedPose(scale * points - 0.3))


@pytest.mark.parametrize("name", ["human34", "upper13"])
@pytest.mark.parametrize("camera", [AHEAD, ASIDE, FLAT], ids=["ahead", "aside", "parallel"])
def test_a_perfect_pose_has_no_energy_where_it_is_seen(name: str, camera: Camera) -> None:
    """For any size from the network; without the rotation to the ray there is energy at the picture's edge."""
    body, rng = body_of(name), np.random.default_rng(3)
    q = random_pose(body, rng, share=0.5, turn=0.5)
    seen = lifted_by(camera, q, 1.3, body)
    (term,) = lifted_directions(body, seen, 0.3)
    gradient = np.zeros(body.nv)
    value = term.accumulate(body.at(q), gradient, np.zeros((body.nv, body.nv)))
    np.testing.assert_allclose([value, *gradient], 0.0, atol=1e-9)
    points = body.landmarks(body.at(q)) @ camera.R_camera_world.T
    (plain,) = lifted_directions(body, replace(seen, lifted=LiftedPose(points)), 0.3)
    assert camera is not ASIDE or plain.value(body.at(q)) > 0.1


def test_eleven_bones_of_a_person_each_with_its_spread() -> None:
    """A forearm turned by a small angle in the picture plane and out of it, for a camera in front."""
    q = BODY.neutral
    seen, axes = lifted_by(FLAT, q), np.eye(3)
    assert len(BONES) == len({frozenset(bone) for bone in BONES}) == 11
    elbow, wrist = (NAMES.index(f"left_{name}") for name in ("elbow", "wrist"))
    assert seen.lifted is not None
    bone = seen.lifted.points[wrist] - seen.lifted.points[elbow]
    for axis, std in ((axes[2], ACROSS), (np.cross(bone, axes[2]) / np.linalg.norm(np.cross(bone, axes[2])), None)):
        points = seen.lifted.points.copy()
        points[wrist] = points[elbow] + pin.exp3(0.01 * axis) @ bone
        e = (points[wrist] - points[elbow] - bone) / np.linalg.norm(bone)
        expected = np.hypot(np.linalg.norm(e[:2]) / ACROSS, e[2] / ALONG["elbow"]) ** 2
        assert std is None or expected == pytest.approx((np.linalg.norm(e) / std) ** 2)
        for share, sure in ((1.0, 1.0), (0.25, 0.6)):
            confidence = seen.confidence.copy()
            confidence[0, wrist] = sure
            given = replace(seen, confidence=confidence, lifted=LiftedPose(points, share))
            (term,) = lifted_directions(BODY, given, 0.3)
            assert term.value(BODY.at(q)) == pytest.approx(0.5 * 0.3 * share * sure * expected, rel=1e-3)


def test_nothing_is_drawn_where_nothing_is_known() -> None:
    seen = lifted_by(AHEAD, BODY.neutral)
    assert seen.lifted is not None
    nowhere = LiftedPose(np.full_like(seen.lifted.points, np.nan))
    others = (
        replace(seen, lifted=None), replace(seen, lifted=seen.lifted._replace(share=0.0)),
        replace(seen, lifted=nowhere), replace(seen, confidence=np.zeros_like(seen.confidence)),
    )  # fmt: skip
    assert [lifted_directions(BODY, other, 0.3) for other in others] == [[]] * 4
    assert lifted_directions(BODY, seen, 0.0) == []
    bare, full = (CostModel(BODY).cost(CostModel(BODY).observation_term(o)).terms for o in (others[0], seen))
    assert [term.name for term in full] == [*(term.name for term in bare), "lifted"]


def test_left_and_right_are_exchanged_with_the_keypoints() -> None:
    """A detection with swapped sides, read with its sides exchanged, equals the correct one."""
    rng = np.random.default_rng(5)
    q, other = random_pose(BODY, rng, share=0.5, turn=0.5), random_pose(BODY, rng, share=0.5, turn=0.5)
    seen, search = lifted_by(AHEAD, q), ModeSearch(CostModel(BODY))
    swapped = seen.exchanged(search.mirror)
    right, wrong, repaired = (
        search.model.cost(term).value_at(other)
        for term in (
            search.term(seen, "as_detected"), search.term(swapped, "as_detected"), search.term(swapped, "exchanged")
        )
    )  # fmt: skip
    assert repaired == pytest.approx(right, rel=1e-12)
    assert wrong > right + 1.0


@pytest.mark.parametrize("seed", [0, 9])
def test_it_determines_the_depth_of_limbs(seed: int) -> None:
    """To one camera an arm that reaches towards it looks like one that reaches away: the best of the first poses is the
    lifted one, though the frame counts little beside the earlier ones, which a first pose does not have."""
    body = body_of("upper13")
    q = body.clamp(random_pose(body, np.random.default_rng(seed), share=0.8))
    seen = lifted_by(camera_at(15.0, distance=3.0), q, 0.9, body)
    assert seen.lifted is not None
    seen = replace(seen, lifted=seen.lifted._replace(share=0.05))

    def off(weight: float) -> float:
        search = ModeSearch(CostModel(body, CostSettings(lifted_weight=weight)))
        best = start_modes(search, np.random.default_rng(0), seen, 4).modes[0]
        return float(np.linalg.norm(body.landmarks(body.at(best.q)) - body.landmarks(body.at(q)), axis=1).max())

    assert off(1.0) < 0.02
    assert off(0.0) > 0.4


@pytest.mark.parametrize("name", ["css-paper", "condensation", "annealed"])
def test_the_trackers_of_the_papers_do_not_use_it(name: str) -> None:
    assert settings_for(name).cost.lifted_weight == 0.0
    assert settings_for("css").cost.lifted_weight > 0.0
