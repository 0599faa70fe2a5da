"""Several chains of one image: exact where the graph is a tree, no chain receives its own message, gated messages do
not echo."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.papers_dual_chain import chains, chains_toy
from benchmarks.papers_dual_chain.chains import exactness
from benchmarks.papers_dual_chain.chains_toy import POINT, Belief, Joint, ParticleWalk, Walk, WeightedStates, seen
from estimator.inference.chains.evidence import Detections, Evidence, EvidenceSettings, evidence_of
from estimator.inference.chains.exchange import APART, GATED, ONE_WAY, PRINTED, WHICH, Message, messages, step
from estimator.inference.chains.feature_density import FeatureDensity, gaussian, uniform
from estimator.inference.chains.kalman import PointChain, PointSettings, PointStates
from estimator.inference.chains.repeated import as_news, new_share
from humanoid.support.errors import InputError

HANDS = ("head", "left_hand", "right_hand")
START = Belief(np.zeros(2), 1.0)


def test_messages_are_exact_inference(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eq. 3 in the first frame, eq. 5 later, both on a grid; the Kalman filter beside an uninformative chain."""
    for module in (chains, chains_toy):
        monkeypatch.setattr(module, "GRID", np.linspace(-14.0, 14.0, 701))  # sums are as exact on a quarter of it
    figures = {check.what: check for check in exactness(1, frames=5)}
    for check in figures.values():
        if check.bar:
            assert float(check.figure) <= float(check.bar), check
    gap = next(c for what, c in figures.items() if "eq. 4, exact" in what)
    assert float(gap.figure) > 0.01  # the joint of both walks is not the product of its marginals
    assert "what is impossible in one chain: density in the other" in figures


def test_a_chain_does_not_receive_its_own_message() -> None:
    """The message to each of three chains is phi times the expectations of the others."""
    expected = [gaussian(POINT, np.full((1, 2), float(k)), (k + 1.0) * np.eye(2)) for k in range(3)]
    received = messages(expected, seen(np.array([0.3, 0.1])), PRINTED)
    phi = seen(np.array([0.3, 0.1])).density
    points = np.random.default_rng(0).normal(size=(10, 1, 2))
    for i, message in enumerate(received):
        others = sum(d.log_density(points) for k, d in enumerate(expected) if k != i)
        np.testing.assert_allclose(message.evidence.log_density(points), phi.log_density(points) + others, atol=1e-9)


def test_the_order_of_chains_does_not_matter() -> None:
    states: list[Any] = [START, Belief(np.ones(2), 2.0), Belief(-np.ones(2), 0.5)]
    chains = [Walk(), Walk(q=0.5), Walk(r=1.0)]
    phi = seen(np.array([0.5, 0.0]))
    after, _ = step(chains, states, phi, 1.0)
    back, _ = step(chains[::-1], states[::-1], phi, 1.0)
    for a, b in zip(after, back[::-1], strict=True):
        np.testing.assert_allclose(a.mean, b.mean, atol=1e-12)
        assert a.variance == pytest.approx(b.variance, abs=1e-12)


@pytest.mark.parametrize("exchange", [GATED, PRINTED, ONE_WAY, APART])
def test_in_the_dark(exchange: str) -> None:
    """As printed a chain grows more certain of unseen features; gated it is as certain as alone, and knows where to
    search."""
    states = [START, START]
    for _ in range(15):
        states, received = step([Walk(), Walk()], states, seen(None), 1.0, exchange)
    alone = START.variance + 15 * 0.25
    if exchange == PRINTED:
        assert states[0].variance < 0.5 * alone
    else:
        assert states[0].variance == pytest.approx(alone)
    assert bool(received[0].guide.known.any()) == (exchange != APART)
    assert bool(received[1].guide.known.any()) == (exchange in (GATED, PRINTED))


def test_what_is_impossible_under_one_chain_is_impossible_in_both() -> None:
    """Two places are as likely by the image and by the particles; the walk is far from one of them."""
    states = np.repeat([[0.0, 0.0], [60.0, 0.0]], 500, axis=0)
    both = WeightedStates(states, np.full(1000, 1e-3))
    image = seen(np.array([30.0, 0.0]), 1e4)
    for exchange, at_most in ((PRINTED, 1e-12), (GATED, 1e-12), (APART, 1.0)):
        chains: list[Any] = [ParticleWalk(np.random.default_rng(0)), Walk()]
        after, _ = step(chains, [both, START], image, 1.0, exchange)
        far = after[0].weights[after[0].states[:, 0] > 30.0].sum()
        assert far < at_most
    assert far == pytest.approx(0.5, abs=0.05)


def test_seen_again_gated_is_as_printed() -> None:
    """With a detection both are eq. 5."""
    phi = seen(np.array([1.0, -1.0]))
    gated, _ = step([Walk(), Walk()], [START, START], phi, 1.0, GATED)
    printed, _ = step([Walk(), Walk()], [START, START], phi, 1.0, PRINTED)
    assert gated[0].variance == printed[0].variance
    joint = Joint(np.zeros(2), np.eye(2)).stepped(1.0)
    assert gated[0].mean[0] == pytest.approx(joint.mean[0])


def test_samples_agree_with_the_closed_form() -> None:
    rng = np.random.default_rng(0)
    chains: list[Any] = [ParticleWalk(rng), Walk()]
    weighted_states = WeightedStates(rng.standard_normal((20_000, 2)), np.full(20_000, 1.0 / 20_000))
    after, _ = step(chains, [weighted_states, START], seen(np.array([0.7, -0.2])), 1.0)
    truth, _ = step([Walk(), Walk()], [START, START], seen(np.array([0.7, -0.2])), 1.0)
    error = np.sqrt(truth[0].variance / 20_000)
    np.testing.assert_allclose(after[0].mean, truth[0].mean, atol=4.0 * error)
    np.testing.assert_allclose(after[0].variance, truth[0].variance, rtol=0.05)


def test_chains_without_a_common_feature_are_refused() -> None:
    apart = [gaussian(("a",), np.zeros((1, 2)), np.eye(2)), gaussian(("b",), np.zeros((1, 2)), np.eye(2))]
    with pytest.raises(InputError, match="no other does"):
        messages(apart, Evidence(uniform(("a",)), np.array([[-1]])))
    with pytest.raises(InputError, match="one of gated, printed"):
        messages(apart[:1], Evidence(uniform(("a",)), np.array([[-1]])), "both")


def blobs(*places: tuple[float, float], merged: bool = False) -> Detections:
    """Detections that may be either hand; the first may be the head."""
    suits = np.tile([0.0, 1.0, 1.0], (len(places), 1))
    suits[0, 0] = 1.0
    suits[0, 1:] = 0.01
    covariance = np.tile(16.0 * np.eye(2), (len(places), 1, 1))
    return Detections(HANDS, np.array(places, float), covariance, suits, np.full(len(places), merged))


def expected_at(*places: tuple[float, float], spread: float = 10.0) -> FeatureDensity:
    return gaussian(HANDS, np.array(places, float), spread**2 * np.eye(6))


def likeliest(detections: Detections, prior: FeatureDensity) -> tuple[int, ...]:
    evidence = evidence_of(detections, EvidenceSettings(), prior)
    weight = evidence.density.times(prior).log_weight
    return tuple(evidence.detection[int(np.argmax(weight))].tolist())


def test_two_hands_do_not_take_one_detection() -> None:
    """Although equally near to both, unless it is merged or misses are excluded."""
    prior = expected_at((100, 50), (100, 200), (110, 200))
    alone = likeliest(blobs((100, 50), (105, 200)), prior)
    assert sorted(alone[1:]) == [-1, 1] or alone[1:] == (1, 1)
    evidence = evidence_of(blobs((100, 50), (105, 200)), EvidenceSettings(shared=0.0), prior)
    assert not any(d >= 0 and way.tolist().count(d) > 1 for way in evidence.detection for d in way)
    assert likeliest(blobs((100, 50), (105, 200), merged=True), prior)[1:] == (1, 1)


def test_identity_follows_the_expectation() -> None:
    detections = blobs((100, 50), (60, 200), (140, 200))
    assert likeliest(detections, expected_at((100, 50), (62, 205), (138, 195))) == (0, 1, 2)
    assert likeliest(detections, expected_at((100, 50), (138, 195), (62, 205))) == (0, 2, 1)


def test_a_chain_with_exchanged_hands_receives_the_other_association() -> None:
    """However certain it is; its own weights express that the association is unlikely."""
    detections = blobs((100, 50), (60, 200), (140, 200))
    wrong = expected_at((100, 50), (140, 200), (60, 200), spread=2.0)
    evidence = evidence_of(detections, EvidenceSettings(), wrong)
    points = np.array([[[100, 50], [60, 200], [140, 200]], [[100, 50], [140, 200], [60, 200]]], float)
    chain = PointChain(HANDS, 400.0, PointSettings(), ((1, 2),))
    theirs = chain.features(chain.initial_state(points[1], 4.0 * np.eye(6)))
    received = messages([wrong, theirs], evidence)[0].evidence.log_density(points)
    assert received[1] - received[0] == pytest.approx(np.log((1.0 - 0.1 - 0.03) / 0.1), abs=0.01)


def test_a_hand_that_is_missed_may_be_before_the_face_or_anywhere() -> None:
    """The face stays the head's. A chain uncertain of the hand's place prefers a missed detection, for the face is
    small."""
    detections = blobs((100, 50), (60, 200))
    assert likeliest(detections, expected_at((100, 50), (60, 200), (101, 52), spread=3.0)) == (0, 1, 0)
    assert likeliest(detections, expected_at((100, 50), (60, 200), (101, 52), spread=20.0)) == (0, 1, -1)
    assert likeliest(detections, expected_at((100, 50), (60, 200), (220, 120))) == (0, 1, -1)


def test_both_hands_may_be_before_the_face() -> None:
    detections = blobs((100, 50), (300, 10))
    assert likeliest(detections, expected_at((100, 50), (98, 52), (101, 49), spread=3.0)) == (0, 0, 0)


def test_a_hidden_feature_has_the_detection_probability_of_the_settings() -> None:
    """Equal to evidence with this knowledge from the start."""
    settings, points = EvidenceSettings(), np.array([[[100.0, 50.0]], [[300.0, 10.0]]])
    hand = Detections(HANDS[1:2], points[0], np.tile(16.0 * np.eye(2), (1, 1, 1)), np.ones((1, 1)), np.zeros(1, bool))
    hidden = evidence_of(hand, settings).density.if_hidden(np.ones(1, bool), *settings.if_hidden)
    known = evidence_of(hand, replace(settings, detected=settings.hidden)).density
    np.testing.assert_allclose(hidden.log_density(points), known.log_density(points), rtol=1e-12)


def test_two_hands_in_one_blob_are_further_from_its_middle_than_one() -> None:
    """Where both are in the blob, each may be anywhere in it; a single hand is near its middle."""
    blob = replace(blobs((100, 50), (105, 200)), together=np.tile(64.0 * np.eye(2), (2, 1, 1)))
    evidence = evidence_of(blob, EvidenceSettings())
    for way, variance in (((0, 1, 1), 64.0), ((0, 1, -1), 16.0)):
        (row,) = np.flatnonzero((evidence.detection == way).all(axis=1))
        np.testing.assert_array_equal(evidence.density.covariance[row][2:4, 2:4], variance * np.eye(2))
    some = blob.of(np.array([1]))
    assert (some.shared[0, 0, 0], some.covariance[0, 0, 0], len(some.suits)) == (64.0, 16.0, 1)


@pytest.mark.parametrize("exchange", [GATED, PRINTED, ONE_WAY])
def test_only_its_own_detection_is_evidence_against_a_hidden_feature(exchange: str) -> None:
    """A hidden feature is in the detection of the one that hides it. The other chain's message changes nothing of
    this."""
    detections, prior = blobs((100, 50), (60, 200)), expected_at((100, 50), (60, 200), (101, 52))
    evidence = evidence_of(detections, EvidenceSettings(), prior)
    received = messages([prior, prior], evidence, exchange)[0].evidence.reduced(1, expected=prior)
    for way, sharers in (((0, 1, 0), [2, 1, 2]), ((0, 1, -1), [1, 1, 0])):
        (row,) = np.flatnonzero((evidence.detection == way).all(axis=1))
        density = evidence.density.of(np.array([row]))
        assert density.sharers is not None
        np.testing.assert_array_equal(density.sharers[0], sharers)
        more = density.if_hidden(np.array([False, True, True]), -2.0, 1.0).log_weight - density.log_weight
        assert more[0] == pytest.approx(-2.0 + (way[2] < 0))
    assert received.sharers is not None
    assert received.sharers[0, 1] == 1
    none = evidence_of(Detections.none(HANDS), EvidenceSettings(), prior)
    missed = messages([prior, prior], none, exchange)[0].evidence
    more = missed.if_hidden(np.array([False, True, False]), -2.0, 1.0).log_weight - missed.log_weight
    np.testing.assert_allclose(more, 1.0)


def test_far_detections_are_clutter() -> None:
    detections = blobs((100, 50), (60, 200), (300, 10))
    assert likeliest(detections, expected_at((100, 50), (60, 200), (140, 200))) == (0, 1, -1)


def test_only_the_likeliest_associations_are_kept_and_they_keep_their_weights() -> None:
    detections = blobs(*[(100 + 30 * k, 50 + 20 * k) for k in range(6)])
    prior = expected_at((100, 50), (130, 70), (160, 90))
    whole = evidence_of(detections, EvidenceSettings(most=10_000), prior)
    few = evidence_of(detections, EvidenceSettings(most=5), prior)
    weight = dict(zip(map(tuple, whole.detection.tolist()), whole.density.log_weight.tolist(), strict=True))
    assert len(few.detection) == 5
    for way, value in zip(map(tuple, few.detection.tolist()), few.density.log_weight.tolist(), strict=True):
        assert weight[way] == value
    kept = np.logaddexp.reduce(few.density.times(prior).log_weight)
    assert np.exp(kept - np.logaddexp.reduce(whole.density.times(prior).log_weight)) > 0.9


@pytest.mark.parametrize("exchange", [GATED, PRINTED, WHICH])
def test_messages_do_not_depend_on_the_unit(exchange: str) -> None:
    """All lengths ten times as many, and false detections a hundredth as dense: every association weighs the same."""
    shares = []
    for scale in (1.0, 10.0):
        seen = blobs((10.0, 0.0), (90.0, 5.0), (60.0, 60.0))
        seen = replace(seen, mean=scale * seen.mean, covariance=scale**2 * seen.covariance)
        own = gaussian(
            HANDS, scale * np.array([[12.0, 0.0], [80.0, 0.0], [20.0, 90.0]]), (scale * 9.0) ** 2 * np.eye(6)
        )
        other = gaussian(
            HANDS, scale * np.array([[8.0, 0.0], [88.0, 9.0], [40.0, 70.0]]), (scale * 6.0) ** 2 * np.eye(6)
        )
        evidence = evidence_of(seen, EvidenceSettings(clutter=0.5 / scale**2), own)
        received = messages([own, other], evidence, exchange)[0].evidence
        both = own.times(received)
        shares.append(both.weights[np.lexsort((both.mean[:, 1, 0], *both.known.T))])
    np.testing.assert_allclose(shares[0], shares[1], rtol=1e-6)


def test_identity_is_not_evidence_of_position() -> None:
    """The other chain selects one of two detections; the position comes from the detection alone."""
    seen = blobs((0.0, 0.0), (100.0, 0.0))
    seen = replace(seen, names=HANDS[1:2], suits=seen.suits[:, 1:2])
    own, other = (gaussian(HANDS[1:2], np.array([[x, 0.0]]), 900.0 * np.eye(2)) for x in (50.0, 95.0))
    received = messages([own, other], evidence_of(seen, EvidenceSettings()), WHICH)[0].evidence
    best = int(np.argmax(received.log_weight))
    np.testing.assert_allclose(received.mean[best, 0], [100.0, 0.0])
    np.testing.assert_allclose(received.covariance[best], seen.covariance[1])
    assert received.weights[best] > 0.9


def test_many_keypoints_keep_the_likeliest_ways() -> None:
    """20 keypoints, each of its own feature or wrong: of 2^20 associations those that flip the least certain are
    kept."""
    names = tuple(f"f{k}" for k in range(20))
    places = np.stack([20.0 * np.arange(20), np.zeros(20)], axis=1)
    off = np.where(np.arange(20) < 3, 60.0, 0.0)  # the first three are far from where they are expected
    seen = Detections(names, places + off[:, None], np.tile(np.eye(2), (20, 1, 1)), np.eye(20), np.zeros(20, bool))
    expected = gaussian(names, places, 9.0 * np.eye(40))
    kept = evidence_of(seen, EvidenceSettings(most=30), expected)
    assert len(kept.detection) == 30
    best = kept.detection[int(np.argmax(kept.density.times(expected).log_weight))]
    np.testing.assert_array_equal(best, np.where(off > 0.0, -1, np.arange(20)))


def test_an_association_exists_where_two_features_claim_each_detection() -> None:
    """24 features in pairs expected at one place with one keypoint each: the keypoint belongs to either, never to
    both."""
    names = tuple(f"f{k}" for k in range(24))
    places = np.repeat(np.stack([40.0 * np.arange(12), np.zeros(12)], axis=1), 2, axis=0)
    suits = np.repeat(np.eye(12), 2, axis=1)
    seen = Detections(names, places[::2], np.tile(np.eye(2), (12, 1, 1)), suits, np.zeros(12, bool))
    kept = evidence_of(seen, EvidenceSettings(shared=0.0), gaussian(names, places, 9.0 * np.eye(48)))
    best = kept.detection[int(np.argmax(kept.density.log_weight))].reshape(12, 2)
    assert np.array_equal(best.max(axis=1), np.arange(12))
    assert np.array_equal(best.min(axis=1), np.full(12, -1))


def test_no_detection_gives_no_evidence() -> None:
    evidence = evidence_of(Detections.none(HANDS), EvidenceSettings())
    assert not evidence.density.known.any()
    assert evidence.density.log_weight[0] == pytest.approx(3.0 * np.log(0.1))


CHAIN = PointChain(HANDS, 100.0, news=0.1)


def initial_state() -> PointStates:
    return CHAIN.initial_state(np.array([[100.0, 50.0], [60.0, 200.0], [140.0, 200.0]]), 9.0 * np.eye(6))


def test_points_are_moved_in_steps_as_in_one() -> None:
    """The noise of two half steps is that of one whole one: an exact discretisation."""
    state = initial_state()
    once = CHAIN.predict(state, 0.08)
    twice = CHAIN.predict(CHAIN.predict(state, 0.04), 0.04)
    np.testing.assert_allclose(once.mean, twice.mean, atol=1e-9)
    np.testing.assert_allclose(once.covariance, twice.covariance, rtol=1e-7, atol=1e-6)


def test_a_moving_point_is_followed_with_its_velocity() -> None:
    """Within the noise, also over gaps; its velocity fades where nothing is seen."""
    rng = np.random.default_rng(0)
    state, errors = initial_state(), []
    for t in range(1, 60):
        truth = np.array([[100.0, 50.0], [60.0 + 4.0 * t, 200.0], [140.0, 200.0 - 3.0 * t]])
        places = [tuple(p) for p in truth + 2.0 * rng.normal(size=(3, 2))]
        missing = t % 9 in (4, 5)
        detections = blobs(*(places[:1] if missing else places))
        prior = CHAIN.predict(state, 1 / 25)
        phi = evidence_of(detections, EvidenceSettings(), CHAIN.features(prior))
        received = messages([CHAIN.features(prior), uniform_like(prior)], phi, GATED)
        state, _ = CHAIN.update(prior, received[0])
        if t > 10 and not missing:
            errors.append(np.abs(state.mean[:, :2] - truth).max())
    assert max(errors) < 8.0
    assert state.mean[1, 2] == pytest.approx(100.0, abs=40.0)  # px/s
    faded = CHAIN.predict(state, 2.0)
    assert abs(faded.mean[1, 2]) < 1.0
    assert np.sqrt(np.diag(faded.covariance)[4]) <= 100.0 * CHAIN.settings.loose + 1e-9


def shared(places: dict[int, tuple[float, float]], covariance: np.ndarray, sharers: int) -> FeatureDensity:
    """Evidence on some features, by number, each in a detection of so many."""
    known = np.isin(np.arange(3), list(places))
    mean = np.array([places.get(f, (0.0, 0.0)) for f in range(3)])
    return FeatureDensity(
        HANDS, np.zeros(1), known[None], mean[None], np.kron(np.eye(3), covariance)[None], known[None] * sharers
    )


def test_a_detection_of_several_points_informs_each_about_once() -> None:
    """However often it is received, a hand before the face is somewhere in its blob, and one with a blob of its own is
    there. A tenth of what was known before counts as new, and no weight is lost."""
    region = np.array([[900.0, 300.0], [300.0, 400.0]])
    received = {n: Message(shared({1: (75.0, 210.0)}, region, n), uniform(HANDS)) for n in (1, 2)}
    place = np.ix_([4, 5], [4, 5])
    wide = CHAIN.initial_state(np.array([[100.0, 50.0], [60.0, 200.0], [140.0, 200.0]]), 1e9 * np.eye(6))
    for n, much in ((1, 11.0), (2, 2.0)):
        state = wide
        for _ in range(11):
            state = CHAIN.update(state, received[n])[0]
        np.testing.assert_allclose(state.covariance[place], region / much, rtol=1e-3)
    narrow = initial_state()
    after, weight = CHAIN.update(narrow, received[2])
    precision = np.linalg.inv(narrow.covariance[place]) + 0.1 * np.linalg.inv(region)
    np.testing.assert_allclose(np.linalg.inv(after.covariance[place]), precision, rtol=1e-9)
    assert weight == pytest.approx(CHAIN.update(narrow, received[1])[1])


def test_a_repeated_shared_detection_is_worth_what_correlated_measurements_are() -> None:
    """Information on a constant by six of them, of errors with exponential correlation, in closed form by their
    covariance."""
    dt, inside, count = 0.04, 0.3, 6
    correlation = np.exp(-dt / inside * np.abs(np.subtract.outer(np.arange(count), np.arange(count))))
    information = np.linalg.inv(correlation).sum()
    assert 1.0 + (count - 1) * new_share(inside, dt) == pytest.approx(information, rel=1e-12)
    assert new_share(0.0, dt) == 1.0


def test_a_message_as_news_keeps_the_weights_of_associations_and_informs_as_points_are_informed() -> None:
    """To a chain with one normal prediction, in closed form: the posterior is that of the chain of points."""
    region = np.array([[900.0, 300.0], [300.0, 400.0]])
    alone, both = (shared({1: (75.0, 210.0)}, region, n) for n in (1, 2))
    assert alone.sharers is not None
    assert both.sharers is not None
    seen = FeatureDensity(
        HANDS, np.log([0.3, 0.7]), *(np.concatenate([getattr(d, n) for d in (alone, both)]) for n in
        ("known", "mean", "covariance", "sharers")),
    )  # fmt: skip
    prior = CHAIN.features(initial_state())
    received = as_news(seen, prior, CHAIN.news)
    np.testing.assert_allclose(received.log_mass(prior), seen.log_mass(prior), rtol=1e-12)
    np.testing.assert_array_equal(received.covariance[0], seen.covariance[0])
    ours = prior.times(received.of(np.array([1])))
    points, _ = CHAIN.update(initial_state(), Message(both, uniform(HANDS)))
    np.testing.assert_allclose(ours.mean[0], points.mean[:, :2], rtol=1e-9)
    place = np.flatnonzero(np.tile([True, True, False, False], 3))
    np.testing.assert_allclose(ours.covariance[0], points.covariance[np.ix_(place, place)], rtol=1e-9, atol=1e-9)


def test_a_hand_that_leaves_the_face_is_the_same_hand() -> None:
    """It was somewhere in the face's blob for half a second and leaves it far from the blob's middle."""
    face, left, right = (100.0, 50.0), (45.0, 100.0), (140.0, 200.0)
    suits = np.array([[1.0, 0.2, 0.2], [0.01, 1.0, 1.0], [0.01, 1.0, 1.0]])
    covariance = np.array([900.0, 16.0, 16.0])[:, None, None] * np.eye(2)
    last = Detections(HANDS, np.array([face, right, left]), covariance, suits, np.array([True, False, False]))
    blob = Detections(HANDS, last.mean[:2], covariance[:2], suits[:2], last.merged[:2])
    state = PointStates(np.array([[*face, 0, 0], [95.0, 60.0, 0, 0], [*right, 0, 0]]), initial_state().covariance)
    for detections in [blob] * 12 + [last]:
        prior = CHAIN.predict(state, 1 / 25)
        phi = evidence_of(detections, EvidenceSettings(), CHAIN.features(prior))
        received = messages([CHAIN.features(prior), uniform_like(prior)], phi, GATED)
        state, _ = CHAIN.update(prior, received[0])
    np.testing.assert_allclose(state.mean[1, :2], left, atol=10.0)


def uniform_like(prior: PointStates) -> FeatureDensity:
    return uniform(HANDS)


def test_points_are_stored_to_the_bit() -> None:
    state = CHAIN.predict(initial_state(), 0.04)
    again = PointStates.from_arrays(state.arrays())
    np.testing.assert_array_equal(again.mean, state.mean)
    np.testing.assert_array_equal(again.covariance, state.covariance)


def test_a_point_that_follows_clutter_is_corrected() -> None:
    """The chain is certain of a hand in a piece of the face; another chain knows the right blob."""
    right = np.array([[100.0, 50.0], [60.0, 200.0], [140.0, 200.0]])
    phi = evidence_of(blobs(*(tuple(p) for p in right)), EvidenceSettings())
    pose = gaussian(HANDS, right, 400.0 * np.eye(6))
    after = {}
    for lost in (0.0, 0.03):
        chain = PointChain(HANDS, 100.0, PointSettings(lost=lost), ((1, 2),))
        state = initial_state()
        state.mean[1, :2] = 110.0, 55.0
        for _ in range(3):
            prior = chain.predict(state, 0.04)
            assert np.exp(chain.features(prior).log_weight).sum() == pytest.approx(1.0)
            state = chain.update(prior, messages([pose, chain.features(prior)], phi, GATED)[1])[0]
        after[lost] = state.mean[:, :2]
    np.testing.assert_allclose(after[0.03], right, atol=10.0)
    assert np.abs(after[0.0] - right).max() > 40.0


def test_exchanged_points_are_corrected() -> None:
    """A chain of points with exchanged hands follows another that has them right if it knows that they look alike;
    otherwise it does not."""
    right = np.array([[100.0, 50.0], [60.0, 200.0], [140.0, 200.0]])
    wrong = initial_state()
    wrong = PointStates(wrong.mean[[0, 2, 1]], wrong.covariance)
    phi = evidence_of(blobs(*(tuple(p) for p in right)), EvidenceSettings())
    pose = gaussian(HANDS, right, 400.0 * np.eye(6))
    after = {}
    for alike in ((), ((1, 2),)):
        chain = PointChain(HANDS, 100.0, PointSettings(), alike)
        prior = chain.predict(wrong, 0.04)
        received = messages([pose, chain.features(prior)], phi, GATED)
        after[alike] = chain.update(prior, received[1])[0].mean[:, :2]
        assert np.exp(chain.features(prior).log_weight).sum() == pytest.approx(1.0)
    np.testing.assert_allclose(after[((1, 2),)], right, atol=10.0)
    assert np.abs(after[()] - right).max() > 40.0
