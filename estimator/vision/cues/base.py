"""Image cues: how a cue is read from pictures, matched to a predicted pose, and drawn.

A cue is one module. A `Cue` has its name, its settings and its reader. The `Matcher` that it makes for one camera at
one instant turns what was read into terms of the energy around a pose. `register` in
`estimator.vision.cues.settings` makes it available; nothing else refers to it.

Settings that all cues share.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.image_cues import ImageCues
from estimator.energy.term import Term
from estimator.vision.camera_pictures import CameraPictures, PersonMasks
from estimator.vision.cues.assigned import AssignedPoints, Assignments
from estimator.vision.cues.cue_picture import CuePicture
from estimator.vision.prediction import Prediction, Predictor
from humanoid.kinematics.body import Body, PosedBody
from humanoid.shape.surface import Surface
from humanoid.support.settings import setting


@dataclass(frozen=True)
class SurfaceSettings:
    """Settings of the comparison of a body's surface with the pictures, common to all cues.

    Neighbouring nodes see nearly the same pixels, so the nodes of a cue together count as its `evidence` of independent
    measurements however fine the mesh is. The extent, of which noises are fractions, is the root mean square distance
    of the subject's landmarks from their centre in the image; noises are never below half a pixel.

    nodes: surface nodes, about. fineness: cells of the depth buffer.
    beside_keypoints: factor of the image likelihood where there are keypoints of the whole person too: both come from
        the same pixels, and errors of the body's shape or the background affect every node at once.
    visibility_evidence: of the visibility penalties (CSS eqs. 5 to 7). back_facing: energy of a back-facing node, nu of
        the equations. occluded: k, how many times that an occluded one costs.
    rounds: how often features are assigned again during a search.
    """

    nodes: int = setting(1000, at_least=1)
    fineness: int = setting(6000, at_least=1)
    beside_keypoints: float = setting(0.15, above=0)
    visibility_evidence: float = setting(10.0, at_least=0)
    back_facing: float = setting(0.5, above=0)
    occluded: float = setting(1.2, above=0)
    rounds: int = setting(3, at_least=1)


LEAST_NOISE = 0.5  # px


class PastPose(NamedTuple):
    """Pose of the body in the frame before, that predicted from it by its velocity, if known, and of a jump, whose
    `parent` is the pose that it jumped to, the pose that it left."""

    parent: PosedBody
    predicted: PosedBody | None = None
    left: PosedBody | None = None


class ContourMatch(NamedTuple):
    """Features assigned to points of a prediction's contours.

    label: its row in the energy's table. features: their points are indices into `Prediction.contours`. unassigned:
    energy of points without a counterpart; it has a row of its own, `unassigned_label`, if that is not empty.
    """

    label: str
    features: Assignments
    unassigned: float = 0.0
    unassigned_label: str = ""


class ExplainedPose(NamedTuple):
    """A pose that is to be explained: `posed`, its prediction, the prediction of the pose at which features were
    assigned, and the past that it was followed from, None where there is none or it is not known."""

    posed: PosedBody
    prediction: Prediction
    assigned: Prediction
    past: PastPose | None


@dataclass(frozen=True, eq=False)
class CameraView:
    """Context in which a cue is matched: one camera at one instant.

    body, surface, predictor: of the subject, in this camera. cues: all that was read of the image. extent: the
    subject's in the image [px]. weight: factor of all image terms, below 1 where keypoints see the person too.
    shared: settings that all cues share. settings: the cue's own.
    """

    body: Body
    surface: Surface
    predictor: Predictor
    cues: ImageCues
    extent: float
    weight: float
    shared: SurfaceSettings
    settings: Any

    @property
    def camera(self) -> Camera:
        """The camera at the resolution of the cues."""
        return self.cues.camera

    def sigma(self, noise: float) -> float:
        """Standard deviation [px] of a noise given as a fraction of the extent, never below half a pixel."""
        return max(LEAST_NOISE, noise * self.extent)

    def on_contours(self, prediction: Prediction, features: Assignments) -> AssignedPoints:
        """The term of features assigned to a prediction's contours."""
        contours = prediction.contours
        return AssignedPoints(self.body, self.camera, contours.joint, contours.local, [features])


class Matcher:
    """One cue of one camera at one instant, matched to poses. A cue overrides what it can do.

    What it returns depends on the pose alone, to the last bit: several processes share the work.
    """

    def __init__(self, view: CameraView) -> None:
        self.view = view

    def contours(self, prediction: Prediction) -> list[ContourMatch]:
        """Features assigned to the contours of a pose; all cues' together make one term."""
        return []

    def terms(self, posed: PosedBody, prediction: Prediction) -> list[Term]:
        """Other terms around a pose, of which `prediction` is the view."""
        return []

    def without_past(self, prediction: Prediction) -> float:
        """Energy that counts beside the terms where a frame has no past: of evidence whose errors stay the same from
        frame to frame, so that with a past only a share of it is new."""
        return 0.0

    def follow(self, pasts: Sequence[PastPose]) -> list[Any]:
        """The image evidence of each past, for a cue that `follows`: small, picklable, the argument of `since`."""
        return [None for _ in pasts]

    def since(self, followed: Any) -> list[Term]:
        """Terms that tie a pose to a past, from the result of `follow` for it."""
        return []

    def leading(self, followed: Any) -> list[Term]:
        """Terms by which a hypothesis is moved from a past to the pose around which the image is used: those of
        `since`, unless the cue moves it with another weight."""
        return self.since(followed)

    def agreement(self, prediction: Prediction) -> float | None:
        """Share, 0 to 1, of the visible part of a pose that the image agrees with; below half a frame is "hard". None
        where the cue does not determine it."""
        return None

    def learn(self, prediction: Prediction, elapsed: float, weight: float) -> np.ndarray | None:
        """An array of all that a cue that `learns` has learned after this frame, None for nothing.

        prediction: the view of the frame's likeliest mode, and weight, 0 to 1, that mode's. elapsed [s]: since the
        frame of which it learned last.
        """
        return None

    def pictures(self, shown: ExplainedPose) -> Iterable[CuePicture]:
        """Diagnostic images of the cue for an explanation of a pose."""
        return ()


class Cue:
    """A kind of image evidence of a body. One stateless object represents it everywhere.

    name: as in `--cues` and in the settings' group `cues.NAME`. summary: in one sentence. settings: a frozen dataclass
    of numbers, texts and truth values, with its defaults, documented in its docstring.
    follows: whether it ties a pose to where the body was in the frame before. on_contours: whether its features lie on
    the body's contours, to which the shape of a body can be fitted. uses_masks: whether it takes given masks of the
    person, or pictures of the empty scene. needs_depth: whether it needs a stereo pair or depth pictures. beside_depth:
    whether it is used without being named where there is depth, too. learns: whether it learns from frame to frame.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    settings: ClassVar[Any]
    follows: ClassVar[bool] = False
    on_contours: ClassVar[bool] = False
    uses_masks: ClassVar[bool] = False
    needs_depth: ClassVar[bool] = False
    beside_depth: ClassVar[bool] = True
    learns: ClassVar[bool] = False

    def prepare(self, pictures: CameraPictures, settings: Any) -> Any:
        """Data computed from a whole clip before it is read, such as its background; passed to `read`."""
        return None

    def read(self, pictures: CameraPictures, instant: int, settings: Any, prepared: Any) -> Any:
        """The evidence of one camera's picture at an instant, None for nothing: a picklable object of arrays,
        independent of what was read before. InputError past the clip's end."""
        raise NotImplementedError

    def person_masks(self, prepared: Any) -> PersonMasks | None:
        """Where the person is in every picture, for use by the other cues, from the result of `prepare`; None where
        this cue does not provide it."""
        return None

    def match(self, view: CameraView) -> Matcher:
        """Its matcher, where something was read."""
        raise NotImplementedError

    def with_learned(self, reading: Any, learned: np.ndarray) -> Any:
        """A reading with what was learned in the frames before, for a cue that `learns`; raises InputError for an array
        that its matcher does not return."""
        return reading

    def doubt(self, cues: ImageCues, keypoints: np.ndarray, instant: int) -> str:
        """Why the evidence read is inconsistent with the person's keypoints (N, 2) [px], empty where it is
        consistent."""
        return ""
