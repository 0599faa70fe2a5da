"""Several people in several cameras: all people are followed, and one person is chosen in all cameras."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import BROWN, body_of, camera_at

from benchmarks.accuracy.crowd_files import write_mmpose, write_openpose
from estimator.data.cameras.camera import Camera
from estimator.data.cameras.epipolar import meeting_points
from estimator.data.formats import people_tracks
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile
from estimator.data.formats.keypoints_reading import Person, Reading
from estimator.data.formats.people_tracks import link
from estimator.data.people.across_cameras import subject_tracks
from estimator.data.people.choice_of_subject import exchange_pieces, grouped
from estimator.synthesis.detector import crowd, placed
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import PIVOT, REACH, TURN_REACH
from humanoid.subject.landmarks import COCO17
from humanoid.support.errors import InputError
from kinemode.inputs.declared import persons_of, plain
from kinemode.inputs.load import load_inputs
from kinemode.request import FileOptions

FRAMES, FPS = 40, 20.0
Frames = list[list[tuple[int, Person]]]


@cache
def cameras() -> dict[str, Camera]:
    """Four cameras around the middle of the world, with lens distortion."""
    made = {}
    for c, (azimuth, distance, height) in enumerate(((20, 4.6, 1.4), (95, 5.2, 1.1), (190, 4.9, 1.8), (280, 5.5, 1.3))):
        seen = camera_at(azimuth, distance=distance, focal=620.0, height=height, aim=(0, 0, 1.0), distortion=BROWN)
        made[f"cam{c}"] = Camera(f"cam{c}", *list(vars(seen).values())[1:])
    return made


@cache
def people() -> tuple[np.ndarray, ...]:
    """Three people; the first two walk past each other, 0.7 m apart."""
    times, body = np.arange(FRAMES) / FPS, body_of("human34")
    walk = np.linspace(-1.0, 1.0, FRAMES)[:, None] * [1.0, 0.0]
    motions = (authored_motion(body, times, m) for m in (REACH, PIVOT, TURN_REACH))
    paths = (walk, np.array([0.0, 0.7]) - walk, np.array([0.2, -0.9]))
    return tuple(placed(q, path, turn) for q, path, turn in zip(motions, paths, (0.3, 2.0, 4.0), strict=True))


@cache
def scene(seed: int, hidden: tuple[int, ...] = ()) -> dict[str, Frames]:
    """Detections of the three in random order; the last camera misses some of them."""
    rng = np.random.default_rng(seed)
    return crowd(body_of("human34"), people(), list(cameras().values()), rng, hidden={"cam3": hidden})


def files(everybody: Mapping[str, Frames], ids: Mapping[str, Mapping[int, str]] | None = None) -> dict[str, PeopleFile]:
    """Keypoint files as read, with ids by camera and person if given."""
    made = {}
    for name, frames in everybody.items():
        reading = Reading(Path(name), "coco17", names=COCO17, count=len(frames), image_size=(640, 480), fps=FPS)
        for t, frame in enumerate(frames):
            reading.add(t, [Person(p.points, (ids or {}).get(name, {}).get(n)) for n, p in frame])
        made[name] = PeopleFile(reading)
    return made


def alone(frames: Frames, number: int) -> np.ndarray:
    """Keypoints (T, J, 3) of one person without the others."""
    points: np.ndarray = np.full((len(frames), len(COCO17), 3), [np.nan, np.nan, 0.0])
    for t, frame in enumerate(frames):
        for n, person in frame:
            if n == number:
                points[t] = person.points
    return points


def assert_same(track: KeypointTrack, points: np.ndarray) -> None:
    np.testing.assert_array_equal(np.concatenate([track.pixels, track.confidence[..., None]], axis=-1), points)


def chosen_person(tracks: Mapping[str, KeypointTrack], everybody: Mapping[str, Frames]) -> int:
    """The one person chosen in all cameras, with every detection used."""
    fits = [
        n
        for n in range(len(people()))
        if all(np.array_equal(t.pixels, alone(everybody[c], n)[..., :2], equal_nan=True) for c, t in tracks.items())
    ]
    assert len(fits) == 1
    return fits[0]


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("names", [("cam0", "cam1"), ("cam1", "cam2", "cam3"), ("cam0", "cam1", "cam2", "cam3")])
def test_all_cameras_take_the_same_person(names: tuple[str, ...], seed: int) -> None:
    everybody = {name: scene(seed)[name] for name in names}
    tracks, notes = subject_tracks(files(everybody), cameras(), {})
    chosen_person(tracks, everybody)
    assert "see the same person" in notes[0]
    assert len(notes) == 1 + len(names)


def test_each_file_alone_takes_several() -> None:
    """The reason to choose across cameras."""
    everybody = scene(0)
    taken = {name: file.one() for name, file in files(everybody).items()}
    best = {
        max(range(3), key=lambda n, t=track, f=everybody[name]: np.sum(t.pixels == alone(f, n)[..., :2]))  # type: ignore[misc]
        for name, track in taken.items()
    }
    assert len(best) > 1


def test_ids_that_change_owners_are_seen_through() -> None:
    everybody = scene(2)
    made = files(everybody, {name: {0: "7", 1: "8", 2: "9"} for name in everybody})
    for name, turn in (("cam0", 12), ("cam2", 25)):
        frames = made[name].reading.frames
        for t in range(turn, FRAMES):
            frames[t] = [Person(p.points, {"7": "8", "8": "7"}.get(str(p.id), p.id)) for p in frames[t]]
    tracks, notes = subject_tracks(made, cameras(), {})
    who = chosen_person(tracks, everybody)
    assert who == 1  # one of the two whose ids changed
    taken = {note.split(":")[0]: note.split(": ")[1].split(" of ")[0] for note in notes[1:]}
    assert taken == {"cam0": "id 7, 8", "cam1": "id 8", "cam2": "id 7, 8", "cam3": "id 8"}


@pytest.mark.parametrize("person", [0, 1, 2])
def test_a_choice_in_one_camera_determines_the_others(person: int) -> None:
    everybody = scene(3, hidden=(1,))
    made = files(everybody, {"cam1": {0: "a", 1: "b", 2: "c"}})
    tracks, notes = subject_tracks(made, cameras(), {"cam1": "abc"[person]})
    assert chosen_person(tracks, everybody) == person
    empty = not (tracks["cam3"].confidence > 0.0).any()
    assert empty == (person == 1)  # no person rather than the wrong one
    assert ("cam3: no one in it fits" in notes[-1]) == empty
    others = dict.fromkeys(("cam0", "cam2", "cam3"), 0)  # all given: used, with a note where they disagree
    _, notes = subject_tracks(made, cameras(), {**others, "cam1": "abc"[person]})
    assert any("its person is not where" in note for note in notes)
    with pytest.raises(InputError, match="ids in it: a, b, c"):
        subject_tracks(made, cameras(), {"cam1": "d"})


def test_no_person_fits() -> None:
    everybody = {
        "cam0": [[x for x in f if x[0] < 2] for f in scene(0)["cam0"]],
        "cam3": [[x for x in f if x[0] == 2] for f in scene(0)["cam3"]],
    }
    _, notes = subject_tracks(files(everybody), cameras(), {})  # close people may count as one, but with a note
    assert "but their rays miss each other" in notes[0]
    half = [0.5, 0.5, 1.0]  # keypoints of a smaller picture
    halved = {
        "cam0": everybody["cam0"],
        "cam3": [[(n, Person(p.points * half)) for n, p in f] for f in everybody["cam3"]],
    }
    with pytest.raises(InputError, match="none is seen by two cameras"):
        subject_tracks(files(halved), cameras(), {})
    some = {"cam0": [[x for x in f if x[0] == 1] for f in everybody["cam0"]], "cam3": halved["cam3"]}
    tracks, notes = subject_tracks(files(some), cameras(), {})  # nothing to choose: used, with a note
    assert_same(tracks["cam0"], alone(everybody["cam0"], 1))
    assert len(notes) == 1
    assert "its person is not where cam3 sees one" in notes[0]
    same = {name: [[x for x in f if x[0] == 1] for f in frames] for name, frames in scene(0).items()}
    assert subject_tracks(files(same), cameras(), {})[1] == ()


def test_frames_are_matched_by_time() -> None:
    """A camera of half the rate that began 0.2 s after the others."""
    everybody = scene(1)
    late = {"cam0": everybody["cam0"], "cam1": everybody["cam1"][4::2]}
    times = {"cam0": np.arange(FRAMES) / FPS, "cam1": 0.2 + np.arange(len(late["cam1"])) * 2.0 / FPS}
    tracks, _ = subject_tracks(files(late), cameras(), {}, times)
    chosen_person(tracks, late)


def test_a_crowd_is_followed_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """All pairs of a frame are compared in one call, and only close ones."""
    compared, distances = [], people_tracks._distances

    def counted(*of: Any) -> np.ndarray:
        compared.append(len(of[-1]))
        return distances(*of)

    monkeypatch.setattr(people_tracks, "_distances", counted)
    rng, count = np.random.default_rng(0), 100
    shape = rng.uniform(-1.0, 1.0, (count, 26, 2)) * [15.0, 40.0]
    grid = np.stack(np.meshgrid(np.arange(20), np.arange(5)), axis=-1).reshape(-1, 2) * [60.0, 150.0]
    frames = {}
    for t in range(20):
        xy = shape + grid[:, None] + t * 3.0 + rng.normal(0.0, 1.0, shape.shape)
        order = rng.permutation(count)
        frames[t] = [Person(np.column_stack([xy[n], np.full(26, 0.9)]), str(n)) for n in order]
    tracks = link(frames)
    assert len(compared) == len(frames) - 1
    assert max(compared) < 5 * count
    assert len(tracks) == count
    assert all(len({p.id for p in track.people.values()}) == 1 and len(track.people) == 20 for track in tracks)


def test_where_two_people_may_have_changed_places_is_known() -> None:
    """Two people pass through each other in the image: the link is doubtful where they are close, and only there."""
    rng = np.random.default_rng(1)
    shape = rng.uniform(-1.0, 1.0, (17, 2)) * [30.0, 80.0]
    frames = {
        t: [
            Person(np.column_stack([rng.normal(shape + np.array([x, 0.0])), np.ones(17)]))
            for x in (9.0 * t, 360.0 - 9.0 * t)
        ]
        for t in range(41)
    }
    doubtful = set.union(*(track.doubtful for track in link(frames)))
    assert 20 in doubtful
    assert doubtful <= set(range(16, 26))


def test_a_jump_within_one_file_is_reported() -> None:
    a, b = (alone(scene(0)["cam0"], n) for n in (0, 2))
    reading = Reading(Path("a.json"), "coco17", names=COCO17, count=FRAMES)
    for t in range(FRAMES):
        reading.add(t, [Person((a if t < 15 else b)[t], "1"), Person(b[t] + [400.0, 0.0, 0.0], "2")])
    jumped = PeopleFile(reading).one("1")
    assert [note for note in jumped.notes if "jump to another person" in note and "(15)" in note]
    assert not any("jump" in note for note in PeopleFile(reading).one("2").notes)


def test_groups_of_the_strongest_bonds_and_their_exchange() -> None:
    bonds = np.array([[0, 5, -9, 1.0], [5, 0, 1, -9], [-9, 1, 0, 4], [1, -9, 4, 0]])
    np.testing.assert_array_equal(grouped(bonds), [0, 0, 1, 1])
    # a greedy choice joins 0 with 3 first, although 0 1 and 2 3 are worth more together
    bonds = np.array([[0, 5, -9, 6.0], [5, 0, 1, -9], [-9, 1, 0, 5], [6, -9, 5, 0]])
    greedy = grouped(bonds)
    assert greedy[0] == greedy[3]
    labels = exchange_pieces(bonds, greedy, int(greedy[0]), np.array([0, 1, 0, 1]), np.zeros(4))
    assert labels[0] == labels[1] != labels[2] == labels[3]
    camera = np.array([-1, -1, -1, -1])
    np.testing.assert_array_equal(exchange_pieces(bonds, greedy, int(greedy[0]), camera, np.zeros(4)), greedy)


def test_rays_are_what_projects_and_meet_where_they_came_from() -> None:
    points = np.random.default_rng(0).normal([0.0, 0.0, 1.0], 0.6, (9, 3))
    used = list(cameras().values())[:3]
    directions = np.stack([camera.directions(camera.project(points)) for camera in used])
    for camera, rays in zip(used, directions, strict=True):
        exact = points @ camera.R_camera_world.T + camera.t_camera_world
        np.testing.assert_allclose(rays, exact / exact[:, 2:], atol=1e-4)
    directions[1:, 4] = np.nan
    met = meeting_points(used, directions)
    np.testing.assert_allclose(np.delete(met, 4, axis=0), np.delete(points, 4, axis=0), atol=1e-3)
    assert np.isnan(met[4]).all()
    assert np.isnan(used[0].directions(np.array([np.nan, 3.0]))).all()


def test_the_person_that_the_user_names() -> None:
    names = ("cam01", "cam02")
    assert persons_of("auto", names) == persons_of(("auto",), names) == {"cam01": "auto", "cam02": "auto"}
    assert persons_of(2, names) == persons_of("2", names) == {"cam01": "2", "cam02": "2"}
    assert persons_of(["cam02=7"], names) == persons_of({"cam02": 7}, names) == {"cam01": "auto", "cam02": "7"}
    assert persons_of(["1", "cam01=2"], names) == {"cam01": "2", "cam02": "1"}
    assert (plain(("auto",)), plain(3), plain({"cam01": 3})) == ("auto", 3, {"cam01": "3"})
    for given, problem in (
        ("cam03=1", "there is no camera 'cam03'.*cameras: cam01, cam02"),
        ({"left": 1}, "there is no camera 'left'"),
        (["cam01=1", "cam01=2"], "'cam01' is given 1 and 2"),
        (["1", "2"], "'cam01' is given 1 and 2"),
        ("cam01=", "'' cannot be used .auto, an id"),
    ):
        with pytest.raises(InputError, match=problem):
            persons_of(given, names)


def test_tracked_from_several_people_as_from_one(tmp_path: Path) -> None:
    """Files in, observations out: equal to those of the person alone, to the bit, with notes."""
    everybody = {name: scene(0)[name] for name in ("cam0", "cam1", "cam2")}
    who = chosen_person(subject_tracks(files(everybody), cameras(), {})[0], everybody)
    body, everyone, lone = body_of("human34"), {}, {}
    for name, frames in everybody.items():
        shown = [[p for _, p in frame] for frame in frames]
        everyone[name] = write_openpose(tmp_path / name, shown)
        shown = [[p for n, p in frame if n == who] for frame in frames]
        lone[name] = write_mmpose(tmp_path / f"{name}.json", shown)
    chosen = load_inputs(body, FileOptions(None, keypoints=everyone, cameras=cameras()))
    alone_there = load_inputs(body, FileOptions(None, keypoints=lone, cameras=cameras()))
    for ours, theirs in zip(chosen.observations, alone_there.observations, strict=True):
        np.testing.assert_array_equal(ours.pixels, theirs.pixels)
        np.testing.assert_array_equal(ours.confidence, theirs.confidence)
        assert ours.jitter == theirs.jitter
    assert any("cam0, cam1, cam2 see the same person" in note for note in chosen.notes)
    assert not any("person" in note for note in alone_there.notes)
    with pytest.raises(InputError, match="there is no camera 'cam9'"):
        load_inputs(body, FileOptions(None, keypoints=everyone, cameras=cameras(), person="cam9=1"))
