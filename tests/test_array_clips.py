"""Clips and keypoints given as arrays or iterators give the same result as files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from tiny_clip import QUICK, tiny_clip

import kinemode as km
from estimator.data.media.clip import Clip
from tests.tiers import later

pytestmark = pytest.mark.filterwarnings("ignore::kinemode.InputWarning", "ignore::kinemode.FindingWarning")
FRAMES, FPS = 4, 5.0


class Given(NamedTuple):
    """A clip as arrays: its camera's name, pictures (T, H, W, 3), keypoints (T, K, 3); and the rest of `km.track`."""

    name: str
    pictures: np.ndarray
    points: np.ndarray
    rest: dict[str, Any]
    run: km.Run


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Given:
    """The same with a run from files: a folder of pictures, which is lossless too."""
    folder = tmp_path_factory.mktemp("clip")
    clip = tiny_clip(folder, frames=FRAMES, fps=FPS)
    ((name, video),) = clip.videos.items()
    seen = km.load_keypoints(clip.keypoints[name])
    points = np.concatenate([seen.pixels, seen.confidence[..., None]], axis=2)
    pictures = np.array(list(Clip.open(video).frames()))
    rest = {"cameras": clip.cameras, "cues": "edges,flow,silhouette", "settings": QUICK, "fit": "off"}
    files = folder / "pictures"
    files.mkdir()
    for i, picture in enumerate(pictures):
        cv2.imwrite(str(files / f"{i}.bmp"), picture)
    run = km.track(clip.subject, {name: files}, keypoints=clip.keypoints, fps=FPS, **rest)
    rest |= {"subject": clip.subject, "fps": FPS, "layout": seen.layout}
    return Given(name, pictures, points, rest, run)


def ways(given: Given) -> Iterator[tuple[Any, Any]]:
    """The same clip and keypoints, in each accepted form."""
    yield given.pictures, given.points
    yield (picture.copy() for picture in given.pictures), given.points
    yield {given.name: (picture for picture in given.pictures)}, {given.name: given.points}
    yield list(given.pictures), given.points


@pytest.mark.parametrize("way", later(range(4), 2, 3))
def test_arrays_and_iterators_are_as_good_as_files(given: Given, way: int) -> None:
    clips, keypoints = list(ways(given))[way]
    run = km.track(clips=clips, keypoints=keypoints, **given.rest)
    assert np.array_equal(run.mode_q, given.run.mode_q, equal_nan=True)
    assert np.array_equal(run.pixels, given.run.pixels, equal_nan=True)
    assert np.array_equal(run.q, given.run.q)
    assert np.array_equal(run.time, given.run.time)


def test_a_run_keeps_the_pictures_that_it_was_given(given: Given, tmp_path: Path) -> None:
    rest = {**given.rest, "cues": "edges"}
    run = km.track(clips=given.pictures, keypoints=given.points, **rest)
    folder = Path(str(run.header.clips[given.name])).parent
    assert np.array_equal(Clip.open(folder / "clip").frame(2), given.pictures[2])
    km.overlay(run, tmp_path / "o.gif")
    del run
    assert not folder.exists()
    kept = km.track(clips=given.pictures, keypoints=given.points, out=tmp_path / "a.run", **rest)
    assert not Path(str(kept.header.clips[given.name])).exists()


def test_keypoints_alone_and_the_fit_take_arrays_too(given: Given) -> None:
    rest = {name: given.rest[name] for name in ("cameras", "fps", "layout")}
    two = given.points[..., :2]  # without confidences
    run = km.track(given.rest["subject"], None, keypoints=two, settings=QUICK, **rest)
    assert np.array_equal(run.time, np.arange(FRAMES) / FPS)
    assert set(np.unique(run.confidence)) <= {0.0, 1.0}
    fitted = km.fit("human34", None, keypoints={given.name: given.points}, **rest)
    assert len(fitted.subject.proportions) > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"clips": np.zeros((2, 4, 4), np.uint8)}, r"^clips: has the shape \(2, 4, 4\)"),
        ({"clips": np.zeros((2, 4, 4, 3))}, r"^clips: frame 0: has the shape \(4, 4, 3\) and type float64"),
        ({"clips": np.zeros((0, 4, 4, 3), np.uint8)}, "^clips: has no picture"),
        ({"clips": {"a": iter([np.zeros((4, 4, 3), np.uint8), None])}}, r"^clips\['a'\]: frame 1: cannot be None"),
        (
            {"clips": (np.zeros((4 + i, 4, 3), np.uint8) for i in range(2))},
            r"^clips: frame 1: has the shape \(5, 4, 3\), those before \(4, 4, 3\)",
        ),
        ({"clips": {"a/b": np.zeros((2, 4, 4, 3), np.uint8)}}, "^a/b: is not a valid camera name"),
        ({"clips": 3}, "^clips: cannot be of type int .*array"),
        ({"keypoints": np.zeros((4, 17))}, r"^keypoints: has the shape \(4, 17\)"),
        ({"keypoints": {"a": np.zeros((4, 5, 3))}}, r"^keypoints\['a'\]: 5 keypoints fit no layout .*coco17 \(17\)"),
        ({"keypoints": np.zeros((4, 5, 3)), "layout": ["nose", "neck"]}, "has 5 keypoints, the layout named 2"),
        ({"keypoints": None, "layout": "coco17"}, "^layout: is of keypoints in arrays"),
    ],
)
def test_wrong_arrays_are_named_by_their_argument(changes: dict[str, Any], message: str) -> None:
    given = {"clips": None, "keypoints": None, **changes}
    with pytest.raises(km.InputError, match=message):
        km.track("human34", **given)
