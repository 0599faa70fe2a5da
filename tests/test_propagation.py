"""Belief propagation beside exact answers: Gaussian trees, smoothers and loops; strata and their weights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.inference.annealing import effective_count
from estimator.inference.beliefs import strata
from estimator.inference.beliefs.graph import APART, OK, UNEXPLAINED, Belief, Edge, Graph, LogLikelihood, Node
from estimator.inference.beliefs.mixture import UniformBox, mixture_of
from estimator.inference.beliefs.potential import Potential, potential_of
from estimator.inference.beliefs.products import ProductSettings, draw_products
from estimator.inference.beliefs.propagation import BeliefSettings, propagate_batch, propagate_tree
from estimator.inference.beliefs.space import PLACEMENTS, Space
from humanoid.support.errors import InputError

LINE, PLANE = Space(1, False), Space(2, False)
STAR, CHAIN, RING = ((0, 1), (0, 2), (0, 3)), ((0, 1), (1, 2), (2, 3), (3, 4)), ((0, 1), (1, 2), (2, 3), (0, 3))
QUICK = ProductSettings(candidates=200, per_draw=4.0, rounds=1)
PRINTED = replace(QUICK, image_weighted=False)
WAYS = [pytest.param(PRINTED, id="as printed", marks=pytest.mark.paper), pytest.param(QUICK, id="image_weighted")]


def seen_at(place: np.ndarray, std: float) -> LogLikelihood:
    return lambda points: -0.5 * np.sum(np.square((points - place) / std), axis=1)


class Gaussian:
    """A graph whose beliefs are known: steps between neighbours are normal, every node is seen with noise.

    mean, covariance: the exact ones (nodes, n) and (n nodes, n nodes).
    """

    def __init__(self, space: Space, edges: tuple[Edge, ...], seed: int, step: float = 0.3, noise: float = 0.5) -> None:
        rng, n = np.random.default_rng(seed), space.n
        count = 1 + max(max(e) for e in edges)
        self.seen = rng.standard_normal((count, n))
        self.steps = {e: 0.3 * rng.standard_normal(n) for e in edges}
        A = rng.standard_normal((n, n))
        self.diffusion = step**2 * (np.eye(n) + 0.3 * A @ A.T)
        self.noise = noise
        precision, P = np.kron(np.eye(count), np.eye(n) / noise**2), np.linalg.inv(self.diffusion)
        pull = (self.seen / noise**2).ravel()
        potentials: dict[Edge, Potential] = {}
        for (i, j), move in self.steps.items():
            a, b = slice(i * n, i * n + n), slice(j * n, j * n + n)
            precision[a, a] += P
            precision[b, b] += P
            precision[a, b] -= P
            precision[b, a] -= P
            pull[a] -= P @ move
            pull[b] += P @ move
            potentials[i, j] = potential_of(space, move, self.diffusion[None])
            potentials[j, i] = potentials[i, j].inverse()
        self.precision, self.pull = precision, pull
        self.covariance = np.linalg.inv(precision)
        self.mean = (self.covariance @ pull).reshape(count, n)
        near = [mixture_of(space, y[None] + 0.3 * noise, np.full((1, n), 3.0 * noise**2)) for y in self.seen]
        nodes = (Node(seen_at(y, noise), Q) for y, Q in zip(self.seen, near, strict=True))
        self.graph = Graph(space, tuple(nodes), potentials)


def means(beliefs: tuple[Belief, ...]) -> np.ndarray:
    return np.stack([belief.weights @ belief.points for belief in beliefs])


@pytest.mark.parametrize("product", WAYS)
def test_errors_of_a_gaussian_tree_fall_with_the_root_of_the_number(product: ProductSettings) -> None:
    """There is no bias: the mean over seeds is within three standard errors of the exact solution."""
    known, error = Gaussian(PLANE, ((0, 1), (0, 2), (2, 3), (2, 4)), 0), {}
    for count in (25, 225):
        settings = BeliefSettings(kernels=count + 1, samples=count, product=product)
        off = np.stack(
            [
                means(propagate_tree(np.random.default_rng(s), known.graph, settings).beliefs) - known.mean
                for s in range(12)
            ]
        )
        error[count] = np.sqrt(np.mean(off**2))
        biased = off.mean(axis=0) / (off.std(axis=0, ddof=1) / np.sqrt(len(off)))
        assert np.sqrt(np.mean(biased**2)) < 2.0
        assert np.abs(off.mean(axis=0)).max() < 4.0 * off.std(axis=0, ddof=1).max() / np.sqrt(len(off))
    assert 2.1 < error[25] / error[225] < 4.3  # nine times as many: three


@pytest.mark.parametrize("product", WAYS)
def test_a_chain_is_the_rauch_tung_striebel_smoother(product: ProductSettings) -> None:
    """A window of five instants whose first belief is fixed, like that of the previous frame."""
    known = Gaussian(PLANE, CHAIN, 1)
    first = known.noise**2 * np.eye(2)
    filtered, predicted = [(known.seen[0], first)], []
    for edge, y in zip(CHAIN, known.seen[1:], strict=True):
        mean, P = filtered[-1][0] + known.steps[edge], filtered[-1][1] + known.diffusion
        predicted.append((mean, P))
        gain = P @ np.linalg.inv(P + first)
        filtered.append((mean + gain @ (y - mean), P - gain @ P))
    smoothed = [filtered[-1]]
    for (m, P), (ahead, spread) in zip(filtered[-2::-1], predicted[::-1], strict=True):
        gain = P @ np.linalg.inv(spread)
        later = smoothed[-1]
        smoothed.append((m + gain @ (later[0] - ahead), P + gain @ (later[1] - spread) @ gain.T))
    even = known.noise * np.random.default_rng(2).standard_normal((3000, 2))
    fixed = Belief(PLANE, known.seen[0] + even - even.mean(axis=0), np.full(3000, 1.0 / 3000))
    graph = Graph(PLANE, (Node(fixed=fixed), *known.graph.nodes[1:]), known.graph.potentials)
    settings = BeliefSettings(kernels=201, samples=300, proposal_share=0.25, product=product)
    results = [propagate_tree(np.random.default_rng(s), graph, settings).beliefs for s in range(6)]
    assert all(result[0] is fixed for result in results)
    for i, (mean, covariance) in enumerate(smoothed[::-1][1:], start=1):
        moments = [result[i].moments() for result in results]
        np.testing.assert_allclose(np.mean([m for m, _ in moments], axis=0), mean, atol=0.05)
        np.testing.assert_allclose(np.mean([c for _, c in moments], axis=0), covariance, atol=0.03)


@pytest.mark.parametrize("product", WAYS)
def test_loops_have_the_means_and_variances_of_gaussian_belief_propagation(product: ProductSettings) -> None:
    """Means are exact, variances are not."""
    known = Gaussian(LINE, RING, 4, step=0.3, noise=0.8)
    A, b, count = known.precision, known.pull, 4
    sources = known.graph.sources
    sent = {(i, j): (0.0, 0.0) for i in range(count) for j in sources[i]}  # precision and pull
    for _ in range(60):
        inside = {e: (A[e[0], e[0]] + sum(sent[k, e[0]][0] for k in sources[e[0]] if k != e[1]),
                      b[e[0]] + sum(sent[k, e[0]][1] for k in sources[e[0]] if k != e[1])) for e in sent}  # fmt: skip
        sent = {(i, j): (-(A[i, j] ** 2) / p, -A[i, j] * h / p) for (i, j), (p, h) in inside.items()}
    precision = np.array([A[i, i] + sum(sent[k, i][0] for k in sources[i]) for i in range(count)])
    mean = np.array([b[i] + sum(sent[k, i][1] for k in sources[i]) for i in range(count)]) / precision
    np.testing.assert_allclose(mean, known.mean[:, 0], atol=1e-9)
    assert np.abs(precision * np.diag(known.covariance) - 1.0).max() > 0.01
    settings = BeliefSettings(kernels=151, samples=150, iterations=6, product=product)
    results = [propagate_batch(np.random.default_rng(s), known.graph, settings).beliefs for s in range(6)]
    np.testing.assert_allclose(np.mean([means(r)[:, 0] for r in results], axis=0), mean, atol=0.05)
    variance = np.mean([[r.moments()[1][0, 0] for r in result] for result in results], axis=0)
    np.testing.assert_allclose(variance * precision, 1.0, atol=0.12)


# lambda_S, and lambda_B as a share of the rest
SHARES = {"belief": (0.0, 1.0), "incoming": (0.0, 0.0), "proposal": (1.0, 0.0), "all": (0.3, 0.5), "little": (0.1, 0.2)}


def off_in_standard_errors(proposal: float, belief: float, product: ProductSettings = PRINTED) -> float:
    known = Gaussian(LINE, STAR, 5)
    settings = BeliefSettings(
        kernels=61, samples=100, iterations=2, proposal_share=proposal, proposal_factor=1.0, belief_share=belief,
        product=product,
    )  # fmt: skip
    off = np.stack(
        [
            means(propagate_batch(np.random.default_rng(s), known.graph, settings).beliefs) - known.mean
            for s in range(24)
        ]
    )[..., 0]
    return float(np.abs(off.mean(axis=0) / (off.std(axis=0, ddof=1) / np.sqrt(len(off)))).max())


def test_half_of_the_first_samples_are_proposed_and_half_as_many_in_each_iteration() -> None:
    for iteration, proposal in enumerate((0.5, 0.25, 0.125)):
        other = 0.5 * (1.0 - proposal)
        assert BeliefSettings().shares(iteration) == (other, other, proposal)


@pytest.mark.parametrize(
    ("shares", "image_weighted"),
    [
        *(("incoming", False), ("all", False), ("all", True)),
        *(pytest.param(name, True, marks=pytest.mark.thorough) for name in ("belief", "incoming", "proposal")),
        *(pytest.param(name, False, marks=pytest.mark.paper) for name in ("belief", "proposal", "little")),
        pytest.param("little", True, marks=pytest.mark.paper),
    ],
)
def test_each_stratum_alone_and_any_shares_come_to_the_same(shares: str, image_weighted: bool) -> None:
    assert off_in_standard_errors(*SHARES[shares], replace(QUICK, image_weighted=image_weighted)) < 3.0


@pytest.mark.parametrize(
    ("name", "wrong", "shares"),
    [
        ("belief_weight", lambda log_phi, log_factors, to: log_phi, "belief"),
        ("incoming_weight", np.zeros_like, "incoming"),
        ("proposal_weight", lambda phi, factors, to, log_q: phi + factors.sum(axis=0) - log_q, "proposal"),
        ("proposal_weight", lambda log_phi, *_: log_phi, "proposal"),
    ],
    ids=["B without 1 / m_ji", "I without phi", "S with m_ji", "S without messages and Q"],
)  # fmt: skip
def test_a_wrong_weight_is_seen(monkeypatch: pytest.MonkeyPatch, name: str, wrong: object, shares: str) -> None:
    monkeypatch.setattr(strata, name, wrong)
    assert off_in_standard_errors(*SHARES[shares]) > 4.0


@pytest.mark.parametrize(
    ("name", "wrong", "shares"),
    [
        ("belief_weight", lambda log_phi, log_factors, to: log_phi, "belief"),
        ("draw_products", lambda *given: [replace(d, image_weighted=False) for d in draw_products(*given)], "incoming"),
    ],
    ids=["B without 1 / m_ji", "phi twice"],
)
def test_a_wrong_weight_of_image_weighted_candidates_is_seen(
    monkeypatch: pytest.MonkeyPatch, name: str, wrong: object, shares: str
) -> None:
    monkeypatch.setattr(strata, name, wrong)
    # using phi twice gives the right mean in symmetric graphs, but too small variances
    if name == "belief_weight":
        assert off_in_standard_errors(*SHARES[shares], QUICK) > 4.0
        return
    known = Gaussian(LINE, STAR, 5)
    settings = BeliefSettings(kernels=61, samples=100, iterations=3, belief_share=0.0, product=QUICK)
    result = propagate_batch(np.random.default_rng(1), known.graph, settings)
    exact = np.diag(known.covariance)
    variance = np.array([belief.moments()[1][0, 0] for belief in result.beliefs])
    assert (variance / exact).mean() < 0.8


def test_a_likelihood_sharper_than_the_messages_is_found_by_more_samples() -> None:
    """A message twenty times as wide as the likelihood: most of its samples have no weight, candidates do."""
    wide = mixture_of(LINE, np.zeros((1, 1)), np.ones((1, 1)))
    graph = Graph(LINE, (Node(seen_at(np.array([1.5]), 0.05), priors=(wide,)),))
    worth = {}
    for image_weighted in (False, True):
        settings = BeliefSettings(product=ProductSettings(image_weighted=image_weighted))
        beliefs = [propagate_batch(np.random.default_rng(s), graph, settings).beliefs[0] for s in range(6)]
        assert all(belief.status == OK for belief in beliefs)
        worth[image_weighted] = np.mean([effective_count(distinct_weights(belief)) for belief in beliefs])
    assert worth[True] > 4.0 * worth[False], worth


def distinct_weights(belief: Belief) -> np.ndarray:
    """The weights of distinct points."""
    _, label = np.unique(belief.points[:, 0], return_inverse=True)
    return np.bincount(label, weights=belief.weights)


def limbs() -> Graph:
    """Three placements about each other, with loops, outliers and a node that is not seen."""
    rng = np.random.default_rng(6)
    origin = np.eye(7)[6]
    box = UniformBox(PLACEMENTS, np.full(3, -1.0), np.full(3, 1.0))
    room = mixture_of(PLACEMENTS, origin[None], np.array([[1.0, 1.0, 1.0, 4.0, 4.0, 4.0]]))
    potentials = {}
    for i, j in ((0, 1), (1, 2), (0, 2)):
        relative = PLACEMENTS.moved(origin, 0.2 * rng.standard_normal((3, 6)))
        potentials[i, j] = potential_of(PLACEMENTS, relative, np.full((3, 6), 0.05**2), outlier=room)
        potentials[j, i] = potentials[i, j].inverse(room if i else box)
    near = mixture_of(PLACEMENTS, origin[None], np.full((1, 6), 0.1))
    return Graph(
        PLACEMENTS,
        (Node(lambda x: -50.0 * np.sum(x[:, :3] ** 2, axis=1), near), Node(proposal=near), Node()),
        potentials,
    )


@pytest.mark.parametrize("product", WAYS)
def test_equal_seeds_equal_bits_in_any_process(product: ProductSettings) -> None:
    settings = BeliefSettings(kernels=31, samples=20, iterations=3, product=product)

    def backwards(function, tasks):  # type: ignore[no-untyped-def]
        return [*map(function, [*tasks][::-1])][::-1]

    seen = []
    one_way = propagate_batch(np.random.default_rng(7), limbs(), settings)
    other = propagate_batch(
        np.random.default_rng(7), limbs(), settings, watch=lambda *state: seen.append(state), each=backwards
    )
    assert [iteration for iteration, _ in seen] == [0, 1, 2][-len(seen) :]
    for a, b in zip(one_way.beliefs, other.beliefs, strict=True):
        assert a.status == OK
        assert np.array_equal(a.points, b.points)
        assert np.array_equal(a.weights, b.weights)
        assert a.weights.sum() == pytest.approx(1.0)
    another = propagate_batch(np.random.default_rng(8), limbs(), settings)
    assert not np.array_equal(one_way.beliefs[0].points, another.beliefs[0].points)


@pytest.mark.parametrize("blind", [-np.inf, np.nan, np.inf])
@pytest.mark.parametrize("product", WAYS)
def test_beliefs_without_weight_widen_and_are_flagged(product: ProductSettings, blind: float) -> None:
    known, settings = Gaussian(LINE, STAR, 9), BeliefSettings(kernels=101, samples=200, product=product)
    dark = replace(known.graph.nodes[1], log_likelihood=lambda points: np.full(len(points), blind))
    graph = Graph(LINE, (known.graph.nodes[0], dark, *known.graph.nodes[2:]), known.graph.potentials)
    result = propagate_batch(np.random.default_rng(9), graph, settings)
    assert [b.status for b in result.beliefs] == [OK, UNEXPLAINED, OK, OK]
    assert result.status[1, 0] == UNEXPLAINED
    seen = propagate_batch(np.random.default_rng(9), known.graph, settings)
    assert result.beliefs[1].moments()[1][0, 0] > 1.2 * seen.beliefs[1].moments()[1][0, 0]
    for belief in result.beliefs:
        assert np.all(np.isfinite(belief.points))
        assert np.all(np.isfinite(belief.weights))


def test_messages_without_common_ground() -> None:
    """Too far apart for floating point: any one of the messages, and the status."""
    far = [mixture_of(LINE, np.array([[place]]), np.array([[1e-4]])) for place in (-1e200, 0.0, 1e200)]
    graph = Graph(LINE, (Node(priors=tuple(far)),))
    (belief,) = propagate_batch(np.random.default_rng(10), graph, BeliefSettings()).beliefs
    assert belief.status == APART
    assert set(np.sign(np.round(belief.points[:, 0]))) == {-1.0, 0.0, 1.0}
    assert np.all(np.isfinite(belief.weights))


def test_invalid_arguments_are_refused() -> None:
    step, nodes = potential_of(LINE, np.zeros((1, 1)), np.ones((1, 1))), (Node(), Node())
    settings, rng = BeliefSettings(iterations=1), np.random.default_rng(11)
    both = {(0, 1): step, (1, 0): step}
    for wrong, message in (
        (lambda: Graph(LINE, nodes, {(0, 2): step}), "2 nodes"),
        (lambda: Graph(LINE, nodes, {(0, 1): step}), "other direction"),
        (lambda: Graph(PLANE, nodes, both), "not of"),
        (lambda: Graph(LINE, (Node(),)), "proposal"),
        (lambda: propagate_batch(rng, Graph(LINE, nodes, both), settings), "node 0: received no message"),
        (lambda: propagate_tree(rng, Graph(LINE, nodes, both), settings), "nothing to draw from"),
        (lambda: propagate_tree(rng, Gaussian(LINE, RING, 0).graph, settings), "loop"),
    ):
        with pytest.raises(InputError, match=message):
            wrong()
