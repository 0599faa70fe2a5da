"""Contradictions between subject and input are named: joints on limits, landmarks far from their keypoints, exchanged
sides."""

from __future__ import annotations

import json
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import kinemode as km
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import write_keypoints
from estimator.data.formats.opensim import upright_world
from estimator.data.observation import Observation, image_extent
from estimator.runs.diagnosis import FAR, Diagnosis, diagnose
from estimator.runs.keypoint_residuals import keypoint_residuals
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.synthesis.detector import keypoints
from estimator.synthesis.settings import DetectorSettings
from estimator.trackers.frame_result import STATUS_MEANINGS, FrameResult
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import mirror_index
from humanoid.subject.subject import Subject, load_subject, subject_from_text
from kinemode.__main__ import main
from kinemode.findings import diagnosed, findings, status_meanings, upright_note
from kinemode.terminal import report
from tests.builders import body_of, camera_at
from tests.made_runs import made_run
from tests.tiny_clip import QUICK_BY_KEYPOINTS
from viz.report.tables import keypoints_part

FRAMES = 12
CAMERAS = (camera_at(20.0), camera_at(110.0))


@dataclass(frozen=True)
class Made:
    """The content of a run: poses (T, nq), keypoints (T, C, L, 2), and how they were associated."""

    q: np.ndarray
    pixels: np.ndarray
    association: str = "as_detected"
    status: str = "tracked"

    def written(self, path: Path, body: Body, tracker: str = "css") -> Run:
        times = np.arange(len(self.q)) / 30.0
        header = RunHeader(
            body.subject.urdf, body.subject.source, body.subject.base, CAMERAS, {c.name: None for c in CAMERAS},
            {c.name: c.image_size for c in CAMERAS}, times, tracker, {}, 0, km.__version__,
        )  # fmt: skip
        seen = np.isfinite(self.pixels).all(axis=-1).astype(float)
        with RunWriter.create(path, header, overwrite=True) as writer:
            writer.put_observations(
                [
                    Observation(t, times[t], CAMERAS, p, c)
                    for t, (p, c) in enumerate(zip(self.pixels, seen, strict=True))
                ]
            )
            unit = np.ones(1)
            for t, q in enumerate(self.q):
                covariance, parent = np.eye(body.nv)[None], np.array([0 if t else -1])
                writer.append(
                    FrameResult(
                        t, times[t], self.status, q[None], unit, unit, covariance, parent, 0 * unit, 0 * unit,
                        (self.association,),
                    ), {},
                )  # fmt: skip
            writer.finish()
        return Run.open(path)


def good(body: Body) -> Made:
    """A body that moves a little, inside its limits, with keypoints where its landmarks are."""
    rng = np.random.default_rng(0)
    q = np.array([body.clamp(body.integrate(body.neutral, 0.05 * rng.standard_normal(body.nv))) for _ in range(FRAMES)])
    places = [[c.project(body.landmarks(body.at(pose))) for c in CAMERAS] for pose in q]
    return Made(q, np.array(places))


def diagnosis_of(made: Made, path: Path, frame: int | None = None, *, limited: bool = True, **how: Any) -> Diagnosis:
    run = made.written(path / "a.run", body_of("human34"), **how)
    return diagnose(run, CostSettings(), frame, limited=limited)


def test_a_good_run_is_silent(tmp_path: Path) -> None:
    diagnosis = diagnosis_of(good(body_of("human34")), tmp_path)
    assert diagnosis.sentences == ()
    assert diagnosis == Diagnosis(None, (), (), (), 0.0)


def test_joints_on_a_limit_in_most_frames_are_named(tmp_path: Path) -> None:
    body, made = body_of("human34"), good(body_of("human34"))
    knee, elbow, neck = (body.q_names.index(n) for n in ("left_knee_flexion", "right_elbow_flexion", "neck_flexion"))
    q = made.q.copy()
    q[:7, knee], q[:6, elbow], q[:, neck] = body.upper[knee], body.lower[elbow], body.lower[neck] + 1e-3
    made = replace(made, q=q)
    (resting,) = diagnosis_of(made, tmp_path).resting
    assert (resting.joint, resting.side, resting.limit, resting.share) == (
        "left_knee_flexion",
        "upper",
        body.upper[knee],
        7 / 12,
    )
    assert "left_knee_flexion (upper limit 2.62, 58%)" in diagnosis_of(made, tmp_path).sentences[0]
    assert {r.joint for r in diagnosis_of(made, tmp_path, frame=3).resting} == {
        "left_knee_flexion",
        "right_elbow_flexion",
    }
    assert diagnosis_of(made, tmp_path, frame=8).resting == ()
    assert diagnosis_of(made, tmp_path, limited=False).resting == ()
    assert diagnosis_of(Made(q[:4], made.pixels[:4]), tmp_path).resting == ()  # too few frames to decide


def test_landmarks_far_from_their_keypoints_are_named(tmp_path: Path) -> None:
    body, made = body_of("human34"), good(body_of("human34"))
    k = body.landmark_names.index("left_elbow")
    deviation = np.nanmax(fitted_deviation(made, tmp_path, k))
    for times_sd, named in ((FAR - 1.0, False), (FAR + 1.0, True)):
        pixels = made.pixels.copy()
        pixels[: FRAMES // 2 + 1, 1, k, 0] += times_sd * deviation
        diagnosis = diagnosis_of(replace(made, pixels=pixels), tmp_path)
        assert bool(diagnosis.far) == named
    assert [(f.landmark, f.camera) for f in diagnosis.far] == [("left_elbow", CAMERAS[1].name)]
    assert diagnosis.far[0].pixels == pytest.approx(times_sd * deviation, rel=0.05)
    assert diagnosis.far[0].deviations == pytest.approx(times_sd, rel=0.05)
    assert diagnosis_of(replace(made, pixels=pixels), tmp_path, frame=FRAMES - 1).far == ()


def test_keypoints_that_are_all_off_by_three_pixels_fit_by_three_and_by_as_much_at_the_person(tmp_path: Path) -> None:
    body, made = body_of("human34"), good(body_of("human34"))
    pixels = made.pixels.copy()
    pixels[:, 1] += 3.0 * np.array([0.6, 0.8])
    pixels[:, 1, body.landmark_names.index("left_elbow")] = np.nan
    run = replace(made, pixels=pixels).written(tmp_path / "a.run", body)
    residuals = keypoint_residuals(run, CostSettings(), range(FRAMES))
    assert residuals is not None
    extent = np.median([image_extent(p, np.isfinite(p).all(axis=1).astype(float)) for p in pixels[:, 1]])
    expected = [[0.0, 0.0], [3.0, 3.0 * body.extent / extent]]
    np.testing.assert_allclose(residuals.of_cameras, expected, atol=1e-6, rtol=0.01)
    assert np.isfinite(residuals.of_landmarks[body.landmark_names.index("left_elbow"), 0])
    assert np.nanmax(residuals.pixels) == pytest.approx(3.0)
    assert residuals.noise.tolist() == [1.0, 1.0]
    (facing, aside) = keypoints_part(residuals).split("<tbody>")[1:]
    assert f'<td>{CAMERAS[1].name}</td><td class="n">3.0</td>' in facing
    assert "left_elbow" in aside


def test_keypoints_on_one_place_are_off_by_no_more_than_can_be(tmp_path: Path) -> None:
    """Nothing shows the person's size in that picture."""
    body, made = body_of("human34"), good(body_of("human34"))
    pixels = made.pixels.copy()
    pixels[0, 1] = 200.0
    run = replace(made, pixels=pixels).written(tmp_path / "a.run", body)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        residuals = keypoint_residuals(run, CostSettings(), range(FRAMES))
    assert residuals is not None
    assert np.isfinite(residuals.at_person[0, 1]).all()


def fitted_deviation(made: Made, path: Path, landmark: int) -> np.ndarray:
    """Standard deviations [px] of a landmark's keypoints in the second camera."""
    run, model = made.written(path / "b.run", body_of("human34")), CostModel(body_of("human34"))
    return np.array([model.keypoint_sigma(run.observation(t))[1, landmark] for t in range(len(run))])


def test_a_camera_in_which_most_is_far_is_named_alone(tmp_path: Path) -> None:
    made = good(body_of("human34"))
    pixels = made.pixels.copy()
    pixels[:, 1] += [90.0, 0.0]
    diagnosis = diagnosis_of(replace(made, pixels=pixels), tmp_path)
    assert [name for name, _ in diagnosis.cameras] == [CAMERAS[1].name]
    assert diagnosis.far == ()
    assert "calibration" in diagnosis.sentences[0]


def test_sides_that_are_exchanged_throughout_are_named(tmp_path: Path) -> None:
    body, made = body_of("human34"), good(body_of("human34"))
    swapped = replace(made, pixels=made.pixels[:, :, mirror_index(body.landmark_names)], association="exchanged")
    diagnosis = diagnosis_of(swapped, tmp_path)
    assert (diagnosis.exchanged, diagnosis.far) == (1.0, ())
    assert "left and right of the keypoints are exchanged in 100% of the frames" in diagnosis.sentences[0]


def test_frames_without_keypoints_give_no_advice(tmp_path: Path) -> None:
    made = good(body_of("human34"))
    assert diagnosis_of(replace(made, pixels=np.full_like(made.pixels, np.nan)), tmp_path).sentences == ()
    assert diagnosis_of(replace(made, status="unobserved", pixels=made.pixels + 200.0), tmp_path).sentences == ()


def test_statuses_are_explained_where_they_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = good(body_of("human34"))
    report.print_run(replace(made, status="hard").written(tmp_path / "hard.run", body_of("human34")))
    printed = capsys.readouterr().out
    assert "12 hard" in printed
    assert f"hard (frame 0, 1, 2, 3, 4 and 7 more): {STATUS_MEANINGS['hard']}" in printed
    assert status_meanings(["tracked", "unobserved"]) == [f"unobserved: {STATUS_MEANINGS['unobserved']}"]
    report.print_run(made.written(tmp_path / "good.run", body_of("human34")))
    assert "hard" not in (printed := capsys.readouterr().out).replace("hard.run", "")
    assert "check:" not in printed


# end to end: another person's limits, and a landmark on another link


def knees_turned_round(subject: Subject) -> Subject:
    text, count = re.subn(
        r'(knee_flexion" type="revolute">.*?<limit )lower="-0.0524" upper="2.6180"',
        r'\1lower="-2.6180" upper="0.0524"', subject.urdf, flags=re.S,
    )  # fmt: skip
    assert count == 2
    return subject_from_text(re.sub(r'<stabiliser joint="\w+_knee_flexion"[^>]*/>', "", text), source="turned.urdf")


@pytest.fixture(scope="module")
def crouching(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keypoints of human34 with bent knees before two cameras, and the cameras."""
    folder, body = tmp_path_factory.mktemp("crouching"), body_of("human34")
    q = np.tile(body.neutral, (6, 1))
    for side in ("left", "right"):
        for joint, angle in (("hip_flexion", 0.9), ("knee_flexion", 1.3), ("ankle_dorsiflexion", 0.3)):
            q[:, body.q_names.index(f"{side}_{joint}")] = angle + np.linspace(0.0, 0.2, 6)
    tracks = keypoints(body, q, CAMERAS, np.random.default_rng(0), DetectorSettings(0.5, 0.0, 0.0))
    for camera, track in zip(CAMERAS, tracks, strict=True):
        write_keypoints(folder / f"{camera.name}.json", track)
    write_cameras(folder / "cameras.json", CAMERAS)
    return folder


def track(folder: Path, subject: Subject, name: str) -> Run:
    files = {c.name: folder / f"{c.name}.json" for c in CAMERAS}
    return km.track(
        subject, (), keypoints=files, cameras=folder / "cameras.json",
        settings=QUICK_BY_KEYPOINTS, fit="off",
        out=folder / name, overwrite=True,
    )  # fmt: skip


def test_limits_that_contradict_the_person_are_reported(
    crouching: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.warns(km.FindingWarning, match="in most frames: .*_knee") as caught:
        run = track(crouching, knees_turned_round(load_subject("human34")), "turned.run")
    sentence = next(str(w.message) for w in caught if isinstance(w.message, km.FindingWarning))
    assert len(sentence) <= 500
    assert sentence in run.header.notes
    assert sentence in findings(run)
    with monkeypatch.context() as patch:
        patch.setattr("kinemode.findings.diagnose", None)  # the stored findings are read
        report.print_run(run)
    assert sentence in capsys.readouterr().out
    before_stored = json.loads(run.header.to_json())
    assert tuple(before_stored.pop("findings")) == findings(run)
    run.header = RunHeader.from_json(json.dumps(before_stored), "old.run")
    assert run.header.findings is None
    assert sentence in findings(run)
    assert findings(run) == diagnosed(run).sentences
    assert main(["explain", str(run.file), "--frame", "3"]) == 0
    assert re.search("in frame 3: .*_knee.* limits", capsys.readouterr().out)


def test_only_the_landmark_on_the_wrong_link_is_reported(crouching: Path, recwarn: pytest.WarningsRecorder) -> None:
    subject = load_subject("human34")
    right = track(crouching, subject, "right.run")
    assert [w for w in recwarn if w.category is km.FindingWarning] == []
    assert findings(right) == ()
    text = subject.urdf.replace('name="left_knee" link="left_shank"', 'name="left_knee" link="left_thigh"')
    with pytest.warns(km.FindingWarning, match="left_knee"):
        track(crouching, subject_from_text(text, source="wrong.urdf"), "wrong.run")


def test_a_person_not_along_z_is_reported(tmp_path: Path) -> None:
    """Not for a person who turns over or stands, nor for a body without a head."""
    subject = load_subject("human34")
    body, rng = Body(subject), np.random.default_rng(0)

    def turned(*rpy: float) -> np.ndarray:
        q = body.neutral.copy()
        q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*rpy)).coeffs()
        return body.integrate(q, 0.1 * rng.normal(size=body.nv) * (np.arange(body.nv) > 5))

    lying = np.array([[turned(-0.5 * np.pi + 0.1 * rng.normal(), 0.0, 0.0)] for _ in range(8)])
    standing = np.array([[turned(0.2 * rng.normal(), 0.0, 3.0 * rng.normal())] for _ in range(8)])
    over = np.array([[turned(0.0, 2.0 * np.pi * t / 8.0, 0.0)] for t in range(8)])
    runs = {name: made_run(tmp_path / f"{name}.run", subject, q) for name, q in
            (("lying", lying), ("standing", standing), ("over", over))}  # fmt: skip
    assert "about along y" in upright_note(runs["lying"])
    assert "--up y" in upright_note(runs["lying"])
    assert upright_note(runs["standing"]) == upright_note(runs["over"]) == ""
    arm = load_subject("arm8")
    still = np.tile(Body(arm).neutral, (3, 1, 1))
    assert upright_note(made_run(tmp_path / "arm.run", arm, still)) == ""


def test_advice_on_up_names_the_axis_of_the_file_and_none_that_is_refused(tmp_path: Path) -> None:
    subject = load_subject("human34")
    q = Body(subject).neutral.copy()
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(np.pi, 0.0, 0.0)).coeffs()  # upside down: -z points up
    run = made_run(tmp_path / "a.run", subject, np.tile(q, (8, 1, 1)))
    assert "track with --up -z" in upright_note(run)
    for taken, right in (("y", "-y"), ("-x", "x"), ("z", "-z")):
        assert f"track with --up {right}" in upright_note(run, upright_world(taken))
    assert "--up" not in upright_note(run, has_world=False)
