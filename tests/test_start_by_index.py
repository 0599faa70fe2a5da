"""First poses from an index of examples for every tracker, and css's neighbours after a loss."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import kinemode as km
from benchmarks.papers_css.beginnings import WITHIN, start_errors, verdict
from benchmarks.papers_elmo.elmo_recovery import LONGEST, SHORTEST, spans
from estimator.data.formats.cameras import load_cameras
from estimator.data.observation import Observation
from estimator.inference.mixture import mixture_of
from estimator.runs.reference_motion import Reference
from estimator.search import from_examples
from estimator.search.from_examples import ExampleSearch
from estimator.trackers.css import frame_proposals
from estimator.trackers.mixture_state import MixtureState
from estimator.tracking.registry import TRACKERS, Settings, make_tracker, settings_for
from estimator.tracking.unused_settings import fit_settings
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import ROOT_Q, Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode import __main__ as front
from kinemode.demo_occlusion import HIDDEN, run_occlusion_demo
from kinemode.progress import unreported
from kinemode.shot import RenderedClip
from kinemode.testing import check_tracker
from tests.test_tracker_contract import FEW
from tests.tiers import later
from tests.tiny_clip import QUICK, named

FPS = 2.5  # frame rate of the demonstration's clip
BEGIN = ("css", "condensation", "icp")
OTHERS = ("single-mode", "annealed", "multiple-hypothesis")


def by_index(name: str, file: Path | None, **more: Any) -> Settings:
    """Settings of a tracker that starts by an index."""
    search = {"start": "index", "index": str(file)}
    return settings_for(name, changes={"search": search, **more})


@pytest.fixture(autouse=True)
def few_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short searches from the examples."""
    few = partial(ExampleSearch, neighbours=20, rounds=2, survivors=5, limbs=100)
    for module in (from_examples, frame_proposals):
        monkeypatch.setattr(module, "ExampleSearch", few)


def tracked(clip: RenderedClip, **how: Any) -> km.Run:
    given = {**named(clip), "keypoints": None, "depth": clip.depths, "cues": "depth", "fit": "off"}
    return km.track(clip.subject, **{**given, **how})


@pytest.fixture(scope="module")
def frames(clip: RenderedClip) -> list[Observation]:
    """Observations of the clip, with depth and without keypoints; the third shows no person."""
    (camera,) = load_cameras(clip.cameras).values()
    nothing = np.full((1, len(load_subject(clip.subject).landmarks), 2), np.nan)
    depths, videos = list(clip.depths.values()), list(clip.videos.values())
    with closing(CueReader(videos, [camera], cue_settings(["depth"]), depths=depths)) as reader:
        seen = [
            Observation(i, i / 5.0, (camera,), nothing, np.zeros(nothing.shape[:2]), cues=reader.at(i))
            for i in range(5)
        ]
    gone = tuple(cues.changed(depth=None) for cues in seen[2].cues)
    return [*seen[:2], replace(seen[2], cues=gone), *seen[3:]]


@pytest.mark.parametrize("name", later(BEGIN, "condensation", "icp"))
def test_trackers_that_begin_by_an_index_keep_the_contract(
    name: str, clip: RenderedClip, frames: list[Observation], small_index_file: Path
) -> None:
    spec, body = TRACKERS[name], Body(load_subject(clip.subject))
    settings = by_index(name, small_index_file, **{spec.group: FEW.get(spec.group, {})})
    assert not make_tracker(name, body, settings).needs_keypoints
    limits = spec.keeps_limits(settings.own)
    some = [frames[0], frames[2], frames[3]]  # seen, not seen, seen again
    check_tracker(lambda: make_tracker(name, body, settings), some, seed=1, keeps_limits=limits, continues=(1,))


@pytest.mark.parametrize("name", OTHERS)
def test_all_that_begin_by_keypoints_begin_by_an_index_too(
    name: str, clip: RenderedClip, frames: list[Observation], small_index_file: Path
) -> None:
    tracker = make_tracker(name, Body(load_subject(clip.subject)), by_index(name, small_index_file))
    assert [tracker.can_start(o) for o in frames] == [True, True, False, True, True]
    _, result = tracker.init(np.random.default_rng(0), frames[0])
    assert set(result.origins.family) == {"example"}


def test_the_first_pose_is_found_without_keypoints_and_its_origin_stored(
    clip: RenderedClip, small_index_file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "a.run"
    few = {name: QUICK[name] for name in ("css", "cues")}
    how: dict[str, Any] = {"start": "index", "index": small_index_file, "settings": few, "out": out, "end": 0.4}
    run = tracked(clip, **how)
    assert km.evaluate(run, clip.truth).mpjpe < 0.15  # from 250 examples and nothing else
    search = run.header.settings["search"]
    assert (search["start"], search["index"]) == ("index", str(small_index_file))
    assert run.result(0).origins.family.tolist().count("example") == len(run.result(0).weight)
    assert run.result(1).extra["searches_example"] > 0
    with pytest.raises(InputError, match="search"):  # must resume with the same settings
        tracked(clip, **{**how, "start": None, "keypoints": clip.first_frame, "resume": True})
    given = tracked(clip, index=small_index_file, settings=QUICK, keypoints=clip.first_frame, end=0.0)
    assert given.result(0).origins.family.tolist() == ["start"] * len(given.result(0).weight)


def test_keypoints_count_where_present(clip: RenderedClip, small_index_file: Path) -> None:
    """With the truth's keypoints in the first frame the first pose is closer to it than by depth alone."""
    how: dict[str, Any] = {"tracker": "single-mode", "start": "index", "index": small_index_file, "end": 0.0}
    alone, both = (tracked(clip, keypoints=given, **how) for given in (None, clip.first_frame))
    truth = Reference.load(clip.truth).points[0]
    order = [Reference.load(clip.truth).names.index(n) for n in alone.body.landmark_names]
    off = [np.linalg.norm(run.mode_landmarks[0, 0] - truth[order], axis=1).mean() for run in (alone, both)]
    assert off[1] < off[0]


def test_css_finds_again_whom_it_has_lost(
    clip: RenderedClip, frames: list[Observation], small_index_file: Path
) -> None:
    """From a pose behind the person and upside down, with neighbours and without."""
    body, truth = Body(load_subject(clip.subject)), Reference.load(clip.truth)
    order = [truth.names.index(name) for name in body.landmark_names]
    off = {}
    for index in ("", str(small_index_file)):
        tracker = make_tracker("css", body, settings_for("css", changes={"search": {"index": index}}))
        begin = make_tracker("css", body, by_index("css", small_index_file))
        state, _ = begin.init(np.random.default_rng(0), frames[0])
        mode = state.mixture.modes[0]
        q = mode.q.copy()
        q[:3] += 1.5 * frames[0].cameras[0].R_camera_world[2]
        q[ROOT_Q][3:] = [1.0, 0.0, 0.0, 0.0]
        lost = MixtureState(mixture_of((replace(mode, q=q),), np.zeros(1)), state.time)
        _, result = tracker.step(np.random.default_rng(1), lost, frames[1])
        points = body.landmarks(body.at(result.q[0]))
        off[bool(index)] = np.linalg.norm(points - truth.points[1, order], axis=1).mean()
        assert ("searches_example" in result.extra) == bool(index)  # nothing changes without an index
    assert off[True] < 0.1 < 0.5 < off[False]


def test_more_examples_are_searched_after_an_absence(
    clip: RenderedClip, frames: list[Observation], small_index_file: Path
) -> None:
    tracker = make_tracker("css", Body(load_subject(clip.subject)), by_index("css", small_index_file))
    state, _ = tracker.init(np.random.default_rng(0), frames[0])
    counts = []
    for i, observation in enumerate(frames[1:]):
        state, result = tracker.step(np.random.default_rng(i), state, observation)
        counts.append(int(result.extra["searches_example"]) if result.extra else None)
        assert state.unseen == pytest.approx(0.2 if i == 1 else 0.0)
    assert counts[1] is None
    assert counts[2] > 2 * max(counts[0], counts[3]) > 0


def test_how_long_nothing_was_seen_is_stored(
    clip: RenderedClip, frames: list[Observation], small_index_file: Path
) -> None:
    tracker = make_tracker("single-mode", Body(load_subject(clip.subject)), by_index("single-mode", small_index_file))
    state, _ = tracker.init(np.random.default_rng(0), frames[0])
    assert "unseen" not in state.arrays()
    arrays = replace(state, unseen=0.6).arrays()
    assert tracker.state_from(arrays).unseen == 0.6
    with pytest.raises(ValueError, match="unseen for -1 s"):
        tracker.state_from(arrays | {"unseen": np.array(-1.0)})


def test_what_cannot_begin_by_an_index_is_one_line(clip: RenderedClip, small_index_file: Path, tmp_path: Path) -> None:
    keypoints = {"keypoints": clip.first_frame}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"start": "index", "depth": None, "cues": "edges"}, "css needs depth or silhouette, which is not used"),
        ({"start": "index", "depth": None, "cues": "off"}, "css needs depth or silhouette, which is not used"),
        ({"start": "soon", **keypoints}, "start: 'soon' is unknown"),
        ({"index": small_index_file, "tracker": "single-mode", **keypoints}, "single-mode looks nothing up in it"),
        ({"settings": {"search": {"start": "anywhere"}}}, "one of keypoints, index"),
        ({"settings": {"css": {"examples": 9}}, **keypoints}, "has no effect: search.index is empty"),
        ({"start": "index", "index": tmp_path / "none.npz"}, "there is no such file"),
    ]
    for how, message in cases:
        how = {"index": small_index_file, **how} if how.get("start") == "index" else how
        with pytest.raises(InputError, match=message) as refused:
            tracked(clip, **how)
        assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match="'index' is for a track"):
        km.fit(clip.subject, clip.videos, cameras=clip.cameras, keypoints=clip.keypoints, start="index")
    bare = load_subject("arm8").urdf.replace("flesh", "fl")
    path = tmp_path / "bare.urdf"
    path.write_text(bare)
    with pytest.raises(InputError, match="flesh"):  # no index exists, and none can be made
        km.track(path, clip.videos, cameras=clip.cameras, depth=clip.depths, cues="depth", start="index")


def test_a_fit_uses_keypoints_whatever_starts_the_track() -> None:
    changes = {"search": {"start": "index", "index": "some.npz", "spare": 5}}
    for name in ("css", "single-mode"):
        search = fit_settings(name, settings_for(name, changes=changes), changes).search
        assert (search.start, search.index, search.spare) == ("keypoints", "", 5)


def test_the_commands_take_it(clip: RenderedClip, small_index_file: Path, tmp_path: Path) -> None:
    (name, video), (_, depth) = next(iter(clip.videos.items())), next(iter(clip.depths.items()))
    files = [f"{name}={video}", "--cameras", str(clip.cameras), "--depth", f"{name}={depth}", "--cues", "depth"]
    files += ["--end", "0"]
    how = ["--subject", str(clip.subject), "--start", "index", "--index", str(small_index_file)]
    out = tmp_path / "a.run"
    assert front.main(["track", *files, *how, "--tracker", "icp", "--out", str(out)]) == 0
    assert km.Run.open(out).header.settings["search"]["start"] == "index"
    both = tmp_path / "both"
    assert front.main(["compare", *files, *how, "--trackers", "icp,single-mode", "--out", str(both)]) == 0
    runs = [km.Run.open(both / f"{tracker}.run") for tracker in ("icp", "single-mode")]
    assert all(run.result(0).origins.family[0] == "example" for run in runs)


@pytest.mark.paper
def test_the_demonstration_finds_whom_a_screen_has_hidden(
    small_index_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = run_occlusion_demo(tmp_path, index=small_index_file, fps=FPS, progress=unreported)
    run = km.Run.open(tmp_path / "occlusion.run")
    unseen = [run.result(i).status == "unobserved" for i in range(len(run))]
    assert unseen == [HIDDEN[0] <= i / FPS < HIDDEN[1] for i in range(len(run))]
    assert result.seen < 250.0
    printed = " ".join(capsys.readouterr().out.split())
    assert f"{result.after:.0f} mm in the first after it" in printed
    capture = cv2.VideoCapture(str(tmp_path / "overlay.mp4"))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == len(run)
    capture.release()
    assert front.main(["demo", "--index", str(small_index_file), "--out", str(tmp_path)]) == 2


def test_occlusions_are_dealt_out() -> None:
    dealt = spans(30, 6, 1.5)
    assert [len(own) for own in dealt] == [5] * 6
    lengths = sorted(end - begin for own in dealt for begin, end in own)
    assert lengths[0] == pytest.approx(SHORTEST)
    assert lengths[-1] == pytest.approx(LONGEST)
    for own in dealt:
        moments = np.array([0.0, *np.ravel(own)])
        assert np.diff(moments)[::2].min() >= 1.5 - 1e-9
        assert np.allclose(moments * 30.0, np.round(moments * 30.0))
    assert [len(own) for own in spans(2, 3, 1.0)] == [1, 1, 0]


def test_a_run_s_beginning_is_measured(clip: RenderedClip) -> None:
    run = km.track(clip.subject, None, cameras=clip.cameras, keypoints=clip.keypoints, fit="off", settings=QUICK)
    measured = start_errors(run, clip.truth, 5.0, ((0.2, 0.4),))
    assert measured.first_best <= measured.first < 120.0
    assert len(measured.after) == 1
    assert len(measured.after[0]) == min(WITHIN, len(run) - 2)
    assert "back in frame 1" in verdict(measured)
