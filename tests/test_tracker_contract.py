"""Every tracker keeps the contract, and a tracker that breaks one of its laws is found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.data.observation import Observation
from estimator.synthesis.motion import authored_motion
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import TRACKERS, make_tracker, settings_for
from kinemode.testing import ContractError, check_tracker
from tests.tiers import later
from tests.tiny_clip import FEW_STARTS

FEW: dict[str, dict[str, object]] = {
    "css": {"samples": 4, "budget": {"searches": 12}},
    "single_mode": {},
    "markers": {"samples": 4},
    "condensation": {"particles": 60},
    "annealed": {"layers": 4, "particles": 40},
    "multiple_hypothesis": {"starts": 4},
    "elmo": {"rounds": 2},
    "loose_limbed": {
        "propagation": {
            "kernels": 6,
            "samples": 4,
            "iterations": 1,
            "product": {"candidates": 10, "per_draw": 1.0, "rounds": 1},
        },
        "start_kernels": 6,
        "start_samples": 4,
        "start_iterations": 1,
        "part_detectors": {"keypoints": {"depths": 3}},
    },
}
FEW["css_dual"] = FEW["css"]
FEW["dual_chain"] = {
    "features": "keypoints",
    "past": True,
    "pose": {"particles": 20, "kernels": 8, "tempering": {"moves": 1}},
}
BY_DEPTH = ("elmo", "psh")
"""These start by depth, see `tests.test_elmo`."""


def arm_clip(frames: int = 3) -> list[Observation]:
    """The arm of eight joints, seen by two cameras with a little noise."""
    body, rng = body_of("arm8"), np.random.default_rng(3)
    start, end = (random_pose(body, rng, share=0.4) for _ in range(2))
    poses = [body.clamp(start + share * (end - start)) for share in np.linspace(0.0, 0.3, frames)]
    cameras = (camera_at(10.0, distance=3.0), camera_at(80.0, distance=3.0))
    return [observe(body, q, cameras, noise=1.0, rng=rng, index=i, time=i / 30.0) for i, q in enumerate(poses)]


def person_clip() -> list[Observation]:
    """A person who reaches and turns, seen by one noisy camera."""
    body, rng = body_of("human34"), np.random.default_rng(81)
    camera = camera_at(30.0, distance=3.5, focal=660.0, height=1.2, aim=(0.0, 0.0, 0.95))
    poses = authored_motion(body, 0.4 + np.arange(3) / 30.0)
    return [observe(body, q, [camera], noise=4.0, rng=rng, index=i, time=i / 30.0) for i, q in enumerate(poses)]


CLIPS = {"arm8": arm_clip, "human34": person_clip}


OF_LIMBS = ("dual-chain", "dual-chain-paper", "likelihood-sampling")
"""These use one camera and limbs of two segments."""
LONG = (("loose-limbed", "human34"), ("likelihood-sampling", "human34"))
"""Covered by the same trackers of another body, and with the chain of points."""


VARIANTS = ("css-paper", "spherical", "gaussian-single-mode", "robust-single-mode", "gaussian-multiple-hypothesis")
"""Trackers of which another setting makes one that is tested with both bodies."""


@pytest.mark.parametrize(
    ("name", "subject"),
    later(
        [(n, s) for n in TRACKERS if n not in BY_DEPTH for s in CLIPS if n not in OF_LIMBS or s == "human34"], *LONG,
        thorough=[(name, "human34") for name in VARIANTS],
    ),
)  # fmt: skip
def test_trackers_keep_the_contract(name: str, subject: str) -> None:
    spec = TRACKERS[name]
    settings = settings_for(name, changes={spec.group: FEW[spec.group], "search": FEW_STARTS})
    check_tracker(
        lambda: make_tracker(name, body_of(subject), settings),
        CLIPS[subject](),
        seed=1,
        keeps_limits=spec.keeps_limits(settings.own),
    )


@dataclass
class Last:
    """The state of `Still`: a pose and a time."""

    q: np.ndarray
    time: float

    def arrays(self) -> dict[str, np.ndarray]:
        return {"q": self.q, "time": np.array(self.time)}


class Still:
    """A right tracker: the pose of the middle of all limits, trembling a little; tests break single methods."""

    needs_keypoints = True
    noise = 1e-3

    def __init__(self) -> None:
        self.body = body_of("arm8")

    def can_start(self, observation: Observation) -> bool:
        return observation.count > 3

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[Last, FrameResult]:
        q = 0.5 * (self.body.lower + self.body.upper)
        return Last(q, observation.time), self.result_of(q, observation, "tracked", -1)

    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        seen = observation.count > 0
        q = state.q + self.noise * rng.normal(size=self.body.nq) if seen else state.q
        return Last(q, observation.time), self.result_of(q, observation, "tracked" if seen else "unobserved", 0)

    def result_of(self, q: np.ndarray, observation: Observation, status: str, parent: int) -> FrameResult:
        nv, zero = self.body.nv, np.zeros(1)
        return FrameResult(
            observation.index, observation.time, status, q[None].copy(), np.ones(1), zero, 0.1 * np.eye(nv)[None],
            np.full(1, parent), zero, zero, ("as_detected",),
        )  # fmt: skip

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> Last:
        return Last(arrays["q"], float(arrays["time"]))


def spoilt(**changes: Any) -> type[Still]:
    """`Still` with other attributes."""
    return type("Still", (Still,), changes)


def telling(**arrays: Callable[[np.ndarray], Any]) -> type[Still]:
    """`Still` whose results have some arrays changed after the first frame."""

    def result_of(self: Still, q: np.ndarray, observation: Observation, status: str, parent: int) -> FrameResult:
        right = Still.result_of(self, q, observation, status, parent)
        spoil = {name: change(getattr(right, name)) for name, change in arrays.items()}
        return right if parent < 0 else replace(right, **spoil)

    return spoilt(result_of=result_of)


class Unseeded(Still):
    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        return super().step(np.random.default_rng(), state, observation)


class KeepsCount(Still):
    """Its own counter moves the pose: it uses more than its state."""

    def __init__(self) -> None:
        super().__init__()
        self.steps = 0

    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        self.steps += 1
        return super().step(rng, Last(state.q + 1e-12 * self.steps, state.time), observation)


class HidesState(Still):
    """Uses more than it stores."""

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[Last, FrameResult]:
        state, result = super().init(rng, observation)
        state.drift = 1e-9  # type: ignore[attr-defined]
        return state, result

    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        after, result = super().step(rng, Last(state.q + getattr(state, "drift", 0.0), state.time), observation)
        after.drift = getattr(state, "drift", 0.0)  # type: ignore[attr-defined]
        return after, result


class Rounds(Still):
    def state_from(self, arrays: Mapping[str, np.ndarray]) -> Last:
        return Last(arrays["q"].astype(np.float32).astype(np.float64), float(arrays["time"]))


class Pickles(Still):
    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[Last, FrameResult]:
        state, result = super().init(rng, observation)
        state.arrays = lambda: {"q": np.array([state], dtype=object)}  # type: ignore[method-assign]
        return state, result


class WritesBack(Still):
    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        after = super().step(rng, state, observation)
        state.q += 1e-9
        return after


class WritesOnKeypoints(Still):
    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        after = super().step(rng, state, observation)
        observation.pixels[0, 0] += 1.0
        return after


class Raises(Still):
    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        if not observation.count:
            raise ZeroDivisionError("no keypoints")
        return super().step(rng, state, observation)


class Chokes(Still):
    """On keypoints far away."""

    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        if np.nanmax(np.append(observation.pixels, 0.0)) > 600.0:
            raise np.linalg.LinAlgError("singular")
        return super().step(rng, state, observation)


class SaysTracked(Still):
    def result_of(self, q: np.ndarray, observation: Observation, status: str, parent: int) -> FrameResult:
        return super().result_of(q, observation, "tracked", parent)


class ForgetsTime(Still):
    def step(self, rng: np.random.Generator, state: Last, observation: Observation) -> tuple[Last, FrameResult]:
        after, result = super().step(rng, state, observation)
        return Last(after.q, state.time), result


def _lopsided(covariance: np.ndarray) -> np.ndarray:
    return covariance + np.eye(covariance.shape[-1], k=1)[None] * 1e-6


BROKEN: dict[str, tuple[type[Still], str]] = {
    "starts from nothing": (spoilt(can_start=lambda *_: True), "an empty frame is no start"),
    "unsure": (spoilt(can_start=lambda *_: 7), "can_start is true or false"),
    "needs unsaid": (spoilt(needs_keypoints=None), "declares whether it needs keypoints"),
    "capable by a table": (spoilt(capabilities={"frames_ahead": 1}), "its capabilities are one record"),
    "unseeded": (Unseeded, "equal seeds give equal tracks"),
    "keeps count": (KeepsCount, "a tracker that has tracked tracks the same again"),
    "hides state": (HidesState, "a resumed track is the uninterrupted one"),
    "rounds": (Rounds, "a state is its arrays, to the last bit"),
    "pickles": (Pickles, "a state's arrays are plain"),
    "writes back": (WritesBack, "a step leaves the state before as it was"),
    "writes on keypoints": (WritesOnKeypoints, "a step leaves the observation as it was"),
    "raises": (Raises, "a frame in which nothing is seen is flagged, not raised"),
    "says tracked": (SaysTracked, "a frame in which nothing is seen is flagged, not raised"),
    "chokes": (Chokes, "a frame of nonsense is flagged, not raised"),
    "forgets time": (ForgetsTime, "a state has its time"),
    "wrong frame": (telling(index=lambda i: i + 1), "a result is of its frame"),
    "odd status": (telling(status=lambda _: "lost"), "a status is a known one"),
    "no hypothesis": (telling(weight=lambda w: w[:0]), "there is a hypothesis"),
    "odd shape": (telling(energy=lambda e: np.zeros(2)), "arrays have their shapes"),
    "not a number": (telling(energy=lambda e: e * np.nan), "numbers are finite"),
    "too heavy": (telling(weight=lambda w: w * 1.001), "weights sum to 1"),
    "beyond limits": (telling(q=lambda q: q + 10.0), "configurations keep to the limits"),
    "lopsided": (telling(covariance=_lopsided), "covariances are symmetric"),
    "indefinite": (telling(covariance=lambda c: -c), "covariances are positive semi-definite"),
    "no such parent": (telling(parent=lambda p: p + 1), "parents are in the frame before"),
}  # fmt: skip


def test_a_right_tracker_passes() -> None:
    check_tracker(Still, arm_clip())


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_law_is_found_and_reported(kind: str) -> None:
    tracker, law = BROKEN[kind]
    with pytest.raises(ContractError) as broken:
        check_tracker(tracker, arm_clip())
    assert broken.value.law == law
    assert str(broken.value).startswith(f"{tracker.__name__}: {law}: ")


def test_orientations_have_to_be_unit_quaternions() -> None:
    """Weights must be decreasing and not below zero: two hypotheses of a free body."""
    from kinemode.testing.trackers import check_result

    body = body_of("human34")
    seen = observe(body, body.neutral, (camera_at(0.0),))
    zero, q = np.zeros(2), np.stack([body.neutral, body.neutral])
    right = FrameResult(
        0, 0.0, "tracked", q, np.array([0.6, 0.4]), zero, np.stack([np.eye(body.nv)] * 2), np.full(2, -1), zero, zero,
        ("as_detected",) * 2,
    )  # fmt: skip
    check_result("two", body, seen, right)
    stretched = q * np.where(np.arange(body.nq) == 6, 1.001, 1.0)
    for changes, law in (
        ({"q": stretched}, "configurations are normalised"),
        ({"weight": np.array([0.4, 0.6])}, "the best hypothesis comes first"),
        ({"weight": np.array([1.2, -0.2])}, "weights are not negative"),
    ):
        with pytest.raises(ContractError, match=law):
            check_result("two", body, seen, replace(right, **changes))  # type: ignore[arg-type]


def test_an_uninformative_clip_is_refused() -> None:
    seen = arm_clip()
    with pytest.raises(ValueError, match="2 frames are too few"):
        check_tracker(Still, seen[:2])
    blind = replace(seen[0], confidence=0.0 * seen[0].confidence)
    with pytest.raises(ValueError, match="cannot start"):
        check_tracker(Still, [blind, *seen[1:]])
