"""Laws of the proportion fit: known lengths come back, sides stay tied, ranges hold, without observations nothing
changes."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import body_of, camera_at, observe

from estimator.data.observation import Observation
from estimator.fitting.fit import SIZES, Fit, bound_note, chosen_pieces, fit_resized, stature, unfitted
from estimator.fitting.fitted_points import FittedKeypoints
from estimator.fitting.measures import Measures, MeasuresEnergy
from estimator.fitting.person import fit_person
from estimator.fitting.settings import FitSettings
from estimator.synthesis.motion import authored_motion
from estimator.tracking.registry import settings_for
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.subject import Subject
from tests.tiny_clip import FEW_STARTS

AROUND = tuple(camera_at(a, distance=3.5, focal=660.0, height=1.2, aim=(0.0, 0.0, 0.95)) for a in (20, 110, 200, 290))
TRACK = settings_for(
    "css",
    modes=2,
    changes={"css": {"samples": 2}, "search": FEW_STARTS, "cost": {"keypoint_noise": 0.01, "keypoint_place": 0.007}},
)
FEW = FitSettings(frames=8, rounds=2)


@cache
def person() -> tuple[Subject, dict[str, float]]:
    """human34 with lengths of its own."""
    subject = body_of("human34").subject
    drawn = np.random.default_rng(91).uniform(0.92, 1.08, size=len(subject.proportions))
    scales = {p.joint: float(s) for p, s in zip(subject.proportions, drawn, strict=True)}
    return subject.scaled(scales), scales


def clip(subject: Subject, noise: float, count: int = 8) -> list[Observation]:
    body, rng = Body(subject), np.random.default_rng(92)
    motion = authored_motion(body, np.linspace(0.3, 2.3, count))
    return [observe(body, q, AROUND, noise=noise, rng=rng, index=i, time=0.25 * i) for i, q in enumerate(motion)]


@cache
def fitted() -> Fit:
    return fit_person(body_of("human34").subject, clip(person()[0], 0.5), settings=FEW, track_settings=TRACK)


def test_known_lengths_come_back() -> None:
    fit, scales = fitted(), person()[1]
    assert fit.names == tuple(scales)
    assert len(fit.frames) == 8
    truth = np.array(list(scales.values()))
    limbs = np.array([name not in ("left_clavicle_elevation", "skull") for name in fit.names])
    assert np.abs(fit.scales - truth)[limbs].max() < 0.02
    # the heights of neck and skull trade against bends of spine and neck, and the fit reports by how much
    assert np.all(np.abs(fit.scales - truth) < 3.0 * np.maximum(fit.std, 0.007))
    assert np.abs(truth - 1.0).max() > 0.05  # there was something to find
    prior = np.array([p.std for p in body_of("human34").subject.proportions])
    assert np.all(fit.std > 0.0)
    assert np.all(fit.std < prior)


def test_sides_stay_tied_and_the_subject_is_the_scaled_one() -> None:
    fit = fitted()
    given = body_of("human34").subject
    assert fit.subject.urdf == given.scaled(dict(zip(fit.names, map(float, fit.scales), strict=True))).urdf
    model = fit.subject.model
    for joint in ("shoulder_elevation", "elbow_flexion", "hip_flexion", "knee_flexion", "ankle_dorsiflexion"):
        left, right = (model.jointPlacements[model.getJointId(f"{s}_{joint}")].translation for s in ("left", "right"))
        assert np.allclose(left * [1.0, -1.0, 1.0], right, atol=1e-12)


def test_lengths_stay_within_their_hard_range() -> None:
    """Cameras 1.5 times as far away turn the same picture into a giant beyond the allowed range."""
    subject = body_of("human34").subject
    low, high = (np.array([getattr(p, f"scale_{end}") for p in subject.proportions]) for end in ("min", "max"))
    away = tuple(replace(c, t_camera_world=1.5 * c.t_camera_world) for c in AROUND)
    seen = [replace(o, cameras=away) for o in clip(subject, 0.5, 2)]
    fit = fit_person(subject, seen, settings=replace(FEW, rounds=1), track_settings=TRACK)
    relative = fit.scales / fit.size
    assert np.all((relative >= low - 1e-12) & (relative <= high + 1e-12))
    assert 1.1 < fit.size <= SIZES[1]
    assert "left_knee_flexion (largest)" in bound_note(fit.subject)
    assert bound_note(subject) == ""


@pytest.mark.parametrize("size", [pytest.param(0.55, marks=pytest.mark.thorough), 1.18])
def test_people_of_any_size_are_found_by_several_cameras(size: float) -> None:
    """A child is not an adult with lengths at their bounds: size comes first, then proportions around it."""
    of_size = person()[0].resized(size)
    seen = clip(of_size, 0.5, 4)
    fit = fit_person(body_of("human34").subject, seen, settings=FEW, track_settings=TRACK)
    truth = size * np.array(list(person()[1].values()))
    limbs = np.array([name not in ("left_clavicle_elevation", "skull") for name in fit.names])
    assert np.abs(fit.scales / truth - 1.0)[limbs].max() < 0.04
    assert bound_note(fit.subject) == ""
    assert f"{fit.size:.2f} times as large" in fit.notes[0]
    assert fit.size == pytest.approx(size, rel=0.06)
    body, own = Body(fit.subject), Body(of_size)
    placed = [body.landmarks(body.at(fit.poses[i])) for i in range(len(seen))]
    true = [own.landmarks(own.at(q)) for q in authored_motion(own, np.linspace(0.3, 2.3, len(seen)))]
    assert np.mean(np.linalg.norm(np.array(placed) - np.array(true), axis=2)) < 0.015


def test_one_camera_does_not_see_how_large_a_person_is() -> None:
    child = body_of("human34").subject.resized(0.7)
    seen = [
        replace(o, cameras=o.cameras[:1], pixels=o.pixels[:1], confidence=o.confidence[:1]) for o in clip(child, 0.5, 3)
    ]
    given, once = body_of("human34").subject, replace(FEW, rounds=1)
    fit = fit_person(given, seen, settings=once, track_settings=TRACK)
    assert fit.size == 1.0
    height = stature(child)
    known = fit_person(given, seen, settings=once, track_settings=TRACK, height=height)
    assert stature(known.subject) == pytest.approx(height, rel=1e-9)
    assert known.notes == ()
    assert np.mean(known.scales) == pytest.approx(0.7, rel=0.05)
    true = authored_motion(Body(child), np.linspace(0.3, 2.3, 3))[:, :3]
    apart = [np.linalg.norm(f.poses[:, :3] - true, axis=1).mean() for f in (fit, known)]
    assert apart[1] < 0.25 < apart[0]
    for k in range(3):
        posed = Body(known.subject).at(known.poses[k])
        pixels = seen[k].cameras[0].project(Body(known.subject).landmarks(posed))
        assert np.nanmedian(np.linalg.norm(pixels - seen[k].pixels[0], axis=1)) < 4.0


def test_a_height_that_contradicts_the_cameras_is_reported() -> None:
    given = body_of("human34").subject
    seen = clip(given, 0.5, 2)
    fit = fit_person(given, seen, settings=replace(FEW, rounds=1), track_settings=TRACK, height=1.3)
    assert re.search(r"the cameras see a person of 1\.[67]\d m", fit.notes[0])
    assert "the height given is 1.30 m" in fit.notes[0]
    assert fit_person(given, seen, settings=replace(FEW, rounds=1), track_settings=TRACK, height=1.70).notes == ()


def test_nothing_usable_leaves_the_subject_as_it_is() -> None:
    subject = body_of("human34").subject
    blank = [replace(o, pixels=o.pixels * np.nan, confidence=o.confidence * 0.0) for o in clip(subject, 0.0, 2)]
    for seen in ([], blank):
        fit = fit_person(subject, seen)
        assert fit.subject is subject
        assert fit.frames == ()
        assert np.array_equal(fit.scales, np.ones(len(fit.names)))


def test_a_short_clip_is_one_piece_whose_frames_are_evenly_spread() -> None:
    seen = clip(body_of("human34").subject, 0.0, 9)
    seen[0] = replace(seen[0], confidence=seen[0].confidence * 0.0)
    (chosen,) = chosen_pieces(seen, FitSettings(seconds=100.0, frames=3))
    assert [o.index for o in chosen] in ([1, 4, 8], [1, 5, 8])
    (whole,) = chosen_pieces(seen, FitSettings(seconds=100.0, frames=50))
    assert [o.index for o in whole] == list(range(1, 9))


def test_a_long_clip_gives_its_beginning_and_the_pieces_that_look_least_alike() -> None:
    seen = clip(body_of("human34").subject, 0.0, 12)
    for k in (6, 7):  # another pose in these frames alone
        seen[k] = replace(seen[k], pixels=seen[k].pixels * (1.0, 0.5))
    seen = [replace(o, pixels=seen[0].pixels) if k not in (6, 7) else o for k, o in enumerate(seen)]
    step = seen[1].time - seen[0].time
    pieces = chosen_pieces(seen, FitSettings(seconds=4.0 * step, frames=4, pieces=2))
    assert [[o.index for o in piece] for piece in pieces] == [[0, 1], [6, 7]]


def test_fits_repeat() -> None:
    seen = clip(person()[0], 0.5, 3)
    once, given = replace(FEW, rounds=1), body_of("human34").subject
    first, second = (fit_person(given, seen, seed=3, settings=once, track_settings=TRACK) for _ in range(2))
    assert np.array_equal(first.scales, second.scales)
    assert first.subject.urdf == second.subject.urdf


def measures_of(x: np.ndarray, count: int) -> Measures:
    return Measures(x[:count], x[count:].reshape(-1, 3))


def test_the_profiles_gradient_is_that_of_the_minimised_energy() -> None:
    """With every pose at its own minimum the derivative in the scales is the partial one (envelope theorem)."""
    proportions = ProportionedBody(body_of("human34").subject)
    body = body_of("human34")
    seen = clip(person()[0], 0.5, 2)
    proportions.base.keypoint_std = np.full(len(body.landmark_names), 0.015)
    points = FittedKeypoints(proportions, cameras=2)
    energy = MeasuresEnergy(proportions, points, seen, replace(TRACK.cost, interpenetration_weight=0.0), 1.0)
    count = len(proportions.names)
    x = np.concatenate([np.full(count, 1.01), 0.004 * np.random.default_rng(0).normal(size=3 * len(points.free))])
    poses = list(authored_motion(body, np.linspace(0.3, 2.3, 2)))
    model = energy.model(measures_of(x, count), poses)
    for k in (*range(count), count + 3 * body.landmark_names.index("left_knee"), len(x) - 1):
        step = 1e-4 * np.eye(len(x))[k]
        ahead, behind = (energy.model(measures_of(x + sign * step, count), model.poses).value for sign in (1.0, -1.0))
        assert (ahead - behind) / 2e-4 == pytest.approx(model.gradient[k], abs=2e-4 * np.abs(model.gradient).max())
    assert np.array_equal(model.hessian, model.hessian.T)
    assert np.linalg.eigvalsh(model.hessian)[0] > 0.0


def test_poses_are_as_uncertain_as_the_lengths_make_them() -> None:
    """The derivative of a pose in the lengths is the motion of its minimum; it widens the covariance at given
    lengths."""
    proportions = ProportionedBody(body_of("human34").subject)
    body = body_of("human34")
    cost = replace(TRACK.cost, interpenetration_weight=0.0, pose_prior_weight=0.0)  # their Hessians omit some curvature
    energy = MeasuresEnergy(proportions, FittedKeypoints(proportions, cameras=2), clip(body.subject, 0.0, 1), cost, 1.0)
    count = len(proportions.names)
    x = np.ones(count)
    model = energy.model(measures_of(x, count), list(authored_motion(body, np.array([1.5]))))
    (follows,) = model.follows
    for k in (proportions.names.index("left_knee_flexion"), proportions.names.index("left_elbow_flexion")):
        step = 1e-3 * np.eye(len(x))[k]
        ahead, behind = (
            energy.model(measures_of(x + sign * step, count), model.poses).poses[0] for sign in (1.0, -1.0)
        )
        moved = (body.difference(model.poses[0], ahead) - body.difference(model.poses[0], behind)) / 2e-3
        np.testing.assert_allclose(follows[:, k], moved, atol=0.1 * np.abs(moved).max())
    of_measures = model.measures_covariance
    wider = model.pose_covariance(0, of_measures) - model.covariances[0]
    np.testing.assert_allclose(wider, follows @ of_measures @ follows.T, atol=1e-12)
    fit = fitted()
    assert fit.pose_covariance.shape == (8, body.nv, body.nv)
    assert np.linalg.eigvalsh(fit.pose_covariance)[:, 0].min() > -1e-12
    estimate = fit.estimates[fit.frames[0]]
    assert np.array_equal(estimate.q, fit.poses[0])
    assert np.array_equal(estimate.covariance, fit.pose_covariance[0])


@pytest.mark.parametrize(
    ("person", "size", "fits"), [(0.8, 0.8, 2), (1.0, 1.0, 1), (0.2, SIZES[0], 2), (3.0, SIZES[1], 2)]
)
def test_a_subject_is_resized_within_the_sizes_of_people(person: float, size: float, fits: int) -> None:
    """Each fit changes the size by the factor it finds, until that factor is one."""
    subject, heights = body_of("human34").subject, list[float]()

    def fit(sized: Subject) -> tuple[Fit, float]:
        heights.append(stature(sized))
        return unfitted(sized, ProportionedBody(sized)), person * stature(subject) / heights[-1]

    best = fit_resized(subject, fit, 3)
    assert (best.size, len(heights)) == (pytest.approx(size), fits)
    assert heights[-1] == pytest.approx(size * heights[0])
    assert stature(best.subject) == heights[-1]
    assert best.frames == ()
    assert fit_resized(subject, fit, 0).size == 1.0
