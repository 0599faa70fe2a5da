"""A live track as a run file: written beside it as the frames come, and there when it is over."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.data.observation import Observation
from estimator.runs.run_file import Run, RunHeader, RunWriter
from estimator.trackers.frame_result import FrameResult
from humanoid.support.atomic import replacing
from kinemode import __version__
from kinemode.jobs import run_findings
from kinemode.streams.stepper import Stepper


class Recording:
    """Keeps every frame of a stepper that it is told of."""

    def __init__(self, writer: RunWriter) -> None:
        self._writer = writer
        self._seen: list[Observation] = []

    def keep(self, stepper: Stepper, observation: Observation, result: FrameResult) -> None:
        """One frame, with the tracker's state after it."""
        self._seen.append(replace(observation, cues=()))  # the pictures' cues would fill the memory
        self._writer.append(result, stepper.frames.stored())

    def finish(self, header: RunHeader, frames: list[int]) -> None:
        """Complete the run; frames: the number of the clip's frame of each that the stepper was given."""
        writer = self._writer
        seen = self._seen[: writer.settle()]  # what was seen is kept first
        kept = tuple(frames[o.index] for o in seen)
        own = kept != tuple(range(len(kept)))
        names = [camera.name for camera in header.cameras] if own else []
        times = np.array([o.time for o in seen], dtype=np.float64)
        writer.put_header(replace(header, times=times, clip_frames=dict.fromkeys(names, kept)))
        writer.put_observations(seen)
        writer.put_findings(*(run_findings(Run.open(writer.path)) if seen else ((), ())))
        writer.finish()


@contextmanager
def recording(path: Path, header: RunHeader) -> Iterator[Recording]:
    """The file appears when the block ends well; raises InputError where it cannot be written."""
    with replacing(path) as temporary, RunWriter.create(temporary, header, overwrite=True) as writer:
        yield Recording(writer)


def live_header(stepper: Stepper, seed: int, clip: Path | None) -> RunHeader:
    """What a run of a stepper is made from, its times aside; clip: the file that the pictures are from."""
    subject, (camera,) = stepper.body.subject, stepper.cameras
    return RunHeader(
        subject_urdf=subject.urdf,
        subject_source=subject.source,
        subject_base=subject.base,
        cameras=stepper.cameras,
        clips={camera.name: None if clip is None else str(clip.absolute())},
        image_sizes={camera.name: camera.image_size},
        times=np.zeros(0),
        tracker=stepper.chosen.tracker,
        settings={**stepper.settings.to_dict(), "fit": "off", "person": "auto"},
        seed=seed,
        version=__version__,
        notes=stepper.notes,
        cues=stepper.cues,
    )
