"""Terms of the image cost: derivatives, minimum at the truth, and the documented behaviour of each cue."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest

from estimator.data.image_cues import ImageCues
from estimator.data.observation import image_extent
from estimator.energy.cost import Cost
from estimator.energy.term import Term
from estimator.numerics.robust import LECLERC, LORENTZIAN
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.render import Renderer
from estimator.synthesis.settings import ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.vision.cues.assigned import AssignedPoints, Assignments
from estimator.vision.cues.edge_matching import search_edges
from estimator.vision.cues.edges import EdgeMap, EdgeSettings, edge_map
from estimator.vision.cues.flow import follow_points
from estimator.vision.cues.flow_field import FlowField, FlowSettings, flow_field
from estimator.vision.cues.foreground import Background, SilhouetteSettings, foreground_mask, silhouette_of
from estimator.vision.cues.image_likelihood import ImageLikelihood, ImageModel
from estimator.vision.cues.settings import CueSettings, cue_settings
from estimator.vision.visibility import HIDDEN, INNER, OUTER
from humanoid.kinematics.body import Body
from tests.builders import body_of, camera_at, slope
from tests.shifted_textures import shifted_textures

SETTINGS = cue_settings()


def with_evidence(**evidence: float) -> CueSettings:
    """The usual settings with other weights of some cues; surface: weight of the visibility penalties."""
    groups: dict[str, Any] = {
        name: replace(SETTINGS.of(name), evidence=v) for name, v in evidence.items() if name != "surface"
    }
    if "surface" in evidence:
        groups["surface"] = replace(SETTINGS.surface, visibility_evidence=evidence["surface"])
    return replace(SETTINGS, **groups)


EDGES = with_evidence(silhouette=0.0, surface=0.0)
OUTLINE = with_evidence(edges=0.0, surface=0.0)
SILENT = with_evidence(edges=0.0, silhouette=0.0)
NOTHING = np.zeros((0, 0), dtype=np.float32)
MOVED = (
    "left_shoulder_elevation", "left_elbow_flexion", "right_shoulder_flexion", "left_knee_flexion", "right_hip_flexion",
    "right_hip_abduction", "lumbar_lateral", "neck_flexion",
)  # fmt: skip


class Frame(NamedTuple):
    """A rendered frame: cues and extents [px] of its cameras, the true pose, that of the frame before, and one off."""

    body: Body
    cues: tuple[ImageCues, ...]
    extents: list[float]
    q: np.ndarray
    q_before: np.ndarray
    q_off: np.ndarray


@cache
def frame() -> Frame:
    """The authored motion in the cluttered room, in two small cameras with distortion, before a known background."""
    body, rng = body_of("human34"), np.random.default_rng(0)
    before, now = authored_motion(body, np.array([1.2 - 1.0 / 30.0, 1.2]))
    points = body.landmarks(body.at(now))
    cameras = framing_cameras(points[None], ViewSettings(count=2, image_size=(320, 240), fill=0.8))
    renderer, cues = Renderer(body, cameras, rng), []
    for k, camera in enumerate(cameras):
        last, picture = (renderer.frame(body.at(q), k, rng) for q in (before, now))
        plate = renderer.plate(k).astype(np.float32)
        background = Background(plate, np.full_like(plate, 2.0), np.ones(plate.shape[:2], dtype=bool))
        outline = silhouette_of(foreground_mask(picture, background, SilhouetteSettings()))
        cues.append(
            ImageCues(
                camera,
                {
                    "edges": edge_map(picture, EdgeSettings()),
                    "flow": flow_field(last, picture, FlowSettings()),
                    "silhouette": outline,
                },
                picture,
            )
        )
    extents = [image_extent(c.project(points), np.ones(len(points))) for c in cameras]
    return Frame(body, tuple(cues), extents, now, before, body.integrate(now, rng.normal(0.0, 0.05, body.nv)))


@cache
def model(settings: CueSettings) -> ImageModel:
    return ImageModel(frame().body, settings)


def likelihood(settings: CueSettings = SETTINGS) -> ImageLikelihood:
    return ImageLikelihood.of(model(settings), frame().cues, frame().extents)


def energy(settings: CueSettings, q: np.ndarray) -> float:
    """The energy of both cameras' features, assigned again."""
    posed = frame().body.at(q)
    return Cost(frame().body, likelihood(settings).assigned(posed)).of(posed).value


def terms(cue: str) -> list[Term]:
    """The terms of one cue of each camera around the perturbed pose."""
    f, posed = frame(), frame().body.at(frame().q_off)
    if cue == "flow":
        return likelihood().followed(f.body.at(f.q_before), posed)
    settings = {"edges": EDGES, "outline": OUTLINE, "all": SETTINGS}[cue]
    return likelihood(settings).assigned(posed)


@pytest.mark.parametrize("cue", ["edges", "outline", "flow", "all"])
def test_derivatives_while_assignments_are_kept(cue: str) -> None:
    """Gradient and exact Hessian against differences through the manifold, and Gauss-Newton's is positive."""
    f, parts = frame(), terms(cue)
    assert len(parts) == 2
    for cost in [*(Cost(f.body, [term]) for term in parts), Cost(f.body, parts)]:
        here, exact = cost.at(f.q_off), cost.at(f.q_off, exact=True)
        assert (exact.value, exact.gradient.tolist()) == (here.value, here.gradient.tolist())
        assert here.gradient.any()
        for v in np.eye(f.body.nv):
            expected = slope(lambda x, c=cost: np.array(c.at(x).value), f.body, f.q_off, v, 1e-5)
            assert abs(here.gradient @ v - expected) < 1e-7 * np.linalg.norm(here.gradient)
        for v in np.random.default_rng(1).normal(size=(4, f.body.nv)):
            v /= np.linalg.norm(v)
            bend = slope(lambda x, c=cost, v=v: c.at(x).gradient @ v, f.body, f.q_off, v, 1e-4)
            assert abs(v @ exact.hessian @ v - bend) < 1e-5 * np.abs(exact.hessian).max()
        np.testing.assert_allclose(here.hessian, here.hessian.T, atol=1e-12 * np.abs(here.hessian).max())
        eigenvalues = np.linalg.eigvalsh(here.hessian)
        assert eigenvalues[0] > -1e-11 * eigenvalues[-1]


@pytest.mark.parametrize("potential", [LECLERC, LORENTZIAN])
@pytest.mark.parametrize(("distance", "focal"), [(1e5, 2e7), (2.0, 600.0)], ids=["from 100 km", "near by"])
def test_the_exact_hessian_is_exact(potential: int, distance: float, focal: float) -> None:
    """Where perspective is flat and where it is not; several features a point, points out of order."""
    body, rng, count = body_of("arm8"), np.random.default_rng(2), 40
    camera = camera_at(20.0, distance=distance, focal=focal)
    joint, local = rng.integers(1, body.njoints, 12), rng.normal(0.0, 0.1, (12, 3))
    posed = body.at(body.neutral)
    world = np.einsum("nij,nj->ni", posed.rotations[joint], local) + posed.translations[joint]
    point = rng.integers(1, 12, count)
    direction = rng.normal(size=(count, 2, 2))
    W = direction @ direction.transpose(0, 2, 1) / 400.0
    features = Assignments(
        point, camera.project(world[point]) + rng.normal(0.0, 20.0, (count, 2)),
        np.stack([W[:, 0, 0], W[:, 0, 1], W[:, 1, 1]], axis=1), rng.uniform(0.5, 1.5, count),
        np.full(count, potential), np.full(count, 3.0),
    )  # fmt: skip
    halves = [Assignments(*(a[s] for a in features)) for s in (slice(0, 15), slice(15, None))]
    cost = Cost(body, [AssignedPoints(body, camera, joint, local, halves, constant=2.5)])
    here = cost.at(body.neutral, exact=True)

    error = features.target - camera.project(world[point])
    square = np.einsum("ni,nij,nj->n", error, W, error)
    rho = 3.0 * np.log1p(square / 3.0) if potential == LORENTZIAN else 3.0 * (1.0 - np.exp(-square / 3.0))
    assert here.value == pytest.approx(2.5 + 0.5 * features.weight @ rho, rel=1e-9)
    for v in rng.normal(size=(12, body.nv)):
        bend = slope(lambda x, v=v: cost.at(x).gradient @ v, body, body.neutral, v, 1e-4)
        assert abs(v @ here.hessian @ v - bend) < 1e-4 * np.abs(here.hessian).max()
    plain = cost.at(body.neutral).hessian
    assert np.abs(plain - here.hessian).max() > 0.1 * np.abs(here.hessian).max()


@pytest.mark.parametrize("settings", [EDGES, OUTLINE, SETTINGS], ids=["edges", "outline", "all"])
def test_the_energy_is_least_at_the_true_pose(settings: CueSettings) -> None:
    """Over all moves of the root by 4 cm or 4.6 degrees and of joints by 8.6 degrees, in both directions."""
    f = frame()
    at_truth, names = energy(settings, f.q), list(f.body.q_names)
    moves = [*0.04 * np.eye(f.body.nv)[:3], *0.08 * np.eye(f.body.nv)[3:6]]
    moves += [0.15 * np.eye(f.body.nv)[names.index(name) - 1] for name in MOVED]
    rises = [energy(settings, f.body.integrate(f.q, sign * v)) - at_truth for v in moves for sign in (-1.0, 1.0)]
    assert min(rises) > 0.0
    assert np.median(rises) > 0.1 * at_truth


def test_flow_is_least_where_the_body_went() -> None:
    f = frame()
    followed = likelihood().followed(f.body.at(f.q_before))
    cost = Cost(f.body, followed)
    still, true, beyond = (
        cost.at(f.body.integrate(f.q_before, s * f.body.difference(f.q_before, f.q))).value for s in (0.0, 1.0, 2.0)
    )
    assert true < 0.5 * still
    assert true < 0.5 * beyond


@pytest.mark.parametrize("settings", [EDGES, OUTLINE, SETTINGS], ids=["edges", "outline", "all"])
def test_evidence_does_not_grow_with_the_mesh(settings: CueSettings) -> None:
    f = frame()
    coarse, dense = (
        Cost(
            f.body,
            likelihood(replace(settings, surface=replace(settings.surface, nodes=n))).assigned(f.body.at(f.q_off)),
        ).at(f.q_off)
        for n in (600, 2000)
    )
    assert coarse.value == pytest.approx(dense.value, rel=0.1)
    assert np.trace(coarse.hessian) == pytest.approx(np.trace(dense.hessian), rel=0.1)
    length = np.linalg.norm(dense.gradient)
    assert np.linalg.norm(coarse.gradient - dense.gradient) < 0.35 * length


def stripes(at: dict[float, float], size: int = 61) -> EdgeMap:
    """Vertical edges at columns x with given strengths, a pixel or two wide."""
    x = np.arange(size, dtype=float)
    row = sum(strength * np.exp(-0.5 * np.square(x - place)) for place, strength in at.items())
    direction = np.zeros((size, size, 2), dtype=np.float32)
    direction[..., 0] = 1.0
    return EdgeMap(np.tile(np.asarray(row, dtype=np.float32), (size, 1)), direction)


def searched(edges: EdgeMap, x: float, state: int = OUTER, **changes: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets along the normal (4,), their shares and trusts, of one contour point at (x, 30) that faces right."""
    options = {"boundary": NOTHING, "distance": NOTHING, "normal": (1.0, 0.0)} | changes
    target, share, trust = np.zeros((1, 4, 2)), np.zeros((1, 4)), np.zeros((1, 4))
    search_edges(
        np.array([[x, 30.0]]), np.array([options["normal"]]), np.array([state], dtype=np.int8), edges.strength,
        edges.direction, options["boundary"], options["distance"], 14.0, 8.0, 4, 4.0, 0.3, target, share, trust,
    )  # fmt: skip
    return target[0, :, 0], share[0], trust[0]


def test_two_equal_edges_pull_alike() -> None:
    """CSS eq. 8: midway between them there is no pull; elsewhere the nearer pulls towards itself."""
    target, share, _ = searched(stripes({23.0: 0.8, 37.0: 0.8}), 30.0)
    assert sorted(target[:2]) == pytest.approx([23.0, 37.0], abs=0.05)
    assert share[0] == pytest.approx(share[1], rel=1e-5)
    assert not share[2:].any()
    shares = [searched(stripes(dict.fromkeys(at, 0.9)), 30.0)[1].sum() for at in ([30.0], [25.0, 30.0, 35.0])]
    assert 0.5 < shares[0] < shares[1] < 1.0  # parts of one piece of evidence; some doubt is left
    body, camera = body_of("arm8"), camera_at(0.0)
    posed = body.at(body.neutral)
    joint, local = np.array([1]), np.array([[0.1, 0.2, 0.0]])
    here = camera.project(posed.rotations[1] @ local[0] + posed.translations[1])

    def pull(offset: float) -> np.ndarray:
        """Gradient with the point `offset` pixels right of the middle."""
        features = Assignments(
            np.zeros(2, dtype=np.int64), here + np.array([[-7.0 - offset, 0.0], [7.0 - offset, 0.0]]),
            np.tile([1.0 / 16.0, 0.0, 0.0], (2, 1)), share[:2], np.full(2, LECLERC), np.full(2, 6.0),
        )  # fmt: skip
        return Cost(body, [AssignedPoints(body, camera, joint, local, [features])]).of(posed).gradient

    right, left = pull(3.0), pull(-3.0)
    assert np.linalg.norm(pull(0.0)) < 1e-5 * np.linalg.norm(right)
    np.testing.assert_allclose(right, -left, rtol=1e-4, atol=1e-5 * np.abs(right).max())


def test_edges_are_found_to_a_fraction_of_a_pixel_along_the_normal_alone() -> None:
    edges = stripes({33.3: 0.9})
    for x, within in ((25.0, 0.1), (30.4, 0.5), (40.0, 0.1)):  # pixels are sampled along the normal
        target, share, _ = searched(edges, x)
        assert target[0] == pytest.approx(33.3, abs=within)
        assert not share[1:].any()
    assert not searched(edges, 30.0, normal=(0.0, 1.0))[1].any()
    assert not searched(edges, 30.0, state=HIDDEN)[1].any()
    assert not searched(edges, 10.0)[1].any()  # beyond the window
    assert searched(edges, 33.0)[1][0] > 1.2 * searched(edges, 25.0)[1][0]  # less likely with distance


def test_motion_boundaries_weigh_as_printed() -> None:
    """W = 1 - k S_p: full weight on a boundary (S_p = 0), 1 - k far from any (S_p = 1)."""
    edges = stripes({33.0: 0.8})
    for potential in (0.0, 0.25, 1.0):
        boundary = np.full(edges.strength.shape, potential, dtype=np.float32)
        trust = searched(edges, 30.0, boundary=boundary)[2]
        assert trust[0] == pytest.approx(1.0 - 0.3 * potential)
    f, curvature = frame(), []
    for potential in (0.0, 1.0):
        flow = replace(f.cues[0]["flow"], boundary=np.full_like(f.cues[0]["flow"].boundary, potential))
        matched = ImageLikelihood.of(model(EDGES), [f.cues[0].changed(flow=flow)], f.extents[:1])
        scaled = Cost(f.body, matched.assigned(f.body.at(f.q))).at(f.q)
        curvature.append(np.trace(scaled.hessian))
    # pulls weaken by 1 - k; the Leclerc potential compensates part of it, as residuals count as smaller
    assert 1.0 - EDGES.of("edges").motion_boundary < curvature[1] / curvature[0] < 1.0


def test_the_foreground_decides_which_edges_can_be_the_bodys() -> None:
    """The outline's edges lie on the foreground's; none of the body's edges lies outside it."""
    edges = stripes({24.0: 0.8, 36.0: 0.8})
    distance = np.tile(np.arange(61, dtype=np.float32) - 24.0, (61, 1))  # foreground to the left of column 24
    target, share, _ = searched(edges, 30.0, distance=distance)
    assert target[0] == pytest.approx(24.0, abs=0.1)
    assert share[0] > 5.0 * share[1]
    across = np.tile(np.arange(61, dtype=np.float32) - 30.0, (61, 1))  # between the two edges
    target, share, _ = searched(edges, 30.0, distance=across, state=INNER)
    assert target[0] == pytest.approx(24.0, abs=0.1)
    assert share[0] > 2.0 * share[1]
    share = searched(edges, 30.0, distance=across - 50.0, state=INNER)[1]
    assert share[0] == pytest.approx(share[1], rel=1e-5)


def test_hidden_nodes_cost_what_is_documented() -> None:
    """CSS eqs. 5 to 7: nu for a back-facing node, k nu for an occluded one, the share of all nodes times the evidence.

    The forearm moves behind the trunk: the nodes that its ray tests find hidden are what changes.
    """
    f = frame()
    s = SILENT
    predictor = model(s).predictor(f.cues[0])
    q_hidden = f.q.copy()
    for joint, angle in (("left_shoulder_flexion", -0.7), ("left_elbow_flexion", 1.6), ("left_shoulder_rotation", 1.2)):
        q_hidden[f.body.q_names.index(joint)] = angle
    q_hidden = f.body.clamp(q_hidden)
    values, counts = [], []
    for q in (f.q, q_hidden):
        posed = f.body.at(q)
        seen = predictor.predict(posed)
        quadratic = Cost(f.body, ImageLikelihood.of(model(s), f.cues[:1], f.extents[:1]).assigned(posed)).of(posed)
        assert not quadratic.gradient.any()
        values.append(quadratic.value)
        counts.append((seen.back_facing + s.surface.occluded * seen.occluded) / len(seen.state))
    assert values == pytest.approx([s.surface.visibility_evidence * s.surface.back_facing * c for c in counts])
    assert values[0] != values[1]


def test_unused_cues_leave_nothing() -> None:
    f = frame()
    silent = with_evidence(edges=0.0, silhouette=0.0, surface=0.0, flow=0.0)
    assert energy(silent, f.q_off) == 0.0
    assert likelihood(silent).followed(f.body.at(f.q_before)) == []
    bare = [ImageCues(c.camera) for c in f.cues]
    matched = ImageLikelihood.of(model(SETTINGS), bare, f.extents)
    posed = f.body.at(f.q)
    assert matched.followed(posed) == []
    assert matched.agreement(posed) == []
    assert not Cost(f.body, matched.assigned(posed)).of(posed).gradient.any()


def test_agreement_is_high_at_the_truth_alone() -> None:
    f = frame()
    truth, off = (
        likelihood().agreement(f.body.at(q)) for q in (f.q, f.body.integrate(f.q, 0.3 * np.eye(f.body.nv)[0]))
    )
    assert len(truth) == 2
    assert min(truth) > 0.9
    assert max(off) < 0.8


@pytest.mark.parametrize("shift", [(3.3, -2.1), (-6.75, 4.4)])
def test_points_follow_a_shifted_picture(shift: tuple[float, float]) -> None:
    before, now = shifted_textures(shift)
    flow = flow_field(*(cv2.cvtColor(p, cv2.COLOR_GRAY2BGR) for p in (before, now)), FlowSettings())
    rng = np.random.default_rng(4)
    points = rng.uniform([20.0, 20.0], [140.0, 100.0], (60, 2))
    target, sure = follow_points(flow, points)
    np.testing.assert_allclose(target, points + shift, atol=0.1)
    assert sure.min() > 0.9
    wrong = points + rng.uniform(-25.0, 25.0, points.shape)
    wrong[::7] = np.nan  # behind the camera
    misled, still_sure = follow_points(flow, points, wrong)
    np.testing.assert_allclose(misled, points + shift, atol=0.1)
    assert (still_sure >= sure).all()


def test_a_guess_leads_where_the_dense_field_is_lost() -> None:
    shift = (24.0, 0.0)
    before, now = shifted_textures(shift)
    still = np.zeros((*before.shape, 2), dtype=np.float32)
    lost = FlowField(still, np.ones(before.shape, np.float32), np.ones(before.shape, np.float32), before, now)
    points = np.random.default_rng(5).uniform([20.0, 20.0], [110.0, 100.0], (40, 2))
    alone = follow_points(lost, points)
    led, sure = follow_points(lost, points, points + np.array(shift) + 1.5)
    assert np.mean(np.linalg.norm(alone[0] - points - shift, axis=1) < 1.0) < 0.3
    np.testing.assert_allclose(led, points + shift, atol=0.1)
    assert sure.min() > 0.9
    assert np.median(alone[1]) < 0.5
