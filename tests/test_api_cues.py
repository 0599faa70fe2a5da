"""Pictures through the public interface: which cues are used, what is refused, and that a stopped run resumes bit by
bit."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

import kinemode
from estimator.data.media.clip import Clip
from estimator.runs.run_reader import Run
from estimator.trackers.css.settings import CssSettings
from estimator.vision.cues.settings import CUES
from humanoid.support.errors import InputError
from kinemode import jobs
from kinemode.pictures import cue_choice
from kinemode.rendering import RenderedClip
from tests.command_lines import interrupted_after
from tests.tiny_clip import QUICK, named

FRAMES = 5
ARRAYS = ("mode_q", "mode_weight", "mode_energy", "mode_covariance", "mode_velocity", "mode_family", "q", "path")
pytestmark = pytest.mark.filterwarnings("ignore::kinemode.InputWarning")


@pytest.fixture(scope="module")
def tracked(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run from the first frame's keypoints, everything else at its default."""
    out = tmp_path_factory.mktemp("run") / "a.run"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return track(clip, out=out, mask=clip.masks)


def track(clip: RenderedClip, **changes: Any) -> Run:
    given = {"subject": "human34", "fit": "off", "settings": QUICK, **named(clip), **changes}
    return kinemode.track(**given)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("auto", None),
        ("off", ()),
        ("flow,edges", ("edges", "flow")),
        (" silhouette , flow ", ("flow", "silhouette")),
        (["edges"], ("edges",)),
        ([], ()),
    ],
)
def test_choices(given: str | list[str], expected: tuple[str, ...] | None) -> None:
    assert cue_choice(given) == expected


def test_one_frame_of_keypoints_and_the_pictures_carry_on(clip: RenderedClip, tracked: Run) -> None:
    assert tracked.complete
    assert tracked.header.cues == tuple(name for name, cue in CUES.items() if not cue.needs_depth)
    assert set(tracked.status) <= {"tracked", "hard"}
    assert np.isfinite(tracked.q).all()
    assert tracked.header.masks == {name: str(path) for name, path in clip.masks.items()}
    assert any(f"keypoints in 1 of {FRAMES} frames" in note for note in tracked.header.notes)
    camera = tracked.header.cameras[0]
    true = camera.project(np.load(clip.truth)["landmarks"][-1])
    first, last = (np.linalg.norm(camera.project(tracked.landmarks[t]) - true, axis=-1).mean() for t in (0, -1))
    assert last < 0.6 * first  # the pose has followed the motion; one camera sees little of its depth


def test_a_stopped_run_resumes_to_the_same_bits(clip: RenderedClip, tracked: Run, tmp_path: Path) -> None:
    out = tmp_path / "b.run"
    with pytest.raises(KeyboardInterrupt), interrupted_after(2):
        track(clip, out=out, mask=clip.masks)
    assert len(kinemode.open_run(out)) == 2
    resumed = track(clip, out=out, mask=clip.masks, resume=True)
    assert resumed.complete
    for name in ARRAYS:
        assert getattr(resumed, name).tobytes() == getattr(tracked, name).tobytes(), name
    for changes, message in (
        ({}, "cameras with masks"),
        ({"mask": clip.masks, "cues": "silhouette"}, "cues"),
        ({"mask": clip.masks, "background": clip.plates}, "cameras with a background"),
    ):
        with pytest.raises(InputError, match=message):
            track(clip, out=out, resume=True, **changes)


def test_keypoints_of_most_frames_leave_the_pictures_alone(clip: RenderedClip, tmp_path: Path) -> None:
    run = track(clip, keypoints=clip.keypoints, mask=clip.masks, out=tmp_path / "a.run")
    assert run.header.cues == ()
    assert run.header.masks == {}
    assert any("--cues" in note for note in run.header.notes)


def test_background_from_a_picture_and_the_fit_from_one_frame(clip: RenderedClip, tmp_path: Path) -> None:
    few = {**QUICK, "smooth": {"enabled": False}}
    changes = {"cues": ["silhouette"], "background": clip.plates, "settings": few, "end": 0.2}
    run = track(clip, out=tmp_path / "a.run", fit="auto", **changes)
    assert run.header.cues == ("silhouette",)
    assert run.header.backgrounds == {name: str(path) for name, path in clip.plates.items()}
    assert not run.header.settings["cues"]["use_edges"]
    assert run.subject.proportions != kinemode.load_subject("human34").proportions
    assert np.isfinite(run.q).all()


def test_settings_reach_the_fit_whatever_the_tracker(
    clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Any] = []

    def fitted(subject: Any, *args: Any, track_settings: Any, **how: Any) -> Any:
        given.append(track_settings)
        return SimpleNamespace(subject=subject, estimates={}, notes=(), noise=())

    monkeypatch.setattr(jobs.person, "fit_person", fitted)
    settings = {"cost": {"keypoint_noise": 0.05, "transition_nu": 9.0}, "annealed": {"particles": 5, "layers": 2}}
    track(clip, out=tmp_path / "a.run", fit="auto", tracker="annealed", cues="off", settings=settings)
    (fitting,) = given
    assert (fitting.cost.keypoint_noise, fitting.cost.transition_nu) == (0.05, 9.0)
    assert fitting.own == CssSettings()
    with pytest.raises(InputError, match=r"transition_nu: has no effect: particles"):  # nothing is fitted
        track(clip, out=tmp_path / "b.run", fit="off", tracker="annealed", cues="off", settings=settings)


def test_what_would_have_no_effect_is_refused_before_the_work(clip: RenderedClip, tmp_path: Path) -> None:
    (tmp_path / "no.toml").write_text("[cues]\nuse_flow = false\n")
    for how, message in (
        ({"tracker": "single-mode", "modes": 3, "settings": None}, "modes: single-mode keeps a single"),
        ({"settings": {"css": {"transition": False, "jump_penalty": 3.0}}}, "css.jump_penalty: has no effect"),
        ({"settings": {"smooth": {"lag": 3}}}, "smooth.lag: has no effect"),
        (
            {"settings": tmp_path / "no.toml", "cues": "edges,flow"},
            r"no.toml: \[cues\] use_flow: .*--cues requests flow",
        ),
        ({"subject": str(clip.subject), "fit": "proportions"}, "fit: .*is used as measured"),
        ({"subject": str(clip.subject), "height": 1.7}, "height: .*is used as measured"),
        ({"subject": "human34", "height": 170.0}, "height: must be 0.5 to 2.5 m, got 170"),
    ):
        with pytest.raises(InputError, match=message):
            track(clip, out=tmp_path / "a.run", **how)
    assert not (tmp_path / "a.run").exists()


def test_what_has_no_effect_on_the_input_is_in_the_notes(clip: RenderedClip, tmp_path: Path) -> None:
    few = {**QUICK, "cues": {**QUICK["cues"], "edges": {"nu": 5.0}}, "smooth": {"enabled": False}}
    run = track(clip, keypoints=clip.keypoints, cues="off", out=tmp_path / "a.run", settings=few)
    (note,) = [note for note in run.header.notes if "without effect" in note]
    assert "cues.edges.nu" in note
    assert "no pictures are used" in note


def test_what_the_reader_notes_is_passed_on(clip: RenderedClip, tmp_path: Path) -> None:
    (tmp_path / "two").mkdir()
    ((name, video),) = clip.videos.items()
    for i in range(2):
        cv2.imwrite(str(tmp_path / "two" / f"{i}.png"), Clip.open(video).frame(i))
    with pytest.warns(kinemode.InputWarning, match="the clip is too short, no background model"):
        run = track(clip, clips={name: tmp_path / "two"}, out=tmp_path / "a.run", cues="silhouette")
    assert any("too short" in note for note in run.header.notes)


def test_a_silhouette_that_is_not_the_persons_is_reported(clip: RenderedClip, tracked: Run, tmp_path: Path) -> None:
    ((name, masks),) = clip.masks.items()
    (tmp_path / "corner").mkdir()
    for path in masks.iterdir():
        corner = np.zeros((120, 160), np.uint8)
        corner[5:25, 5:25] = 255
        cv2.imwrite(str(tmp_path / "corner" / path.name), corner)
    few = {**QUICK, "smooth": {"enabled": False}}
    run = track(clip, out=tmp_path / "a.run", mask={name: tmp_path / "corner"}, settings=few)
    message = f"{name}: the silhouette of frame 0 has"
    assert any(note.startswith(message) for note in run.header.notes)
    assert not any(note.startswith(message) for note in tracked.header.notes)


def test_invalid_input_is_refused_before_any_work(clip: RenderedClip, tmp_path: Path) -> None:
    ((name, masks),) = clip.masks.items()
    few = tmp_path / "few"
    few.mkdir()
    (few / "0.png").write_bytes(next(masks.iterdir()).read_bytes())
    content = json.loads(clip.first_frame[name].read_text())
    content["frames"][0]["keypoints"][3:] = [[0.0, 0.0, 0.0]] * len(content["frames"][0]["keypoints"][3:])
    nobody = tmp_path / "nobody.json"
    nobody.write_text(json.dumps(content))
    cases: list[tuple[dict[str, Any], str]] = [
        ({"keypoints": None}, "keypoints: are needed.*kinemode annotate"),
        ({"keypoints": nobody}, "no frame has 4 or more of the subject's landmarks"),
        ({"clips": None, "cues": "edges"}, "cues: edges need the pictures"),
        ({"cues": "edges,taste"}, "no cue 'taste'.*edges, flow, silhouette"),
        ({"cues": "flow", "mask": masks}, "is for the silhouette"),
        ({"cues": "off", "background": clip.plates}, "is for the silhouette"),
        ({"mask": few}, f"masks of 1 frames, the clip has {FRAMES}"),
        ({"mask": {"elsewhere": masks, "here": masks}}, "no clip 'elsewhere' for this mask"),
        ({"clips": None, "mask": masks}, "for this mask"),
        ({"background": tmp_path / "none.png"}, "no such background"),
        ({"background": clip.cameras}, "not an image"),
        ({"settings": tmp_path / "none.toml"}, "none.toml"),
    ]
    for changes, message in cases:
        with pytest.raises(InputError, match=message):
            track(clip, out=tmp_path / "a.run", **changes)
    assert not (tmp_path / "a.run").exists()
