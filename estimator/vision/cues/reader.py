"""Reads the cues of clips: the evidence of every cue used in every camera's picture at an instant."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.image_cues import ImageCues
from estimator.data.media.clip import Clip
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.settings import CUES, CueSettings
from estimator.vision.person_region import KnownPerson, known_persons
from humanoid.kinematics.body import Body
from humanoid.subject.subject import BUILT_IN, Subject, load_subject


class CueReader:
    """Reads the cues of synchronised clips, one a camera.

    clips: open clips or their paths. cameras: in the same order.
    masks: for each camera a folder of images or a video, white on the person, or None; they replace the background.
    plates: for each camera a picture of the empty scene, or None.
    frames: for each camera the number of its clip's frame at each instant (T,), or None where that is the instant's.
    persons: for each camera where the person is by the keypoints, or None (`estimator.vision.person_region`).
    rights: for each camera the number of the one to its right that makes a stereo pair with it, or None.
    depths: for each camera a folder of depth pictures (`estimator.data.media.depth_folder`), or None.

    Attributes
    ----------
    notes: for the user.

    Raises
    ------
    InputError: a file is not readable, or its size is not the camera's.
    """

    def __init__(
        self,
        clips: Sequence[Clip | Path],
        cameras: Sequence[Camera],
        settings: CueSettings,
        *,
        masks: Sequence[Path | None] | None = None,
        plates: Sequence[Path | None] | None = None,
        frames: Sequence[np.ndarray | None] | None = None,
        persons: Sequence[KnownPerson | None] | None = None,
        rights: Sequence[int | None] | None = None,
        depths: Sequence[Path | None] | None = None,
    ) -> None:
        none, size = (None,) * len(cameras), settings.working_size
        given = (masks or none, plates or none, frames or none, persons or none, depths or none)
        each = [
            CameraPictures(clip, camera, size, masks=mask, plate=plate, frames=numbers, person=person, depth=depth)
            for clip, camera, mask, plate, numbers, person, depth in zip(clips, cameras, *given, strict=True)
        ]
        for pictures, right in zip(each, rights or none, strict=True):
            pictures.right = None if right is None else each[right]
        self._views = tuple(_View(pictures, settings) for pictures in each)
        self.notes = tuple(note for view in self._views for note in view.pictures.notes)

    def at(self, index: int) -> tuple[ImageCues, ...]:
        """Cues of every camera at instant `index`, regardless of what was read before; InputError past a clip's end."""
        return tuple(view.at(index) for view in self._views)

    def close(self) -> None:
        """Let go of the files."""
        for view in self._views:
            view.pictures.close()


class _View:
    """One camera's pictures, and what each cue learns from them as a whole."""

    def __init__(self, pictures: CameraPictures, settings: CueSettings) -> None:
        self.pictures = pictures
        used = [(CUES[name], settings.of(name)) for name in settings.used]
        self._follows = any(cue.follows for cue, _ in used)
        prepared: dict[str, Any] = {}
        for cue, own in sorted(used, key=lambda each: not each[0].needs_depth):  # those that locate the person first
            prepared[cue.name] = cue.prepare(pictures, own)
            pictures.person_masks = pictures.person_masks or cue.person_masks(prepared[cue.name])
        self._used = [(cue, own, prepared[cue.name]) for cue, own in used]

    def at(self, index: int) -> ImageCues:
        if self._follows:
            self.pictures.before(index)  # read in the order of the clip, and kept
        read: dict[str, Any] = {cue.name: cue.read(self.pictures, index, s, known) for cue, s, known in self._used}
        picture = self.pictures.picture(index)
        return ImageCues(self.pictures.camera, {n: value for n, value in read.items() if value is not None}, picture)


def persons_before(
    subject: Subject, cameras: Sequence[Camera], pixels: np.ndarray, confidence: np.ndarray, chosen: CueSettings
) -> Sequence[KnownPerson] | None:
    """Where the person is by the keypoints (T, C, L, 2), confidence (T, C, L), for every camera; None where no cue
    needs it.

    The body is the unmodified built-in subject, so that a run's own, which was fitted later, gives the same.
    """
    if not any(CUES[name].uses_masks for name in chosen.used):
        return None
    shipped = load_subject(subject.source, base=subject.base) if subject.source in BUILT_IN else subject
    return known_persons(Body(shipped), cameras, pixels, confidence)


class ReadAhead:
    """A cue reader with one thread of its own, which alone touches the files; the cues are the reader's own."""

    def __init__(self, reader: CueReader) -> None:
        self._reader = reader
        self._thread = ThreadPoolExecutor(1, "cues")
        self._next: tuple[int, Future[tuple[ImageCues, ...]]] | None = None
        self.notes = reader.notes

    def at(self, index: int) -> tuple[ImageCues, ...]:
        """See `CueReader.at`; afterwards the next frame's are on their way."""
        waiting = self._next
        expected = waiting is not None and waiting[0] == index
        reading = waiting[1] if waiting is not None and expected else self._thread.submit(self._reader.at, index)
        cues = reading.result()
        self._next = (
            index + 1,
            self._thread.submit(self._reader.at, index + 1),
        )  # the error past the end does not matter
        return cues

    def close(self) -> None:
        """Wait for the thread and let go of the files."""
        self._thread.shutdown(cancel_futures=True)
        self._reader.close()
