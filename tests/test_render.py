"""`kinemode render`: files that agree with each other and can be tracked from."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import kinemode as km
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.runs.reference_motion import Reference
from estimator.synthesis.settings import DetectorSettings, SceneSettings, ViewSettings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode import __main__ as front
from kinemode.shot import RenderedClip, while_open

SMALL = ViewSettings(count=2, image_size=(160, 120))
EXACT = DetectorSettings(0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> RenderedClip:
    folder: Path = tmp_path_factory.mktemp("clip") / "new"
    scales = {"left_knee_flexion": 1.1}
    return km.render(folder, "pivot", proportions=scales, view=SMALL, detector=EXACT, fps=25, seconds=0.4, masks=True)


def pictures(path: Path) -> list[np.ndarray]:
    capture = cv2.VideoCapture(str(path))
    frames = []
    while (read := capture.read())[0]:
        frames.append(read[1])
    assert capture.get(cv2.CAP_PROP_FPS) == 25.0
    capture.release()
    return frames


def test_files_agree_with_each_other(clip: RenderedClip) -> None:
    cameras, reference = load_cameras(clip.cameras), Reference.load(clip.truth)
    body = Body(load_subject(clip.subject))
    assert body.nv == 30
    with np.load(clip.truth) as truth:
        q = truth["q"]
        assert truth["q_names"].tolist() == list(body.q_names)
    assert q.shape == (10, body.nq)
    np.testing.assert_allclose(reference.points, [body.landmarks(body.at(pose)) for pose in q], atol=1e-12)
    for name, camera in cameras.items():
        track, first = load_keypoints(clip.keypoints[name]), load_keypoints(clip.first_frame[name])
        assert track.image_size == first.image_size == (160, 120)
        assert (track.fps, first.fps, track.layout, first.layout) == (25.0, 25.0, "coco17", "landmarks")
        order = [reference.names.index(n) for n in track.names if n is not None]
        np.testing.assert_allclose(track.pixels, camera.project(reference.points[:, order]), atol=1e-9)
        assert first.names == body.landmark_names
        np.testing.assert_allclose(first.pixels[0], camera.project(reference.points[0]), atol=1e-9)
        assert first.frame_count == 10
        assert not first.confidence[1:].any()


def test_the_person_is_where_plate_and_picture_differ(clip: RenderedClip) -> None:
    for name, video in clip.videos.items():
        frames, plate = pictures(video), cv2.imread(str(clip.plates[name])).astype(int)
        assert len(frames) == 10
        masks = sorted(clip.masks[name].glob("*.png"))
        assert len(masks) == 10
        mask = cv2.imread(str(masks[4]), cv2.IMREAD_GRAYSCALE) == 255
        differs = np.abs(frames[4].astype(int) - plate).max(axis=2)
        assert np.median(differs[mask]) > 3.0 * np.median(differs[~mask])
        rows = np.flatnonzero(mask.any(axis=1))
        assert 0.5 < np.ptp(rows) / 120 < 0.75


def test_the_body_is_the_requested_one(tmp_path: Path) -> None:
    own, shape = load_subject("human34"), {"torso": (0.12, 0.16, 0.22, 0.65, 0.85, 0.08, 0.18, 0.0, 0.0)}
    made = km.render(tmp_path, "reach", shape=shape, girth=1.1, view=SMALL, seconds=0.1, videos=False)
    for was, flesh in zip(own.flesh, load_subject(made.subject).flesh, strict=True):
        thick = 1.1 if flesh.link.endswith(("thigh", "shank", "arm")) else 1.0
        if flesh.link == "torso":
            assert np.array_equal(flesh.parameters, shape["torso"])
        elif not flesh.link.endswith(("foot", "clavicle")):
            assert np.allclose(flesh.parameters, was.parameters * [thick, thick, *[1.0] * 7], rtol=1e-12)


def test_the_shutter_is_open_around_the_frame() -> None:
    body = Body(load_subject("arm8"))
    q = body.neutral + 0.01 * np.square(np.arange(5))[:, None]
    scene = SceneSettings(shutter=0.6, sub_frames=3)
    poses = np.array([frame.q for frame in while_open(body, q, 2, scene)])
    np.testing.assert_allclose(poses, [0.8 * q[2] + 0.2 * q[1], q[2], 0.8 * q[2] + 0.2 * q[3]], atol=1e-12)
    assert len(while_open(body, q, 0, SceneSettings(shutter=0.0))) == 1


def test_the_same_seed_gives_the_same_files(clip: RenderedClip, tmp_path: Path) -> None:
    def made(seed: int) -> RenderedClip:
        return km.render(tmp_path / str(seed), "reach", view=SMALL, seconds=0.1, seed=seed, videos=False)

    first = {p.name: p.read_bytes() for p in made(1).keypoints.values()}
    assert first == {p.name: p.read_bytes() for p in made(1).keypoints.values()}
    assert first != {p.name: p.read_bytes() for p in made(2).keypoints.values()}
    assert not list((tmp_path / "1").glob("*.mp4"))


@pytest.mark.parametrize("background", ["pillar", "black", "moving"])
def test_the_command_renders_any_scene(background: str, tmp_path: Path) -> None:
    out = tmp_path / "clip"
    options = ["--background", background, "--occluder", "post", "--shutter", "0.5", "--lens-blur", "0.5"]
    assert (
        front.main(["render", "--motion", "arm", "--fps", "25", "--seconds", "0.12", *options, "--out", str(out)]) == 0
    )
    assert len(pictures(out / "cam01.mp4")) == 3
    assert (out / "plate_cam01.png").exists() == (background != "moving")
    assert load_keypoints(out / "keypoints" / "cam01.json").layout == "landmarks"  # an arm is not a COCO person


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--motion", "fly"], "one of reach, arm, pivot, turn_reach, reach_out, cross_arms, talk, random, or a .bvh"),
        (["--motion", "absent.bvh"], "no such file"),
        (["--motion", "arm", "--subject", "human34"], "no joint left_forearm_pronation"),
        (["--seconds", "9"], "seconds: is 9"),
        (["--fps", "0"], "fps: must be 1 to 1000"),
        (["--noise", "-1"], "noise: is -1"),
        (["--girth", "3"], "girth: must be 0.5 to 1.6"),
        (["--cameras", "0"], "cameras: is 0"),
        (["--hidden", "1.0"], "hidden: is 1.0 (seconds FROM:TO"),
        (["--hidden", "1:0.5"], "hidden: is 1:0.5"),
    ],
)
def test_what_cannot_be_rendered_is_one_line(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert front.main(["render", *options, "--out", str(tmp_path / "x")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.strip().splitlines()) == 1


def test_a_hidden_person_has_neither_keypoints_nor_mask(tmp_path: Path) -> None:
    out = tmp_path / "clip"
    view = ["--background", "black", "--hidden", "0.04:0.12", "--seconds", "0.2", "--fps", "25", "--masks"]
    assert front.main(["render", *view, "--out", str(out)]) == 0
    seen = load_keypoints(out / "keypoints" / "cam01.json").confidence.any(axis=1)
    masked = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).any() for path in sorted((out / "masks/cam01").iterdir())]
    assert seen.tolist() == masked == [True, False, False, True, True]


def test_a_fixed_floor_is_below_and_a_moving_background_has_no_plate(tmp_path: Path) -> None:
    scene = SceneSettings(background="moving")
    before = km.render(tmp_path, "reach", view=SMALL, fps=25, seconds=0.08, masks=True)
    clip = km.render(tmp_path, "reach", view=SMALL, scene=scene, fps=25, seconds=0.04, masks=True)
    assert clip.plates == {}
    assert not before.plates["cam01"].exists()  # no file of an earlier clip remains
    assert len(list(clip.masks["cam01"].iterdir())) == 1
    with pytest.raises(InputError, match="absent"):
        km.render(tmp_path, "reach", subject="absent.urdf")
