"""Laws of the pose prior: a known density, its derivatives, mirror images, and where its numbers come from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose, slope
from scipy.stats import multivariate_normal, t

from benchmarks.support.pose_prior_clips import captured_files
from benchmarks.training.pose_learning import (
    LEFT_OUT,
    LearnSettings,
    Poses,
    captured_poses,
    joints_of,
    learned,
    mirror_of,
)
from benchmarks.training.pose_prior import mixture_of_all
from estimator.energy.descent.seek import Seeker
from estimator.energy.pose_prior import SHIPPED, PoseMixture, PosePrior, joint_axes, load_mixture, misfit
from estimator.energy.priors import Stabilisers
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings, TermContext, terms_of
from estimator.tracking.registry import TRACKERS, make_tracker, settings_for
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import mirror_index
from humanoid.subject.subject import load_subject, subject_from_text
from humanoid.support.errors import InputError

BODY = body_of("human34")
PLACE = np.array([7 + joints_of(BODY).index(name) for name in load_mixture().joints])  # in q, of the mixture's joints
ITS_JOINTS = {**dict.fromkeys(joints_of(BODY), 0.0), **dict.fromkeys(load_mixture().joints, 1.0)}


def evaluated(
    prior: PosePrior | Stabilisers, q: np.ndarray, exact: bool = False
) -> tuple[float, np.ndarray, np.ndarray]:
    gradient, hessian = np.zeros(BODY.nv), np.zeros((BODY.nv, BODY.nv))
    return prior.accumulate(BODY.at(q), gradient, hessian, exact), gradient, hessian


def posed(angles: np.ndarray) -> np.ndarray:
    """Its joints at these angles, the others at rest."""
    q = BODY.neutral.copy()
    q[PLACE] = angles
    return q


def between_components(rng: np.random.Generator, mixture: PoseMixture) -> np.ndarray:
    """A pose supported by several components."""
    shares = rng.dirichlet(np.ones(2 * len(mixture.weight)))
    return posed(shares @ mixture.both_sides()[1] + 0.1 * rng.normal(size=len(mixture.joints)))


def blurred(mixture: PoseMixture) -> PoseMixture:
    """Wide enough that components overlap."""
    return replace(mixture, covariance=mixture.covariance + 0.3 * np.eye(len(mixture.joints)))


def two_piece_students(body: Body, joints: Sequence[str]) -> tuple[np.ndarray, Callable[[np.ndarray], float]]:
    """Rest positions, and the log density of the stabilisers: two halves of Student's t with 3 degrees of freedom, each
    with its own scale, which meet at rest."""
    of = {s.joint: s for s in body.subject.stabilisers}
    rest, below, above = (np.array([getattr(of[j], n) for j in joints]) for n in ("rest", "std", "std_above"))

    def log_density(angles: np.ndarray) -> float:
        scale = np.where(angles > rest, above, below)
        halves = t(3.0, rest, scale * math.sqrt(4.0 / 3.0)).logpdf(angles)  # exp(-Lorentzian / 2) with nu = 4
        return float((halves + np.log(2.0 * scale / (below + above))).sum())

    return rest, log_density


@pytest.mark.parametrize("wide", [False, True])
def test_it_is_the_stated_density(wide: bool) -> None:
    mixture = blurred(load_mixture()) if wide else load_mixture()
    prior, rng = PosePrior(BODY, mixture, 0.7), np.random.default_rng(0)
    rest, background = two_piece_students(BODY, mixture.joints)
    for q in [between_components(rng, mixture) for _ in range(5)] + [random_pose(BODY, rng)]:
        density = mixture.background * math.exp(background(q[PLACE]))
        for share, mean, covariance in zip(*mixture.both_sides(), strict=True):
            density += share * multivariate_normal(mean, covariance).pdf(q[PLACE])
        expected = 0.7 * (background(rest) - math.log(density))
        assert evaluated(prior, q)[0] == pytest.approx(expected, rel=1e-9)


def test_derivatives() -> None:
    rng, mixture = np.random.default_rng(1), blurred(load_mixture())
    prior = PosePrior(BODY, mixture, 1.3)
    for q in [between_components(rng, mixture) for _ in range(4)] + [random_pose(BODY, rng)]:
        _, gradient, exact = evaluated(prior, q, exact=True)
        cautious = evaluated(prior, q)[2]
        assert not gradient[:6].any()
        for v in rng.normal(size=(5, BODY.nv)):
            along = slope(lambda x: np.array(evaluated(prior, x)[0]), BODY, q, v, 1e-4)
            assert gradient @ v == pytest.approx(float(along), rel=1e-7, abs=1e-6)
            turned = slope(lambda x: evaluated(prior, x)[1], BODY, q, v, 1e-4)
            assert np.allclose(exact @ v, turned, rtol=1e-6, atol=1e-5)
        assert np.array_equal(cautious, cautious.T)
        assert np.linalg.eigvalsh(cautious)[0] > -1e-9
        # a mixture is flatter than its parts: the true curvature is smaller
        assert np.linalg.eigvalsh(cautious - exact)[0] > -1e-9


def test_far_from_everything_the_stabilisers_decide() -> None:
    mixture, rng = load_mixture(), np.random.default_rng(2)
    prior, stabilisers = PosePrior(BODY, mixture), Stabilisers(BODY, relative=ITS_JOINTS)
    for _ in range(20):
        q = random_pose(BODY, rng)
        gap = evaluated(prior, q)[0] - evaluated(stabilisers, q)[0]
        assert gap <= -math.log(mixture.background) + 1e-9
    far = posed(BODY.upper[PLACE])
    (value, gradient, hessian), (other, pull, bend) = evaluated(prior, far), evaluated(stabilisers, far)
    assert value - other == pytest.approx(-math.log(mixture.background))
    assert np.allclose(gradient, pull)
    assert np.allclose(hessian, bend)


def test_a_pose_and_its_mirror_image_are_equally_likely() -> None:
    mixture, rng = load_mixture(), np.random.default_rng(3)
    other, sign = mirror_of(BODY)
    assert set(joints_of(BODY)) - set(mixture.joints) == set(LEFT_OUT)
    assert np.array_equal(PLACE[mixture.other_side], 7 + other[PLACE - 7])
    assert np.array_equal(mixture.mirror_sign, sign[PLACE - 7])
    swap = mirror_index(BODY.landmark_names)
    for _ in range(5):
        q = random_pose(BODY, rng, turn=0.0)
        q[:7] = BODY.neutral[:7]
        q[7:] = np.where(np.isin(np.arange(7, BODY.nq), PLACE), q[7:], BODY.neutral[7:])
        mirrored = posed(mixture.mirrored(q[PLACE]))
        points, image = BODY.landmarks(BODY.at(q)), BODY.landmarks(BODY.at(mirrored))
        assert np.allclose(image, points[swap] * [1.0, -1.0, 1.0], atol=1e-9)
        prior = PosePrior(BODY, mixture)
        assert evaluated(prior, mirrored)[0] == pytest.approx(evaluated(prior, q)[0], abs=1e-9)


def test_standing_is_likelier_than_the_stabilisers_have_it() -> None:
    prior = PosePrior(BODY, load_mixture())
    assert evaluated(prior, BODY.neutral)[0] < -1.0
    rng = np.random.default_rng(4)
    q = BODY.neutral.copy()
    assert np.median([evaluated(prior, random_pose(BODY, rng))[0] for _ in range(50)]) > evaluated(prior, q)[0] + 10.0


def test_it_replaces_the_stabilisers_in_the_energy() -> None:
    rng = np.random.default_rng(5)
    q, seen = random_pose(BODY, rng, share=0.4), observe(BODY, BODY.neutral, (camera_at(20.0),))
    values = {}
    for share in (0.0, 0.25, 1.0):
        model = CostModel(BODY, CostSettings(pose_prior_weight=share, interpenetration_weight=0.0))
        cost = model.cost(model.observation_term(seen))
        values[share] = cost.at(q).value
        solution = Seeker(BODY).seek(cost, q)
        assert solution.status == "converged"
    assert values[0.25] == pytest.approx(0.75 * values[0.0] + 0.25 * values[1.0])


def test_a_joint_that_it_leaves_out_keeps_its_stabiliser() -> None:
    """For any share."""
    (place,) = (7 + joints_of(BODY).index(name) for name in LEFT_OUT)
    bent, values = BODY.neutral.copy(), []
    bent[place] += 0.2
    for share in (0.0, 0.25, 1.0):
        terms = terms_of(TermContext(BODY, CostSettings(pose_prior_weight=share)))
        values.append(sum(term.value(BODY.at(bent)) - term.value(BODY.at(BODY.neutral)) for term in terms))
    assert values[0] > 0.5
    assert values == pytest.approx([values[0]] * 3)


def test_a_file_for_a_body_without_the_joints_is_refused() -> None:
    settings = settings_for("css", changes={"cost": {"pose_prior_file": str(SHIPPED)}})
    make_tracker("css", BODY, settings)
    for name in ("arm8", "upper13"):
        with pytest.raises(InputError, match=r"needs joints it does not have: .*human34"):
            make_tracker("css", body_of(name), settings)
    with pytest.raises(InputError, match=r"pose_prior_weight.*at most 1"):
        settings_for("css", changes={"cost": {"pose_prior_weight": 1.5}})


def kinds(body: Body, tracker: str = "css") -> list[str]:
    return [term.name for term in terms_of(TermContext(body, settings_for(tracker).cost))]


def test_by_default_it_is_on_where_it_fits_and_off_in_reproductions() -> None:
    assert kinds(BODY) == ["stabilisers", "pose prior"]
    assert kinds(body_of("upper13")) == kinds(body_of("arm8")) == ["stabilisers"]
    q = body_of("upper13").neutral + 0.1
    posed, gradient, hessian = body_of("upper13").at(q), np.zeros(13), np.zeros((13, 13))
    (alone,) = terms_of(TermContext(body_of("upper13"), CostSettings()))
    whole = Stabilisers(body_of("upper13"))
    assert alone.accumulate(posed, gradient, hessian) == whole.accumulate(posed, gradient, hessian)
    of_an_upper_body = ("dual-chain", "dual-chain-paper", "likelihood-sampling")  # by their papers; no mixture fits it
    for tracker in TRACKERS:
        own = tracker in ("css", "css-dual", "loose-limbed", *of_an_upper_body)
        assert kinds(BODY, tracker) == (["stabilisers", "pose prior"] if own else ["stabilisers"]), tracker


def test_a_body_whose_joints_turn_the_other_way_is_not_for_it() -> None:
    text = BODY.subject.urdf
    place = text.index("<axis", text.index('<joint name="left_knee_flexion"'))
    end = text.index("/>", place)
    axis = text[place:end].split('"')[1]
    other = " ".join(str(-float(x)) for x in axis.split())
    turned = Body(subject_from_text(text[:place] + f'<axis xyz="{other}"' + text[end:], source="turned"))
    assert misfit(turned, load_mixture()) == "another axis of left_knee_flexion"
    assert kinds(turned) == ["stabilisers"]


def test_locked_joints_leave_the_marginal_of_the_others() -> None:
    locked = ("left_clavicle_elevation", "right_clavicle_protraction", "neck_axial")
    body, mixture = Body(load_subject("human34", lock=locked)), load_mixture()
    kept = [i for i, name in enumerate(mixture.joints) if name not in locked]
    assert [name for name in joints_of(body) if name not in LEFT_OUT] == [mixture.joints[i] for i in kept]
    assert kinds(body) == ["stabilisers", "pose prior"]
    names = [mixture.joints[i] for i in kept]
    rest, background = two_piece_students(body, names)
    rng, place = np.random.default_rng(7), [7 + joints_of(body).index(name) for name in names]
    for _ in range(3):
        angles = rng.dirichlet(np.ones(2 * len(mixture.weight))) @ mixture.both_sides()[1][:, kept]
        density = mixture.background * math.exp(background(angles))
        for share, mean, covariance in zip(*mixture.both_sides(), strict=True):
            density += share * multivariate_normal(mean[kept], covariance[np.ix_(kept, kept)]).pdf(angles)
        q = body.neutral.copy()
        q[place] = angles
        value = PosePrior(body, mixture).accumulate(body.at(q), np.zeros(body.nv), np.zeros((body.nv, body.nv)))
        assert value == pytest.approx(background(rest) - math.log(density), rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"background": 0.2', '"background": 1.2', "background.*cannot work"),
        ('"background": 0.2', '"foreground": 0.2', "background: is missing"),
        ('"neck_axial"', '"neck_spiral"', "name every joint once"),
        ('"weight": ', '"weight": -', "cannot work"),
        ('"covariance": [', '"covariance": [-', r"components\[0\].covariance: is not positive definite"),
        ('"mean": [', '"mean": [1.0, ', r"components\[0\].mean: 27 numbers are needed, found 28"),
    ],
)  # fmt: skip
def test_a_spoilt_file_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "mixture.json"
    path.write_text(SHIPPED.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        load_mixture(path)
    assert str(path) in str(caught.value)


def test_a_file_round_trips(tmp_path: Path) -> None:
    mixture = load_mixture()
    mixture.save(tmp_path / "again.json", "again")
    again = load_mixture(tmp_path / "again.json")
    assert again.joints == mixture.joints
    for name in ("axes", "other_side", "mirror_sign", "weight", "mean", "covariance"):
        assert np.allclose(getattr(again, name), getattr(mixture, name), atol=1e-5)


def test_learning_finds_the_gaussians_that_poses_were_drawn_from() -> None:
    rng = np.random.default_rng(6)
    other, sign = mirror_of(BODY)
    D = len(joints_of(BODY))
    truth = PoseMixture(
        joints_of(BODY), joint_axes(BODY, joints_of(BODY)), other, sign, 0.2, np.array([0.3, 0.7]),
        rng.normal(0.0, 0.8, (2, D)), np.array([0.01 * np.eye(D), 0.04 * np.eye(D)]),
    )  # fmt: skip
    mean = np.repeat(truth.mean, [300, 700], axis=0)
    angles = mean + rng.normal(size=mean.shape) * np.repeat([0.1, 0.2], [300, 700])[:, None]
    some = rng.random(1000) < 0.5
    angles[some] = truth.mirrored(angles[some])  # the side of a pose carries no information
    poses = Poses(angles, np.full((1000, D, D), 1e-6 * np.eye(D)))
    mixture = learned(BODY, [poses], LearnSettings(pairs=2, prior_count=0.0, starts=2), rng)
    order = np.argsort(mixture.weight)
    assert np.allclose(mixture.weight[order], [0.3, 0.7], atol=0.01)
    for k, true, std in zip(order, truth.mean, (0.1, 0.2), strict=True):
        assert (
            min(np.abs(m - true).max() for m in (mixture.mean[k], mixture.mirrored(mixture.mean[k]))) < 4.0 * std / 17.0
        )
        assert np.sqrt(np.diag(mixture.covariance[k])).mean() == pytest.approx(std, rel=0.05)


@pytest.mark.paper
def test_the_shipped_numbers_are_what_the_script_makes() -> None:
    files = captured_files(None)
    if not files:
        pytest.skip("the motion capture is not here")
    settings = LearnSettings()
    poses = {f.stem: captured_poses(BODY, f, settings.spacing) for f in files}
    made, shipped = PosePrior(BODY, mixture_of_all(BODY, poses, settings)), PosePrior(BODY, load_mixture())
    for clip in poses.values():
        for angles in clip.angles[::10]:
            q = np.concatenate([BODY.neutral[:7], angles])
            assert evaluated(made, q)[0] == pytest.approx(evaluated(shipped, q)[0], abs=0.3)
