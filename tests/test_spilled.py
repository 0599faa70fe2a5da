"""Lists partly in memory: they hold what plain lists hold, with few items in memory."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from builders import body_of, camera_at, observe

from estimator.energy.cost import Cost
from estimator.synthesis.motion import authored_motion
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import make_tracker
from estimator.tracking.smoothing import Smoothed, SmoothSettings, clip as smoothing_of_clips, frames, smooth_track
from estimator.tracking.smoothing.motion_energy import MotionEnergy
from estimator.tracking.smoothing.ties import Ties
from estimator.tracking.smoothing.window_energy import WindowEnergy
from humanoid.kinematics.body import Body
from humanoid.support import spilled
from humanoid.support.spilled import MadeList, Spill

FPS, FRAMES, KEPT = 25.0, 40, 4
SETTINGS = SmoothSettings(window=4, iterations=2, pace_rounds=1)


class Item:
    """An item with numbers, a reference to a shared object, and possibly a part that cannot be pickled."""

    def __init__(self, number: int, common: object, more: object = None) -> None:
        self.numbers, self.common, self.more = np.arange(number) + 0.5, common, more


def same(ours: Item, theirs: Item) -> bool:
    return np.array_equal(ours.numbers, theirs.numbers) and ours.common is theirs.common and ours.more is theirs.more


def test_two_lists_hold_what_plain_lists_hold() -> None:
    """For any sequence of assignments, with items that grow and shrink, and some that cannot be pickled."""
    rng, common, fixed = np.random.default_rng(1), {1, 2}, body_of("arm8")
    spill = Spill(KEPT, [fixed], (set,))
    ours, plain = [spill.list(), spill.list([])], [list[Item](), list[Item]()]
    for step in range(300):
        which, stuck = int(rng.integers(2)), (lambda: None) if step % 11 == 0 else None
        item = Item(int(rng.integers(50)), common if step % 2 else fixed, stuck)
        place = int(rng.integers(-1, len(plain[which]))) if plain[which] else -1
        if place < 0 and len(plain[which]) < 40:
            plain[which].append(item)
            ours[which].append(item)
        else:
            plain[which][place] = ours[which][place] = item
        probe = int(rng.integers(-len(plain[which]), len(plain[which])))
        assert same(ours[which][probe], plain[which][probe])
    for spilled_one, known in zip(ours, plain, strict=True):
        assert len(spilled_one) == len(known)
        assert all(map(same, spilled_one, known))
        assert all(map(same, spilled_one[3:17:2], known[3:17:2]))
        with pytest.raises(IndexError):
            spilled_one[len(known)]


def test_few_items_are_in_memory_and_the_file_has_no_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spilled.tempfile, "tempdir", str(tmp_path))
    alive = weakref.WeakSet[Item]()
    items = Spill(KEPT).list()
    for number in range(30):
        item = Item(number, None)
        alive.add(item)
        items.append(item)
    del item
    assert len(alive) == KEPT
    assert [len(each.numbers) for each in items] == list(range(30))
    assert len(alive) <= KEPT
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_written_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: object) -> None:
        raise OSError(28, "no space left on device")

    monkeypatch.setattr(spilled.tempfile, "TemporaryFile", full)
    items = Spill(KEPT).list(Item(number, None) for number in range(12))
    assert [len(each.numbers) for each in items] == list(range(12))


def test_items_are_made_on_demand() -> None:
    asked = list[int]()
    made = MadeList(5, lambda i: asked.append(i) or i * i)  # type: ignore[func-returns-value]
    assert (len(made), asked) == (5, [])
    assert (made[-1], made[1:3], asked) == (16, [1, 4], [4, 1, 2])
    assert list(made) == [0, 1, 4, 9, 16]
    with pytest.raises(IndexError):
        made[5]


def smoothed_by(kept: int, monkeypatch: pytest.MonkeyPatch) -> tuple[Smoothed, int]:
    """A clip with two modes per frame, smoothed with a limit of energies in memory, and their largest number."""
    body, rng = body_of("human34"), np.random.default_rng(3)
    search, camera = make_tracker("css", body).search, camera_at(15.0, distance=3.5, height=1.0, aim=(0.0, 0.0, 0.9))
    truth = authored_motion(body, np.arange(FRAMES) / FPS)
    seen = [observe(body, q, (camera,), noise=3.0, rng=rng, index=i, time=i / FPS) for i, q in enumerate(truth)]
    results = []
    for i, pose in enumerate(truth):
        q = np.array([body.integrate(pose, rng.normal(0.0, s, body.nv)) for s in (0.1, 0.05)])
        weight, zero = np.array([0.6, 0.4]), np.zeros(2)
        results.append(
            FrameResult(
                i, i / FPS, "tracked", q, weight, zero, np.zeros((2, 0, 0)), np.arange(2) - 2 * (i == 0), zero, zero,
                ("as_detected",) * 2,
            )
        )  # fmt: skip
    alive, most = weakref.WeakSet[Cost](), 0

    made = WindowEnergy.__init__

    def begin(window: WindowEnergy, body: Body, costs: Sequence[Cost], ties: Sequence[Ties]) -> None:
        nonlocal most
        alive.update(costs)
        most = max(most, len(alive))
        made(window, body, costs, ties)

    with monkeypatch.context() as patched:
        patched.setattr(WindowEnergy, "__init__", begin)
        patched.setattr(smoothing_of_clips, "_MARGIN", frames.REACH)
        patched.setattr(frames, "Spill", lambda _, *shared: Spill(kept, *shared))
        patched.setattr(smoothing_of_clips, "Spill", lambda _: Spill(min(kept, KEPT)))
        return smooth_track(search, seen, results, SETTINGS), most


def test_a_clip_is_smoothed_alike_with_few_energies_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit, and with no more than those of a window beside the few."""
    (whole, every), (by_part, few) = (smoothed_by(kept, monkeypatch) for kept in (10_000, KEPT))
    window = SETTINGS.window + 2 * frames.REACH
    assert every >= 2 * FRAMES
    assert few <= KEPT + 3 * window < FRAMES
    for name in ("q", "mode", "weight"):
        assert np.array_equal(getattr(whole, name), getattr(by_part, name), equal_nan=True)
    assert whole.covariance is not None
    assert by_part.covariance is not None
    assert all(np.array_equal(a, b) for a, b in zip(whole.covariance, by_part.covariance, strict=True))
    assert not np.array_equal(*whole.covariance[:2])


@pytest.mark.parametrize("memory", [0.0, 0.12])
@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_the_energy_of_motion_needs_no_derivatives(memory: float, count: int) -> None:
    body, rng = body_of("human34"), np.random.default_rng(7)
    q = np.array([body.integrate(body.neutral, rng.normal(0.0, 0.2, body.nv)) for _ in range(count)])
    times = np.cumsum(rng.uniform(0.02, 0.1, count))
    motion = SETTINGS.motion(make_tracker("css", body).search.model)._replace(memory=memory)
    energy = MotionEnergy(body, motion, np.array([b - a for a, b in pairwise(times)]))
    gradient, blocks = np.zeros((count, body.nv)), np.zeros((4, count, body.nv, body.nv))
    assert energy.energy(q) == energy.add(q, gradient, blocks)
