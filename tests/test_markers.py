"""Markers: their evidence on a pose, lengths and places fitted to them, tracks and runs from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import bent, body_of

import kinemode as km
from estimator.data.formats.opensim import write_trc
from estimator.data.observation import Observation
from estimator.energy.point_targets import MarkerNoise, marker_targets
from estimator.fitting.fitted_points import FittedMarkers
from estimator.fitting.markers import MarkerFitSettings, fit_markers
from estimator.fitting.measures import Measures, MeasuresEnergy, standing_pose
from estimator.runs.keypoint_residuals import marker_residuals
from estimator.runs.lasting_spread import LastingPoints, lasting_by_places
from estimator.search.cost_terms import CostSettings
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.marker_set import marker_set
from humanoid.subject.subject import Subject, Zero, load_subject
from viz.scene import pictured_scene

FPS = 50.0
FLEXED = {"left_knee_flexion": 0.9, "right_hip_flexion": 0.7, "left_elbow_flexion": 1.2, "lumbar_flexion": 0.3}


@cache
def marked() -> Subject:
    """human34 with the markers of Plug-in Gait, all at known places."""
    return load_subject("human34").with_markers(marker_set("plug-in-gait").markers)


def poses(body: Body, count: int) -> np.ndarray:
    """A person who bends and straightens, one step on."""
    base = body_of("human34")
    whole = body.difference(body.neutral, bent(base, base.neutral, **FLEXED))
    whole[:2] = 0.4, 0.1
    shares = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count))
    return np.array([body.integrate(body.neutral, share * whole) for share in shares])


def measured(body: Body, q: np.ndarray, noise: float = 0.0, seed: int = 0) -> list[Observation]:
    """A laboratory's measurement of poses (T, nq), with noise [m]."""
    rng, count = np.random.default_rng(seed), len(body.landmark_names)
    points = body.markers_of(body.placed(q))
    points = points + noise * rng.normal(size=points.shape)
    nothing = np.zeros((0, count, 2)), np.zeros((0, count))
    return [Observation(t, t / FPS, (), *nothing, markers=p) for t, p in enumerate(points)]


def turned(body: Body, q: np.ndarray, results: Sequence[Any]) -> np.ndarray:
    """Errors of the best modes' joints (T, n) [rad]."""
    return np.array([body.difference(a, r.q[0])[6:] for a, r in zip(q, results, strict=True)])


def test_the_energy_of_markers_is_that_of_their_distances() -> None:
    body = Body(marked())
    (seen,) = measured(body, body.neutral[None])
    assert seen.markers is not None
    away = seen.markers.copy()
    away[0, 0] += 0.03
    away[1] = np.nan
    (term,) = marker_targets(body, replace(seen, markers=away), MarkerNoise(0.005, 0.5, 4.0))
    variance = 0.005**2 + 0.25 * body.marker_std[0] ** 2
    assert term.value(body.at(body.neutral)) == pytest.approx(0.5 * 4.0 * np.log1p(0.03**2 / variance / 4.0))
    assert not marker_targets(body, replace(seen, markers=None), MarkerNoise(0.005, 0.5, 4.0))


def test_the_gradient_by_lengths_and_places_is_that_of_the_energy() -> None:
    subject = marked()
    proportions = ProportionedBody(subject)
    seen = measured(proportions.at(np.full(len(proportions.names), 1.03)), poses(proportions.base, 3), 0.004)
    energy = MeasuresEnergy(
        proportions, FittedMarkers(proportions), seen, replace(CostSettings(), interpenetration_weight=0.0), 0.5
    )
    rng = np.random.default_rng(1)
    measures = Measures(np.ones(len(proportions.names)), 0.004 * rng.normal(size=(len(subject.markers), 3)))
    model = energy.model(measures, list(poses(proportions.base, 3)))
    places = 0.1 * rng.normal(size=3 * len(subject.markers))
    direction = np.concatenate([rng.normal(size=len(proportions.names)), places])
    values = []
    for step in (-1e-4, 1e-4):
        values.append(energy.at(model, (step * direction, None)).value)
    assert (values[1] - values[0]) / 2e-4 == pytest.approx(model.gradient @ direction, rel=2e-3)


def test_lengths_are_found_and_places_handed_on() -> None:
    subject = marked()
    factors = {"left_knee_flexion": 1.08, "left_elbow_flexion": 0.93}
    person = subject.scaled(factors)
    body = Body(person)
    fit = fit_markers(subject, measured(body, poses(body, 8), 0.001), settings=MarkerFitSettings(effective_frames=8.0))
    lengths_found = dict(zip(fit.names, fit.scales, strict=True))
    for name in fit.names:
        assert lengths_found[name] == pytest.approx(factors.get(name, 1.0), abs=0.035), name
    fitted = {marker.name: marker for marker in fit.subject.markers}
    for marker in subject.markers:
        assert fitted[marker.name].std <= marker.std * (1.0 + 1e-9)
    off = [np.linalg.norm(np.subtract(fitted[m.name].xyz, m.xyz)) for m in person.markers]
    assert np.median(off) < 0.005


def test_a_person_of_another_size_is_resized_first() -> None:
    subject = marked()
    body = Body(subject.resized(0.75))
    fit = fit_markers(subject, measured(body, poses(body, 2)))
    assert fit.size * np.exp(np.log(fit.scales).mean()) == pytest.approx(0.75, abs=0.02)


def displaced(subject: Subject, seed: int) -> Subject:
    """A person whose markers sit a centimetre from their places in the set."""
    rng = np.random.default_rng(seed)
    moved = [np.array(m.xyz) + rng.normal(size=3) * 0.01 / np.sqrt(3.0) for m in subject.markers]
    places: list[tuple[float, float, float]] = [(float(x), float(y), float(z)) for x, y, z in moved]
    return subject.with_markers([replace(m, xyz=xyz) for m, xyz in zip(subject.markers, places, strict=True)])


def standing(body: Body, count: int, **held: float) -> np.ndarray:
    """Upright, all joints at zero but some that are held [rad]."""
    q = standing_pose(body, body.neutral)
    for name, angle in held.items():
        q[body.model.idx_qs[body.model.getJointId(name)]] = angle
    return np.tile(body.clamp(q), (count, 1))


def test_a_static_trial_determines_the_zeros_of_the_joints() -> None:
    """Misplaced markers shift the joints' zeros, which a known pose restores."""
    body = Body(displaced(marked(), 5))
    q = poses(body, 8)
    moving, static = measured(body, q, 0.001), measured(body, standing(body, 4), 0.001, seed=1)
    off = []
    for stood in ((), static):
        fit = fit_markers(marked(), moving, stood)
        assert fit.frames == tuple(range(8))
        assert fit.notes == ()
        errors = np.array([body.difference(a, b)[6:] for a, b in zip(q, fit.poses, strict=True)])
        off.append(float(np.sqrt(np.mean(errors.mean(axis=0) ** 2))))
    assert off[1] < 0.5 * off[0]


def test_static_frames_count_as_one() -> None:
    """A longer static trial does not make the pose better known, and its heading does not matter."""
    body = Body(marked())
    moving, stood = measured(body, poses(body, 3)), standing(body, 1)
    fits = [fit_markers(marked(), moving, measured(body, np.tile(stood, (count, 1)))) for count in (1, 5)]
    np.testing.assert_allclose(fits[0].scales, fits[1].scales, atol=1e-6)
    np.testing.assert_allclose(fits[0].covariance, fits[1].covariance, rtol=1e-4, atol=1e-9)
    turned_round = stood.copy()
    turned_round[:, 3:7] = 0.0, 0.0, 1.0, 0.0
    other = fit_markers(marked(), moving, measured(body, turned_round))
    np.testing.assert_allclose(fits[0].scales, other.scales, atol=1e-5)


def test_joints_that_are_bent_in_a_static_trial_are_not_taken_as_known() -> None:
    body = Body(marked())
    held = {"left_shoulder_elevation": 1.4, "right_shoulder_elevation": 1.4}
    moving, static = measured(body, poses(body, 3), 0.001), measured(body, standing(body, 3, **held), 0.001)
    fit = fit_markers(marked(), moving, static)
    assert set(fit.bent) >= set(held)
    assert not any("knee" in name or "hip" in name for name in fit.bent)
    (note,) = fit.notes
    assert note.startswith("bent in the static trial")
    assert "left_shoulder_elevation" in note


def test_exact_markers_give_the_pose_despite_outliers() -> None:
    body = Body(marked().with_markers([replace(m, std=1e-3) for m in marked().markers]))
    q = poses(body, 6)
    seen = measured(body, q)
    for t, observation in enumerate(seen):
        assert observation.markers is not None
        observation.markers[3 * t] += 0.2
        observation.markers[3 * t + 1] = np.nan
    tracker = make_tracker("markers", body, settings_for("markers", modes=1))
    results = [result for result, _ in run(tracker, seen, 0)]
    assert {r.status for r in results} == {"tracked"}
    assert np.rad2deg(np.abs(turned(body, q, results))).max() < 1.5


def test_a_frame_without_markers_is_unobserved_and_one_with_few_is_searched_widely() -> None:
    body = Body(marked())
    seen = measured(body, poses(body, 5))
    assert seen[2].markers is not None
    assert seen[3].markers is not None
    seen[2].markers[:] = np.nan
    seen[3].markers[6:] = np.nan
    tracker = make_tracker("markers", body, settings_for("markers", changes={"markers": {"samples": 4}}))
    results = [result for result, _ in run(tracker, seen, 0)]
    assert [r.status for r in results] == ["tracked", "tracked", "unobserved", "tracked", "tracked"]
    assert [int(r.extra.get("searches_sample", 0)) for r in results] == [0, 0, 0, 4, 0]


def test_places_that_are_unsure_leave_the_pose_as_unsure_in_every_frame() -> None:
    body = Body(marked())
    posed, prior, whole = [body.at(body.neutral)], np.zeros((1, body.nv, body.nv)), np.eye(body.nv)[None]
    once = lasting_by_places(body, LastingPoints.markers(body), posed, prior, whole)
    twice = Body(marked().with_markers([replace(m, std=2.0 * m.std) for m in marked().markers]))
    np.testing.assert_allclose(
        np.diag(lasting_by_places(twice, LastingPoints.markers(twice), posed, prior, whole)[0])[6:12],
        4.0 * np.diag(once[0])[6:12],
        rtol=1e-2,
    )


def test_zeros_that_are_less_sure_widen_what_lasts_and_leave_what_moves_with_what() -> None:
    body = Body(marked())
    posed, prior, whole = [body.at(body.neutral)], np.zeros((1, body.nv, body.nv)), np.eye(body.nv)[None]
    places = lasting_by_places(body, LastingPoints.markers(body), posed, prior, whole)[0]
    zeros = [Zero("left_hip_flexion", 0.2), Zero("right_hip_flexion", 1e-5)]
    less = Body(marked().with_markers(marked().markers, zeros))
    unsure = lasting_by_places(less, LastingPoints.markers(less), posed, prior, whole)[0]
    hip = body.v_names.index("left_hip_flexion")
    expected = np.sqrt(np.diag(places))
    expected[hip] = 0.2
    np.testing.assert_allclose(np.sqrt(np.diag(unsure)), expected)
    np.testing.assert_allclose(correlation(unsure), correlation(places), atol=1e-9)


def test_markers_that_are_off_together_leave_zeros_less_sure_than_each_by_itself_would() -> None:
    body = Body(marked())
    fit = fit_markers(marked(), measured(body, poses(body, 12), 0.003), settings=MarkerFitSettings(frames=12))
    fitted = Body(fit.subject)
    posed, nothing = [fitted.at(fit.poses[0])], np.zeros((1, fitted.nv, fitted.nv))
    zeros, fitted.zero_std = fitted.zero_std, np.full(fitted.nv, np.nan)
    alone = np.sqrt(
        np.diag(lasting_by_places(fitted, LastingPoints.markers(fitted), posed, nothing, np.eye(fitted.nv)[None])[0])
    )
    assert np.all(zeros > 1.05 * alone)


def correlation(covariance: np.ndarray) -> np.ndarray:
    std = np.sqrt(np.diag(covariance))
    return covariance / np.outer(std, std)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Body, np.ndarray]:
    """A TRC file of a person with the lengths of human34, the body and its poses."""
    body = Body(marked())
    q = poses(body, 6)
    path = tmp_path_factory.mktemp("points") / "bend.trc"
    rng = np.random.default_rng(3)
    points = body.markers_of(body.placed(q))
    write_trc(path, body.marker_names, points + 0.001 * rng.normal(size=points.shape), np.arange(6) / FPS)
    return path, body, q


@pytest.fixture(scope="module")
def tracked(recorded: tuple[Path, Body, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("runs") / "bend.run"
    return km.track("human34", points=recorded[0], fit="off", out=path)


def test_a_file_of_points_becomes_a_run(recorded: tuple[Path, Body, np.ndarray], tracked: Any) -> None:
    _, body, q = recorded
    assert tracked.complete
    assert tracked.header.points == (str(recorded[0]),)
    assert set(tracked.status) == {"tracked"}
    off = np.rad2deg(np.array([body.difference(a, b)[6:] for a, b in zip(q, tracked.q, strict=True)]))
    assert np.sqrt(np.mean(off**2)) < 1.5
    assert tracked.markers.shape == (6, len(body.marker_names), 3)
    residuals = marker_residuals(tracked, CostSettings().markers)
    assert residuals is not None
    assert np.nanmax(residuals.rms) < 0.01
    assert not residuals.missing.any()


def test_a_run_from_points_resumes_to_the_bit(
    recorded: tuple[Path, Body, np.ndarray], tracked: Any, tmp_path: Path
) -> None:
    again = km.track("human34", points=[recorded[0]], fit="off", out=tmp_path / "again.run")
    resumed = km.track("human34", points=recorded[0], fit="off", out=tmp_path / "again.run", resume=True)
    np.testing.assert_array_equal(tracked.q, again.q)
    np.testing.assert_array_equal(again.q, resumed.q)


def test_a_run_from_points_is_drawn_by_a_camera_facing_it(tracked: Any) -> None:
    scene = pictured_scene(tracked)
    (camera,) = scene.cameras
    pixels = camera.project(tracked.landmarks.reshape(-1, 3))
    assert ((pixels > 0.0) & (pixels < np.array(camera.image_size))).all()


def test_the_model_for_opensim_has_the_markers(tracked: Any, tmp_path: Path) -> None:
    text = km.export(tracked, tmp_path / "bend.osim").read_text()
    for name in tracked.body.marker_names:
        assert f'<Marker name="{name}"' in text


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"cameras": "cameras.json"}, "cameras: is of cameras"),
        ({"cues": "edges"}, "cues: is of cameras"),
        ({"height": 1.8}, "height: is of cameras"),
        ({"markers": "nobody"}, "nobody: is not a set of markers"),
        ({"fit": "proportions"}, "fit: 'proportions' is of keypoints"),
        ({"start": 7.0}, "no frame between --start and --end"),
        ({"subject": "arm8"}, "has links that arm8 has not"),
    ],
)
def test_what_does_not_go_with_points_is_refused(
    recorded: tuple[Path, Body, np.ndarray], given: dict[str, Any], problem: str
) -> None:
    arguments = {"subject": "human34", "points": recorded[0]} | given
    with pytest.raises(km.InputError, match=problem):
        km.track(arguments.pop("subject"), **arguments)


def test_options_of_points_need_points() -> None:
    with pytest.raises(km.InputError, match="markers: is for points"):
        km.track("human34", "walk.mp4", markers="opencap")
    with pytest.raises(km.InputError, match="fit: no points are given"):
        km.track("human34", "walk.mp4", fit="markers")


def test_a_static_trial_of_a_file_joins_the_fit(recorded: tuple[Path, Body, np.ndarray], tmp_path: Path) -> None:
    """The trial is the same from TRC and npz, and the run keeps nothing of it but the person."""
    path, body, _ = recorded
    points, time = body.markers_of(body.placed(standing(body, 3))), np.arange(3) / FPS
    more = np.concatenate([points, points[:, :1] + 0.1], axis=1)
    write_trc(tmp_path / "static.trc", (*body.marker_names, "EXTRA"), more, time)
    np.savez(tmp_path / "static.npz", points=points, names=np.array(body.marker_names), fps=FPS, unit="m", up="z")
    with pytest.warns(km.InputWarning, match="static trial alone are left out: EXTRA"):
        fit = km.fit("human34", points=path, static=tmp_path / "static.trc")
    again = km.fit("human34", points=path, static=[tmp_path / "static.npz"])
    np.testing.assert_allclose(fit.scales, again.scales, atol=1e-4)
    assert np.abs(fit.scales - km.fit("human34", points=path).scales).max() > 1e-6
    run = km.track("human34", points=path, static=tmp_path / "static.npz", out=tmp_path / "walk.run")
    assert run.header.points == (str(path),)
    assert len(run) == 6
    assert [m.std for m in run.subject.markers] == [m.std for m in again.subject.markers]


def test_a_static_trial_without_a_use_is_refused(
    recorded: tuple[Path, Body, np.ndarray], tracked: Any, tmp_path: Path
) -> None:
    path, me = recorded[0], tmp_path / "me.urdf"
    tracked.subject.scaled({"left_knee_flexion": 1.02}).write(me)
    points = np.random.default_rng(0).normal(size=(2, 4, 3))
    write_trc(tmp_path / "other.trc", ["A", "B", "C", "D"], points, [0.0, 0.02])
    for subject, given, problem in (
        ("human34", {"static": path}, "static: is for points"),
        ("human34", {"points": path, "static": path, "fit": "off"}, "static: is for the fit"),
        (me, {"points": path, "static": path}, "static: .*me.urdf is used as measured"),
        ("human34", {"points": path, "static": tmp_path / "other.trc"}, "other.trc: no frame has 4 of the markers"),
        ("human34", {"points": path, "static": tmp_path / "none.trc"}, "none.trc"),
    ):
        with pytest.raises(km.InputError, match=problem) as caught:
            km.track(subject, **given)
        assert "\n" not in str(caught.value)


def test_a_left_handed_file_is_refused(recorded: tuple[Path, Body, np.ndarray], tmp_path: Path) -> None:
    _, body, q = recorded
    points = body.markers_of(body.placed(q)) * np.array([1.0, -1.0, 1.0])
    write_trc(tmp_path / "mirrored.trc", body.marker_names, points, np.arange(6) / FPS)
    with pytest.raises(km.InputError, match="are mirrored"):
        km.track("human34", points=tmp_path / "mirrored.trc")


def test_a_fitted_subject_serves_other_files(recorded: tuple[Path, Body, np.ndarray], tmp_path: Path) -> None:
    fit = km.fit("human34", points=recorded[0], out=tmp_path / "me.urdf")
    assert fit.names
    again = km.track(tmp_path / "me.urdf", points=recorded[0])
    assert [m.name for m in again.subject.markers] == [m.name for m in fit.subject.markers]
    assert set(again.status) == {"tracked"}
