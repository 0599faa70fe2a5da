"""`kinemode.Tracker`: frame by frame it equals the run of `kinemode.track`, to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from builders import body_of, camera_at, observe
from tiny_clip import FEW_STARTS, QUICK, tiny_clip

import kinemode as km
from estimator.data.cameras.camera import Camera
from estimator.data.media.clip import Clip
from estimator.synthesis.motion import authored_motion
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.smoothing import FixedLag, SmoothSettings
from kinemode.streams.step import Step
from tests.tiers import later

pytestmark = pytest.mark.filterwarnings("ignore::kinemode.InputWarning", "ignore::kinemode.FindingWarning")
FPS, FRAMES, LAG = 25.0, 11, 3
BLIND = (0, 6)  # no person is seen in these frames
FILTERED = {"smooth": {"enabled": False}}  # compared without smoothing
FEW: dict[str, Any] = {
    "css": {"samples": 4, "budget": {"searches": 12}, "modes": 3},
    "search": FEW_STARTS,
    **FILTERED,
}


class Seen(NamedTuple):
    """Keypoints (T, K, 3) of each camera by name, as arrays, from which the run was made."""

    cameras: dict[str, Camera]
    points: dict[str, np.ndarray]
    run: km.Run

    def frame(self, i: int) -> dict[str, np.ndarray | None]:
        return {name: None if i in BLIND else points[i] for name, points in self.points.items()}

    def jitter(self) -> dict[str, float]:
        return dict(zip(self.cameras, self.run.observation(0).jitter, strict=True))


def seen_from(folder: Path, azimuths: tuple[float, ...]) -> Seen:
    """human34 seen by cameras with noise, tracked from files."""
    body, rng = body_of("human34"), np.random.default_rng(3)
    views = [camera_at(a, distance=3.5, height=1.0, aim=(0.0, 0.0, 0.9)) for a in azimuths]
    truth = authored_motion(body, 0.4 + np.arange(FRAMES) / FPS)
    shots = [observe(body, q, views, noise=2.0, rng=rng, index=i, time=i / FPS) for i, q in enumerate(truth)]
    pixels = np.array([shot.pixels for shot in shots])
    confidence = rng.uniform(0.5, 1.0, pixels.shape[:3])
    confidence[list(BLIND)] = 0.0
    points = np.concatenate([pixels, confidence[..., None]], axis=-1)
    cameras = {view.name: view for view in views}
    files = {}
    for c, (name, view) in enumerate(cameras.items()):
        files[name] = folder / f"{name}.json"
        pixels_of, seen = np.where(confidence[:, c, :, None] > 0.0, pixels[:, c], np.nan), confidence[:, c]
        track = km.KeypointTrack("named", body.landmark_names, pixels_of, seen, view.image_size, FPS)
        km.write_keypoints(files[name], track)
    run = km.track("human34", None, keypoints=files, cameras=cameras, fit="off", settings=FEW, seed=5)
    return Seen(cameras, {name: points[:, c] for c, name in enumerate(cameras)}, run)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    return seen_from(tmp_path_factory.mktemp("alone"), (15.0,))


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    return seen_from(tmp_path_factory.mktemp("pair"), (15.0, 80.0))


def tracker_of(seen: Seen, **changes: Any) -> km.Tracker:
    given: dict[str, Any] = {"layout": body_of("human34").landmark_names, "settings": FEW, "seed": 5}
    return km.Tracker("human34", cameras=seen.cameras, **{**given, "jitter": seen.jitter(), **changes})


def same(step: Step, run: km.Run, i: int) -> bool:
    """Whether a step equals frame i of a run bit by bit."""
    result = run.result(i)
    assert (step.index, step.time, step.status) == (result.index, result.time, result.status)
    upper = (..., *np.triu_indices(step.body.nv))  # what runs keep, in single precision
    pairs = (
        (step.hypotheses, result.q),
        (step.weights, result.weight),
        (step.covariance[upper].astype(np.float32), result.covariance[upper].astype(np.float32)),
    )
    return all(np.array_equal(ours, theirs) for ours, theirs in pairs)


@pytest.mark.parametrize("which", ["alone", "pair"])
def test_steps_are_the_frames_of_a_run_to_the_bit(which: str, request: pytest.FixtureRequest) -> None:
    seen: Seen = request.getfixturevalue(which)
    tracker = tracker_of(seen)
    steps = [tracker.step(seen.frame(i), time=i / FPS) for i in range(FRAMES)]
    assert tracker.finish() == []
    assert {"tracked", "unobserved"} <= set(seen.run.status)
    for i, step in enumerate(steps):
        assert step is not None
        assert same(step, seen.run, i)
        assert np.array_equal(step.q, seen.run.mode_q[i, 0], equal_nan=True)
    other = tracker_of(seen, seed=6)
    assert not all(same(other.step(seen.frame(i), time=i / FPS), seen.run, i) for i in range(FRAMES))  # type: ignore[arg-type]


def test_with_a_lag_they_come_later_smoothed_and_the_rest_at_the_end(alone: Seen) -> None:
    tracker = tracker_of(alone, lag=LAG)
    given = [tracker.step(alone.frame(i), time=i / FPS) for i in range(FRAMES)]
    late = [step for step in given if step is not None]
    rest = tracker.finish()
    assert [step is None for step in given[:LAG]] == [True] * LAG
    # the first frame has no pose to smooth: it comes in order, and does not delay the others for long
    assert [s.index for s in (*late, *rest)] == list(range(FRAMES))
    assert len(rest) <= LAG + 1
    assert all(same(step, alone.run, i) for i, step in enumerate((*late, *rest)))
    search = make_tracker("css", alone.run.body, settings_for("css", changes=FEW)).search  # type: ignore[attr-defined]
    smoother = FixedLag(search, SmoothSettings(lag=LAG))
    smoothed: dict[int, np.ndarray] = {}
    for i in range(FRAMES):
        smoothed.update(smoother.push(alone.run.observation(i, standing=True), alone.run.result(i)))
    smoothed.update(smoother.flush())
    assert set(smoothed) == set(range(FRAMES)) - {0}
    for step in (*late, *rest)[1:]:
        np.testing.assert_allclose(step.q, smoothed[step.index], atol=1e-6)  # runs keep covariances in single precision
        assert not np.array_equal(step.q, step.hypotheses[0])


@pytest.mark.parametrize("cues", later(["edges,flow", "edges,flow,silhouette"], "edges,flow"))
def test_with_pictures_they_are_the_runs_too(tmp_path: Path, cues: str) -> None:
    """Of the silhouette where a picture of the empty scene is given, which the run then uses too."""
    clip = tiny_clip(tmp_path, frames=4)
    ((name, video),) = clip.videos.items()
    plate = clip.plates if "silhouette" in cues else None
    given: dict[str, Any] = {
        "cameras": clip.cameras,
        "cues": cues,
        "background": plate,
        "settings": {**QUICK, **FILTERED},
    }
    run = km.track(clip.subject, clip.videos, keypoints=clip.keypoints, fit="off", **given)
    seen = km.load_keypoints(clip.keypoints[name])
    points = np.concatenate([seen.pixels, seen.confidence[..., None]], axis=2)
    tracker = km.Tracker(clip.subject, jitter=run.observation(0).jitter[0], layout=seen.layout, **given)
    for i, picture in enumerate(Clip.open(video).frames()):
        step = tracker.step(points[i], picture, time=float(run.time[i]))
        assert step is not None
        assert same(step, run, i)
    with pytest.raises(km.InputError, match=r"picture: has the shape \(8, 8, 3\)"):
        tracker.step(points[0], np.zeros((8, 8, 3), np.uint8), time=9.0)
    with pytest.raises(km.InputError, match="picture: cannot be None"):
        tracker.step(points[0], time=9.0)


def test_keypoint_jitter_is_estimated_from_the_frames_so_far(alone: Seen) -> None:
    """Unless it is given; a run knows its whole clip. Two pixels of noise were added."""
    tracker, still = tracker_of(alone, jitter=None), tracker_of(alone, jitter=0.0)
    for i in range(1, FRAMES):
        informed, uninformed = (t.step(alone.points["at15"][i], time=i / FPS) for t in (tracker, still))
        assert informed is not None
        assert uninformed is not None
        assert np.array_equal(informed.q, uninformed.q) == (i < 3)  # second differences need three frames
    observer = tracker._stepper._observer
    assert observer._pending is not None
    assert observer._pending.jitter[0] == pytest.approx(2.0, rel=0.5)


def test_a_step_gives_angles_and_landmarks(alone: Seen) -> None:
    tracker = tracker_of(alone)
    nothing = tracker.step(None, time=0.0)
    assert nothing is not None
    assert (nothing.has_pose, nothing.status) == (False, "unobserved")
    assert np.isnan(nothing.landmarks).all()
    assert np.isnan(nothing.angle("left_knee_flexion"))
    step = tracker.step(alone.points["at15"][1], time=0.1)
    assert step is not None
    body = step.body
    assert step.angle("left_knee_flexion") == step.q[body.q_names.index("left_knee_flexion")]
    assert step.angle("left_knee_flexion", degrees=True) == pytest.approx(np.degrees(step.angle("left_knee_flexion")))
    assert np.array_equal(step.landmarks, body.landmarks(body.at(step.q)))
    assert "covariance" not in repr(step)
    with pytest.raises(km.InputError, match=r"no joint 'knee' .*left_knee_flexion"):
        step.angle("knee")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"keypoints": np.zeros((17, 4)), "time": 1.0}, r"^keypoints of at15: has the shape \(17, 4\)"),
        ({"keypoints": np.zeros((3, 17, 3)), "time": 1.0}, r"\(3, 17, 3\) \(\(K, 2\) or \(K, 3\) is needed\)"),
        ({"keypoints": np.zeros((18, 3)), "time": 1.0}, "has 18 keypoints, the layout coco17 17"),
        ({"keypoints": "walk.json", "time": 1.0}, "not an array of numbers"),
        ({"keypoints": None, "time": -1.0}, "time: -1 s does not follow 0 s"),
        ({"keypoints": None, "time": "now"}, "time: cannot be of type str"),
        ({"keypoints": {"at99": None}, "time": 1.0}, "there is no camera 'at99'"),
        ({"keypoints": None, "picture": np.zeros((4, 4, 3), np.uint8), "time": 1.0}, "picture: is not used"),
    ],
)
def test_an_invalid_frame_is_refused_and_does_not_count(pair: Seen, given: Any, message: str) -> None:
    tracker = km.Tracker("human34", cameras=pair.cameras, layout="coco17", settings=FEW)
    tracker.step(None, time=0.0)
    points = given["keypoints"]
    named = {"at15": points} if points is not None and not isinstance(points, dict) else points
    with pytest.raises(km.InputError, match=message):
        tracker.step(**{**given, "keypoints": named})
    step = tracker.step(None, time=0.5)
    assert step is not None
    assert step.index == 1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "camera: is needed"),
        ({"image_size": (640, 480), "cameras": "file.json"}, "exclude each other|no such file"),
        ({"image_size": (640, 480), "layout": "coco99"}, "layout: there is no 'coco99'"),
        ({"image_size": (640, 480), "layout": ["a", "b", "c", "d"]}, "has 0 of the subject's landmarks"),
        ({"image_size": (640, 480), "cues": "auto"}, "auto needs a whole clip"),
        ({"image_size": (640, 480), "cues": "depth"}, "depth needs depth, which a stream does not have"),
        ({"image_size": (640, 480), "cues": "silhouette"}, "show no whole clip .*picture of the empty scene"),
        ({"image_size": (640, 480), "jitter": {"side": 1.0}}, "jitter: is of side"),
        ({"image_size": (640, 480), "floor": 0.0, "lag": 4}, "floor: is of the cameras' world, and none is given"),
        ({"camera": camera_at(15.0), "floor": 0.0}, "floor: needs smoothing, which is off"),
        ({"camera": camera_at(15.0), "floor": "sea", "lag": 4}, "floor: 'sea' is unknown"),
        ({"image_size": (640,)}, "image_size: cannot be of type tuple"),
    ],
)
def test_invalid_arguments_are_refused_at_once(given: Any, message: str) -> None:
    with pytest.raises(km.InputError, match=message):
        km.Tracker("human34", **given)
