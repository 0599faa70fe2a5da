"""Smoothing with features and flow assigned again: flow between two free poses, energies, bits."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from builders import body_of, camera_at

import kinemode
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.numerics.robust import LORENTZIAN
from estimator.runs.run_reader import Run
from estimator.trackers.base import energy_of
from estimator.tracking.registry import make_tracker
from estimator.tracking.smoothing import clip as smoothing_of_clips, smooth_track
from estimator.tracking.smoothing.chain import REACH
from estimator.tracking.smoothing.renewal import Renewal, Trajectory
from estimator.tracking.smoothing.ties import FlowTie
from estimator.vision.cues.assigned import AssignedPoints, assignments
from estimator.vision.cues.reader import ReadAhead
from humanoid.kinematics.body import Body
from kinemode.explain import cue_reader, run_settings
from kinemode.rendering import RenderedClip
from tests.tiny_clip import QUICK, named


def followed(body: Body, q: np.ndarray, moved: np.ndarray) -> AssignedPoints:
    """Points of a body at q, tracked to their places in another pose, with the highest certainty of flow."""
    rng, count, camera = np.random.default_rng(1), 30, camera_at(15.0, distance=3.5)
    joint, local = rng.integers(1, body.njoints, count), rng.normal(0.0, 0.1, (count, 3))
    posed = body.at(moved)
    world = np.einsum("nij,nj->ni", posed.rotations[joint], local) + posed.translations[joint]
    W = rng.normal(size=(count, 2, 2))
    W = W @ W.transpose(0, 2, 1)
    precision = np.stack([W[:, 0, 0], W[:, 0, 1], W[:, 1, 1]], axis=1)
    weight = rng.uniform(0.5, 1.5, count)
    group = assignments(np.arange(count), camera.project(world), precision, weight, LORENTZIAN, 4.0)
    return AssignedPoints(body, camera, joint, local, [group])


@pytest.mark.parametrize("name", ["human34", "arm8", "gripper"])
def test_flow_between_two_poses(name: str) -> None:
    """With the earlier pose as origin of the flow it is the term of the later one; its derivatives by both poses equal
    differences; the true movement from the same place has no energy."""
    body, rng = body_of(name), np.random.default_rng(2)
    past = body.integrate(body.neutral, rng.normal(0.0, 0.1, body.nv))
    now, off = (body.integrate(past, rng.normal(0.0, 0.03, body.nv)) for _ in range(2))
    term, nv = followed(body, past, now), body.nv
    tie = FlowTie(body, term, body.at(past))

    def at(before: np.ndarray, after: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        gradient, hessian = np.zeros(2 * nv), np.zeros((2 * nv, 2 * nv))
        return tie.accumulate_pair(body.at(before), body.at(after), gradient, hessian), gradient, hessian

    assert at(past, now)[0] == pytest.approx(0.0, abs=1e-12)
    alone, (value, gradient, hessian) = Cost(body, [term]).at(off), at(past, off)
    assert value == pytest.approx(alone.value, rel=1e-9)
    assert value > 1.0
    np.testing.assert_allclose(gradient[nv:], alone.gradient, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(hessian[nv:, nv:], alone.hessian, rtol=1e-9, atol=1e-6)
    value, gradient, hessian = at(off, now)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-9 * np.abs(hessian).max())
    assert np.linalg.eigvalsh(hessian)[0] > -1e-9 * np.abs(hessian).max()
    for v in rng.normal(size=(6, 2 * nv)):
        ends = [at(body.integrate(off, s * v[:nv]), body.integrate(now, s * v[nv:]))[0] for s in (-1e-6, 1e-6)]
        assert gradient @ v == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-4)


@pytest.fixture(scope="module")
def tracked(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("run") / "a.run"
    return kinemode.track(subject="human34", fit="off", settings=QUICK, mask=clip.masks, out=out, **named(clip))


@pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
def test_rounds_lower_the_energy_window_by_window(tracked: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame's pictures are read once for all rounds, the total energy falls, and the run has these bits."""
    settings = run_settings(tracked)
    search = energy_of(make_tracker("css", tracked.body, settings), "css")
    seen, energies = list[int](), list[tuple[float, float]]()

    class Watched(Renewal):
        def __call__(self, trajectories: list[Trajectory]) -> None:  # type: ignore[override]
            see = self._see
            self._see = lambda i: seen.append(i) or see(i)  # type: ignore[func-returns-value]
            none = replace(self._settings, rounds=0)
            self._settings, chosen = none, self._settings
            super().__call__(trajectories)
            before = [self.energy(each) for each in trajectories]
            self._settings = chosen
            super().__call__(trajectories)
            energies.extend((b, self.energy(each)) for b, each in zip(before, trajectories, strict=True))

    monkeypatch.setattr(smoothing_of_clips, "Renewal", Watched)
    observations = [tracked.observation(i) for i in range(len(tracked))]
    results, smooth = list(tracked), replace(settings.smooth, renewed=4)
    with closing(ReadAhead(cue_reader(tracked, settings))) as cues:
        windows = smooth_track(search, observations, results, smooth, cues=cues).q
        assert seen == 2 * list(range(len(tracked)))
        assert all(after < before - 1.0 for before, after in energies)
        assert not np.array_equal(windows, tracked.q)
        monkeypatch.undo()
        whole = smooth_track(search, observations, results, settings.smooth, cues=cues).q
        as_assigned = smooth_track(search, observations, results, replace(settings.smooth, rounds=0), cues=cues).q
    assert np.array_equal(whole, tracked.q)
    assert not np.array_equal(whole, as_assigned)


@pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
def test_no_window_buys_a_smoother_motion_with_its_images(tracked: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a motion prior that has become so stiff that all energy falls where the motion shrinks, no window ends with
    more of the images' energy than it began with."""
    settings = run_settings(tracked)
    search = energy_of(make_tracker("css", tracked.body, settings), "css")
    images = list[tuple[float, float]]()

    class Watched(Renewal):
        def __call__(self, trajectories: list[Trajectory]) -> None:  # type: ignore[override]
            for each in trajectories:
                std = each.motion.velocity_std, each.motion.acceleration_std
                each.motion = each.motion._replace(velocity_std=0.01 * std[0], acceleration_std=0.01 * std[1])
            super().__call__(trajectories)

        def _window(self, trajectory: Trajectory, seen: dict[int, Observation], first: int, last: int) -> None:
            low, high = max(0, first - REACH), min(len(trajectory.q), last + REACH)

            def shown(q: np.ndarray) -> float:
                images = self._renewed(trajectory, seen, q, low, first, last).images
                return sum(float(part.sum()) for part in images.values(q))

            before = trajectory.q[low:high].copy()
            super()._window(trajectory, seen, first, last)
            images.append((shown(before), shown(trajectory.q[low:high])))

    monkeypatch.setattr(smoothing_of_clips, "Renewal", Watched)
    observations = [tracked.observation(i) for i in range(len(tracked))]
    with closing(ReadAhead(cue_reader(tracked, settings))) as cues:
        smooth_track(search, observations, list(tracked), replace(settings.smooth, renewed=4), cues=cues)
    assert len(images) >= 2
    assert all(after <= before for before, after in images)


@pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
def test_pictures_tie_the_trajectory_to_the_filtered_modes(tracked: Run) -> None:
    """Modes that are trusted far more than all else are returned, after features were assigned again, too; keypoints
    alone tie to none, to the last bit."""
    settings, body = run_settings(tracked), tracked.body
    search = energy_of(make_tracker("css", body, settings), "css")
    observations, results = [tracked.observation(i) for i in range(len(tracked))], list(tracked)
    firm, none = (replace(settings.smooth, overconfidence=each, stance=0.0) for each in (1e-4, 0.0))
    with closing(ReadAhead(cue_reader(tracked, settings))) as cues:
        tied = smooth_track(search, observations, results, firm, cues=cues)
    assert tied.mode is not None
    for q, k, result in list(zip(tied.q, tied.mode, results, strict=True))[1:]:  # the first frame has keypoints
        free = np.diag(result.covariance[k]) > 0.0
        assert np.abs(body.difference(result.q[k], q)[free]).max() < 2e-3
    by_keypoints = [smooth_track(search, observations, results, each).q for each in (firm, none)]
    assert np.array_equal(*by_keypoints)
