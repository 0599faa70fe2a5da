"""Worker processes: the same bits with any number of them, and nothing left behind at any end."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from multiprocessing import active_children
from typing import Any

import numpy as np
import pytest

import kinemode as km
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.data.sequence import assemble
from estimator.energy.descent.solution import StepCounts
from estimator.numerics import pool
from estimator.numerics.broadcast import SMALL, Broadcaster, Receiver
from estimator.search.cost_model import CostModel
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.search.search_pool import search_pool
from estimator.trackers.baselines.single_mode import unlimited
from estimator.trackers.capabilities import energy_of, sharing
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from estimator.vision.likelihood.reader import CueReader
from estimator.vision.likelihood.settings import cue_settings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.rendering.clip import RenderedClip
from tests.builders import body_of, camera_at, observe
from tests.tiny_clip import FEW_STARTS
from tests.waiting import DEADLINE

FRAMES = 3
QUICK = {"css": {"budget": {"searches": 9}}}
ARRAYS = ("q", "weight", "energy", "covariance", "parent", "kkt_residual", "penetration", "velocity")


def tracked(
    clip: RenderedClip, processes: int, changes: dict[str, Any], counts: list[StepCounts] | None = None
) -> list[FrameResult]:
    """The clip's frames, edges and flow included. counts: gets what this process has solved up to each frame's end."""
    cameras = load_cameras(clip.cameras)
    name = next(iter(cameras))
    body = Body(load_subject("human34"))
    keypoints = {name: load_keypoints(clip.keypoints[name])}
    seen = assemble(body, keypoints, cameras, np.arange(FRAMES) / 10.0)
    cues = CueReader([clip.videos[name]], [cameras[name]], cue_settings(["edges", "flow"]))
    tracker = make_tracker("css", body, settings_for("css", modes=3, changes=QUICK | changes))
    results = []
    with sharing(tracker, processes):
        for result, _ in run(tracker, seen, 0, cues=cues):
            results.append(result)
            if counts is not None:
                counts.append(energy_of(tracker, "css").seeker.solver.counts)
    return results


def equal_bits(a: list[FrameResult], b: list[FrameResult]) -> bool:
    pairs = [(getattr(x, name), getattr(y, name)) for x, y in zip(a, b, strict=True) for name in ARRAYS]
    pairs += [(x.extra[name], y.extra[name]) for x, y in zip(a, b, strict=True) for name in x.extra]
    return all(mine.tobytes() == others.tobytes() for mine, others in pairs)


def test_equal_bits_with_any_number_of_workers(clip: RenderedClip, monkeypatch: pytest.MonkeyPatch) -> None:
    """One process, two that take what they get, and a worker that is left all the pieces. The steps that are told are
    all that one process alone has solved; this process has solved none where the worker solves them."""
    importance = {"search": {**FEW_STARTS, "weigh": "importance", "weigh_samples": 5}}
    alone: list[StepCounts] = []
    whole = tracked(clip, 1, importance, alone)
    assert equal_bits(whole, tracked(clip, 2, importance))
    for result, *counts in zip(whole[1:], alone, alone[1:], strict=False):
        solved = StepCounts.between(*counts)
        assert {f"steps_{solver}": count for solver, count in solved._asdict().items()} == {
            name: int(value) for name, value in result.extra.items() if name.startswith("steps_")
        }
        assert solved.free > 0
        assert solved.proxqp > 0
    took: list[int] = []
    monkeypatch.setattr(pool, "taken", lambda *_: took.append(1) or ())
    volume = {"search": {**FEW_STARTS, "weigh": "volume"}}
    left: list[StepCounts] = []
    assert equal_bits(tracked(clip, 1, volume), tracked(clip, 2, volume, left))
    assert sum(left[-1]) == 0
    assert len(took) > 5 * (FRAMES - 1)


@pytest.fixture
def search() -> Iterator[ModeSearch]:
    """Of an arm: quick to make anew."""
    made = ModeSearch(CostModel(body_of("arm8")))
    yield made
    assert active_children() == []


def case_of(search: ModeSearch) -> FrameProblem:
    return FrameProblem(search.associations(observe(search.body, search.body.neutral, [camera_at(20.0)])))


def starts(search: ModeSearch, count: int) -> list[Hypothesis]:
    rng = np.random.default_rng(0)
    return [Hypothesis(search.body.integrate(search.body.neutral, rng.normal(0.0, 0.1, search.body.nv)), 0)] * count


def test_a_worker_that_dies_is_one_clear_error(search: ModeSearch) -> None:
    """However many pieces it still had; the search goes on alone afterwards."""
    case = case_of(search)
    expected = search.explored(starts(search, 6), case)
    with search_pool(search, 2):
        assert [c.energy for c in search.explored(starts(search, 6), case)] == [c.energy for c in expected]
        (worker,) = active_children()
        assert worker.pid is not None
        os.kill(worker.pid, signal.SIGKILL)
        worker.join(DEADLINE)
        with pytest.raises(InputError, match=r"workers: a worker process has ended \(exit code -9\)"):
            search.explored(starts(search, 6), case)
        assert [c.energy for c in search.explored(starts(search, 6), case)] == [c.energy for c in expected]


def test_what_goes_wrong_in_a_worker_is_raised_here(search: ModeSearch, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C, which a terminal sends to all, leaves workers cold: their leader ends them."""
    with search_pool(search, 2):
        (worker,) = active_children()
        assert worker.pid is not None
        os.kill(worker.pid, signal.SIGINT)
        case = case_of(search)
        assert len(search.explored(starts(search, 4), case)) == 4
        monkeypatch.setattr(pool, "taken", lambda *_: ())
        with pytest.raises(IndexError) as raised:
            search.explored([h._replace(association=7) for h in starts(search, 2)], case)
        assert "frame_search.py" in str(raised.value.__cause__)


def test_large_arrays_are_shared_not_copied() -> None:
    rng = np.random.default_rng(0)
    small, large, turned = rng.random(3), rng.random((SMALL, 3)), rng.random((70, 90)).astype(np.float32).T
    open_files = len(os.listdir("/dev/fd"))
    with Broadcaster() as broadcaster:
        reader = Receiver()

        def handed() -> int:
            return os.dup(broadcaster.descriptor)

        for factor in (1.0, 2.0, 3.0):
            thing = {"small": factor * small, "large": [factor * large] * 2, "turned": turned, "bytes": large > factor}
            notice = broadcaster.show(thing)
            assert notice.moved == (factor == 1.0)
            assert len(notice.content) < SMALL
            shared = reader.read(notice, handed)
            assert shared["large"][0] is shared["large"][1]
            for name in ("small", "turned", "bytes"):
                assert np.array_equal(shared[name], thing[name])
                assert shared[name].strides == thing[name].strides
                assert shared[name].flags.writeable  # compiled functions tell the kinds apart
            assert np.array_equal(shared["large"][0], factor * large)
            assert shared["large"][0].ctypes.data % 64 == 0
        broadcaster.show({"large": 5.0 * large})
        assert np.array_equal(shared["large"][0], 5.0 * large)  # it looks at the memory
        bigger = broadcaster.show(np.zeros((100, SMALL)))
        assert bigger.moved
        assert not reader.read(bigger, handed).any()
        assert np.array_equal(shared["large"][0], 5.0 * large)  # what was read stays
        reader.close()
    del shared
    assert len(os.listdir("/dev/fd")) == open_files


def test_what_cannot_be_shared_is_refused(search: ModeSearch) -> None:
    for count in (0, -1, 1000):
        with pytest.raises(InputError, match=r"workers.*1 to 64"), search_pool(search, count):
            pass
        with pytest.raises(InputError, match="workers"):
            km.track("arm8", None, workers=count)
    with pytest.raises(InputError, match="works in one process"):
        sharing(make_tracker("single-mode", search.body), 2)
    other = ModeSearch(CostModel(unlimited(search.body)))
    with pytest.raises(ValueError, match="limits"), search_pool(other, 2):
        pass
