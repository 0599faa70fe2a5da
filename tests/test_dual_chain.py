"""Poses and points that correct each other, on a short rendered clip of an upper body with long sleeves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
import pytest

import kinemode as km
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.checked_arrays import DamageError
from estimator.data.observation import Observation
from estimator.inference.chains.evidence import EvidenceSettings
from estimator.inference.chains.exchange import ONE_WAY, PRINTED
from estimator.search.cost_model import CostModel
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import ModeSearchSettings
from estimator.trackers.dual_chain.pose_chain import PoseChainSettings
from estimator.trackers.dual_chain.settings import DualChainSettings
from estimator.trackers.dual_chain.tracker import DualChain, DualState
from estimator.trackers.dual_chain.walk import TemperingSettings
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.errors import InputError
from tests.builders import body_of

FEW = DualChainSettings(pose=PoseChainSettings(particles=150, kernels=50))
FRAMES = 4
Tracked = tuple[DualChain, list[DualState]]


@dataclass(frozen=True)
class Seen:
    """The observations of all frames, the first with landmarks, and the true poses (T, nq)."""

    observations: list[Observation]
    q: np.ndarray


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seen]:
    folder = tmp_path_factory.mktemp("talk")
    clip = km.render(
        folder, "talk", fps=25.0, seconds=FRAMES / 25.0, scene=km.SceneSettings(sleeves="long"),
        view=km.ViewSettings(parallel=True, image_size=(320, 240)),
    )  # fmt: skip
    ((name, video),) = clip.videos.items()
    camera = load_cameras(clip.cameras)[name]
    body = body_of("upper13")
    q = np.load(clip.truth)["q"]
    first = camera.project(body.landmarks(body.at(q[0])))
    with closing(
        CueReader([video], [camera], cue_settings(("edges", "silhouette")), plates=[clip.plates[name]])
    ) as reader:
        observations = []
        for i in range(FRAMES):
            pixels = first if i == 0 else np.full_like(first, np.nan)
            confidence = np.isfinite(pixels).all(axis=1).astype(float)
            observations.append(Observation(i, i / 25.0, (camera,), pixels[None], confidence[None], cues=reader.at(i)))
        yield Seen(observations, q)


def tracker(settings: DualChainSettings = FEW) -> DualChain:
    body = body_of("upper13")
    model = CostModel(body, None, SelfCollision(body), cue_settings(("edges", "silhouette")))
    return DualChain(ModeSearch(model, ModeSearchSettings()), settings)


def errors(body: Body, state: DualState, q: np.ndarray) -> float:
    """Mean distance [m] of landmarks, expected over the poses."""
    there = body.landmarks_of(body.placed(state.q))
    return float(np.linalg.norm(there - body.landmarks(body.at(q)), axis=2).mean())


@pytest.fixture(scope="module")
def tracked(seen: Seen) -> Tracked:
    """The tracker and its states, from equal random generators in every test."""
    made, states = tracker(), []
    for i, observation in enumerate(seen.observations):
        rng = np.random.default_rng([7, i])
        state = made.init(rng, observation)[0] if i == 0 else made.step(rng, states[-1], observation)[0]
        states.append(state)
    return made, states


def test_hands_are_followed_from_the_keypoints_of_one_frame(seen: Seen, tracked: Tracked) -> None:
    made, states = tracked
    assert errors(made.body, states[-1], seen.q[FRAMES - 1]) < 0.1
    hands = seen.observations[-1].cameras[0].project(made.parts.features.points(made.body.placed(seen.q[-1:])))[0]
    assert np.linalg.norm(states[-1].points.mean[:, :2] - hands, axis=1).max() < 12.0
    for state in states:
        assert (state.q >= made.body.lower).all()
        assert (state.q <= made.body.upper).all()


def test_the_first_poses_are_weighed_by_the_picture(seen: Seen, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the poses that the keypoints leave open: expectations are those under the likelihood."""
    body, states = body_of("upper13"), []
    elbow = body.place("left_elbow_flexion").q

    class Outlines:
        """An angle alone, in a closed form."""

        def log_likelihood(self, placed: PlacedBodies) -> np.ndarray:
            return np.asarray(6.0 * placed.q[:, elbow].reshape(-1))

    for outlines in (None, Outlines()):
        made = tracker(replace(FEW, pose=replace(FEW.pose, particles=2000)))
        monkeypatch.setattr(made, "_outlines", lambda *_, given=outlines: given)
        states.append(made.init(np.random.default_rng(3), seen.observations[0])[0].q)
    weight = np.exp(6.0 * states[0][:, elbow].reshape(-1))
    expected = weight @ states[0] / weight.sum()
    np.testing.assert_allclose(states[1].mean(axis=0), expected, atol=0.01)
    assert np.abs(expected - states[0].mean(axis=0)).max() > 0.05  # and it is informative


def test_a_stored_state_resumes_to_the_bit(seen: Seen, tracked: Tracked) -> None:
    made, states = tracked
    again = made.state_from(states[1].arrays())
    rng = np.random.default_rng([7, 2])
    after, _ = made.step(rng, again, seen.observations[2])
    np.testing.assert_array_equal(after.q, states[2].q)
    np.testing.assert_array_equal(after.points.mean, states[2].points.mean)
    beside = [state.alternative for state in (after, states[2])]
    assert beside[0] is not None
    assert beside[1] is not None
    np.testing.assert_array_equal(beside[0].q, beside[1].q)
    assert beside[0].log_odds == beside[1].log_odds
    without, _ = made.step(np.random.default_rng([7, 2]), replace(again, alternative=None), seen.observations[2])
    assert not np.array_equal(without.q, after.q)  # and it is followed
    with pytest.raises(DamageError, match="alternative_q has no poses"):
        made.state_from(states[2].arrays() | {"alternative_q": beside[0].q[:0]})
    broken = dict(states[1].arrays(), pose_owner=np.full(len(states[1].owner), 99))
    with pytest.raises(DamageError, match="not a hypothesis"):
        made.state_from(broken)


def test_a_black_frame_is_tracked(seen: Seen, tracked: Tracked) -> None:
    made, states = tracked
    observation = seen.observations[2]
    cues = observation.cues[0]
    assert cues.picture is not None
    black = replace(cues, by_name={}, picture=np.zeros_like(cues.picture))
    after, result = made.step(np.random.default_rng(0), states[1], replace(observation, cues=(black,)))
    assert np.isfinite(after.q).all()
    assert np.isfinite(after.points.covariance).all()
    spread = [made.body.differences(s.q[0], s.q).std(axis=0).mean() for s in (states[1], after)]
    assert spread[1] > spread[0]
    assert len(result.q)


@pytest.mark.parametrize(("chain", "exchange"), [(True, PRINTED), (True, ONE_WAY), (False, PRINTED)])
def test_likelihood_sampling_draws_an_undetected_hand_from_the_points(
    chain: bool, exchange: str, seen: Seen, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As printed: of a frame in which one hand makes no blob, only the message of the points places it."""
    plain = PoseChainSettings(particles=150, tempering=TemperingSettings(powers=1))
    alone = EvidenceSettings(shared=0.0)
    made = tracker(DualChainSettings(chain=chain, past=False, exchange=exchange, pose=plain, evidence=alone))
    state, _ = made.init(np.random.default_rng(0), seen.observations[0])
    observation = seen.observations[1]
    detections = made.seen.detected(observation, state.skin)
    hand = made.parts.features.names.index("left_hand")
    there = observation.cameras[0].project(made.parts.features.points(made.body.placed(seen.q[1:2])))[0, hand]
    off = np.linalg.norm(detections.mean - there, axis=1)
    others = detections.of(np.flatnonzero(off > off.min()))
    # nor is it before the face
    others = replace(others, merged=np.zeros_like(others.merged), suits=np.where(others.suits > 0.5, others.suits, 0.0))
    monkeypatch.setattr(made.seen, "detected", lambda *_: others)
    after, result = made.step(np.random.default_rng(1), state, observation)
    assert (result.extra["samples"] > 0) == chain
    if chain:
        drawn = observation.cameras[0].project(made.parts.features.points(made.body.placed(after.q)))[:, hand]
        assert np.linalg.norm(np.median(drawn, axis=0) - there) < 20.0


def test_untrackable_input_is_refused(seen: Seen) -> None:
    made, first = tracker(), seen.observations[0]
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="picture of one camera, and there is no"):
        made.init(rng, replace(first, cues=()))
    wall = replace(first.cues[0], picture=np.full_like(first.cues[0].picture, 128))
    with pytest.raises(InputError, match=r"colour of the skin points in .*% of the picture"):
        made.init(rng, replace(first, cues=(wall,)))
    both = {name: getattr(first, name).repeat(2, axis=0) for name in ("pixels", "confidence")}
    with pytest.raises(InputError, match="uses one camera, there are 2"):
        made.init(rng, replace(first, cameras=first.cameras * 2, **both))
    with pytest.raises(InputError, match="no such model file"):
        tracker(replace(FEW, face_model="nowhere.onnx"))


def test_keypoints_in_place_of_skin_need_no_picture(seen: Seen) -> None:
    made = tracker(replace(FEW, features="keypoints"))
    q, rng = seen.q[:FRAMES], np.random.default_rng(3)
    state = None
    for observation, true in zip(seen.observations, q, strict=True):
        pixels = observation.cameras[0].project(made.body.landmarks(made.body.at(true)))
        bare = replace(observation, cues=(), pixels=pixels[None], confidence=np.ones((1, len(pixels))))
        state, result = made.init(rng, bare) if state is None else made.step(rng, state, bare)
    assert state is not None
    assert state.skin is None
    assert result.status == "tracked"
    assert errors(made.body, state, q[-1]) < 0.06
    assert np.linalg.norm(state.points.mean[:, :2] - pixels, axis=1).max() < 4.0
