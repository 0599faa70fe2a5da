"""A chain of poses: its posterior from past and message equals plain weighting of the past's samples."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from estimator.data.cameras.camera import Camera, parallel_camera
from estimator.data.image_cues import ImageCues
from estimator.energy.pose_prior import PosePrior, shipped_mixture
from estimator.inference.chains.evidence import Detections, EvidenceSettings, evidence_of
from estimator.inference.chains.exchange import Message, nothing_seen
from estimator.inference.chains.feature_density import FeatureDensity, gaussian
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import landmark_features, skin_features
from estimator.trackers.dual_chain.alternative import Alternative
from estimator.trackers.dual_chain.outline_values import OutlineLikelihood
from estimator.trackers.dual_chain.pose_chain import Expected, ParticleSet, PoseChain, PoseChainSettings
from estimator.trackers.dual_chain.pose_parts import PoseParts
from estimator.trackers.dual_chain.pose_target import anywhere
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.limbs.graph import limb_graph
from humanoid.support.errors import InputError
from tests.builders import body_of

SETTINGS = PoseChainSettings(particles=3000, kernels=40)


def camera() -> Camera:
    return parallel_camera("k", (640, 480), 400.0, np.array([0.0, 0.0, 0.3]))


@cache
def parts_of(name: str) -> PoseParts:
    body = body_of(name)
    anatomy = anatomy_of(body)
    return PoseParts.of(body, anatomy, skin_features(body, anatomy), limb_graph(body))


class BentArm:
    """Outlines that show nothing but the angles of the left arm, in a closed form."""

    def log_likelihood(self, placed: PlacedBodies) -> np.ndarray:
        arm = parts_of("upper13").dofs[1]
        off = placed.q[:, arm] - crowd(body_of("upper13")).q[:, arm].mean(axis=0) - 0.1
        return -0.5 * np.square(off / 0.2).sum(axis=1)

    def values(self, placed: PlacedBodies, shapes: np.ndarray) -> tuple[np.ndarray]:
        """The same of a part with the left arm."""
        left = np.array_equal(shapes, parts_of("upper13").shapes[1])
        return (self.log_likelihood(placed)[:, None] * left,)


def chain(
    rng: np.random.Generator, settings: PoseChainSettings = SETTINGS, *, past: bool = True, bent: bool = False
) -> PoseChain:
    parts = parts_of("upper13")
    std = np.where(np.arange(13) < 2, 0.02, 0.08)
    outlines: Any = BentArm() if bent else None
    return PoseChain(rng, parts, camera(), outlines, std, settings, past)


def crowd(body: Body, count: int = 40) -> ParticleSet:
    rng = np.random.default_rng(5)
    q = body.neutral.copy()
    for joint in ("left_elbow_flexion", "right_elbow_flexion"):
        q[body.place(joint).q] = 1.2
    spread = np.where(np.arange(body.nv) < 2, 0.02, 0.05)
    poses = body.integrated(np.tile(q, (count, 1)), spread * rng.standard_normal((count, body.nv)))
    return ParticleSet(poses, np.full(count, 1.0 / count), q)


def shifted_message(prior_of: PoseChain, shift: float = 12.0, spread: float = 6.0) -> Message:
    """A head where it is expected, and hands beside their places: two associations for the left one."""
    state = crowd(prior_of.body)
    where = prior_of.camera.project(prior_of.parts.features.points(prior_of.body.placed(state.reference[None])))[0]
    moved = np.add(where, [[0.0, 0.0], [shift, 0.0], [0.0, -shift]])
    first = gaussian(prior_of.parts.features.names, moved, spread**2 * np.eye(6))
    other = first.mean[0] - [[0.0, 0.0], [2.0 * shift, 0.0], [0.0, 0.0]]
    both = FeatureDensity(
        first.names, np.log([0.6, 0.4]), np.ones((2, 3), bool), np.stack([first.mean[0], other]),
        np.repeat(first.covariance, 2, axis=0),
    )  # fmt: skip
    return Message(both, both)


def plainly_weighed(
    made: PoseChain, prior: Expected, message: Message, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tangents (N, nv) drawn from the past alone, each part by itself and one arm possibly anywhere, their weights by
    the message and outlines, and where the arm was anywhere (N,) bool: the same posterior."""
    rng, x, odds = np.random.default_rng(9), np.empty((count, made.body.nv)), 3.0 * np.exp(prior.log_odds_lost)
    target, anew = made._target(prior, message), rng.random(count) < odds / (1.0 + odds)
    for part, group in enumerate(prior.steps.groups):
        for own in (False, True):
            reach = replace(target, elsewhere={1: anywhere(made.parts, prior)} if own else {}).past_of(part)
            centres = reach.centres[rng.choice(len(reach.centres), size=count)]
            x[np.ix_(anew == own, group)] = reach.steps.moved_group(rng, centres, group)[anew == own]
    placed = target.prepared(x)
    log_weight = target.log_message(placed)
    if made.outlines is not None:
        log_weight = log_weight + made.outlines.log_likelihood(placed)
    weight = np.exp(log_weight - log_weight.max())
    return x, weight / weight.sum(), anew


def test_parts_are_trunk_and_arms() -> None:
    parts = parts_of("upper13")
    names = [[parts.body.v_names[d] for d in dofs] for dofs in parts.dofs]
    assert names[0] == ["trunk_left", "trunk_up", "neck_flexion", "neck_lateral", "neck_axial"]
    assert all(name.startswith("left_") for name in names[1])
    assert all(name.startswith("right_") for name in names[2])
    assert [parts.features.names[f] for part in parts.of_part for f in part] == ["head", "left_hand", "right_hand"]
    covered = np.sum(parts.shapes, axis=0)
    assert (covered == 1).all()  # every sampled limb belongs to one part
    human = parts_of("human34")
    assert sorted(np.concatenate(human.dofs).tolist()) == list(range(human.body.nv))


def test_a_body_without_arms_is_refused() -> None:
    body = body_of("arm8")
    with pytest.raises(InputError, match="no landmarks on one face"):
        skin_features(body, anatomy_of(body))
    graph, anatomy = limb_graph(body), anatomy_of(body)
    nothing = replace(landmark_features(body, anatomy), limb=np.full(len(body.landmark_names), -1))
    with pytest.raises(InputError, match="no limb of two segments"):
        PoseParts.of(body, anatomy, nothing, graph)


@pytest.mark.parametrize(
    ("by_past", "lost", "past"),
    [
        *(pytest.param(share, 0.0, True, marks=pytest.mark.paper) for share in (0.2, 0.8)),
        (0.2, 86.0, True),
        (0.2, 0.0, False),
    ],
)
def test_the_posterior_is_that_of_weighing_the_past(
    by_past: float, lost: float, past: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With outlines, for any share of samples from the image, for a limb that is displaced as likely as not, and for
    likelihood sampling: means and spreads of all joints, and of the hands in the image."""
    particles = 3000 if past else 12_000  # drawn from the image alone they are far apart
    settings = replace(SETTINGS, by_past=by_past, lost=lost, renewed=0.45, particles=particles)
    made = chain(np.random.default_rng(0), settings, past=past, bent=True)
    if lost:
        monkeypatch.setattr(PoseChain, "_chosen", lambda *_: (1,))
    prior = made.predict(crowd(made.body), 0.04)
    # few displaced limbs hit a small detection, and plain weighting would have few samples
    message = shifted_message(made, spread=25.0 if lost else 6.0)
    x, weight, anew = plainly_weighed(made, prior, message, 200_000)
    mean = weight @ x
    std = np.sqrt(weight @ np.square(x - mean))
    unsure = std * np.sqrt(np.square(weight).sum())  # is the plain mean
    tangents, counts, shares = [], [], []
    for seed in range(5):
        again = chain(np.random.default_rng(100 + seed), settings, past=past, bent=True)
        after, _ = again.update(replace_samples(again, prior), message)
        tangents.append(made.body.differences(prior.reference, after.q))
        counts.append(again.diagnostics["effective_sample_size"])
        shares.append(again.diagnostics.get("renewed", 0.0))
    assert np.mean(counts) > 20.0
    if lost:
        assert np.mean(shares) == pytest.approx(weight @ anew, abs=0.05)
    each = np.array([t.mean(axis=0) for t in tangents])
    error = each.std(axis=0) / np.sqrt(len(each))
    assert (np.abs(each.mean(axis=0) - mean) < 4.0 * np.hypot(error, unsure) + 0.02 * std).all()
    spread = np.sqrt(np.mean([np.square(t - mean).mean(axis=0) for t in tangents], axis=0))
    np.testing.assert_allclose(spread, std, rtol=0.2)


@pytest.mark.parametrize("log_odds", [-12.0, -1.0, 12.0])
def test_an_alternative_keeps_the_odds_that_all_images_give_it(log_odds: float) -> None:
    """Poses whose left arm is elsewhere: with a share that particles can have they are among these, and otherwise the
    less likely stay beside the others, with odds by the evidence of both."""
    made = chain(np.random.default_rng(0), replace(SETTINGS, lost=1e-6), bent=True)
    arm = made.parts.dofs[1]
    states = [crowd(made.body)]
    moved = np.where(np.isin(np.arange(made.body.nv), arm), 0.15, 0.0)
    other = made.body.integrated(states[0].q, np.tile(moved, (len(states[0].q), 1)))
    states.append(replace(states[0], q=other))
    message = shifted_message(made)
    means, log_evidences = [], []
    for state in states:
        x, weight, log_evidence = parts_weighed(made, made.predict(state, 0.04), message, 100_000)
        means.append(weight @ x[:, arm])
        log_evidences.append(log_evidence)
    right = log_odds + log_evidences[1] - log_evidences[0]
    after_shares, after_odds, arms = [], [], []
    for seed in range(5):
        again = chain(np.random.default_rng(100 + seed), made.settings, bent=True)
        state = replace(states[0], alternative=Alternative(other, log_odds))
        after, _ = again.update(again.predict(state, 0.04), message)
        after_shares.append(again.diagnostics["renewed"])
        arms.append(made.body.differences(states[0].reference, after.q)[:, arm].mean(axis=0))
        if after.alternative is not None:
            after_odds.append(after.alternative.log_odds)
    share = 1.0 / (1.0 + np.exp(-right))
    assert np.mean(after_shares) == pytest.approx(share, abs=0.06)
    apart = min(share, 1.0 - share) < 1.0 / SETTINGS.kernels
    assert len(after_odds) == (5 if apart else 0)
    if apart:
        assert np.mean(after_odds) == pytest.approx(-abs(right), abs=0.4)
    expected = (1.0 - share) * means[0] + share * means[1]
    np.testing.assert_allclose(np.mean(arms, axis=0), expected, atol=0.02)


def parts_weighed(
    made: PoseChain, prior: Expected, message: Message, count: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Tangents (N, nv) drawn from a prediction, each part by itself, their weights, and the log-evidence."""
    rng, x, target = np.random.default_rng(9), np.empty((count, made.body.nv)), made._target(prior, message)
    for group in prior.steps.groups:
        centres = prior.centres[rng.choice(len(prior.centres), size=count)]
        x[:, group] = prior.steps.moved_group(rng, centres, group)
    placed = target.prepared(x)
    log_weight = target.log_message(placed) + target.likelihood(placed)
    weight = np.exp(log_weight - log_weight.max())
    return x, weight / weight.sum(), float(np.log(weight.mean()) + log_weight.max())


def replace_samples(made: PoseChain, prior: Expected) -> Expected:
    """The same past with samples of its own."""
    rows = made.rng.choice(len(prior.centres), size=made.settings.particles, p=prior.weights)
    return replace(prior, samples=prior.steps.moved(made.rng, prior.centres[rows]))


def test_a_hand_that_is_seen_is_not_behind_the_trunk() -> None:
    """In front of or behind the trunk a hand has the same image: if it is seen, in front is likelier, by the
    settings."""
    parts, settings = parts_of("upper13"), EvidenceSettings()
    body = parts.body
    outlines = OutlineLikelihood(body, parts.graph, ImageCues(camera(), {}), 200.0)
    rng = np.random.default_rng(0)
    q = body.lower + rng.random((4000, body.nq)) * (body.upper - body.lower)
    q[:, : parts.dofs[0].size] = body.neutral[: parts.dofs[0].size]
    placed = body.placed(q)
    _, hidden = outlines.with_hidden(placed, parts.features.points(placed), parts.of_limb)
    behind, before = (int(np.flatnonzero((hidden == [False, left, False]).all(axis=1))[0]) for left in (True, False))
    pixels = camera().project(parts.features.points(placed))
    for way, n in ((True, behind), (False, before)):
        suits = np.eye(3)
        seen = Detections(
            parts.features.names, pixels[n], np.tile(4.0 * np.eye(2), (3, 1, 1)), suits, np.zeros(3, bool)
        )
        evidence = evidence_of(seen, settings).density
        made = replace(chain(np.random.default_rng(0)), outlines=outlines, if_hidden=settings.if_hidden)
        target = made._target(made.predict(crowd(body), 0.04), Message(evidence, evidence))
        value = target.likelihood(placed.of(np.array([n])))[0]
        assert value == pytest.approx(np.log(settings.hidden / settings.detected) if way else 0.0, abs=0.01)


def test_without_evidence_the_prediction_stands() -> None:
    made = chain(np.random.default_rng(1), replace(SETTINGS, lost=0.0))
    prior = made.predict(crowd(made.body), 0.04)
    after, _ = made.update(prior, nothing_seen(made.parts.features.names))
    x = made.body.differences(prior.reference, after.q)
    np.testing.assert_allclose(x.mean(axis=0), prior.samples.mean(axis=0), atol=0.02)
    assert (x >= prior.steps.lower - 1e-12).all()
    assert (x <= prior.steps.upper + 1e-12).all()


def test_hands_that_are_elsewhere_are_reached_by_the_image_and_not_by_the_past() -> None:
    """A hand 100 px from all expectations: likelihood sampling finds it, samples of the past do not."""
    made = chain(np.random.default_rng(2))
    prior = made.predict(crowd(made.body), 0.04)
    message = shifted_message(made, shift=100.0, spread=4.0)
    after, _ = made.update(prior, message)
    pixels = made.camera.project(made.parts.features.points(made.body.placed(after.q)))
    off = np.linalg.norm(pixels[:, None] - message.evidence.mean[None], axis=3).max(axis=2).min(axis=1)
    assert np.median(off) < 12.0
    _, weight, _ = plainly_weighed(made, prior, message, 3000)
    assert 1.0 / np.square(weight).sum() < 5.0


def test_equal_generators_equal_bits() -> None:
    runs = []
    for _ in range(2):
        made = chain(np.random.default_rng(4), replace(SETTINGS, particles=200))
        prior = made.predict(crowd(made.body), 0.04)
        runs.append(made.update(prior, shifted_message(made))[0].q)
    np.testing.assert_array_equal(runs[0], runs[1])


def test_draws_from_the_past_alone_are_condensation() -> None:
    """Whole poses of the past, selected by their weights, outlines included, with the mean weight as evidence."""
    made = chain(np.random.default_rng(5), replace(SETTINGS, draws="past", particles=500), bent=True)
    prior = made.predict(crowd(made.body), 0.04)
    message = shifted_message(made, spread=15.0)
    after, log_mean = made.update(prior, message)
    target = made._target(prior, message)
    placed = target.prepared(prior.samples)
    log_weight = target.log_message(placed) + BentArm().log_likelihood(placed)
    weight = np.exp(log_weight - log_weight.max())
    x = made.body.differences(prior.reference, after.q)
    share = weight / weight.sum()
    copies = np.array([np.count_nonzero(np.abs(x - sample).max(axis=1) < 1e-9) for sample in prior.samples])
    assert np.abs(copies - share * len(x)).max() < 1.0
    assert log_mean == pytest.approx(np.log(weight.mean()) + log_weight.max())
    assert made.diagnostics["effective_sample_size"] == pytest.approx(1.0 / np.square(share).sum())


@pytest.mark.parametrize("subject", ["upper13", "human34"])
def test_the_derivatives_of_features_are_their_differences(subject: str) -> None:
    parts, view = parts_of(subject), camera()
    body, rng = parts.body, np.random.default_rng(6)
    q = body.integrated(np.tile(body.neutral, (3, 1)), 0.2 * rng.standard_normal((3, body.nv)))
    chosen = np.arange(parts.features.count)[::-1]
    pixels, jacobian = parts.features.in_image(body, q, view, chosen)
    np.testing.assert_allclose(pixels, view.project(parts.features.points(body.placed(q)))[:, chosen], atol=1e-9)
    for dof in range(body.nv):
        step = np.where(np.arange(body.nv) == dof, 1e-6, 0.0)
        ends = [
            view.project(
                parts.features.points(body.placed(np.array([pin.integrate(body.model, r, s * step) for r in q])))
            )
            for s in (1.0, -1.0)
        ]
        numeric = (ends[0] - ends[1])[:, chosen] / 2e-6
        np.testing.assert_allclose(jacobian[..., dof], numeric, atol=1e-3)


def test_the_learned_prior_weighs_poses_by_its_density() -> None:
    """Without other evidence the result is the past times the prior, as by weighting many samples of the past."""
    body = body_of("human34")
    pose_prior = PosePrior(body, shipped_mixture())
    settings = replace(SETTINGS, particles=1000, lost=0.0)
    std = np.where(np.arange(body.nv) < 6, 0.01, 0.3)

    def made(rng: np.random.Generator) -> PoseChain:
        return PoseChain(rng, parts_of("human34"), camera(), None, std, settings, pose_prior=pose_prior)

    state = ParticleSet(body.neutral[None], np.ones(1), body.neutral)
    prior = made(np.random.default_rng(6)).predict(state, 0.04)
    message = nothing_seen(parts_of("human34").features.names)
    x = prior.steps.moved(np.random.default_rng(7), np.tile(prior.centres[:1], (40_000, 1)))
    value = pose_prior.values(body.placed(body.integrated(np.tile(body.neutral, (len(x), 1)), x)))
    share = np.exp(value.min() - value)
    expected = share @ value / share.sum()
    each = []
    for again in range(4):
        rng = np.random.default_rng(100 + again)
        after, _ = made(rng).update(replace_samples(made(rng), prior), message)
        each.append(pose_prior.values(body.placed(after.q)).mean())
    assert expected < value.mean() - 1.0  # and it is informative
    assert abs(np.mean(each) - expected) < 4.0 * np.std(each) / 2.0 + 0.1
