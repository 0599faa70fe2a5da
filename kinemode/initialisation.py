"""Whether a tracker can start from the input, and do what is requested: checked before an hour of work, not
after."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from estimator.data.observation import MIN_POINTS, Observation
from estimator.search.settings import BY_INDEX
from estimator.trackers.base import TrackerProtocol, capabilities_of
from estimator.trackers.frame_result import FrameResult
from estimator.vision.cues.base import Cue
from estimator.vision.cues.settings import CUES
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.settings import Chosen


def check_keypoints(subject: Subject, observations: Sequence[Observation]) -> None:
    """Raise InputError where no frame has enough keypoints for a pose."""
    if not any(o.has_enough_points for o in observations):
        raise _too_few(subject)


def check_beginning(
    tracker: TrackerProtocol[Any], name: str, subject: Subject, observations: Sequence[Observation], pictures: bool
) -> None:
    """Raise InputError where a tracker, of some name, cannot start in any frame.

    observations: without cues. pictures: whether they are used: their content is not known yet, so a tracker that
    needs no keypoints may still wait for them in vain.
    """
    if any(tracker.can_start(o) for o in observations):
        return
    if tracker.needs_keypoints:
        raise _too_few(subject)
    if not pictures:
        problem = f"{name} cannot start in any frame from the given keypoints"
        raise InputError("cues", problem, remedy="give the clips and use their pictures (--cues)")


def check_start(tracker: TrackerProtocol[Any], chosen: Chosen) -> None:
    """Raise InputError where a tracker that cannot start by an index should."""
    begins = capabilities_of(tracker).needed_cues and not tracker.needs_keypoints
    if chosen.settings.search.start == BY_INDEX and not begins:
        raise InputError("start", f"{chosen.tracker} does not start by an index", remedy="leave it out")


def check_cue(tracker: TrackerProtocol[Any], name: str, cues: Collection[str]) -> None:
    """Raise InputError where a tracker, of some name, needs cues of which none is used."""
    needed = capabilities_of(tracker).needed_cues
    if needed and not set(needed) & set(cues):
        problem = f"{name} needs {' or '.join(needed)}, which is not used"
        raise InputError("cues", problem, remedy=", or ".join(_how_to_give(CUES[cue]) for cue in needed))


def _how_to_give(cue: Cue) -> str:
    """The input that a cue needs."""
    if cue.needs_depth:
        return f"a pair of cameras (--stereo) or depth pictures (--depth), and --cues {cue.name}"
    if cue.uses_masks:
        return f"--cues {cue.name},edges, which takes masks (--mask) or learns the background"
    return f"--cues {cue.name}"


def check_smoothing(tracker: TrackerProtocol[Any], chosen: Chosen) -> None:
    """Raise InputError where hypotheses without energy are to be smoothed; if not requested it is left out."""
    asked = chosen.settings.smooth.enabled and "smooth" in chosen.changes
    if asked and capabilities_of(tracker).energy is None:
        problem = f"the hypotheses of {chosen.tracker} have no energy that could be smoothed"
        raise InputError(chosen.source or "settings", problem, place="[smooth]", remedy="leave it out")


def note_on_beginning(name: str, results: Iterable[FrameResult]) -> list[str]:
    """Notes where a tracker, of some name, found no start in any frame."""
    told = f"{name} could not start in any frame: give more cues (--cues) or keypoints"
    notes = list[str]()
    for result in results:
        if len(result.q):
            return []
        notes = [told]
    return notes


def notes_on_fit(observations: Sequence[Observation]) -> list[str]:
    """Warning where a subject was to be fitted to the person and there is nothing to fit it to."""
    if any(o.has_enough_points for o in observations):
        return []
    return [f"no frame has {MIN_POINTS} keypoints: the subject is not fitted to the person, but used unchanged"]


def _too_few(subject: Subject) -> InputError:
    problem = f"no frame has {MIN_POINTS} or more of the subject's landmarks"
    return InputError("keypoints", problem, remedy=f"landmarks: {', '.join(m.name for m in subject.landmarks)}")
