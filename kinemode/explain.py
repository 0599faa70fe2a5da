"""The parts of a hypothesis' energy, term by term and camera by camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.clip import Clip
from estimator.data.observation import Observation
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.runs.keypoint_residuals import KeypointResiduals, keypoint_residuals
from estimator.runs.run_reader import Run
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import capabilities_of
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import Settings, make_tracker, settings_for, stored_changes
from estimator.vision.cues.base import ExplainedPose, PastPose
from estimator.vision.cues.image_likelihood import CameraLikelihood, ImageLikelihood
from estimator.vision.cues.learned import with_learned, without_learned
from estimator.vision.cues.reader import CueReader, persons_before
from estimator.vision.cues.settings import CUES
from estimator.vision.resolution import scaled_camera
from humanoid.kinematics.body import Body, PosedBody
from humanoid.support.errors import InputError
from humanoid.support.plugins import VARIABLE
from kinemode import __version__
from kinemode.energy_parts import Case, EnergyPart, energy_parts
from viz import palette
from viz.cue_pictures import CueView

_LARGEST = 960  # longer side of the pictures of a run without cues [px]


@dataclass(frozen=True)
class Explanation:
    """The energy of one hypothesis, as far as it can be computed again.

    file: the run's. frame, hypothesis: which, and status, weight, association: as stored (see `FrameResult`).
    parts: of the energy. stored: the energy as the run has it. notes: where the hypothesis came from, and why the parts
    may add up to something else. views (C): what there is for pictures of each camera. origin: what the run has of
    where the hypothesis came from, None where it was made before that was kept. extra: what the tracker stored of the
    frame beside its hypotheses. keypoints: how far they lie from where the body has them along the trajectory, in this
    frame alone; None without any.
    """

    file: Path
    frame: int
    hypothesis: int
    status: str
    weight: float
    association: str
    parts: tuple[EnergyPart, ...]
    stored: float
    notes: tuple[str, ...]
    views: tuple[CueView, ...]
    parent: int = -1
    origin: Origin | None = None
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    keypoints: KeypointResiduals | None = None

    @property
    def total(self) -> float:
        """Sum of the parts."""
        return float(sum(part.energy for part in self.parts))


def explain(run: Run, frame: int, hypothesis: int | None = None) -> Explanation:
    """The energy of a frame's hypothesis in its parts, and what pictures of it need; of a tracker whose hypotheses have
    no energy the images alone, and what it stored.

    run: finished or not. frame: its number. hypothesis: its place in the frame, 0 for the heaviest; the one on the best
    path unless given.

    Raises
    ------
    InputError: no such frame or hypothesis, a frame without an observation of its own, a clip that the run was made
        from and that cannot be read any more.
    """
    if run.header.retargeted:
        raise InputError(run.file, "was made from another motion, not tracked", remedy="open it with kinemode view")
    k = _chosen(run, frame, hypothesis)
    settings = run_settings(run)
    can = capabilities_of(make_tracker(run.header.tracker, run.body, settings))
    with reopened_cues(run, settings) as reader:
        observation = as_tracked(run, frame, reader)
    result, cameras = run.result(frame), range(len(observation.cameras))
    if can.seen_as is not None:
        observation = can.seen_as(observation, result)
    stored, parts = float(result.energy[k]), tuple[EnergyPart, ...]()
    if can.energy is not None:
        case = _case(run, can.energy, observation, k)
        parts = tuple(energy_parts(case))
        notes = tuple(_notes(run, case, result, sum(p.energy for p in parts) - stored))
        views = tuple(_view(run, case, c) for c in cameras)
    else:
        notes = (f"the hypotheses of {run.header.tracker} have no energy that could be taken apart",)
        views = tuple(_pose_view(run, observation, run.body.at(result.q[k]), c) for c in cameras)
    if can.pictures is not None and observation.cues:
        more = can.pictures(observation, result)
        views = tuple(
            replace(view, pictures=(*view.pictures, more[c])) if c in more else view for c, view in enumerate(views)
        )
    return Explanation(
        run.file, frame, k, result.status, float(result.weight[k]), result.association[k], parts, stored, notes, views,
        int(result.parent[k]), None if result.origins is None else result.origins.of_mode(k),
        without_learned(result.extra),
        keypoint_residuals(run, settings.cost, [frame]),
    )  # fmt: skip


def _chosen(run: Run, frame: int, hypothesis: int | None) -> int:
    if not 0 <= frame < len(run):
        have = f"--frame 0 to {len(run) - 1}" if len(run) else "track with --resume first"
        raise InputError(run.file, f"has no frame {frame}", remedy=have)
    result = run.result(frame)
    if len(result.q) == 0 or result.status == "unobserved":
        seen = np.flatnonzero((run.status != "unobserved") & (np.arange(len(run)) < frame))
        kept = f"its hypotheses are those of frame {seen[-1]}" if len(seen) else "it lies before the first pose"
        remedy = f"--frame {seen[-1]}" if len(seen) else f"first pose: {_first_pose(run)}"
        raise InputError(run.file, f"nothing was observed; {kept}", place=f"frame {frame}", remedy=remedy)
    k = int(run.path[frame]) if hypothesis is None else hypothesis
    if not 0 <= k < len(result.q):
        remedy = f"--hypothesis 0 to {len(result.q) - 1}"
        raise InputError(run.file, f"has no hypothesis {k}", place=f"frame {frame}", remedy=remedy)
    return k


def _first_pose(run: Run) -> str:
    some = np.flatnonzero(run.status != "unobserved")
    return f"--frame {some[0]}" if len(some) else "none yet"


def run_settings(run: Run) -> Settings:
    """The settings that a run was made with; InputError where it used a cue that is not there any more."""
    for name in run.header.cues:
        if name not in CUES:
            problem = f"was made with the cue {name!r}, which is not here: there are {', '.join(CUES)}"
            raise InputError(run.file, problem, remedy=f"{VARIABLE} names the module that has it")
    tracker = run.header.tracker
    changes = stored_changes(tracker, run.header.settings)
    return settings_for(tracker, changes=changes, source=run.file)


def cue_reader(run: Run, settings: Settings) -> CueReader:
    """The cues of the pictures that a run was made from, to be closed after use; raises InputError where they cannot be
    read any more."""
    header = run.header
    names = [camera.name for camera in header.cameras]
    clips = [Path(header.clips[name] or "") for name in names]
    masks, plates = ([Path(f[n]) if n in f else None for n in names] for f in (header.masks, header.backgrounds))
    frames = [header.frames_of(name) if name in header.clip_frames else None for name in names]
    persons = persons_before(run.subject, header.cameras, run.pixels, run.confidence, settings.cues)
    rights = [names.index(header.stereo[name]) if name in header.stereo else None for name in names]
    depths = [Path(header.depths[name]) if name in header.depths else None for name in names]
    return CueReader(
        clips, header.cameras, settings.cues, masks=masks, plates=plates, frames=frames, persons=persons,
        rights=rights, depths=depths,
    )  # fmt: skip


@contextmanager
def reopened_cues(run: Run, settings: Settings) -> Iterator[CueReader | None]:
    """See `cue_reader`, which is closed when the block ends; None of a run without pictures."""
    with closing(cue_reader(run, settings)) if run.header.cues else nullcontext() as reader:
        yield reader


def as_tracked(run: Run, frame: int, reader: CueReader | None) -> Observation:
    """A frame as it was tracked, with the cues of its pictures and what these had learned before it."""
    observation = run.observation(frame, standing=True)
    if reader is None:
        return observation
    return with_learned(replace(observation, cues=reader.at(frame)), run.result(frame).extra)


def _case(run: Run, search: ModeSearch, observation: Observation, k: int) -> Case:
    """A hypothesis with its penalised past from the run; without a past where the run has none."""
    result, body = run.result(observation.index), search.body
    before = run.result(observation.index - 1) if observation.index else None
    origin = _origin(result, k)
    previous = origin.previous
    dt = 0.0 if before is None else observation.time - before.time
    posed = body.at(result.q[k])
    return Case(
        search=search,
        observation=observation,
        association=result.association[k],
        posed=posed,
        past=None if previous is None else _past(body, previous),
        has_transition=origin.transition_from is not None,
        dt=dt,
        assigned=_posed(body, origin.q_assigned) or posed,
        likelihood=_likelihood(search, observation, origin, result if before is None or not len(before.q) else before),
    )


def _origin(result: FrameResult, k: int) -> Origin:
    return Origin(Family.START) if result.origins is None else result.origins.of_mode(k)


def _past(body: Body, previous: PreviousPose) -> PastPose:
    return PastPose(body.at(previous.q), _posed(body, previous.q_predicted), _posed(body, previous.q_left))


def _posed(body: Body, q: np.ndarray | None) -> PosedBody | None:
    return None if q is None else body.at(q)


def _likelihood(search: ModeSearch, observation: Observation, origin: Origin, about: FrameResult) -> ImageLikelihood:
    """The image likelihood for the extent that the search used; `about`: a frame to measure it in where the run does
    not."""
    likelihood = search.likelihood(observation, about.q[0])
    if len(origin.extent) != len(likelihood.cameras):
        return likelihood
    cameras = zip(likelihood.cameras, origin.extent, strict=True)
    return ImageLikelihood(tuple(CameraLikelihood(c.model, c.cues, extent, c.detected) for c, extent in cameras))


def _notes(run: Run, case: Case, result: FrameResult, difference: float) -> Iterator[str]:
    """Why the parts may add up to something else than the run has."""
    if run.header.version != __version__:
        yield f"the run is of kinemode {run.header.version}, this is {__version__}"
    if result.origins is not None:
        return
    if case.observation.index:
        yield (
            "the run does not store its hypotheses' previous poses, so the change since the frame before and the flow"
            f" from there are left out ({difference:+.3f}): it was made by a kinemode that did not keep it; track again"
        )
    if case.likelihood.cameras:
        yield "the pictures' features are assigned again at the pose; the search assigned them a little before it ended"


def _view(run: Run, case: Case, c: int) -> CueView:
    """What the pictures of one camera are drawn from."""
    view = _pose_view(run, case.search.associated(case.observation, case.association), case.posed, c)
    cameras = case.likelihood.cameras
    return _with_cues(view, case, cameras[c]) if cameras else view


def _pose_view(run: Run, seen: Observation, posed: PosedBody, c: int) -> CueView:
    """The same without the cues' features. seen: the frame as the hypothesis reads it."""
    camera = seen.cameras[c]
    cues = seen.cues[c] if seen.cues else None
    small = scaled_camera(camera, min(1.0, _LARGEST / max(camera.image_size))) if cues is None else cues.camera
    ratio = np.array(small.image_size) / np.array(camera.image_size)
    keypoints = np.where(seen.confidence[c, :, None] > 0.0, (seen.pixels[c] + 0.5) * ratio - 0.5, np.nan)
    landmarks = small.project(run.body.landmarks(posed))
    picture = _image(run, small, seen.index) if cues is None or cues.picture is None else cues.picture
    return CueView(small.name, picture, run.body.landmark_names, keypoints, landmarks)


def _image(run: Run, camera: Camera, instant: int) -> np.ndarray:
    """The camera's picture at its size; a plain one where the run was made without."""
    path = run.header.clips.get(camera.name)
    if path is None or not (run.header.cues or Path(path).exists()):
        return palette.plain(*camera.image_size)
    clip, frame = Clip.open(path), int(run.header.frames_of(camera.name)[instant])
    try:
        return np.asarray(cv2.resize(clip.frame(frame), camera.image_size, interpolation=cv2.INTER_AREA))
    except IndexError:
        raise InputError(path, "has no such frame any more", place=f"frame {frame}") from None
    finally:
        clip.close()


def _with_cues(view: CueView, case: Case, likelihood: CameraLikelihood) -> CueView:
    prediction, assigned = (likelihood.predictor.predict(at) for at in (case.posed, case.assigned))
    shown = ExplainedPose(case.posed, prediction, assigned, case.past)
    return replace(view, prediction=prediction, pictures=tuple(likelihood.pictures(shown)))
