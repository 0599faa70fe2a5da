"""The starts that a tracker really searches from: every hypothesis of `css` over clips of human34, one camera."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.speed.mode_search_duel import NOISE_PX, Start
from estimator.data.observation import Observation
from estimator.data.sequence import assemble
from estimator.inference.origin import Family
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Candidate, Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.synthesis import detector
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import motion_named
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.trackers.base import energy_of
from estimator.trackers.css.tracker import CovarianceScaledSampling
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject

KINDS = KEPT, EXCHANGED, JUMP, SAMPLE = "kept", "other association", "jump", "sample"
KIND_OF = dict(zip((Family.KEPT, Family.ASSOCIATION, Family.DEPTH_JUMP, Family.SAMPLE), KINDS, strict=True))
MOTIONS = ("reach", "turn_reach")
FPS = 30.0


class Recorder(ModeSearch):
    """A mode search that records its starts, except for the first frame, which has no parents."""

    def __init__(self, search: ModeSearch) -> None:
        super().__init__(search.model, search.settings)
        self.starts: list[Start] = []

    def explored(self, hypotheses: Iterable[Hypothesis], case: FrameProblem) -> list[Candidate]:
        """See `ModeSearch.explored`."""
        hypotheses = list(hypotheses)
        for h in hypotheses:
            if h.parent >= 0:
                observation = case.associations[h.association].term.observation
                kind = KIND_OF[h.origin.family]
                self.starts.append(Start(kind, self.body.clamp(h.q), observation, h.origin.transition_from, case.dt))
        return super().explored(hypotheses, case)


def tracker_starts(seed: int, motions: Sequence[str] = MOTIONS, frames: int | None = None) -> list[Start]:
    """All starts of the tracker over authored motions, for the requested number of frames each."""
    body, starts = Body(load_subject("human34")), list[Start]()
    for k, name in enumerate(motions):
        usual = make_tracker("css", body)
        recorder = Recorder(energy_of(usual, "css"))
        tracker = CovarianceScaledSampling(recorder)
        deque(run(tracker, _clip(body, name, frames, np.random.default_rng((seed, k))), seed), maxlen=0)
        starts += recorder.starts
    return starts


def subsample(starts: Sequence[Start], count: int, rng: np.random.Generator) -> list[Start]:
    """So many of them (or all, if there are fewer), each as likely as any other, in their order."""
    chosen = rng.choice(len(starts), size=min(count, len(starts)), replace=False)
    return [starts[i] for i in np.sort(chosen)]


def _clip(body: Body, name: str, frames: int | None, rng: np.random.Generator) -> list[Observation]:
    motion = motion_named(name)
    times = np.arange(round(FPS * motion.seconds))[:frames] / FPS
    q = authored_motion(body, times, motion)
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    cameras = framing_cameras(points, ViewSettings(azimuth=motion.azimuth))
    tracks = detector.keypoints(body, q, cameras, rng, DetectorSettings(NOISE_PX), fps=FPS)
    camera = cameras[0]
    return assemble(body, {camera.name: tracks[0]}, {camera.name: camera}, times)
