"""Every cue keeps the contract, and a cue that breaks one of its laws is found."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest

from estimator.data.formats.cameras import load_cameras
from estimator.numerics.robust import LORENTZIAN
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.assigned import AssignedPoints, assignments, isotropic
from estimator.vision.cues.base import CameraView, ContourMatch, Cue, Matcher
from estimator.vision.cues.cue_picture import CuePicture
from estimator.vision.cues.settings import CUES
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.shot import RenderedClip
from kinemode.testing import ContractError, check_cue


@dataclass(frozen=True)
class Seen:
    """A rendered clip: the body, how its pictures are opened, and its true poses."""

    body: Body
    pictures: Callable[[], CameraPictures]
    q: np.ndarray


@pytest.fixture(scope="module")
def seen(clip: RenderedClip) -> Seen:
    """The first three frames."""
    ((name, video),) = clip.videos.items()
    camera = load_cameras(clip.cameras)[name]
    body = Body(load_subject(clip.subject))
    q = np.load(clip.truth)["q"][:3]
    opened = partial(CameraPictures, video, camera, 160, masks=clip.masks[name], depth=clip.depths[name])
    return Seen(body, opened, q)


@pytest.mark.parametrize("name", list(CUES))
def test_cues_keep_the_contract(name: str, seen: Seen) -> None:
    check_cue(CUES[name], seen.body, seen.pictures, seen.q)


@dataclass(frozen=True)
class Settings:
    """weight: of the landmark."""

    weight: float = 1.0


class Bright(Cue):
    """A right cue: a landmark is pulled to the middle of the bright area; tests break single methods."""

    name, summary, settings = "bright", "where it is bright", Settings()

    def read(self, pictures: CameraPictures, instant: int, settings: Settings, prepared: Any) -> Any:
        grey = pictures.picture(instant).mean(axis=2)
        return np.argwhere(grey > np.quantile(grey, 0.9)).mean(axis=0)[::-1].copy()

    def match(self, view: CameraView) -> Matcher:
        return BrightMatcher(view)


class BrightMatcher(Matcher):
    weight, precision = 1.0, 0.01

    def terms(self, posed: Any, prediction: Any) -> list[Any]:
        body = self.view.body
        target = self.view.cues[self.view_name][None]
        group = assignments(
            np.zeros(1, int), target, isotropic(np.full(1, self.precision)), np.full(1, self.weight), LORENTZIAN, 4.0
        )
        joint, local = body.landmark_joint[:1], body.landmark_local[:1]
        return [AssignedPoints(body, self.view.camera, joint, local, [group], name="bright")]

    @property
    def view_name(self) -> str:
        return next(iter(self.view.cues))

    def pictures(self, shown: Any) -> list[CuePicture]:
        return [CuePicture("bright", "bright", self.view.cues.picture, [], [])]


def cue(matcher: dict[str, Any] | None = None, **changes: Any) -> Cue:
    """`Bright` with other attributes, and a matcher with others."""
    spoilt = type("Spoilt", (BrightMatcher,), matcher or {})
    return type("Bright", (Bright,), {"match": lambda self, view: spoilt(view), **changes})()


def restless() -> Callable[..., np.ndarray]:
    looks = iter(range(10**6))
    return lambda self, pictures, instant, *_: Bright.read(self, pictures, instant, *_) + next(looks)


def chance() -> Callable[..., np.ndarray]:
    draws = iter(range(10**6))
    return lambda *_: np.full(2, float(next(draws)))


def on_contours(point: int, weight: float, target: float = 5.0, label: str = "bright") -> dict[str, Any]:
    def contours(self: Matcher, prediction: Any) -> list[ContourMatch]:
        target_px, W = np.full((1, 2), target), isotropic(np.full(1, 0.01))
        at = len(prediction.contours.state) + point if point >= 0 else 0
        return [ContourMatch(label, assignments(np.array([at]), target_px, W, np.full(1, weight), LORENTZIAN, 4.0))]

    return {"contours": contours}


def remembering(self: BrightMatcher, posed: Any, prediction: Any) -> list[Any]:
    self.weight = self.weight + 1e-3
    return BrightMatcher.terms(self, posed, prediction)


def writing(self: BrightMatcher, posed: Any, prediction: Any) -> list[Any]:
    given = BrightMatcher.terms(self, posed, prediction)
    self.view.cues[self.view_name][0] = 7.0
    return given


class WrongSlope:
    """A term whose gradient is not its value's."""

    name = "wrong"

    def value(self, posed: Any) -> float:
        return float(posed.q[7])

    def accumulate(self, posed: Any, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        gradient[6] += 0.5
        return self.value(posed)


def numbers(self: Matcher) -> Iterator[int]:
    yield from range(3)


UNSENDABLE = lambda: 3  # noqa: E731
BROKEN: dict[str, tuple[Cue, str]] = {
    "odd name": (cue(name="two words"), "has a plain name"),
    "no summary": (cue(summary=""), "has a summary"),
    "loose settings": (cue(settings={"weight": 1.0}), "its settings are a frozen dataclass"),
    "restless": (cue(read=restless()), "a reading does not depend on earlier readings"),
    "cannot be sent": (cue(read=lambda *_: UNSENDABLE), "a reading can be sent to another process"),
    "endless": (cue(read=lambda *_: np.zeros(2)), "past the clip's end is an InputError"),
    "remembers": (cue({"terms": remembering}), "the result depends on the pose alone"),
    "nowhere": (cue(on_contours(0, 1.0)), "features lie on existing points"),
    "below zero": (cue(on_contours(-1, -1.0)), "no weight is below zero"),
    "not a number": (cue(on_contours(-1, 1.0, np.nan)), "features are finite"),
    "unlabelled": (cue(on_contours(-1, 1.0, label="")), "parts of the energy have labels"),
    "wrong slope": (
        cue({"terms": lambda *_: [WrongSlope()]}), "the gradient is the derivative",
    ),
    "too few answers": (cue({"follow": lambda self, pasts: [None]}), "each past is followed"),
    "follows silently": (cue({"follow": lambda self, pasts: [0 for _ in pasts]}), "what follows is declared"),
    "cannot send": (
        cue({"follow": lambda self, pasts: [numbers(self) for _ in pasts]}, follows=True),
        "the followed features can be sent to another process",
    ),
    "agrees too much": (cue({"agreement": lambda *_: 1.2}), "agreement is a share"),
    "untitled": (
        cue({"pictures": lambda self, _: [CuePicture("a", "", self.view.cues.picture, [], [])]}),
        "pictures have names and titles",
    ),
    "small picture": (
        cue({"pictures": lambda self, _: [CuePicture("a", "b", self.view.cues.picture[1:], [], [])]}),
        "pictures have the size of the cues",
    ),
    "writes": (cue({"terms": writing}), "matching does not change a reading"),
    "learns nothing": (cue(learns=True), "what is learned is an array"),
    "learns by chance": (cue({"learn": chance()}, learns=True), "what is learned depends on the frame alone"),
    "learns in place": (
        cue({"learn": lambda *_: np.ones(2)}, learns=True, with_learned=lambda _, r, known: np.add(r, known, out=r)),
        "learning does not change a reading",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_law_is_found_and_reported(kind: str, seen: Seen) -> None:
    broken, law = BROKEN[kind]
    with pytest.raises(ContractError) as error:
        check_cue(broken, seen.body, seen.pictures, seen.q)
    assert error.value.law == law


def test_a_right_cue_passes_and_one_without_effect_is_refused(seen: Seen) -> None:
    check_cue(Bright(), seen.body, seen.pictures, seen.q)
    with pytest.raises(ValueError, match="has no features on the body"):
        check_cue(cue({"terms": lambda *_: []}), seen.body, seen.pictures, seen.q)
    with pytest.raises(ValueError, match="too few"):
        check_cue(Bright(), seen.body, seen.pictures, seen.q[:1])
