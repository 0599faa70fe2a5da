"""The contract of cues (see `estimator.vision.cues.base.Cue`)."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import image_extent
from estimator.energy.term import Term
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.base import CameraView, Cue, ExplainedPose, Matcher, PastPose
from estimator.vision.cues.image_likelihood import ImageModel
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from kinemode.testing.laws import differing, require
from kinemode.testing.terms import check_term

_AWAY = 0.05  # rad or m: how far another pose is


def check_cue(
    cue: Cue,
    body: Body,
    pictures: Callable[[], CameraPictures],
    q: np.ndarray,
    *,
    settings: Any = None,
    curvature: float | None = None,
) -> None:
    """Check the promises of a cue on the clip of a body whose poses are known.

    It names and describes itself; its settings are plain and cannot change; what it reads of an instant does not depend
    on what was read before, can be sent to another process, and stays as it is when it is matched; past the clip's end
    is an InputError; what its matcher returns depends on the pose alone; features lie on existing points, with
    weights not below zero; its terms keep the contract of terms (`kinemode.testing.check_term`); a share of
    agreement is one; its pictures have the size of the cues. A cue that learns has learned of the instant before: what
    it learned is an array that depends on the frame alone, and does not change the reading that it is added to.

    Parameters
    ----------
    cue: see `estimator.vision.cues.base.Cue`.
    body: in the pictures. pictures: opens the clip of one camera, again at each call.
    q (T, nq): poses of the body at the clip's instants, two or more; features are matched a little beside them.
    settings: the cue's own, unless its defaults. curvature: see `check_term`.

    Raises
    ------
    ContractError: the first promise that is not kept.
    ValueError: the cue has no features in the clip.
    """
    check = _CueCheck(cue, body, pictures, np.asarray(q), settings)
    check.describes_itself()
    check.reads_the_same_in_any_order()
    check.ends_with_the_clip()
    check.matches(curvature)


class _CueCheck:
    def __init__(
        self, cue: Cue, body: Body, pictures: Callable[[], CameraPictures], q: np.ndarray, settings: Any
    ) -> None:
        self.cue, self.body, self.open, self.q = cue, body, pictures, q
        self.settings = cue.settings if settings is None else settings
        self.who = str(getattr(cue, "name", "")) or type(cue).__name__
        if len(q) < 2:
            raise ValueError(f"poses of {len(q)} instants are too few: two or more are needed")

    def require(self, kept: bool, law: str, count_matched: str) -> None:
        require(kept, self.who, law, count_matched)

    def describes_itself(self) -> None:
        name, summary, settings = (getattr(self.cue, n, None) for n in ("name", "summary", "settings"))
        self.require(isinstance(name, str) and name.isidentifier(), "has a plain name", f"its name is {name!r}")
        self.require(isinstance(summary, str) and bool(summary), "has a summary", f"its summary is {summary!r}")
        frozen = is_dataclass(settings) and type(settings).__dataclass_params__.frozen  # type: ignore[union-attr]
        self.require(frozen, "its settings are a frozen dataclass", f"they are a {type(settings).__name__}")
        assert is_dataclass(settings)
        odd = [f.name for f in fields(settings) if not isinstance(getattr(settings, f.name), int | float | str)]
        self.require(not odd, "its settings are numbers, texts and truth values", f"not {', '.join(odd)}")

    def read(self, instants: Sequence[int]) -> dict[int, Any]:
        pictures = self.open()
        try:
            known = self.cue.prepare(pictures, self.settings)
            return {i: self.cue.read(pictures, i, self.settings, known) for i in instants}
        finally:
            pictures.close()

    def reads_the_same_in_any_order(self) -> None:
        count = len(self.q)
        once, back = self.read(range(count)), self.read(range(count - 1, -1, -1))
        for i in range(count):
            apart = differing(parts(once[i]), parts(back[i]))
            self.require(not apart, "a reading does not depend on earlier readings", f"instant {i}: {apart}")
            sent = self.pickled(once[i], "a reading can be sent to another process")
            apart = differing(parts(once[i]), parts(sent))
            self.require(not apart, "a reading can be sent to another process", f"instant {i}: {apart}")

    def pickled(self, thing: Any, law: str) -> Any:
        try:
            return pickle.loads(pickle.dumps(thing))
        except Exception as error:
            self.require(False, law, f"{type(error).__name__}: {error}")
            raise

    def ends_with_the_clip(self) -> None:
        beyond = 10**6
        try:
            self.read([beyond])
        except InputError:
            return
        except Exception as error:
            self.require(False, "past the clip's end is an InputError", f"{type(error).__name__}: {error}")
        self.require(False, "past the clip's end is an InputError", f"instant {beyond} was read")

    def matches(self, curvature: float | None) -> None:
        """At the last instant of which something was read."""
        instant = max((i for i, thing in self.read(range(len(self.q))).items() if thing is not None), default=None)
        if instant is None:
            raise ValueError(f"{self.who} reads nothing from this clip")
        view = self.view(instant)
        if self.cue.learns:
            view = self.after_learning(view, max(0, instant - 1))
        matching = _Matching(self, view, self.body, self.q[instant], self.q[max(0, instant - 1)])
        before = copied(parts(view.cues[self.cue.name]))
        matching.said_of(matching.q)
        apart = differing(before, parts(view.cues[self.cue.name]))
        self.require(not apart, "matching does not change a reading", apart)
        matching.depends_on_the_pose_alone()
        count_matched = matching.features_are_some(curvature) + matching.terms_keep_their_contract(curvature)
        count_matched += matching.past_is_followed(curvature)
        if not count_matched:
            raise ValueError(f"{self.who} has no features on the body in this clip")
        matching.agreement_is_a_share()
        matching.pictures_fit()

    def view(self, instant: int) -> CameraView:
        pictures = self.open()
        try:
            known = self.cue.prepare(pictures, self.settings)
            read = self.cue.read(pictures, instant, self.settings, known)
            cues = ImageCues(pictures.camera, {self.cue.name: read}, pictures.picture(instant))
        finally:
            pictures.close()
        model = ImageModel(self.body)
        points = self.body.landmarks(self.body.at(self.q[instant]))
        extent = image_extent(cues.camera.project(points), np.ones(len(points)))
        return CameraView(
            body=self.body, surface=model.surface, predictor=model.predictor(cues), cues=cues, extent=extent,
            weight=1.0, shared=model.settings, settings=self.settings,
        )  # fmt: skip

    def after_learning(self, view: CameraView, instant: int) -> CameraView:
        """The same view of a cue that has learned of an earlier instant."""
        earlier = self.view(instant)
        prediction = earlier.predictor.predict(self.body.at(self.q[instant]))
        learned = [self.cue.match(earlier).learn(prediction, 0.0, 1.0) for _ in range(2)]
        law = "what is learned is an array"
        self.require(isinstance(learned[0], np.ndarray), law, f"it is {learned[0]!r}")
        assert learned[0] is not None
        apart = differing(parts(learned[0]), parts(learned[1]))
        self.require(not apart, "what is learned depends on the frame alone", apart)
        reading = view.cues[self.cue.name]
        before = copied(parts(reading))
        taught = self.cue.with_learned(reading, learned[0])
        apart = differing(before, parts(reading))
        self.require(not apart, "learning does not change a reading", apart)
        return replace(view, cues=view.cues.changed(**{self.cue.name: taught}))


class _Matching:
    """A cue's matcher at one instant, called with a pose near the true one; `parent`: that of the instant before."""

    def __init__(self, check: _CueCheck, view: CameraView, body: Body, q: np.ndarray, parent: np.ndarray) -> None:
        self.check, self.view, self.body = check, view, body
        self.matcher: Matcher = check.cue.match(view)
        rng = np.random.default_rng(0)
        self.q, self.other = (body.integrate(q, _AWAY * rng.uniform(-1.0, 1.0, body.nv)) for _ in range(2))
        self.posed = body.at(self.q)
        self.past = PastPose(body.at(parent), self.posed)

    def require(self, kept: bool, law: str, count_matched: str) -> None:
        self.check.require(kept, law, count_matched)

    def said_of(self, q: np.ndarray) -> dict[str, np.ndarray]:
        """All that a matcher returns for a pose."""
        posed = self.body.at(q)
        prediction = self.view.predictor.predict(posed)
        parts_told = parts([tuple(match) for match in self.matcher.contours(prediction)], "contours")
        for k, term in enumerate([*self.matcher.terms(posed, prediction), *self.since([self.past])]):
            parts_told[f"term {k}, {term.name}"] = np.array(term.value(posed))
        return parts_told | {"agreement": np.array(self.matcher.agreement(prediction), dtype=float)}

    def since(self, pasts: Sequence[PastPose]) -> list[Term]:
        return [term for followed in self.matcher.follow(pasts) for term in self.matcher.since(followed)]

    def depends_on_the_pose_alone(self) -> None:
        first = self.said_of(self.q)
        self.said_of(self.other)
        apart = differing(first, self.said_of(self.q))
        self.require(not apart, "the result depends on the pose alone", f"after another pose:  {apart}")

    def features_are_some(self, curvature: float | None) -> int:
        prediction = self.view.predictor.predict(self.posed)
        count, count_matched = len(prediction.contours.state), 0
        for match in self.matcher.contours(prediction):
            self.labelled(match.label)
            f = match.features
            outside = np.count_nonzero((f.point < 0) | (f.point >= count))
            self.require(outside == 0, "features lie on existing points", f"{outside} do not, of {count} points")
            wrong = sum(np.count_nonzero(~np.isfinite(a)) for a in (f.target, f.precision, f.weight, match.unassigned))
            self.require(wrong == 0, "features are finite", f"{wrong} numbers are not")
            least = float(f.weight.min(initial=0.0))
            self.require(least >= 0.0, "no weight is below zero", f"one is {least:.3g}")
            if len(f.point):
                count_matched += 1
                check_term(self.view.on_contours(prediction, f), self.body, self.q, curvature=curvature)
        return count_matched

    def labelled(self, label: Any) -> None:
        self.require(isinstance(label, str) and bool(label), "parts of the energy have labels", f"one is {label!r}")

    def terms_keep_their_contract(self, curvature: float | None) -> int:
        terms = self.matcher.terms(self.posed, self.view.predictor.predict(self.posed))
        for term in terms:
            self.labelled(term.name)
            check_term(term, self.body, self.q, curvature=curvature)
        return len(terms)

    def past_is_followed(self, curvature: float | None) -> int:
        """As another process would: what `follow` returns is sent, and makes the same terms there."""
        pasts = [self.past, PastPose(self.past.parent)]
        followed = list(self.matcher.follow(pasts))
        law = "each past is followed"
        self.require(len(followed) == len(pasts), law, f"{len(followed)} answers to {len(pasts)} pasts")
        if not self.check.cue.follows:
            some = sum(answer is not None for answer in followed)
            self.require(some == 0, "what follows is declared", f"{some} of {len(pasts)} pasts were followed")
            return 0
        law = "the followed features can be sent to another process"
        terms = self.matcher.since(followed[0])
        sent = self.matcher.since(self.check.pickled(followed[0], law))
        values = [[term.value(self.posed) for term in some] for some in (terms, sent)]
        self.require(values[0] == values[1], law, f"energies {values[0]} become {values[1]}")
        for term in terms:
            self.labelled(term.name)
            check_term(term, self.body, self.q, curvature=curvature)
        return len(terms)

    def agreement_is_a_share(self) -> None:
        share = self.matcher.agreement(self.view.predictor.predict(self.posed))
        self.require(share is None or 0.0 <= share <= 1.0, "agreement is a share", f"it is {share!r}")

    def pictures_fit(self) -> None:
        assigned = self.view.predictor.predict(self.posed)
        shown = ExplainedPose(self.posed, assigned, assigned, self.past if self.check.cue.follows else None)
        width, height = self.view.camera.image_size
        for picture in self.matcher.pictures(shown):
            self.require(bool(picture.name and picture.title), "pictures have names and titles", f"{picture[:2]!r}")
            fits = picture.base.shape[:2] == (height, width) and picture.base.dtype == np.uint8
            count_matched = (
                f"{picture.name} is {picture.base.shape} {picture.base.dtype}, the cues are {width} x {height}"
            )
            self.require(fits, "pictures have the size of the cues", count_matched)


def parts(thing: Any, name: str = "it") -> dict[str, np.ndarray]:
    """All arrays and numbers in dataclasses, tuples, lists and mappings, by where they are."""
    if is_dataclass(thing) and not isinstance(thing, type):
        return parts({f.name: getattr(thing, f.name) for f in fields(thing)}, name)
    if isinstance(thing, Mapping):
        return {k: v for key, value in thing.items() for k, v in parts(value, f"{name}.{key}").items()}
    if isinstance(thing, list | tuple):
        return {k: v for i, value in enumerate(thing) for k, v in parts(value, f"{name}[{i}]").items()}
    return {name: np.asarray(thing)} if thing is not None else {f"{name} (nothing)": np.zeros(0)}


def copied(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same arrays, of their own."""
    return {name: np.array(array) for name, array in arrays.items()}
