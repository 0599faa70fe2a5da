"""Laws of the fit with pictures: known girths come back, sides stay tied, ranges hold, nothing seen changes nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from builders import body_of, camera_at, random_pose

from estimator.cost.model import CostSettings
from estimator.fitting import Fit, FitSettings, fit_proportions
from estimator.imaging.cues import ImageCues
from estimator.imaging.edges import EdgeSettings, edge_map
from estimator.imaging.foreground import Background, SilhouetteSettings, foreground_mask, silhouette_of
from estimator.imaging.observation import Observation
from estimator.initialisation.body_energy import BodyEnergy, Gaussian
from estimator.initialisation.descent import DescentSettings, descend
from estimator.initialisation.shape_parameters import GIRTHS, OF_PART, ShapeParameters
from estimator.initialisation.shaped_body import ShapedBody, Unknowns
from estimator.initialisation.stages import ShapeSettings, fit_shape
from estimator.synthesis import Renderer, SceneSettings, authored_motion
from humanoid.body import Body, points_in_world
from humanoid.clearance import Clearance
from humanoid.solids import solids_of
from humanoid.subject import Subject, load_subject
from humanoid.superquadric import fault
from humanoid.surface import surface_of
from humanoid.urdf_flesh import limb_capsule
from humanoid.urdf_reshape import mirror_parts

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
    """The cues of one instant, whatever frame is asked for."""

    def __init__(self, cues: tuple[ImageCues, ...]) -> None:
        self.cues = cues

    def at(self, index: int) -> tuple[ImageCues, ...]:
        return self.cues


@cache
def shown(count: int) -> OneFrame:
    """What pictures of the person before a cluttered room show to the first `count` cameras; the plates are known."""
    subject, q = person()
    body, cameras = Body(subject), CAMERAS[:count]
    renderer = Renderer(body, cameras, np.random.default_rng(1), SceneSettings())
    cues = []
    for c, camera in enumerate(cameras):
        picture = renderer.frame([body.at(q)], c, np.random.default_rng((2, c)))
        plate = renderer.plate(c).astype(np.float32)
        background = Background(plate, np.full_like(plate, 2.0), np.ones(plate.shape[:2], dtype=bool))
        silhouette = silhouette_of(foreground_mask(picture, background, SilhouetteSettings()))
        cues.append(ImageCues(camera, edge_map(picture, EdgeSettings()), None, silhouette))
    return OneFrame(tuple(cues))


@cache
def first_stage(count: int) -> Fit:
    """Stage one from clicks, two pixels off, on the one frame."""
    subject, q = person()
    body, rng = Body(subject), np.random.default_rng(3)
    landmarks = body.landmarks(body.at(q))
    pixels = np.array([camera.project(landmarks) for camera in CAMERAS[:count]])
    pixels += 2.0 * rng.normal(size=pixels.shape)
    seen = Observation(0, 0.0, CAMERAS[:count], pixels, np.ones(pixels.shape[:2]), given=True)
    return fit_proportions(load_subject("human34"), [seen], settings=FitSettings())


@cache
def fitted(count: int) -> Fit:
    return fit_shape(load_subject("human34"), first_stage(count), shown(count))


def overlap(subject: Subject, q: np.ndarray, count: int) -> float:
    """Area that the model's and the true mask share, of the area of either; mean of the cameras."""
    found = []
    for camera in CAMERAS[:count]:
        a, b = (mask(Body(s), pose, camera.image_size, camera.project) for s, pose in ((subject, q), person()))
        found.append(np.count_nonzero(a & b) / np.count_nonzero(a | b))
    return float(np.mean(found))


def mask(body, q, size, project) -> np.ndarray:  # type: ignore[no-untyped-def]
    surface = surface_of(body, nodes=2500)
    pixels = project(points_in_world(body.at(q), surface.joint, surface.local))
    drawn = np.zeros(size[::-1], np.uint8)
    for face in surface.faces:
        cv2.fillConvexPoly(drawn, np.round(16 * pixels[face]).astype(np.int32), 1, shift=4)
    return drawn > 0


def truth(fit: Fit) -> np.ndarray:
    return np.array([PROPORTIONS.get(name, 1.0) for name in fit.names])


@pytest.mark.parametrize("count", [1, 2])
def test_known_girths_come_back(count: int) -> None:
    first, fit = first_stage(count), fitted(count)
    assert fit.shape is not None
    target = half_axes(person()[0])
    before, after = (np.abs(half_axes(f.subject) / target - 1.0).mean() for f in (first, fit))
    assert before > 0.1
    assert after < 0.5 * before
    errors = [np.sqrt(np.mean(np.square(f.scales - truth(f)))) for f in (first, fit)]
    assert errors[1] < errors[0] + 0.002
    assert fit.shape.agreement[1] > 0.9
    iou = overlap(first.subject, first.poses[0], count), overlap(fit.subject, fit.shape.poses[0], count)
    assert iou[1] > max(0.93, iou[0] + 0.02)
    true = Body(person()[0]).landmarks(Body(person()[0]).at(person()[1]))
    miss = [
        np.linalg.norm(Body(f.subject).landmarks(Body(f.subject).at(q)) - true, axis=1).mean()
        for f, q in ((first, first.poses[0]), (fit, fit.shape.poses[0]))
    ]
    assert miss[1] < miss[0] + 0.01
    print(before, after, errors, iou, miss)
