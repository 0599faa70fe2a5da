"""Failure table and ablation: all trackers get CSS's time and the same criteria, and the verdicts are right."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.papers_css import ablation, failure_table
from benchmarks.papers_css.ablation_runs import STAND_INS, Measured, Wanted, parts
from benchmarks.papers_css.failure_runs import CSS, Attempt, Sizing, Tracking, own_size, resized, size_for
from benchmarks.papers_css.failure_table import PAPER, in_markdown, order, summed
from benchmarks.papers_css.failures import BY_ONE_CAMERA
from benchmarks.papers_css.runs_plot import write_differences, write_runs
from benchmarks.papers_css.sequences import FPS, Task
from benchmarks.papers_css.summaries import gain, paired, spread_of, track_statistics
from benchmarks.support.common import CUES
from benchmarks.support.result_store import INTERRUPTED, Figures, ResultStore, all_done
from benchmarks.support.scores import TRAJECTORIES, Outcome, TrackErrors
from estimator.trackers.css.settings import Source, allocated
from estimator.tracking.registry import TRACKERS


def errors_of(mean: float, lost: int | None = None, of_limits: float = 0.5) -> TrackErrors:
    return TrackErrors(mean, mean, 1.0, lost, of_limits, mean, mean)


def attempt(tracker: str, mean: float, lost: int | None = None, motion: str = "arm", clip: int = 1, seed: int = 0,
            cpu: float = 0.1, smooths: bool = True) -> Attempt:  # fmt: skip
    errors = errors_of(mean, lost)
    return Attempt(
        tracker, motion, clip, seed, None, cpu, 10, smooths, Outcome(dict.fromkeys(TRAJECTORIES, errors), 10.0, ())
    )


def field(tracker: str, means: Mapping[tuple[int, int], float], lost: int = 0, motion: str = "arm") -> list[Attempt]:
    """Attempts on one motion by clip and seed, the first so many of them lost in frame 5."""
    return [
        attempt(tracker, mean, 5 if i < lost else None, motion, *key) for i, (key, mean) in enumerate(means.items())
    ]


def test_time_grows_in_a_straight_line() -> None:
    def seconds(size: int) -> float:
        return 0.02 + 0.003 * size

    assert size_for(seconds(70), [10, 40], [seconds(10), seconds(40)]) == 70
    assert size_for(seconds(70), [10, 90], [seconds(10), seconds(90)]) == 70
    assert size_for(0.01, [10, 40], [seconds(10), seconds(40)]) == 1  # below the cheapest
    assert size_for(0.4, [10, 40], [0.1, 0.1]) == 160  # too fast to extrapolate: in proportion
    assert size_for(0.4, [10, 40], [0.1, 0.1001]) == 480  # nearly so


@pytest.mark.parametrize("tracker", BY_ONE_CAMERA)
def test_a_tracker_is_given_its_size(tracker: str) -> None:
    changes = {"css": {"modes": 3}}
    own = own_size(tracker, changes)
    assert (own is None) == (TRACKERS[tracker].group == "single_mode")
    if own is not None:
        assert own_size(tracker, resized(tracker, changes, own + 1)) == own + 1
    assert changes == {"css": {"modes": 3}}


@pytest.mark.parametrize("tracker", TRACKERS)
def test_all_trackers_are_smoothed_alike(tracker: str, tmp_path: Path) -> None:
    how = {"cues": "off", "modes": 2, "settings": {"smooth": {"window": 100}}}
    task = Task("arm", 1, 0.2, False, tmp_path, how, detected=True)
    settings = Tracking(task, tracker, 0).settings
    assert settings.smooth == replace(settings.smooth, enabled=True, window=100)
    assert Tracking(task, tracker, 0).what != Tracking(task, tracker, 1).what
    off = replace(task, how=how | {"settings": {"smooth": {"enabled": False}}})
    assert not Tracking(off, tracker, 0).settings.smooth.enabled


def test_the_paper_is_about_known_trackers_and_sequences() -> None:
    assert {tracker for _, tracker in PAPER} <= set(TRACKERS)
    assert {motion for motion, _ in PAPER} == set(FPS)


def test_a_spread_is_the_textbooks() -> None:
    values = [1.0, 2.0, 3.0, 4.0]
    alone = spread_of(values, range(4))
    assert alone.mean == 2.5
    assert alone.deviation == pytest.approx(math.sqrt(5.0 / 3.0))
    assert alone.error == pytest.approx(math.sqrt(5.0 / 3.0) / 2.0)
    # runs of a clip are one measurement if they are equal: standard error of the two clips' means, 0 and 2
    clustered = spread_of([0.0, 0.0, 2.0, 2.0], ["a", "a", "b", "b"])
    assert clustered.error == pytest.approx(1.0)
    # where the clips do not differ, that of independent runs
    assert spread_of([0.0, 2.0, 0.0, 2.0], ["a", "a", "b", "b"]).error == pytest.approx(math.sqrt(4.0 / 3.0) / 2.0)
    assert spread_of([3.0], ["a"])[0] == 3.0
    assert math.isnan(spread_of([3.0], ["a"]).error)
    drawn = np.random.default_rng(0).normal(5.0, 2.0, (2000, 9))
    inside = [abs(s.mean - 5.0) < 2.0 * s.error for s in (spread_of(row, range(9)) for row in drawn)]
    assert np.mean(inside) == pytest.approx(0.919, abs=0.02)  # Student's t of 8 degrees within 2


def test_differences_are_those_of_pairs() -> None:
    ours = {("a", 0): 1.0, ("a", 1): 2.0, ("b", 0): 3.0, ("c", 0): 100.0}
    theirs = {("a", 0): 2.0, ("a", 1): 3.0, ("b", 0): 4.0, ("d", 0): -100.0}
    clips = {key: key[0] for key in (*ours, *theirs)}
    assert paired(theirs, ours, clips)[:2] == (1.0, 0.0)  # the same everywhere, though the runs are apart
    better = gain(ours, theirs, clips)
    assert better.share == pytest.approx(1.0 / 3.0)
    assert better.shown(0.33)
    assert not better.shown(0.34)
    noisy = gain({0: 1.0, 1: 1.0, 2: 1.0}, {0: 1.0, 1: 1.0, 2: 4.0}, {0: 0, 1: 1, 2: 2})
    assert noisy.share == pytest.approx(0.5)
    assert not noisy.shown(0.1)  # one standard error


def test_runs_have_track_statistics() -> None:
    runs = [errors_of(10.0, None, 0.4), errors_of(20.0, 7, 1.5), errors_of(60.0, 3, math.inf)]
    j = track_statistics(runs, ["a", "b", "c"])
    assert (j.error.mean, j.lost, j.runs, j.lost_at) == (30.0, 2, 3, 5.0)
    assert j.of_limits == pytest.approx(0.95)
    assert j.worst_of_limits == math.inf
    assert j.doubled == 0
    assert track_statistics([replace(runs[0], pixels=30.1), replace(runs[0], worst=math.nan)], "ab").doubled == 2


KEYS = {(clip, seed): 30.0 + clip + 0.1 * seed for clip in (1, 2, 3) for seed in (0, 1, 2)}


def field_of(css_lost: int, paper_lost: int, single_lost: int, css_mean: float) -> list[Attempt]:
    """All trackers but one kind on one motion, 9 runs each."""
    return [
        *field(CSS, {k: css_mean + v for k, v in KEYS.items()}, css_lost),
        *field("css-paper", {k: v - 20.0 for k, v in KEYS.items()}, paper_lost),
        *field("condensation", {k: 30.0 + v for k, v in KEYS.items()}),
        *field("annealed", {k: 90.0 + v for k, v in KEYS.items()}),
        *field("single-mode", {k: 95.0 + v for k, v in KEYS.items()}, single_lost),
    ]


def verdict_texts(attempts: list[Attempt]) -> dict[str, str]:
    return {line.split(":")[0]: line for line in order(attempts, summed(attempts))}


def test_the_papers_order() -> None:
    good = verdict_texts(field_of(0, 1, 6, 0.0))
    assert len(good) == 4
    assert all(": reached" in line for line in good.values())
    assert "the next is condensation" in good["arm"]  # css-paper, nearer, is a variation of css
    bad = verdict_texts(field_of(1, 2, 5, 25.0))  # 1 of 9 is 3 of 27, 2 of 9 are 6, 5 of 9 are 15; 5 of 62 mm are 8 %
    assert len(bad) == 4
    assert all(": not reached" in line for line in bad.values())


def test_rows_are_of_a_motion_and_of_all() -> None:
    runs = [
        *field(CSS, KEYS), *field(CSS, {k: 3.0 * v for k, v in KEYS.items()}, 3, "pivot"),
        *(replace(a, cpu=0.3, smooths=False) for a in field("annealed", KEYS)),
        *(replace(a, cpu=0.1) for a in field("annealed", KEYS, 0, "pivot")),
    ]  # fmt: skip
    rows = {(row.tracker, row.motion): row for row in summed(runs)}
    mean = float(np.mean(list(KEYS.values())))
    assert rows[CSS, failure_table.ALL].filtered.error.mean == pytest.approx(2.0 * mean)
    assert rows[CSS, failure_table.ALL].filtered.lost == 3
    assert rows["annealed", "arm"].times == pytest.approx(3.0)
    assert rows["annealed", failure_table.ALL].times == pytest.approx(2.0)
    assert rows["annealed", "arm"].smoothed is None  # nothing to smooth by
    assert rows["annealed", "pivot"].smoothed is not None
    lines = in_markdown(list(rows.values())).splitlines()
    assert [line.count("|") for line in lines] == [8] * 4
    assert "| - |" in lines[3]


def test_what_is_left_of_the_budget_goes_to_the_others() -> None:
    """So the rows of the ablation have as many searches, whichever source is off."""

    def source(share: float, there: int = 1000) -> Source:
        return Source(share, lambda count: [None] * min(count, there))  # type: ignore[list-item]

    for off in range(5):
        shares = [7.0, 5.0, 5.0, 4.0, 14.0]
        shares[off] = 0.0
        assert len(allocated(33, [source(share) for share in shares])) == 33
    assert len(allocated(33, [source(7.0, there=0), source(14.0)])) == 33


@dataclass(frozen=True)
class Doubled:
    """A piece that leaves a trace of its work, and is interrupted where a file requests it."""

    number: int
    folder: Path

    @property
    def name(self) -> str:
        return f"doubled_{self.number}"

    @property
    def what(self) -> dict[str, Any]:
        return {"number": self.number}

    def work(self, store: ResultStore) -> Figures:
        if (self.folder / f"stop_{self.number}").exists():
            raise KeyboardInterrupt
        with (self.folder / "worked").open("a") as file:
            file.write(f"{self.number}\n")
        return {"doubled": 2 * self.number, "share": self.number / 3.0, "far": math.inf}


def test_an_interrupted_measure_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pieces = [Doubled(number, tmp_path) for number in range(5)]
    whole = all_done("whole", ResultStore(tmp_path / "whole"), pieces, 1)
    (tmp_path / "worked").unlink()
    (tmp_path / "stop_3").touch()
    store = ResultStore(tmp_path / "kept")
    with pytest.raises(SystemExit) as stop:
        all_done("interrupted", store, pieces, 1)
    assert stop.value.code == INTERRUPTED
    (tmp_path / "stop_3").unlink()
    capsys.readouterr()
    assert all_done("again", store, pieces, 1) == whole
    assert "3 of 5 are kept" in capsys.readouterr().err
    assert (tmp_path / "worked").read_text().split() == ["0", "1", "2", "3", "4"]  # no repeats
    assert len(store.codes(pieces)) == 1
    other = store.path(pieces[0])
    other.write_text(json.dumps(json.loads(other.read_text()) | {"code": "another"}))
    assert len(store.codes(pieces)) == 2


def test_the_ablation_shares_the_runs_of_css(tmp_path: Path) -> None:
    how = {"cues": ",".join(CUES), "modes": 7, "settings": {}}
    ours = Tracking(Task("arm", 2, None, False, tmp_path, how), CSS, 1)
    wanted = Wanted(tmp_path, None, ("arm",), (1, 2), (0, 1), None, {})
    store = ResultStore(tmp_path)
    by_row = {name: parts(STAND_INS, name, changes, wanted) for name, changes in ablation.ROWS.items()}
    assert store.path(ours) in [store.path(part.piece) for part in by_row[ablation.WHOLE]]
    paths = {store.path(part.piece) for of in by_row.values() for part in of}
    assert len(paths) == 4 * len(ablation.ROWS)  # every row has different settings


def measured(row: str, mean: float, lost: int | None, clip: int, seed: int) -> Measured:
    return Measured(STAND_INS, row, f"{clip}", seed, 10, 0.1, dict.fromkeys(TRAJECTORIES, errors_of(mean, lost)))


def test_verdicts_of_the_ablation(tmp_path: Path) -> None:
    done = [
        measured(row, mean + more, 4 if clip <= lost else None, clip, seed)
        for row, more, lost in (("css", 0.0, 0), ("no samples", 2.0, 3), ("spherical samples", 2.0, 0))
        for (clip, seed), mean in KEYS.items()
    ]
    rows = {row.name: row for row in ablation.summed(done)}
    assert rows["no samples"].more.filtered.mean == pytest.approx(2.0)
    assert rows["no samples"].more.smoothed.error == pytest.approx(0.0, abs=1e-9)
    assert rows["no samples"].lost_more.filtered.mean == 1.0
    none, spherical = ablation.verdicts(done)
    assert none.endswith(": reached")  # 6 %, but lost always
    assert spherical.endswith("not reached")
    lines = ablation.in_markdown(list(rows.values())).splitlines()
    assert [line.count("|") for line in lines] == [4] * 5
    assert "+2.0 ± 0.0; 9 of 9" in lines[3]
    write_differences(tmp_path / "a.png", ablation.differences(list(rows.values())))
    write_runs(tmp_path / "b.png", failure_table.by_tracker(field_of(1, 2, 5, 3.0)))
    assert min((tmp_path / name).stat().st_size for name in ("a.png", "b.png")) > 5000


def test_a_short_race(tmp_path: Path) -> None:
    how = {"cues": "off", "modes": 2, "settings": {"css": {"samples": 2, "jumps": 0}}}
    task, store = Task("arm", 1, 0.24, False, tmp_path, how, detected=True), ResultStore(tmp_path)
    runs = [Tracking(task, CSS, 0), Tracking(task, "single-mode", 0)]
    css, single = (Attempt.of(result) for result in all_done("short", store, runs, 1))
    assert css.frames == single.frames == 6
    assert css.smooths
    assert single.smooths
    filtered, smoothed = (single.outcome.errors[name].mean for name in ("filtered", "smoothed"))
    assert filtered != smoothed  # a baseline is smoothed too
    assert max(filtered, smoothed) < 250.0
    assert asdict(Attempt.of(store.of(runs[0]))) == asdict(css)
    sized = Sizing(Tracking(task, "condensation", 0), (runs[0],), 4)
    (size,) = (result["size"] for result in all_done("size", store, [sized], 1))
    rival = Attempt.of(store.of(Tracking(task, "condensation", 0, size)))
    assert rival.size == size
    assert rival.outcome.errors["filtered"].mean < 250.0
    assert not list((tmp_path / "scratch").iterdir())
