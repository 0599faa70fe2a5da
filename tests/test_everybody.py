"""Everybody in the keypoint files: matched across cameras, one run each, no duplicates and no losses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_people import COCO17, FRAMES, Frames, alone, assert_same, cameras, files, scene
from tiny_clip import QUICK

import kinemode as km
from benchmarks.accuracy.crowd_files import write_mmpose
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile
from estimator.data.formats.keypoints_reading import Person, Reading
from estimator.data.people.everybody import everybody
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from kinemode.inputs.declared import persons_of, wants_all

pytestmark = pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
CAMERAS = ("cam0", "cam1", "cam2")


def numbers(tracks: Mapping[str, KeypointTrack], people: Mapping[str, Frames]) -> set[int]:
    """The person to whom these detections belong, in any camera and frame."""
    rows = {
        person.points[:, :2].tobytes(): number
        for frames in people.values()
        for frame in frames
        for number, person in frame
    }
    return {rows[xy.tobytes()] for track in tracks.values() for xy in track.pixels if np.isfinite(xy).any()}


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("names", [("cam0", "cam1"), ("cam0", "cam1", "cam2", "cam3")])
def test_everybody_is_whole_and_alone(names: tuple[str, ...], seed: int) -> None:
    people = {name: scene(seed)[name] for name in names}
    people_found, notes = everybody(files(people), cameras())
    assert notes == ()
    owners = [numbers(tracks, people) for tracks in people_found]
    assert sorted(n for of in owners for n in of) == [0, 1, 2]
    for tracks, (who,) in zip(people_found, owners, strict=True):
        for name, track in tracks.items():
            assert_same(track, alone(people[name], who))


def test_a_person_hidden_in_a_camera_is_missing_there() -> None:
    people = scene(3, hidden=(1,))
    people_found, _ = everybody(files(people), cameras())
    (of_one,) = (tracks for tracks in people_found if numbers(tracks, people) == {1})
    assert not (of_one["cam3"].confidence > 0.0).any()
    assert (of_one["cam0"].confidence > 0.0).any()


def test_ghosts_and_people_of_one_camera_are_left_out_with_a_note() -> None:
    people = {name: scene(0)[name] for name in CAMERAS}
    brief = {name: [[x for x in f if x[0] != 2 or t < 6] for t, f in enumerate(people[name])] for name in people}
    people_found, notes = everybody(files(brief), cameras())
    assert sorted(next(iter(numbers(tracks, people))) for tracks in people_found) == [0, 1]
    assert [note for note in notes if "one person seen in 6 frames alone, fewer than 10, left out" in note]
    single = {name: [[x for x in f if x[0] != 2 or name == "cam1"] for f in people[name]] for name in people}
    people_found, notes = everybody(files(single), cameras())
    assert len(people_found) == 2
    assert [note for note in notes if note.startswith("cam1: one person in 40 frames whom no other camera sees")]


def test_one_camera_uses_ids_or_following() -> None:
    people = {"cam1": scene(0)["cam1"]}
    people_found, _ = everybody(files(people, {"cam1": {0: "a", 1: "b", 2: "c"}}), cameras())
    for tracks in people_found:
        (who,) = numbers(tracks, people)
        assert_same(tracks["cam1"], alone(people["cam1"], who))
    apart = Reading(Path("a.json"), "coco17", names=COCO17, count=FRAMES)
    points = alone(people["cam1"], 0)
    for t in range(FRAMES):
        apart.add(t, [Person(points[t] + [dx, 0.0, 0.0]) for dx in (0.0, 900.0)[:: 1 if t % 2 else -1]])
    people_found, notes = everybody({"cam1": PeopleFile(apart)}, cameras())
    assert (len(people_found), notes) == (2, ())
    steps = [np.nanmax(np.abs(np.diff(tracks["cam1"].pixels[..., 0], axis=0))) for tracks in people_found]
    assert max(steps) < 600.0


def test_all_is_for_all_cameras_alone() -> None:
    assert wants_all("all")
    assert wants_all(("all",))
    assert not wants_all(("all", "cam0=1"))
    for given in ("all", ["cam0=all"], {"cam0": "all"}, ["all", "cam0=1"]):
        with pytest.raises(InputError, match="all means everyone"):
            persons_of(given, CAMERAS)


@cache
def walkers() -> dict[str, Frames]:
    """Two of the three for a few frames, the second only for the later ones."""
    return {
        name: [[x for x in f if x[0] == 0 or (x[0] == 2 and t >= 2)] for t, f in enumerate(scene(0)[name][:6])]
        for name in CAMERAS
    }


def tracked(folder: Path, people: Mapping[str, Frames], **more: Any) -> dict[str, Run]:
    keypoints = {
        name: write_mmpose(folder / f"{name}.json", [[p for _, p in f] for f in frames])
        for name, frames in people.items()
    }
    write_cameras(folder / "cameras.json", list(cameras().values()))
    runs = km.track(
        "human34", None, keypoints=keypoints, cameras=folder / "cameras.json", person="all", fit="off", fps=20.0,
        settings=QUICK, **more,
    )  # fmt: skip
    assert isinstance(runs, dict)
    return runs


def test_each_has_a_run_of_their_own_that_can_be_resumed(tmp_path: Path) -> None:
    runs = tracked(tmp_path, walkers(), out=tmp_path / "walk.run")
    assert list(runs) == ["person1", "person2"]
    assert sorted(path.name for path in tmp_path.glob("*.run")) == ["walk.person1.run", "walk.person2.run"]
    by_length = sorted(runs.values(), key=len)
    assert [len(run) for run in by_length] == [4, 6]
    np.testing.assert_allclose(by_length[0].time, np.arange(2, 6) / 20.0)  # on the clock of all
    place = {run.header.settings["person"]: run.q[:, :2].mean(axis=0) for run in runs.values()}
    assert set(place) == {"all: person1", "all: person2"}
    assert np.linalg.norm(np.subtract(*place.values())) > 0.5
    with pytest.raises(InputError, match=r"walk\.person1\.run.*exists already"):
        tracked(tmp_path, walkers(), out=tmp_path / "walk.run")
    before = {name: run.q.copy() for name, run in runs.items()}
    (tmp_path / "walk.person2.run").unlink()
    again = tracked(tmp_path, walkers(), out=tmp_path / "walk.run", resume=True)
    for name, run in again.items():
        np.testing.assert_array_equal(run.q, before[name])


def test_one_untrackable_person_does_not_lose_the_others(tmp_path: Path) -> None:
    """The run of the first person, to be resumed, is not a run file."""
    (tmp_path / "walk.person1.run").write_text("no run")
    with pytest.warns(km.InputWarning, match=r"person1 is not tracked, the others are: .*walk\.person1\.run"):
        runs = tracked(tmp_path, walkers(), out=tmp_path / "walk.run", resume=True)
    assert list(runs) == ["person2"]
    assert (tmp_path / "walk.person1.run").read_text() == "no run"
