"""Laws of limbs from keypoints: exact keypoints reproduce their limbs, and give no more evidence than they contain."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.data.observation import Observation
from estimator.inference.beliefs.space import placements_of
from estimator.numerics.alignment import motions_onto, similarity_onto
from estimator.search.cost_model import CostModel
from estimator.trackers.loose_limbed.limbs.keypoint_evidence import (
    KeypointEvidence,
    KeypointEvidenceSettings,
    LimbLandmarks,
    landmarks_of_limbs,
)
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals, PartProposals
from estimator.trackers.loose_limbed.part_detectors.keypoint_fits import Fits, turned_about
from estimator.trackers.loose_limbed.part_detectors.keypoints import KeypointDetectorSettings, keypoint_proposals
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.subject.landmarks import mirror_index
from humanoid.support.errors import InputError

CAMERAS = tuple(camera_at(azimuth) for azimuth in (20.0, 110.0, 200.0, 310.0))


@cache
def limbs_of(name: str) -> tuple[LimbGraph, tuple[LimbLandmarks, ...]]:
    graph = limb_graph(body_of(name))
    return graph, landmarks_of_limbs(body_of(name), graph)


def seen(name: str, seed: int, views: int = 4) -> tuple[Observation, np.ndarray, np.ndarray]:
    """Exact keypoints of a random pose, and the limbs' true placements."""
    body = body_of(name)
    q = random_pose(body, np.random.default_rng(seed), share=0.8)
    return observe(body, q, CAMERAS[:views]), *limb_placements(limbs_of(name)[0], body, q)


def part_proposals(name: str, observation: Observation, **settings: float) -> AllPartProposals:
    graph, landmarks = limbs_of(name)
    return keypoint_proposals(body_of(name), graph, observation, KeypointDetectorSettings(**settings), landmarks)  # type: ignore[arg-type]


def evidence(name: str, observation: Observation, **settings: float) -> KeypointEvidence:
    graph, landmarks = limbs_of(name)
    sigma = CostModel(body_of(name)).keypoint_sigma(observation)
    chosen = KeypointEvidenceSettings(**settings)  # type: ignore[arg-type]
    return KeypointEvidence(body_of(name), graph, observation, sigma, chosen, landmarks)


def limbs_with_known_axis(name: str) -> list[int]:
    """Limbs whose axis is given by fixed landmarks."""
    graph, landmarks = limbs_of(name)
    heights = [of.place[of.fixed, 2] for of in landmarks]
    return [k for k, z in enumerate(heights) if len(z) and np.ptp(z) > 0.1 * graph.limbs[k].length]


def nearest(proposals: PartProposals, t: np.ndarray, R: np.ndarray) -> tuple[float, float, float]:
    """How far off the nearest candidate is: origin [m], axis and rotation [deg]."""
    places, turns = placements_of(proposals.points)
    off = np.linalg.norm(places - t, axis=1)
    axis = np.degrees(np.arccos(np.clip(turns[:, :, 2] @ R[:, 2], -1.0, 1.0)))
    turn = np.degrees(np.arccos(np.clip(0.5 * (np.einsum("nij,ij->n", turns, R) - 1.0), -1.0, 1.0)))
    best = int(np.argmin(off / 0.1 + (axis + 0.1 * turn) / 30.0))
    return float(off[best]), float(axis[best]), float(turn[best])


def test_many_motions_are_each_the_best_one() -> None:
    rng = np.random.default_rng(0)
    points, others = rng.normal(size=(5, 3)), rng.normal(size=(20, 5, 3))
    R, t = motions_onto(points, others, np.ones((20, 5)))
    for k in range(20):
        alone = similarity_onto(points, others[k])
        np.testing.assert_allclose(R[k], alone.R, atol=1e-9)
        np.testing.assert_allclose(t[k], alone.t, atol=1e-9)
    weight = np.array([[1.0, 1.0, 1.0, 0.0, 1.0]])
    hidden = np.where(weight[0, :, None] > 0.0, others[0], np.nan)[None]
    kept = weight[0] > 0.0
    alone = similarity_onto(points[kept], others[0][kept])
    np.testing.assert_allclose(motions_onto(points, hidden, weight)[0][0], alone.R, atol=1e-9)


def test_landmarks_of_a_limb_stay_in_its_frame_and_are_mirrored() -> None:
    body, (graph, landmarks) = body_of("human34"), limbs_of("human34")
    q = random_pose(body, np.random.default_rng(9), share=0.8)
    t, R = limb_placements(graph, body, q)
    points = body.landmarks(body.at(q))
    mirror = mirror_index(body.landmark_names)
    for k, of in enumerate(landmarks):
        local = (points[of.landmark] - t[k]) @ R[k]
        np.testing.assert_allclose(local[of.fixed], of.place[of.fixed], atol=2e-3)
        other = landmarks[graph.mirror[k]]
        assert set(mirror[of.landmark[of.fixed]]) == set(other.landmark[other.fixed])
    assert len(limbs_with_known_axis("human34")) == len(graph.limbs) - 1  # nothing but the neck is fixed to the torso


@pytest.mark.parametrize("name", ["human34", "arm8", "upper13"])
@pytest.mark.parametrize("views", [4, 2])
def test_exact_keypoints_give_back_the_limbs(name: str, views: int) -> None:
    for seed in range(4):
        observation, t, R = seen(name, seed, views)
        for k, proposals in enumerate(part_proposals(name, observation)):
            assert (proposals.weights > 0.0).all()
            assert len(proposals.points) == len(proposals.weights) > 0
            off, axis, turn = nearest(proposals, t[k], R[k])
            if k in limbs_with_known_axis(name):
                assert off < 3e-3
                assert axis < 1.0
                assert turn < 75.0
            elif name == "human34":
                assert off < 0.15
                assert axis < 30.0


def test_the_likeliest_candidate_is_the_limb_s_own() -> None:
    observation, t, R = seen("human34", 1)
    for k in limbs_with_known_axis("human34"):
        proposals = part_proposals("human34", observation)[k]
        best = PartProposals(proposals.points[[proposals.weights.argmax()]], np.ones(1))
        assert nearest(best, t[k], R[k])[0] < 3e-3


def test_neighbours_determine_how_a_limb_is_turned() -> None:
    off = []
    for seed in range(6):
        observation, t, R = seen("human34", seed)
        made = part_proposals("human34", observation)
        for k in limbs_with_known_axis("human34"):
            best = PartProposals(made[k].points[[made[k].weights.argmax()]], np.ones(1))
            off.append(nearest(best, t[k], R[k])[2])
    assert np.mean(np.array(off) < 30.0) > 0.85


def test_rays_that_miss_each_other_are_doubted_and_far_ones_are_not_of_one_landmark() -> None:
    observation, t, _ = seen("human34", 1)
    pixels = observation.pixels.copy()
    pixels[0, :, 1] += 30.0  # the whole view alike, so that only the rays' distance shows it
    view_off = replace(observation, pixels=pixels)
    for k in limbs_with_known_axis("human34"):
        proposals = part_proposals("human34", view_off)[k]
        away = np.linalg.norm(placements_of(proposals.points)[0] - t[k], axis=1)
        assert away[proposals.weights.argmax()] < 3e-3
        assert proposals.weights[away > 0.02].max(initial=0.0) < 0.5 * proposals.weights.max()
    pixels[0, :, 1] += 120.0
    two = replace(observation, cameras=CAMERAS[:2], pixels=pixels[:2], confidence=observation.confidence[:2])
    assert all(not len(proposals.weights) for proposals in part_proposals("human34", two, alone=False))


def test_turning_about_a_line_leaves_the_line() -> None:
    rng = np.random.default_rng(2)
    R, _ = motions_onto(rng.normal(size=(4, 3)), rng.normal(size=(5, 4, 3)), np.ones((5, 4)))
    line = rng.normal(size=(5, 3))
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    fits = Fits(R, rng.normal(size=(5, 3)), np.zeros(5), np.arange(5), line, rng.normal(size=(5, 3)))
    turned = turned_about(fits, np.full(5, 1.0))
    for along in (0.0, 0.7):
        on_line = fits.pivot + along * line
        before, after = (np.einsum("kij,kj->ki", f.R, on_line) + f.t for f in (fits, turned))
        np.testing.assert_allclose(after, before, atol=1e-12)
    assert np.trace(fits.R[0].T @ turned.R[0]) == pytest.approx(1.0 + 2.0 * np.cos(1.0))


def test_one_camera_knows_a_limb_by_its_length() -> None:
    good = []
    for seed in range(6):
        observation, t, R = seen("human34", seed, 1)
        off = [nearest(proposals, t[k], R[k]) for k, proposals in enumerate(part_proposals("human34", observation))]
        good += [off[k][0] < 0.1 and off[k][1] < 30.0 for k in limbs_with_known_axis("human34")]
    assert np.mean(good) > 0.95
    assert all(not len(proposals.weights) for proposals in part_proposals("human34", observation, alone=False))


def test_exchanged_sides_are_covered_in_one_view_or_all() -> None:
    mirror = mirror_index(body_of("human34").landmark_names)
    observation, t, R = seen("human34", 2)
    pixels = observation.pixels.copy()
    pixels[0] = pixels[0, mirror]
    for other in (observation.exchanged(mirror), replace(observation, pixels=pixels)):
        for k in limbs_with_known_axis("human34"):
            assert nearest(part_proposals("human34", other)[k], t[k], R[k])[0] < 3e-3
    # in every view at the cost of the exchange for each of a pair, spread over undetermined turns
    graph, made = limbs_of("human34")[0], part_proposals("human34", observation)
    price = 2.0 * KeypointDetectorSettings().exchange
    for k in (k for k in limbs_with_known_axis("human34") if graph.mirror[k] != k):
        places, weights = placements_of(made[k].points)[0], made[k].weights
        sums = [weights[np.linalg.norm(places - t[i], axis=1) < 3e-3].sum() for i in (k, graph.mirror[k])]
        assert sums[1] / sums[0] == pytest.approx(np.exp(-price), rel=0.05)
    thigh = next(k for k in limbs_with_known_axis("human34") if graph.mirror[k] != k)
    # two views, one of them exchanged: only an exchange is consistent
    two = replace(observation, cameras=CAMERAS[:2], pixels=pixels[:2], confidence=observation.confidence[:2])
    assert nearest(part_proposals("human34", two)[thigh], t[thigh], R[thigh])[0] < 3e-3


def test_nothing_seen_gives_no_evidence() -> None:
    observation, t, R = seen("human34", 3)
    shape = observation.confidence.shape
    missing = replace(observation, pixels=np.full((*shape, 2), np.nan), confidence=np.zeros(shape))
    assert all(
        proposals.points.shape == (0, 7) and proposals.weights.shape == (0,)
        for proposals in part_proposals("human34", missing)
    )
    for k in range(len(t)):
        assert evidence("human34", missing).log_likelihood(k, t[[k]], R[[k]])[0] == 0.0
    pixels = observation.pixels.copy()
    pixels[1:, :, 0] = np.nan  # with confidence, but without a position
    alone = part_proposals("human34", replace(observation, pixels=pixels))
    for k in limbs_with_known_axis("human34"):
        assert nearest(alone[k], t[k], R[k])[0] < 0.15


@pytest.mark.parametrize("name", ["human34", "arm8"])
@pytest.mark.parametrize("views", [4, 3, 2, 1])
def test_the_true_placement_is_likelier_than_far_ones(name: str, views: int) -> None:
    observation, t, R = seen(name, 5, views)
    of, rng = evidence(name, observation), np.random.default_rng(0)
    for k in limbs_with_known_axis(name):
        way = rng.normal(size=(500, 3))
        away = t[k] + way * (rng.uniform(0.3, 6.0, 500) / np.linalg.norm(way, axis=1))[:, None]
        values = of.log_likelihood(k, away, np.repeat(R[[k]], 500, axis=0))
        true = of.log_likelihood(k, t[[k]], R[[k]])[0]
        assert np.isfinite(values).all()
        assert true <= 0.0
        # little changes along a single camera's line of sight
        assert np.mean(true > values) > (0.97 if views == 1 else 0.995)


def test_evidence_of_exchanged_sides_costs_the_exchange_in_every_view() -> None:
    body, (graph, landmarks) = body_of("human34"), limbs_of("human34")
    observation, t, R = seen("human34", 6)
    other = observation.exchanged(mirror_index(body.landmark_names))
    k = next(i for i in limbs_with_known_axis("human34") if len(landmarks[i].landmark) == 2 and graph.mirror[i] != i)
    own = evidence("human34", observation).log_likelihood(k, t[[k]], R[[k]])[0]
    assert own == pytest.approx(-4.0 * np.log(1.0 + np.exp(-3.0)), abs=0.05)
    assert evidence("human34", other).log_likelihood(k, t[[k]], R[[k]])[0] == pytest.approx(own - 12.0, abs=0.05)


def test_landmarks_that_move_in_a_limb_are_less_certain() -> None:
    """Only the neck is fixed to the torso: its true placement is nearly the best possible one."""
    trunk = next(k for k in range(len(limbs_of("human34")[0].limbs)) if k not in limbs_with_known_axis("human34"))
    values = []
    for seed in range(12):
        observation, t, R = seen("human34", seed)
        values.append(evidence("human34", observation).log_likelihood(trunk, t[[trunk]], R[[trunk]])[0])
    assert np.mean(values) > -5.0


def test_keypoints_of_two_limbs_count_once() -> None:
    """Doubling the noise of one landmark's keypoint changes the sum over limbs like one Gaussian energy."""
    body, (graph, landmarks) = body_of("arm8"), limbs_of("arm8")
    observation, t, R = seen("arm8", 7, 1)
    owners = np.bincount(np.concatenate([of.landmark for of in landmarks]), minlength=len(body.landmark_names))
    loose = {int(i) for of in landmarks for i in of.landmark[~of.fixed]}
    k = next(k for k in range(len(owners)) if owners[k] > 1 and k not in loose)
    pixels = observation.pixels.copy()
    pixels[0, k, 0] += 3.0
    sigma = np.full(observation.confidence.shape, 2.0)
    settings = KeypointEvidenceSettings(potential="gaussian")
    values = [
        KeypointEvidence(body, graph, o, sigma, settings, landmarks)
        for o in (observation, replace(observation, pixels=pixels))
    ]
    near = [
        sum(v.log_likelihood(i, t[[i]], R[[i]])[0] for i in range(len(t)) if i in limbs_with_known_axis("arm8"))
        for v in values
    ]
    assert near[0] - near[1] == pytest.approx(0.5 * (3.0 / 2.0) ** 2, abs=0.02)


def test_equal_input_equal_bits_and_wrong_input_is_refused() -> None:
    observation = seen("human34", 8, 3)[0]
    body, (graph, landmarks) = body_of("human34"), limbs_of("human34")
    for a, b in zip(part_proposals("human34", observation), keypoint_proposals(body, graph, observation), strict=True):
        assert np.array_equal(a.points, b.points)
        assert np.array_equal(a.weights, b.weights)
    with pytest.raises(InputError, match="sigma"):
        KeypointEvidence(body, graph, observation, np.zeros((3, 2)), None, landmarks)
