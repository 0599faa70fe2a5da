"""Laws of the fit with pictures: known girths come back, sides stay tied, ranges hold, without observations nothing
changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pinocchio as pin
import pytest
from builders import SUBJECTS, bent, body_of, camera_at, inside

from estimator.data.cameras.camera import Camera
from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.fitting import flesh
from estimator.fitting.body_energy import (
    BodyEnergy,
    Expansion,
    Gaussian,
    ShapedBody,
    Unknowns,
    covariance_at,
    descend,
    seen_at,
)
from estimator.fitting.fit import Fit
from estimator.fitting.flesh import fit_flesh
from estimator.fitting.person import fit_person
from estimator.fitting.settings import DescentSettings, FitSettings, FleshSettings
from estimator.fitting.shape_parameters import GIRTHS, OF_PART, ShapeParameters
from estimator.search.cost_terms import CostSettings
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.render import Renderer
from estimator.synthesis.settings import SceneSettings
from estimator.tracking.registry import Settings
from estimator.vision.cues.edges import EdgeSettings, edge_map
from estimator.vision.cues.foreground import Background, SilhouetteSettings, foreground_mask, silhouette_of
from estimator.vision.cues.settings import cue_settings
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body, points_in_world
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import Subject, load_subject
from humanoid.subject.superquadric import MIRROR, fault
from humanoid.subject.urdf_flesh import limb_capsule, mirror_parts
from kinemode.terminal.report import print_fit

CAMERAS = tuple(camera_at(a, distance=3.2, focal=750.0, height=1.0, aim=(0.0, 0.0, 0.95)) for a in (15, 100))
PROPORTIONS = {"left_knee_flexion": 1.04, "left_ankle_dorsiflexion": 0.98, "left_elbow_flexion": 1.04}
GIRTH = 1.12


def limbs(subject: Subject) -> list[int]:
    return [k for k, f in enumerate(subject.flesh) if f.link.endswith(("arm", "thigh", "shank"))]


def half_axes(subject: Subject) -> np.ndarray:
    """a and b of the limbs (., 2) [m]."""
    return np.array([subject.flesh[k].size[:2] for k in limbs(subject)])


@cache
def person() -> tuple[Subject, np.ndarray]:
    """human34 with lengths and thicker limbs of its own, and a pose."""
    scaled = load_subject("human34").scaled(PROPORTIONS)
    thick = np.array([GIRTH, GIRTH, *[1.0] * 7])
    subject = scaled.reshaped({k: (scaled.flesh[k].parameters * thick).tolist() for k in limbs(scaled)})
    return subject, authored_motion(Body(subject), np.array([0.9]))[0]


class OneFrame:
    """A reader with the cues of one instant for every frame."""

    def __init__(self, cues: tuple[ImageCues, ...]) -> None:
        self.cues = cues

    def at(self, index: int) -> tuple[ImageCues, ...]:
        return self.cues


@cache
def pictures() -> tuple[ImageCues, ...]:
    """Observations from pictures of the person before a cluttered room; the empty room is known."""
    subject, q = person()
    body = Body(subject)
    renderer = Renderer(body, CAMERAS, np.random.default_rng(1), SceneSettings())
    cues = []
    for c, camera in enumerate(CAMERAS):
        picture = renderer.frame([body.at(q)], c, np.random.default_rng((2, c)))
        plate = renderer.plate(c).astype(np.float32)
        background = Background(plate, np.full_like(plate, 2.0), np.ones(plate.shape[:2], dtype=bool))
        silhouette = silhouette_of(foreground_mask(picture, background, SilhouetteSettings()))
        cues.append(ImageCues(camera, {"edges": edge_map(picture, EdgeSettings()), "silhouette": silhouette}))
    return tuple(cues)


@cache
def first_stage(count: int) -> Fit:
    """Stage one from clicks, two pixels off, in the single frame."""
    subject, q = person()
    body, rng = Body(subject), np.random.default_rng(3)
    landmarks = body.landmarks(body.at(q))
    pixels = np.array([camera.project(landmarks) for camera in CAMERAS[:count]])
    pixels += 2.0 * rng.normal(size=pixels.shape)
    seen = Observation(0, 0.0, CAMERAS[:count], pixels, np.ones(pixels.shape[:2]), given=True)
    return fit_person(load_subject("human34"), [seen])


@cache
def fitted(count: int) -> Fit:
    return with_pictures(first_stage(count), OneFrame(pictures()[:count]), FleshSettings())


def with_pictures(first: Fit, cues: OneFrame, settings: FleshSettings) -> Fit:
    return fit_flesh(load_subject("human34"), first, cues, FitSettings(flesh=settings), Settings())


def overlap(subject: Subject, q: np.ndarray, count: int) -> float:
    """Intersection over union of the model's and the true mask; mean of the cameras."""
    overlaps = []
    for camera in CAMERAS[:count]:
        a, b = (mask(Body(s), pose, camera) for s, pose in ((subject, q), person()))
        overlaps.append(np.count_nonzero(a & b) / np.count_nonzero(a | b))
    return float(np.mean(overlaps))


def mask(body: Body, q: np.ndarray, camera: Camera) -> np.ndarray:
    """The body's mask in the picture, (H, W) bool."""
    surface = surface_of(body, nodes=2500)
    pixels = camera.project(points_in_world(body.at(q), surface.joint, surface.local))
    drawn = np.zeros(camera.image_size[::-1], np.uint8)
    for face in surface.faces:
        cv2.fillConvexPoly(drawn, np.round(16 * pixels[face]).astype(np.int32), 1, shift=4)
    return drawn > 0


def truth(fit: Fit) -> np.ndarray:
    return np.array([PROPORTIONS.get(name, 1.0) for name in fit.names])


@pytest.mark.parametrize(("count", "share"), [pytest.param(1, 0.6, marks=pytest.mark.paper), (2, 0.5)])
def test_known_girths_come_back(count: int, share: float) -> None:
    first, fit = first_stage(count), fitted(count)
    assert fit.shape is not None
    before, after = (np.abs(half_axes(f.subject) / half_axes(person()[0]) - 1.0).mean() for f in (first, fit))
    assert before > 0.1
    assert after < share * before
    wrong = [np.sqrt(np.mean(np.square(f.scales - truth(f)))) for f in (first, fit)]
    assert wrong[1] < wrong[0] + 0.002
    iou = overlap(first.subject, first.poses[0], count), overlap(fit.subject, fit.shape.poses[0], count)
    assert iou[1] > max(0.95, iou[0] + 0.03)
    assert fit.shape.agreement[1] > 0.95
    miss = [distance(f.subject, q) for f, q in ((first, first.poses[0]), (fit, fit.shape.poses[0]))]
    assert miss[1] < miss[0] + 0.005


def distance(subject: Subject, q: np.ndarray) -> float:
    """Mean distance of landmarks from the truth's [m]."""
    bodies = Body(subject), Body(person()[0])
    points = [body.landmarks(body.at(pose)) for body, pose in zip(bodies, (q, person()[1]), strict=True)]
    return float(np.linalg.norm(points[0] - points[1], axis=1).mean())


def test_the_fit_is_the_subject_that_it_describes() -> None:
    given, fit = load_subject("human34"), fitted(2)
    assert fit.shape is not None
    parameters = np.array([f.parameters for f in fit.subject.flesh])
    mirror = mirror_parts([f.link for f in given.flesh])
    assert np.array_equal(parameters[mirror], parameters * MIRROR)
    scaled = given.scaled(dict(zip(fit.names, map(float, fit.scales), strict=True)))
    k = [f.link for f in given.flesh].index("left_thigh")
    # a limb's section also scales with its length; the factors are relative to that
    row = fit.shape.parts.index("thigh")
    assert np.allclose(parameters[k, :2] / scaled.flesh[k].parameters[:2], fit.shape.factors[row], atol=0.02)
    assert np.allclose(parameters[k, 5:7] - given.flesh[k].taper, fit.shape.tapers[row], atol=1e-12)
    body = Body(fit.subject)
    covariance = fit.shape.covariance[0]
    assert covariance.shape == (body.nv, body.nv)
    assert np.linalg.eigvalsh(covariance)[0] > -1e-12
    assert np.all(fit.shape.std[:, 0] < 0.13)
    assert np.all(fit.std <= 0.06)


def test_parts_stay_apart() -> None:
    fit = fitted(2)
    assert fit.shape is not None
    own, body = SelfCollision(body_of("human34")), Body(fit.subject)
    self_collision = SelfCollision(body)
    assert self_collision.pairs == own.pairs
    assert self_collision.penetration(body.at(fit.shape.poses[0])) < FleshSettings().overlap


def test_a_shape_is_drawn_back_where_its_parts_overlap() -> None:
    """Arms straight down beside the trunk: at the largest thickness they would overlap it by two centimetres."""
    first, body = first_stage(1), body_of("human34")
    seen = [replace(o, cues=pictures()[:1]) for o in first.observations]
    shaped = ShapedBody(load_subject("human34"), 300)
    made = flesh._Stages(shaped, seen, first, FitSettings(), Settings())
    q = bent(body, left_shoulder_elevation=0.0, right_shoulder_elevation=0.0)
    thick = np.where(shaped.shape.kind == 0, shaped.shape.high, 0.0)
    x = Unknowns(q[None], np.ones(len(first.scales)), thick)
    apart = made.apart(x)
    assert np.array_equal(apart.shape, 0.75 * thick)
    before, after = (SelfCollision(Body(shaped.at(u))).penetration(body.at(q)) for u in (x, apart))
    assert after < FleshSettings().overlap < before


def elsewhere(cues: ImageCues) -> ImageCues:
    """A silhouette in the picture's corner, and no edges."""
    corner = np.zeros(cues.camera.image_size[::-1], dtype=bool)
    corner[10:90, 10:60] = True
    return cues.changed(edges=None, silhouette=silhouette_of(corner))


def nothing(cues: ImageCues) -> ImageCues:
    """A uniform grey picture without a person."""
    grey = np.full((*cues.camera.image_size[::-1], 3), 90, np.uint8)
    return cues.changed(edges=edge_map(grey, EdgeSettings()), silhouette=silhouette_of(np.zeros(grey.shape[:2], bool)))


@pytest.mark.parametrize("seen", [lambda c: c.changed(edges=None, silhouette=None), elsewhere, nothing])
def test_poor_pictures_leave_the_first_stage(seen: Callable[[ImageCues], ImageCues]) -> None:
    first = first_stage(1)
    cues = OneFrame(tuple(map(seen, pictures()[:1])))
    assert with_pictures(first, cues, FleshSettings(rounds=1)) is first


@pytest.mark.paper
def test_girths_stay_within_their_hard_range() -> None:
    """The silhouette of a giant in the place of the person."""
    first, (cues, *_) = first_stage(1), pictures()
    wide = cv2.dilate(cues["silhouette"].mask.astype(np.uint8), np.ones((41, 41), np.uint8)) > 0
    giant = OneFrame((cues.changed(edges=None, silhouette=silhouette_of(wide)),))
    fit = with_pictures(first, giant, FleshSettings(agreement=0.0, worse=1.0, outline_noise=0.1))
    assert fit.shape is not None
    assert 1.25 < np.sqrt(fit.shape.factors.prod(axis=1)).max() <= GIRTHS[1] * (1.0 + 1e-12)
    body = ProportionedBody(load_subject("human34"))
    assert np.all((fit.scales >= body.low) & (fit.scales <= body.high))


def test_every_shape_in_range_is_a_surface_and_its_limbs_stay_limbs() -> None:
    for name in SUBJECTS:
        subject = load_subject(name)
        shape, rng = ShapeParameters(subject), np.random.default_rng(5)
        assert np.all(shape.low <= 0.0)
        assert np.all(shape.high >= 0.0)
        limb = [limb_capsule(f) is not None for f in subject.flesh]
        for _ in range(30):
            drawn = np.where(rng.random(len(shape.low)) < 0.5, shape.low, shape.high)
            drawn_flesh = [f.with_parameters(p) for f, p in zip(subject.flesh, shape.of_parts(drawn), strict=True)]
            assert all(fault(f.parameters) is None for f in drawn_flesh)
            assert [limb_capsule(f) is not None for f in drawn_flesh] == limb
        assert shape.subject(subject, np.zeros(len(shape.low))).urdf == subject.urdf


def test_a_half_axis_varies_by_15_per_cent() -> None:
    shape = ShapeParameters(load_subject("human34"))
    covariance = np.linalg.inv(shape.precision)
    girth, flatness = (np.flatnonzero((shape.group == 0) & (shape.kind == OF_PART.index(k))) for k in OF_PART[:2])
    spread = np.zeros(len(shape.low))
    spread[girth], spread[flatness] = 1.0, 1.0  # log of a's factor
    assert np.sqrt(spread @ covariance @ spread) == pytest.approx(0.15, abs=0.003)
    assert np.allclose(np.sqrt(np.diag(covariance)[shape.kind >= 2]), 0.1)


def test_derivatives_of_the_parts_are_those_of_differences() -> None:
    shape, rng = ShapeParameters(load_subject("human34")), np.random.default_rng(6)
    here = 0.5 * rng.uniform(shape.low, shape.high)
    derivatives = shape.derivatives(here)
    for s in rng.choice(len(here), 12, replace=False):
        step = 1e-6 * np.eye(len(here))[s]
        difference = (shape.of_parts(here + step) - shape.of_parts(here - step)) / 2e-6
        np.testing.assert_allclose(derivatives[:, :, s], difference, atol=1e-9)


def energy_of(count: int) -> tuple[ShapedBody, BodyEnergy, Unknowns]:
    """The energy of `count` frames of one camera, features assigned at unknowns that are not its minimum."""
    first, rng = first_stage(1), np.random.default_rng(7)
    seen = [replace(o, cues=pictures()[:1]) for o in first.observations] * count
    shaped = ShapedBody(load_subject("human34"), 400)
    x = Unknowns(
        np.repeat(first.poses, count, axis=0), first.scales, 0.5 * rng.uniform(shaped.shape.low, shaped.shape.high)
    )
    prior = Gaussian(shaped.proportions.mean, np.diag(1.0 / shaped.proportions.std**2))
    self_collision = SelfCollision(Body(shaped.at(x)))
    return shaped, BodyEnergy(shaped, seen, x, CostSettings(), cue_settings(), prior, 0.7, self_collision), x


def test_a_camera_among_the_landmarks_is_not_a_fault() -> None:
    """Landmarks behind it have no pixel: the others count, and nothing where all are behind."""
    shaped, _, x = energy_of(1)
    landmarks = Body(shaped.at(x)).landmarks(Body(shaped.at(x)).at(x.poses[0]))
    for share in (0.5, 1.1):
        camera = CAMERAS[0]
        depths = np.sort(camera.depths(landmarks))
        step = depths[len(depths) // 2] if share < 1.0 else depths[-1] + 0.2
        inside = replace(camera, t_camera_world=camera.t_camera_world - [0.0, 0.0, step])
        assert np.isnan(inside.project(landmarks)).any(axis=1).mean() > 0.4
        cues = (replace(pictures()[0], camera=inside),)
        seen = [replace(o, cameras=(inside,), cues=cues) for o in first_stage(1).observations]
        ((posed, likelihood),) = seen_at(shaped, seen, x, cue_settings())
        assert np.isfinite(likelihood.assigned_values(posed)).all()


def test_the_energys_gradient_is_that_of_differences() -> None:
    shaped, energy, assigned = energy_of(2)
    rng = np.random.default_rng(8)
    size = shaped.places(2)[1].stop
    x = shaped.moved(assigned, 0.01 * rng.normal(size=size))  # away from where the contours were predicted
    x = x._replace(shape=0.9 * assigned.shape)
    here = energy.at(x)
    assert here.gradient.shape == (size,)
    assert np.allclose(here.hessian, here.hessian.T)
    assert np.linalg.eigvalsh(here.hessian)[0] > -1e-6
    nv = shaped.proportions.base.nv
    blocks = (slice(0, nv), slice(nv, 2 * nv), *shaped.places(2))
    for block in blocks:
        for _ in range(2):
            v = np.zeros(size)
            v[block] = rng.normal(size=block.stop - block.start)
            h = 1e-5
            values = [energy.at(_stepped(shaped, x, s * h * v)).value for s in (1.0, -1.0)]
            assert (values[0] - values[1]) / (2.0 * h) == pytest.approx(here.gradient @ v, rel=1e-5, abs=1e-4), block


def test_the_covariance_of_a_pose_is_that_with_all_else_eliminated() -> None:
    """A joint that presses against its limit has none."""
    shaped, rng = ShapedBody(load_subject("human34"), 400), np.random.default_rng(9)
    body, size = shaped.proportions.base, shaped.places(2)[1].stop
    root = rng.normal(size=(size, size))
    H, gradient = root @ root.T + size * np.eye(size), np.zeros(size)
    at_limit = body.neutral.copy()
    at_limit[body.bounded_q[0]] = body.upper[body.bounded_q[0]]
    held = body.nv + body.bounded_v[0]
    gradient[held] = -1.0
    x = Unknowns(np.array([body.neutral, at_limit]), shaped.proportions.mean, np.zeros(len(shaped.shape.low)))
    covariance = covariance_at(shaped, Expansion(0.0, gradient, H), x)
    assert not covariance[held].any()
    pose, rest = np.arange(body.nv), np.setdiff1d(np.arange(body.nv, size), held)
    eliminated = H[np.ix_(pose, pose)] - H[np.ix_(pose, rest)] @ np.linalg.solve(
        H[np.ix_(rest, rest)], H[rest][:, pose]
    )
    np.testing.assert_allclose(covariance[: body.nv, : body.nv] @ eliminated, np.eye(body.nv), atol=1e-6)


def _stepped(shaped: ShapedBody, x: Unknowns, step: np.ndarray) -> Unknowns:
    """A step that no limit stops."""
    body, (of_scales, of_shape) = shaped.proportions.base, shaped.places(len(x.poses))
    turns = step[: of_scales.start].reshape(len(x.poses), -1)
    poses = [pin.integrate(body.model, q, turn) for q, turn in zip(x.poses, turns, strict=True)]
    return Unknowns(np.array(poses), x.scales + step[of_scales], x.shape + step[of_shape])


def test_the_energy_falls_and_what_is_held_stays() -> None:
    shaped, energy, x = energy_of(1)
    before = energy.at(x).value
    of_shape = shaped.places(1)[1]
    alone, second = descend(shaped, energy, x, of_shape, DescentSettings())
    assert second < before - 1.0
    assert second == energy.at(alone).value
    assert np.array_equal(alone.poses, x.poses)
    assert np.array_equal(alone.scales, x.scales)
    together, third = descend(shaped, energy, alone, slice(0, of_shape.stop), DescentSettings())
    assert third < second
    assert inside(shaped.proportions.base, together.poses)
    for settings in (DescentSettings(iterations=1), DescentSettings(iterations=2)):
        assert third <= descend(shaped, energy, alone, slice(0, of_shape.stop), settings)[1] <= second


def test_the_fit_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    print_fit(fitted(2), "me.urdf")
    printed = capsys.readouterr().out
    fit = fitted(2)
    assert fit.shape is not None
    row = next(line for line in printed.splitlines() if line.strip().startswith("upper arm"))
    k = fit.shape.parts.index("upper_arm")
    assert all(f"{factor:.3f}" in row for factor in fit.shape.factors[k])
    assert "pictures of frame 0; outline on the silhouettes" in printed
    print_fit(first_stage(2), "me.urdf")
    assert "flesh as given" in capsys.readouterr().out
