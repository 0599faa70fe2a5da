"""Runs of the ablation: css with some settings on the stand-ins, on captured motions and on beam4cam."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import kinemode as km
from benchmarks.accuracy import mocap
from benchmarks.accuracy.beam4cam import CAMERAS
from benchmarks.papers_css.failure_runs import CSS, Tracking
from benchmarks.papers_css.sequences import FPS, Task, clip_folder
from benchmarks.support.common import CUES, beam_folder
from benchmarks.support.mocap_person import DETECTOR, FPS as FILMED_FPS, person
from benchmarks.support.result_store import Figures, Piece, ResultStore, cached_clip, removed
from benchmarks.support.scores import TrackErrors, outcome
from benchmarks.support.tracking import Times, timed_track
from estimator.runs.run_reader import Run
from estimator.synthesis.mocap import load_mocap
from estimator.trackers.spec import NO_CAPTURE, together
from estimator.tracking.registry import settings_for
from humanoid.support.errors import InputError
from kinemode.settings import choose
from kinemode.shot import RenderedClip

MOCAP_CLIP_SEED = 2  # as `benchmarks.accuracy.mocap`


class Suite(NamedTuple):
    """A set of clips tracked in one way. pictures: from the first frame's joints and pictures, else from keypoints.
    measure: which field of `TrackErrors` is the error. title: in a line."""

    pictures: bool
    measure: str
    title: str


STAND_INS, MOCAP_PICTURES, MOCAP_KEYPOINTS, BEAM = "stand-ins", "mocap-pictures", "mocap-keypoints", "beam4cam"
SUITES = {
    STAND_INS: Suite(True, "mean", "stand-ins, pictures alone"),
    MOCAP_PICTURES: Suite(True, "mean", "motion capture, pictures alone"),
    MOCAP_KEYPOINTS: Suite(False, "aligned", "motion capture, keypoints"),
    BEAM: Suite(False, "aligned", "beam4cam, one camera, keypoints"),
}


class Prepared(Piece, Protocol):
    """A piece whose clip is rendered before all others are tracked."""

    def prepare(self) -> RenderedClip | None:
        """Render the clip unless it is there."""
        ...


@dataclass(frozen=True)
class Part:
    """One run of the table: its suite, the row, the clip and the tracker's seed, and the piece of work."""

    suite: str
    row: str
    clip: str
    seed: int
    piece: Prepared

    def read(self, figures: Figures) -> Measured:
        """The result of its piece."""
        errors = {name: TrackErrors(**e) for name, e in figures["outcome"]["errors"].items()}
        return Measured(self.suite, self.row, self.clip, self.seed, figures["frames"], figures["cpu"], errors)


@dataclass(frozen=True)
class Measured:
    """A run of the table: errors by trajectory; cpu: seconds of processor time a frame, of tracking alone."""

    suite: str
    row: str
    clip: str
    seed: int
    frames: int
    cpu: float
    errors: dict[str, TrackErrors]

    @property
    def key(self) -> tuple[str, str, int]:
        """The key that a run of another row must share to be compared with it."""
        return self.suite, self.clip, self.seed


@dataclass(frozen=True)
class Captured:
    """A piece of work: a rendered captured motion, tracked as `benchmarks.accuracy.mocap` does.

    motion: BVH file. folder: of all clips. pictures: see `Suite`. changes: to the settings.
    """

    motion: Path
    seconds: float | None
    folder: Path
    pictures: bool
    seed: int
    changes: Mapping[str, Any]

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self.motion.stem}_{'pictures' if self.pictures else 'keypoints'}_{self.seed}"

    @property
    def what(self) -> dict[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {
            "mocap": self.motion.stem, "clip_seed": MOCAP_CLIP_SEED, "seconds": self.seconds,
            "pictures": self.pictures, "seed": self.seed, "settings": _all_settings(self.changes),
        }  # fmt: skip

    def prepare(self) -> RenderedClip:
        """Render the clip unless it is there."""

        def render(folder: Path) -> None:
            longest = load_mocap(self.motion).seconds
            seconds = None if self.seconds is None else min(self.seconds, longest)
            km.render(
                folder, self.motion, subject=person(), detector=DETECTOR, fps=FILMED_FPS, seconds=seconds,
                seed=MOCAP_CLIP_SEED,
            )  # fmt: skip

        return cached_clip(clip_folder(self.folder, self.motion.stem, MOCAP_CLIP_SEED, self.seconds), render)

    def work(self, store: ResultStore) -> Figures:
        """Errors and times; the run itself is not kept."""
        clip, out = self.prepare(), store.scratch(self, ".run")
        run, times = timed_track(
            clip.first_frame if self.pictures else clip.keypoints, clip.cameras, out,
            clips=clip.videos if self.pictures else None, cues=",".join(CUES) if self.pictures else "off",
            seed=self.seed, settings=_acting(self.changes),
        )  # fmt: skip
        return _measured(run, times, clip.truth, out)


@dataclass(frozen=True)
class Filmed:
    """A piece of work: beam4cam tracked from one camera's keypoints as `benchmarks.accuracy.beam4cam` does.
    folder: of the clip. changes: to the settings."""

    camera: str
    folder: Path
    seed: int
    changes: Mapping[str, Any]

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"beam4cam_{self.camera}_{self.seed}"

    @property
    def what(self) -> dict[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {"beam4cam": self.camera, "seed": self.seed, "settings": _all_settings(self.changes)}

    def prepare(self) -> None:
        """Nothing: it is a film."""

    def work(self, store: ResultStore) -> Figures:
        """Errors and times; the run itself is not kept."""
        files, out = {self.camera: self.folder / "keypoints" / f"{self.camera}.json"}, store.scratch(self, ".run")
        cameras, settings = self.folder / "calibration.json", _acting(self.changes)
        run, times = timed_track(files, cameras, out, seed=self.seed, settings=settings)
        return _measured(run, times, self.folder / "reference3d.npz", out)


def _measured(run: Run, times: Times, truth: Path, out: Path) -> Figures:
    scored = outcome(run, times, truth)
    removed(out)
    return {"frames": len(run), "cpu": times.cpu_tracking, "outcome": asdict(scored)}


def _acting(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Those that have an effect where the subject is fitted."""
    return choose(CSS, changes).used(fits=True)


def _all_settings(changes: Mapping[str, Any]) -> dict[str, Any]:
    return settings_for(CSS, changes=_acting(changes)).to_dict()


class Wanted(NamedTuple):
    """The common choices of all rows: where clips are, where the data is, which of the clips (all if empty), their
    seeds where they have several, those of the tracker, how much of each clip, and changes to the settings."""

    clips: Path
    data: Path | None
    motions: Sequence[str]
    clip_seeds: Sequence[int]
    seeds: Sequence[int]
    seconds: float | None
    changes: Mapping[str, Any]


def parts(suite: str, row: str, changes: Mapping[str, Any], wanted: Wanted) -> list[Part]:
    """The runs of a suite without one part; changes: the row's. None where the wanted clips are those of others.

    Raises
    ------
    InputError: the data of the suite is not here.
    """
    settings = together(wanted.changes, changes)
    if suite == STAND_INS:
        how = {"cues": ",".join(CUES), "modes": None, "settings": settings}
        tasks = [
            Task(m, s, wanted.seconds, False, wanted.clips, how) for m in _some(FPS, wanted) for s in wanted.clip_seeds
        ]
        return [Part(suite, row, t.label, s, Tracking(t, CSS, s)) for s in wanted.seeds for t in tasks]
    if suite == BEAM:
        cameras = _some(CAMERAS, wanted)
        folder = beam_folder(wanted.data) if cameras else Path()
        return [Part(suite, row, c, s, Filmed(c, folder, s, settings)) for s in wanted.seeds for c in cameras]
    files = mocap.motion_files(wanted.data, mocap.DEFAULT, False)
    if not files:
        raise InputError(
            "mocap", "the motion capture is not here", remedy="--data DIR or KINEMODE_DATA names its folder"
        )
    settings = together(NO_CAPTURE, settings)  # it was learned from these people
    chosen, pictures = _some([f.stem for f in files], wanted), SUITES[suite].pictures
    return [
        Part(suite, row, f.stem, s, Captured(f, wanted.seconds, wanted.clips, pictures, s, settings))
        for s in wanted.seeds
        for f in files
        if f.stem in chosen
    ]


def _some(names: Sequence[str] | Mapping[str, Any], wanted: Wanted) -> list[str]:
    return [name for name in names if not wanted.motions or name in wanted.motions]


def prepared(part: Part) -> None:
    """Render a part's clip."""
    part.piece.prepare()
