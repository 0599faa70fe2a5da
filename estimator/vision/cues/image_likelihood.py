"""The likelihood of a pose by the pictures of one instant: the parts of all cues, as terms of the energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from estimator.data.image_cues import ImageCues
from estimator.energy.term import Term
from estimator.vision.cues.assigned import AssignedPoints, Assignments, nothing, value_of
from estimator.vision.cues.base import CameraView, ContourMatch, ExplainedPose, Matcher, PastPose
from estimator.vision.cues.cue_picture import CuePicture
from estimator.vision.cues.settings import CueSettings, cue_settings, cues_of
from estimator.vision.prediction import Prediction, Predictor
from humanoid.kinematics.body import Body, PosedBody
from humanoid.shape.surface import Surface, surface_of

BRIEF = 2  # a first search uses one in so many points of the contours
Followed = dict[str, Any]
"""The evidence of each cue of one camera that follows the surface, for one past."""


class ImageModel:
    """Everything about image terms that does not change from frame to frame.

    cues: the settings of all cues. surface: of the body, unless it is another than its own.
    """

    def __init__(
        self,
        body: Body,
        cues: CueSettings | None = None,
        surface: Surface | None = None,
    ) -> None:
        self.body = body
        self.cues = cues or cue_settings()
        self.settings = self.cues.surface
        self.surface = surface or surface_of(body, nodes=self.settings.nodes)
        self._predictors: dict[tuple[object, ...], Predictor] = {}

    def predictor(self, cues: ImageCues) -> Predictor:
        """The predictor of a camera at the cues' resolution, made once."""
        c = cues.camera
        key = c.image_size, *(a.tobytes() for a in (c.K, c.lens, c.R_camera_world, c.t_camera_world))
        if key not in self._predictors:
            self._predictors[key] = Predictor(self.surface, c, self.settings.fineness)
        return self._predictors[key]


class ImageLikelihood:
    """The image likelihood of one instant, in every camera; constant without cameras."""

    def __init__(self, cameras: tuple[CameraLikelihood, ...] = ()) -> None:
        self.cameras = cameras

    @staticmethod
    def of(
        model: ImageModel, cues: Sequence[ImageCues], extents: Sequence[float], detected: float = 0.0
    ) -> ImageLikelihood:
        """The likelihood from the readings of the cameras' pictures.

        extents: the subject's extent in each camera's cues [px]. detected: how far keypoints see the person, 0 to 1.
        """
        pairs = zip(cues, extents, strict=True)
        return ImageLikelihood(tuple(CameraLikelihood(model, of, extent, detected) for of, extent in pairs))

    @property
    def extents(self) -> tuple[float, ...]:
        """The subject's extent in each camera's cues [px]."""
        return tuple(camera.extent for camera in self.cameras)

    def assigned(self, posed: PosedBody, brief: bool = False) -> list[Term]:
        """The cues' terms around a pose, with features assigned to the surface there, and the penalties of hidden
        nodes. brief: by some of the contours' points, which is enough for a first search."""
        return [term for camera in self.cameras for term in camera.assigned(posed, brief)]

    def assigned_values(self, posed: PosedBody) -> list[float]:
        """The values at a pose of the terms of `assigned` around it, to the last bit, one by one."""
        return [value for camera in self.cameras for value in camera.assigned_values(posed)]

    def without_past(self, posed: PosedBody) -> float:
        """See `Matcher.without_past`, of all cameras and cues."""
        return sum(camera.without_past(posed) for camera in self.cameras)

    def followed(self, parent: PosedBody, predicted: PosedBody | None = None) -> list[Term]:
        """Terms that tie a pose to the frame before, with the surface at `parent`; it is also searched from its place
        at `predicted`."""
        return self.followed_each([PastPose(parent, predicted)])[0]

    def followed_each(self, pasts: Sequence[PastPose]) -> list[list[Term]]:
        """`followed` for many pasts: the pictures are searched once for the points of all of them."""
        return [self.terms_since(followed) for followed in self.follow(pasts)]

    def follow(self, pasts: Sequence[PastPose]) -> list[list[Followed]]:
        """The evidence of each camera for each past; `terms_since` makes terms of it."""
        by_camera = [camera.follow(pasts) for camera in self.cameras]
        return [[said[k] for said in by_camera] for k in range(len(pasts))]

    def terms_since(self, followed: Sequence[Followed]) -> list[Term]:
        """The terms of one past, from the cameras' evidence for it."""
        pairs = zip(self.cameras, followed, strict=True)
        return [term for camera, said in pairs for term in camera.since(said)]

    def leading(self, followed: Sequence[Followed]) -> list[Term]:
        """The terms by which a hypothesis is moved from a past to the pose around which the pictures are used."""
        pairs = zip(self.cameras, followed, strict=True)
        return [term for camera, said in pairs for term in camera.leading(said)]

    def agreement(self, posed: PosedBody) -> list[float]:
        """The share of the pose that the image agrees with, for every camera and every cue that determines it."""
        return [share for camera in self.cameras for share in camera.agreement(posed)]


class CameraLikelihood:
    """The image likelihood of one instant in one camera.

    cues: what was read of the image. extent: the subject's in it [px]. matchers: of the cues, by name, in the order in
    which their parts are summed.
    """

    def __init__(self, model: ImageModel, cues: ImageCues, extent: float, detected: float = 0.0) -> None:
        self.model, self.cues, self.extent, self.detected = model, cues, float(extent), detected
        self.predictor = model.predictor(cues)
        self._weight = 1.0 - detected * (1.0 - model.settings.beside_keypoints)
        self._brief = BRIEF + round(detected)  # beside keypoints pictures decide little
        known = cues_of(cues)
        self.matchers: dict[str, Matcher] = {cue.name: cue.match(self.view(cue.name)) for cue in known}
        self._following = [cue.name for cue in known if cue.follows]

    def view(self, name: str) -> CameraView:
        """Context in which a cue is matched."""
        return CameraView(
            body=self.model.body,
            surface=self.model.surface,
            predictor=self.predictor,
            cues=self.cues,
            extent=self.extent,
            weight=self._weight,
            shared=self.model.settings,
            settings=self.model.cues.of(name),
        )

    def assigned(self, posed: PosedBody, brief: bool = False) -> list[Term]:
        """See `ImageLikelihood.assigned`: one term of all features on contours, then the cues' other terms."""
        if not self.matchers:
            return []
        prediction = self.predictor.predict(posed, self._brief if brief else 1)
        groups, constant = self._groups(prediction)
        return [self.on_contours(prediction, groups, constant), *self.others(posed, prediction)]

    def assigned_values(self, posed: PosedBody) -> list[float]:
        """See `ImageLikelihood.assigned_values`."""
        if not self.matchers:
            return []
        prediction = self.predictor.predict(posed)
        groups, constant = self._groups(prediction)
        c = prediction.contours
        on_contours = value_of(posed, self.cues.camera, c.joint, c.local, groups) + float(constant)
        return [on_contours, *(term.value(posed) for term in self.others(posed, prediction))]

    def without_past(self, posed: PosedBody) -> float:
        """See `Matcher.without_past`, of all cues."""
        prediction = self.predictor.predict(posed)
        return sum(matcher.without_past(prediction) for matcher in self.matchers.values())

    def _groups(self, prediction: Prediction) -> tuple[list[Assignments], float]:
        """The features on a prediction's contours, and the energy of points without one, including penalties."""
        groups, constant = [], self.penalty(prediction)
        for match in self.contours(prediction):
            groups.append(match.features)
            constant += match.unassigned
        return groups or [nothing()], constant

    def on_contours(
        self, prediction: Prediction, groups: Sequence[Assignments], constant: float = 0.0, name: str = "on contours"
    ) -> Term:
        """The term of features assigned to a prediction's contours, with the energy of points without one."""
        c = prediction.contours
        return AssignedPoints(self.model.body, self.cues.camera, c.joint, c.local, groups, constant, name=name)

    def contours(self, prediction: Prediction) -> list[ContourMatch]:
        """The features of all cues that lie on a prediction's contours."""
        return [match for matcher in self.matchers.values() for match in matcher.contours(prediction)]

    def others(self, posed: PosedBody, prediction: Prediction) -> list[Term]:
        """The terms of all cues beside the features on contours."""
        return [term for matcher in self.matchers.values() for term in matcher.terms(posed, prediction)]

    def penalty(self, prediction: Prediction) -> float:
        """Energy of back-facing and occluded nodes (CSS eq. 7)."""
        s = self.model.settings
        hidden = prediction.back_facing + s.occluded * prediction.occluded
        return self._weight * s.visibility_evidence * s.back_facing * hidden / len(prediction.state)

    def follow(self, pasts: Sequence[PastPose]) -> list[Followed]:
        """See `ImageLikelihood.follow`."""
        said = {name: self.matchers[name].follow(pasts) for name in self._following}
        return [{name: of_cue[k] for name, of_cue in said.items()} for k in range(len(pasts))]

    def since(self, followed: Followed) -> list[Term]:
        """See `ImageLikelihood.terms_since`."""
        return [term for name, said in followed.items() for term in self.matchers[name].since(said)]

    def leading(self, followed: Followed) -> list[Term]:
        """See `ImageLikelihood.leading`."""
        return [term for name, said in followed.items() for term in self.matchers[name].leading(said)]

    def agreement(self, posed: PosedBody) -> list[float]:
        """See `ImageLikelihood.agreement`."""
        prediction = self.predictor.predict(posed)
        shares = [matcher.agreement(prediction) for matcher in self.matchers.values()]
        return [share for share in shares if share is not None]

    def pictures(self, shown: ExplainedPose) -> list[CuePicture]:
        """Diagnostic images of the cues for an explanation of a pose."""
        return [picture for matcher in self.matchers.values() for picture in matcher.pictures(shown)]
