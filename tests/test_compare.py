"""Several trackers on one clip: one cost, one fit, and the same figures after an interruption."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

import kinemode
from estimator.data.observation import PoseEstimate
from estimator.runs.evaluation import FAR, HIPS, LIMB_JOINTS, far_px, mpjpe, trajectory_errors
from estimator.runs.reference_motion import Reference
from estimator.tracking.registry import TRACKERS, settings_for
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from kinemode import __main__ as front, jobs
from kinemode.comparison import Comparison, plotted, tracker_names
from kinemode.progress import unreported
from kinemode.request import TrackRequest
from kinemode.scores import TrackTime, courses
from kinemode.shot import RenderedClip
from tests.tiny_clip import QUICK, named
from viz.pictures.plot import COLOURS, Curve, MeasurePanel, Plot, first_losses, write_plot

NAMES = ("single-mode", "css", "gaussian-single-mode")
MEASURED = (0.5,)  # factor of the noise of the only camera
SETTINGS = {**QUICK, "smooth": {"enabled": False}}


def detected(clip: RenderedClip) -> dict[str, Any]:
    """The clip as keypoints of every frame, without its pictures."""
    return {"clips": None, "cameras": clip.cameras, "keypoints": clip.keypoints, "settings": SETTINGS, "fit": "off"}


@pytest.fixture(scope="module")
def compared(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> Comparison:
    out = tmp_path_factory.mktemp("compared") / "new"
    return kinemode.compare(clip.subject, trackers=NAMES, out=out, reference=clip.truth, **detected(clip))


def test_one_row_per_tracker_in_the_given_order(compared: Comparison) -> None:
    assert tuple(s.tracker for s in compared.scores) == tuple(compared.runs) == NAMES
    assert all(run.complete for run in compared.runs.values())
    with compared.table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    figures = json.loads(compared.figures.read_text())
    for row, score in zip(rows, compared.scores, strict=True):
        assert row["tracker"] == score.tracker
        assert float(row["mpjpe [m]"]) == score.mpjpe == figures[score.tracker]["mpjpe"]
        assert len(figures[score.tracker]["course"]["error"]) == score.frames == 5
        assert score.fps > 0.0


def test_errors_are_those_of_the_heaviest_hypotheses(compared: Comparison, clip: RenderedClip) -> None:
    truth = Reference.load(clip.truth)
    for score in compared.scores:
        run, course = compared.runs[score.tracker], compared.courses[score.tracker]
        ours, theirs = ([list(n).index(j) for j in LIMB_JOINTS] for n in (run.body.landmark_names, truth.names))
        hips = [LIMB_JOINTS.index(hip) for hip in HIPS]
        error = mpjpe(run.mode_landmarks[:, 0][:, ours], truth.points[:, theirs], hips)
        np.testing.assert_allclose(course.error, error)
        assert score.mpjpe == pytest.approx(error.mean())
        every = [mpjpe(points[:, ours], truth.points[:, theirs], hips) for points in run.mode_landmarks.swapaxes(0, 1)]
        nearest = np.nanmin(every, axis=0)  # of each frame's hypotheses
        assert score.best_of_k == pytest.approx(nearest.mean())
        assert score.first_lost is None


def test_the_nearest_of_k_need_not_be_the_heaviest(compared: Comparison, clip: RenderedClip, tmp_path: Path) -> None:
    """Beside a reference that moves as the second hypothesis does, wherever there is one."""
    run = compared.runs["css"]
    second = run.mode_landmarks[:, 1]
    there = np.isfinite(second).all(axis=(1, 2))
    assert there.any()
    points = np.where(there[:, None, None], second, run.mode_landmarks[:, 0])
    np.savez(tmp_path / "second.npz", points=points, names=np.array(run.body.landmark_names), time=run.time)
    out = shutil.copytree(compared.table.parent, tmp_path / "again")
    how: dict[str, Any] = {"trackers": NAMES, "out": out, "resume": True, **detected(clip)}
    again = kinemode.compare(clip.subject, reference=tmp_path / "second.npz", **how)
    scores = {score.tracker: score for score in again.scores}
    assert scores["css"].best_of_k == pytest.approx(0.0, abs=1e-6)
    assert scores["css"].mpjpe > 1e-3
    assert scores["single-mode"].best_of_k == scores["single-mode"].mpjpe > 1e-3


def test_all_are_measured_by_one_cost(compared: Comparison) -> None:
    """The first frame has no past: css minimised there the very cost by which all are compared."""
    css, gaussian = (compared.courses[name].energy for name in ("css", "gaussian-single-mode"))
    assert css[0] == pytest.approx(compared.runs["css"].mode_energy[0, 0], abs=1e-9)
    assert gaussian[0] != pytest.approx(compared.runs["gaussian-single-mode"].mode_energy[0, 0], abs=1e-3)
    assert gaussian[0] >= css[0] - 1e-6  # css minimised it, the other something else


def test_the_distance_from_the_keypoints(compared: Comparison) -> None:
    run = compared.runs["css"]
    (camera,) = run.header.cameras
    for t in range(len(run)):
        seen = run.confidence[t, 0] > 0.0
        apart = np.linalg.norm(camera.project(run.mode_landmarks[t, 0]) - run.pixels[t, 0], axis=1)[seen]
        assert compared.courses["css"].residual[t] == pytest.approx(apart.mean())


def test_lost_frames(compared: Comparison) -> None:
    run = compared.runs["css"]
    points, cameras = run.mode_landmarks[:, 0], run.header.cameras
    gone = points.copy()
    gone[1] = np.nan
    gone[3] += (FAR + 0.01) * cameras[0].R_camera_world[2]  # along the optical axis
    assert trajectory_errors(gone, points, None, cameras).lost.tolist() == [False, True, False, True, False]
    truth = points.copy()
    truth[3:] = np.nan  # a frame unknown to the reference cannot be lost
    reference = Reference(run.body.landmark_names, truth + 2.0, None)
    course = courses({"css": run}, settings_for("css"), reference, True, lambda done, total: None)["css"]
    assert course.lost.tolist() == [True, True, True, False, False]
    aligned = courses({"css": run}, settings_for("css"), reference, False, lambda done, total: None)["css"]
    assert not aligned.lost.any()


def test_an_interrupted_comparison_resumes(
    compared: Comparison, clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_into = jobs.run_into

    def stopping(*args: Any, **kwargs: Any) -> None:
        def stop(done: int, total: int) -> None:
            kwargs["progress"](done, total)
            if done == 3 and args[0].path.stem == "css":
                raise KeyboardInterrupt

        run_into(*args, **{**kwargs, "progress": stop})

    monkeypatch.setattr(jobs, "run_into", stopping)
    how: dict[str, Any] = {"trackers": ",".join(NAMES), "out": tmp_path, **detected(clip)}
    with pytest.raises(KeyboardInterrupt):
        kinemode.compare(clip.subject, **how)
    monkeypatch.undo()
    assert sorted(path.name for path in tmp_path.glob("*.run")) == ["css.run", "single-mode.run"]
    assert json.loads((tmp_path / "times.json").read_text())["css"]["frames"] == 2
    with pytest.raises(InputError, match=r"exists already.*--resume"):
        kinemode.compare(clip.subject, **how)
    again = kinemode.compare(clip.subject, resume=True, reference=clip.truth, **how)
    for score, whole in zip(again.scores, compared.scores, strict=True):
        assert replace(score, fps=0.0) == replace(whole, fps=0.0)
    assert (
        json.loads((tmp_path / "times.json").read_text())["css"]["frames"] == 3
    )  # the first of a session is not timed


def test_the_subject_is_fitted_once(clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fits = []

    def fitted(subject: Any, *args: Any, **how: Any) -> Any:
        fits.append(subject)
        body = Body(subject)
        known = {k: PoseEstimate(body.neutral, 1e-4 * np.eye(body.nv)) for k in (1, 0)}
        return SimpleNamespace(
            subject=subject.scaled({subject.proportions[0].joint: 1.05}),
            estimates=known,
            notes=(),
            noise=MEASURED,
        )

    monkeypatch.setattr(jobs.person, "fit_person", fitted)
    how = {**detected(clip), "fit": "auto", "trackers": NAMES[:2], "out": tmp_path}
    first = kinemode.compare("human34", **how)
    assert len(fits) == 1
    again = kinemode.compare("human34", **{**how, "trackers": NAMES}, resume=True)
    assert len(fits) == 1
    urdfs = {run.header.subject_urdf for c in (first, again) for run in c.runs.values()}
    assert len(urdfs) == 1
    assert urdfs != {fits[0].urdf}
    everywhere = [run for c in (first, again) for run in c.runs.values()]
    assert all(list(run.estimates or {}) == [0] for run in everywhere)
    assert {run.observation(0).noise for run in everywhere} == {MEASURED}


def test_pictures_count_where_they_were_used(clip: RenderedClip, tmp_path: Path) -> None:
    how = {**named(clip), "cues": "edges", "settings": {"cues": QUICK["cues"]}, "fit": "off"}
    comparison = kinemode.compare(clip.subject, trackers="single-mode", out=tmp_path, **how)
    course = comparison.courses["single-mode"]
    assert np.isfinite(course.energy).all()
    assert np.isfinite(course.residual).tolist() == [True, False, False, False, False]
    assert [panel.label for panel in plotted(comparison.scores, comparison.courses).panels] == ["energy of the pose"]


def test_what_is_plotted(compared: Comparison) -> None:
    plot = plotted(compared.scores, compared.courses)
    limit = far_px(compared.runs["css"].header.cameras[0].image_size)
    assert [(panel.label[-4:], panel.limit) for panel in plot.panels] == [("[mm]", 1e3 * FAR), ("[px]", limit)]
    assert all([curve.name for curve in panel.curves] == list(NAMES) for panel in plot.panels)
    assert not first_losses(plot)
    nothing = np.full(5, np.nan)
    guessed = {n: replace(c, world_error=nothing, pixel_error=nothing) for n, c in compared.courses.items()}
    (panel,) = plotted(compared.scores, guessed).panels
    assert panel.label == "mean error, hips aligned [mm]"
    unknown = {n: replace(c, error=nothing) for n, c in guessed.items()}
    assert plotted(compared.scores, unknown).panels[0].label == "mean distance from the keypoints [px]"


def test_a_loss_is_marked_by_the_measure_that_it_broke(compared: Comparison) -> None:
    """In the image in frame 1, without a pose in frame 2, in the world in frames 3 and 4."""
    world, pixels = np.array([0.1, 0.1, np.nan, 0.3, 0.3]), np.array([1.0, 20.0, np.nan, 5.0, 5.0])
    lost = ~((world <= FAR) & (pixels <= 15.0))
    course = replace(compared.courses["css"], world_error=world, pixel_error=pixels, lost=lost, pixel_limit=15.0)
    plot = plotted([s for s in compared.scores if s.tracker == "css"], {"css": course})
    in_world, in_image = (panel.curves[0] for panel in plot.panels)
    assert in_world.lost == (course.time[2],)  # and not found again
    assert in_image.lost == (course.time[1],)  # not found before frame 3
    assert first_losses(plot) == {"css": course.time[1]}


def test_every_curve_is_in_the_picture(tmp_path: Path) -> None:
    time = np.arange(30) / 10.0
    curves = [Curve(f"tracker {i}", time, 10.0 * (i + 1) + time, (2.0,) if i == 1 else ()) for i in range(len(COLOURS))]
    write_plot(Plot("title", [MeasurePanel("error [mm]", curves, 50.0)]), tmp_path / "a.png")
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image is not None
    for colour in COLOURS:
        bgr = [int(colour[i : i + 2], 16) for i in (5, 3, 1)]
        assert np.count_nonzero((image == bgr).all(axis=2)) > 50, colour


def test_times() -> None:
    assert TrackTime(frames=20, seconds=2.0, smoothing=1.0).rate(10) == pytest.approx(5.0)
    assert np.isnan(TrackTime().rate(10))


def test_names_of_trackers() -> None:
    assert tracker_names("css, single-mode,css") == tracker_names(["css", "single-mode"]) == ("css", "single-mode")
    with pytest.raises(InputError, match="none is named"):
        tracker_names([" ", ","])


def test_the_command(clip: RenderedClip, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (keypoints,) = clip.keypoints.values()
    arguments = ["compare", "--keypoints", str(keypoints), "--cameras", str(clip.cameras), "--fit", "off"]
    out = tmp_path / "out"
    assert front.main([*arguments, "--trackers", "css,cs", "--out", str(out)]) == front.BAD_INPUT
    printed = capsys.readouterr().err
    assert "no tracker 'cs'" in printed
    assert all(name in printed for name in TRACKERS)
    assert len(printed.splitlines()) == 1
    assert not out.exists()
    given = [*arguments, "--trackers", "single-mode", "--subject", str(clip.subject), "--out", str(out)]
    assert front.main(given) == 0
    assert "residual [px]" in capsys.readouterr().out
    assert {p.name for p in out.iterdir()} == {
        "single-mode.run", "times.json", "compare.csv", "compare.json", "compare.png",
    }  # fmt: skip
    assert front.main(["trackers"]) == 0
    listed = capsys.readouterr().out
    assert all(f"{name} " in listed for name in TRACKERS)


def test_an_interrupted_command_prints_how_to_resume(
    clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where there is something to resume: here the first tracker's run."""
    (keypoints,) = clip.keypoints.values()
    out = ["--out", str(tmp_path / "c"), "--subject", str(clip.subject), "--fit", "off", "--overwrite"]
    arguments = ["compare", "--trackers", "single-mode,css", "--keypoints", str(keypoints), *out]
    track_subject = jobs.track_subject

    def interrupted(subject: Any, files: Any, wanted: TrackRequest, known: Any) -> Any:
        if wanted.tracker == "css":
            raise KeyboardInterrupt
        return track_subject(subject, files, wanted, known)

    monkeypatch.setattr(jobs, "track_subject", interrupted)
    assert front.main([a.removeprefix("single-mode,") for a in arguments]) == front.INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n"
    assert front.main(arguments) == front.INTERRUPTED
    assert capsys.readouterr().err.rstrip().endswith(f"kinemode {' '.join(arguments[:-1])} --resume")


def test_a_damaged_file_of_times_is_named(clip: RenderedClip, tmp_path: Path) -> None:
    (tmp_path / "times.json").write_text("[1]")
    with pytest.raises(InputError, match=r"times\.json"):
        kinemode.compare(clip.subject, trackers="css", out=tmp_path, progress=unreported, **detected(clip))
