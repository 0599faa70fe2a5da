"""The contract of trackers and of their results (`TrackerProtocol`, `FrameResult`)."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.formats.checked_arrays import sizes_of
from estimator.data.observation import Observation
from estimator.trackers.base import Capabilities, capabilities_of
from estimator.trackers.frame_result import RESULT_FIELDS, STATUS_MEANINGS, FrameResult
from humanoid.kinematics.body import Body
from kinemode.testing.laws import differing, require

_WEIGHTS, _UNIT, _SYMMETRIC, _DEFINITE = 1e-9, 1e-9, 1e-9, 1e-9
Law = Callable[[bool, str, str], None]
"""Called with whether a law holds, its name, and what was found."""
_FINITE = ("q", "weight", "energy", "covariance", "velocity")


def check_result(
    who: str,
    body: Body,
    seen: Observation,
    result: FrameResult | None,
    before: FrameResult | None = None,
    *,
    keeps_limits: bool = True,
) -> None:
    """Check a tracker's result of a frame: shapes, a known status, weights that fall and sum to 1, configurations that
    are some and keep to the limits, symmetric positive semi-definite covariances, parents in the frame before, and
    that numbers are finite.

    Parameters
    ----------
    who: the tracker, for messages. body: the tracked one. seen: the frame. before: the result of the frame before,
    None for the first.

    Raises
    ------
    ContractError: the first promise that is not kept.
    """
    where = f"frame {seen.index}"

    def law(kept: bool, name: str, detail: str) -> None:
        require(kept, who, name, f"{where}: {detail}")

    law(result is not None, "every frame from the first has a result", "there is none")
    assert result is not None
    at = (result.index, result.time)
    law(at == (seen.index, seen.time), "a result is of its frame", f"it is of {at}, seen was {(seen.index, seen.time)}")
    law(result.status in STATUS_MEANINGS, "a status is a known one", f"{result.status!r}")
    _shapes(law, body, result)
    for name in _FINITE:
        array = getattr(result, name)
        wrong = 0 if array is None else np.count_nonzero(~np.isfinite(array))
        law(wrong == 0, "numbers are finite", f"{wrong} of {name} are not")
    for name, array in getattr(result, "extra", {}).items():
        wrong = np.count_nonzero(~np.isfinite(array)) if array.dtype.kind == "f" else 0
        law(wrong == 0, "numbers are finite", f"{wrong} of extra {name!r} are not")
    _weights(law, result)
    _poses(law, body, result, keeps_limits)
    for k, covariance in enumerate(result.covariance):
        largest = np.abs(covariance).max()
        apart = np.abs(covariance - covariance.T).max()
        law(apart <= _SYMMETRIC * largest, "covariances are symmetric", f"hypothesis {k} to {apart:.3g} only")
        least = np.linalg.eigvalsh(covariance)[0]
        detail = f"hypothesis {k} has the eigenvalue {least:.3g}, its largest entry is {largest:.3g}"
        law(least >= -_DEFINITE * largest, "covariances are positive semi-definite", detail)
    most = 0 if before is None else len(before.weight)
    outside = [int(p) for p in result.parent if not -1 <= p < most]
    law(not outside, "parents are in the frame before", f"{outside}, there are {most}")


def _shapes(law: Law, body: Body, result: FrameResult) -> None:
    count = len(result.weight)
    law(count >= 1, "there is a hypothesis", "there is none")
    sizes = {**sizes_of(body), "K": count}
    for name, field in RESULT_FIELDS.items():
        array, shape = getattr(result, name), tuple(sizes[size] for size in field.shape)
        if array is not None:
            law(np.shape(array) == shape, "arrays have their shapes", f"{name} is {np.shape(array)}, not {shape}")


def _weights(law: Law, result: FrameResult) -> None:
    total, least = float(result.weight.sum()), float(result.weight.min())
    law(abs(total - 1.0) <= _WEIGHTS, "weights sum to 1", f"they sum to {total!r}")
    law(least >= 0.0, "weights are not negative", f"one is {least:.3g}")
    rise = float(np.diff(result.weight).max(initial=0.0))
    law(rise <= 0.0, "the best hypothesis comes first", f"a weight is {rise:.3g} above the one before it")


def _poses(law: Law, body: Body, result: FrameResult, keeps_limits: bool) -> None:
    for k, q in enumerate(result.q):
        unit = pin.isNormalized(body.model, q, _UNIT)
        law(
            unit,
            "configurations are normalised",
            f"hypothesis {k} is not a configuration of the model: {np.round(q, 4).tolist()}",
        )
        if keeps_limits:
            beyond = np.maximum(body.lower - q, q - body.upper)
            worst = int(np.argmax(beyond))
            detail = f"hypothesis {k} is {beyond[worst]:.3g} beyond, at {body.q_names[worst]}"
            law(beyond[worst] <= 0.0, "configurations keep to the limits", detail)


class Told(NamedTuple):
    """A tracker's result of a frame and its state, None before the first pose."""

    result: FrameResult | None
    state: Any


def check_tracker(
    make: Callable[[], Any],
    observations: Sequence[Observation],
    *,
    seed: int = 0,
    keeps_limits: bool = True,
    continues: Sequence[int] | None = None,
) -> None:
    """Check the promises of a tracker on a short clip.

    Equal seeds give equal tracks; a frame leaves states and observations of before as they were; a state's arrays,
    stored and read again, are the same to the last bit, and a track resumed from them is the uninterrupted one;
    results are well formed and finite (`check_result`); a frame in which nothing is seen is
    "unobserved", and one of nonsense is flagged: neither raises; an empty frame is never enough to start; what it can
    do beside tracking is one record (`estimator.trackers.base.Capabilities`).

    Parameters
    ----------
    make: a new tracker, each time it is called.
    observations: at least three frames in order, from the first of which the tracker can start, with what it uses:
        keypoints, cues of the pictures, or both.
    seed: of the generators, one a frame.
    keeps_limits: whether all poses keep to the joint limits; else the first frame's do.
    continues: indices into observations after which a track is stored and taken up again; by default after the first,
        in the middle, and before the last.

    Raises
    ------
    ContractError: the first promise that is not kept.
    ValueError: the observations are too few, or none to start from.
    """
    check = _TrackerCheck(make, list(observations), seed, keeps_limits)
    check.begins()
    whole = check.track(check.frames)
    check.results_are_well_formed(whole)
    check.states_are_plain_arrays(whole)
    check.steps_leave_the_past_alone(whole)
    check.equal_seeds_give_equal_tracks(whole)
    check.states_survive_as_arrays(whole)
    last = len(check.frames) - 1
    check.resumed_is_uninterrupted(whole, sorted({0, last // 2, last - 1}) if continues is None else continues)
    check.nothing_seen_is_unobserved(whole)
    check.nonsense_is_flagged(whole)


class _TrackerCheck:
    def __init__(self, make: Callable[[], Any], observations: list[Observation], seed: int, keeps_limits: bool) -> None:
        self.make, self.frames, self.seed, self.keeps_limits = make, observations, seed, keeps_limits
        self.who = type(make()).__name__
        can = getattr(make(), "capabilities", Capabilities())
        self.require(isinstance(can, Capabilities), "its capabilities are one record", f"capabilities is {can!r}")
        if len(observations) < 3:
            raise ValueError(f"{len(observations)} frames are too few: three or more are needed")

    def require(self, kept: bool, law: str, detail: str) -> None:
        require(kept, self.who, law, detail)

    def track(self, frames: Sequence[Observation], state: Any = None, first: int = 0, of: Any = None) -> list[Told]:
        return track_frames(self.make() if of is None else of, frames, (self.seed,), state, first)

    def begins(self) -> None:
        """By its own decision, which does not change; and never from nothing."""
        tracker, first = self.make(), self.frames[0]
        answers = [tracker.can_start(first) for _ in range(2)]
        if not answers[0]:
            raise ValueError("the tracker cannot start from the first frame: give one from which it can")
        self.require(
            answers == [True, True], "can_start is true or false", f"it returns {answers[0]!r}, {answers[1]!r}"
        )
        blank = tracker.can_start(_nothing_seen(first))
        self.require(not blank, "an empty frame is no start", f"of a frame without anything it returns {blank!r}")
        needs = getattr(tracker, "needs_keypoints", None)
        self.require(isinstance(needs, bool), "declares whether it needs keypoints", f"needs_keypoints is {needs!r}")
        without = tracker.can_start(_no_keypoints(first))
        detail = f"needs_keypoints, but can_start returns {without!r} of a frame without"
        self.require(not (needs and without), "does not start without the keypoints it needs", detail)

    def results_are_well_formed(self, whole: Sequence[Told]) -> None:
        body, before = self.make().body, None
        for seen, steps in zip(self.frames, whole, strict=True):
            limits = self.keeps_limits or before is None
            check_result(self.who, body, seen, steps.result, before, keeps_limits=limits)
            detail = f"after the frame of {seen.time} s the state is of {steps.state.time} s"
            self.require(steps.state.time == seen.time, "a state has its time", detail)
            before = steps.result

    def equal_seeds_give_equal_tracks(self, whole: Sequence[Told]) -> None:
        tracker = self.make()
        again = self.track(self.frames, of=tracker)
        self.same(whole, again, self.frames, "equal seeds give equal tracks")
        begin = self.frames if capabilities_of(tracker).frames_ahead else self.frames[:2]
        twice = self.track(begin, of=tracker)
        self.same(whole, twice, self.frames, "a tracker that has tracked tracks the same again")

    def states_are_plain_arrays(self, whole: Sequence[Told]) -> None:
        for seen, steps in zip(self.frames, whole, strict=True):
            arrays = steps.state.arrays()
            odd = [f"{n} is a {type(a).__name__}" for n, a in arrays.items() if not isinstance(a, np.ndarray)]
            odd += [f"{n} holds objects" for n, a in arrays.items() if np.asarray(a).dtype.hasobject]
            self.require(not odd, "a state's arrays are plain", f"frame {seen.index}: {', '.join(odd)}")

    def states_survive_as_arrays(self, whole: Sequence[Told]) -> None:
        law = "a state is its arrays, to the last bit"
        for seen, steps in zip(self.frames, whole, strict=True):
            arrays = steps.state.arrays()
            apart = differing(arrays, self.make().state_from(_stored(arrays)).arrays())
            self.require(not apart, law, f"frame {seen.index}, stored and read again: {apart}")

    def resumed_is_uninterrupted(self, whole: Sequence[Told], continues: Sequence[int]) -> None:
        for k in continues:
            tracker = self.make()
            state = tracker.state_from(_stored(whole[k].state.arrays()))
            rest = self.track(self.frames, state, k + 1, tracker)
            law = "a resumed track is the uninterrupted one"
            self.same(whole[k + 1 :], rest, self.frames[k + 1 :], law, f" after frame {self.frames[k].index}")

    def steps_leave_the_past_alone(self, whole: Sequence[Told]) -> None:
        """Neither the state that a step is given nor what was observed changes."""
        seen, state = self.frames[1], whole[0].state
        before, shown = _copied(state.arrays()), _copied(_arrays_of(seen))
        self.track(self.frames[:2], state, 1)
        apart = differing(before, state.arrays())
        self.require(not apart, "a step leaves the state before as it was", apart)
        apart = differing(shown, _arrays_of(seen))
        self.require(not apart, "a step leaves the observation as it was", apart)

    def nothing_seen_is_unobserved(self, whole: Sequence[Told]) -> None:
        law = "a frame in which nothing is seen is flagged, not raised"
        frames = [self.frames[0], _nothing_seen(self.frames[1]), self.frames[2]]
        steps = self.tried(frames, whole, law)
        result = steps[1].result
        status = None if result is None else result.status
        self.require(status == "unobserved", law, f"its status is {status!r}")
        check_result(self.who, self.make().body, frames[1], result, steps[0].result, keeps_limits=False)

    def nonsense_is_flagged(self, whole: Sequence[Told]) -> None:
        """Keypoints all over the picture; of a clip without any there is nothing to scatter."""
        seen = self.frames[1]
        if not seen.count:
            return
        width, height = seen.cameras[0].image_size
        scattered = np.random.default_rng(0).uniform(0.0, (width, height), size=seen.pixels.shape)
        frames = [self.frames[0], replace(seen, pixels=scattered), self.frames[2]]
        steps = self.tried(frames, whole, "a frame of nonsense is flagged, not raised")
        for here, before, frame in zip(steps[1:], steps, frames[1:], strict=False):
            limits = self.keeps_limits
            check_result(self.who, self.make().body, frame, here.result, before.result, keeps_limits=limits)

    def tried(self, frames: Sequence[Observation], whole: Sequence[Told], law: str) -> list[Told]:
        try:
            return [whole[0], *self.track(frames, whole[0].state, 1)]
        except Exception as error:
            self.require(False, law, f"{type(error).__name__}: {error}")
            raise

    def same(
        self, ours: Sequence[Told], theirs: Sequence[Told], frames: Sequence[Observation], law: str, where: str = ""
    ) -> None:
        for a, b, seen in zip(ours, theirs, frames, strict=False):
            apart = differing(_told(a), _told(b))
            self.require(not apart, law, f"frame {seen.index}{where}: {apart}")


def track_frames(
    tracker: Any, frames: Sequence[Observation], seed: tuple[int, ...], state: Any = None, first: int = 0
) -> list[Told]:
    """Every frame from `first` on, with a generator of its own as in `estimator.tracking.runner.run`."""
    ahead, behind = capabilities_of(tracker).frames_ahead, capabilities_of(tracker).frames_behind
    steps = []
    for k in range(first, len(frames)):
        seen, result = frames[k], None
        rng = np.random.default_rng((*seed, seen.index))
        following = (tuple(frames[k + 1 : k + 1 + ahead]),) if ahead or behind else ()
        if state is not None:
            before = (tuple(frames[max(0, k - behind) : k]),) if behind else ()
            state, result = tracker.step(rng, state, seen, *following, *before)
        elif tracker.can_start(seen):
            state, result = tracker.init(rng, seen, *following)
        steps.append(Told(result, state))
    return steps


def _told(steps: Told) -> dict[str, np.ndarray]:
    """All of a frame as arrays."""
    result = steps.result
    if result is None:
        return {}
    named = {name: value for name, value in vars(result).items() if name not in ("origins", "extra")}
    named |= getattr(result, "extra", {})
    named |= {} if result.origins is None else result.origins.arrays()
    named |= {f"state {name}": value for name, value in steps.state.arrays().items()}
    return {name: np.asarray(value) for name, value in named.items() if value is not None}


def _nothing_seen(seen: Observation) -> Observation:
    return replace(_no_keypoints(seen), cues=())


def _no_keypoints(seen: Observation) -> Observation:
    return replace(seen, pixels=np.full_like(seen.pixels, np.nan), confidence=np.zeros_like(seen.confidence))


def _arrays_of(seen: Observation) -> dict[str, np.ndarray]:
    return {"pixels": seen.pixels, "confidence": seen.confidence}


def _copied(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: np.array(array) for name, array in arrays.items()}


def _stored(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """As read back from a file without objects."""
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    file.seek(0)
    with np.load(file, allow_pickle=False) as stored:
        return dict(stored)
