"""A pose in space beside the keypoints: read from files, brought to observations, and weak evidence of a pose."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.data.cameras.camera import guessed_camera
from estimator.data.formats.keypoints import KeypointTrack, load_keypoints, load_people, write_keypoints
from estimator.data.formats.people_file import write_people
from estimator.data.observation import Observation
from estimator.data.sequence import assemble
from estimator.data.timing import at_places
from humanoid.subject.landmarks import FORMATS, mirror_index
from humanoid.support.errors import InputError
from tests.builders import body_of

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
    """Whoever is chosen, whichever frame is the first, and through a file written again; a frame without has none."""
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
    ("world", "said"),
    [
        ([[0.0, 0.0, 0.0]] * 16, "17 x 3 numbers are needed, found 16 x 3"),
        ([[0.0, 0.0]] * 17, "17 x 3 numbers are needed, found 17 x 2"),
        ([[0.0, 0.0, 0.0]] * 16 + [[0.0, float("nan"), 0.0]], "not finite"),
        ([[0.0, 0.0, 0.0]] * 16 + [[0.0, 0.0, -3.5]], r"has 3\.5 m from the hips, at most 3 m is taken"),
        ("near", "numbers are needed, found text"),
    ],
)
def test_a_world_that_cannot_be_is_refused_by_its_place(tmp_path: Path, world: Any, said: str) -> None:
    person = {**drawn("coco17", 0), "world": world}
    path = written(tmp_path / "a.json", [drawn("coco17", 1), person])
    with pytest.raises(InputError, match=rf"a\.json: frame 1, person 0, world: .*{said}"):
        load_keypoints(path)
    written(path, [{"people": [{"id": 4, **drawn("coco17", 2)}, {"id": 5, **person}]}])
    with pytest.raises(InputError, match=rf"a\.json: frame 0, person 1, world: .*{said}"):
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


def test_a_frame_counts_as_much_as_is_new_in_it() -> None:
    """All of it in the first and after a gap, and if it is looked at alone."""
    times = np.array([0.0, 0.1, 0.15, 0.25, 1.0])
    observations = observed(tracked(1, 2, None, 3, 4), times=times)
    shares = [o.lifted.share for o in observations if o.lifted is not None]
    np.testing.assert_allclose(shares, [1.0, 1 / 3, 0.5, 1.0])
    assert {o.alone.lifted.share for o in observations if o.alone.lifted is not None} == {1.0}


def test_between_two_frames_the_nearer_ones_counts() -> None:
    track = tracked(1, 2, 3)
    placed = at_places(track, np.array([0.2, 0.8, np.nan, 2.0]), np.arange(3) / 30.0)
    assert track.world is not None
    nothing = np.full_like(track.world[0], np.nan)
    np.testing.assert_array_equal(placed.world, [track.world[0], track.world[1], nothing, track.world[2]])
    bare = at_places(replace(track, world=None), np.array([0.2, 0.8]), np.arange(3) / 30.0)
    assert bare.world is None
