"""Which cues of a clip's images are used."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from estimator.tracking.unused_settings import UnusedSetting
from estimator.vision.cues.reader import CueReader, ReadAhead, persons_before
from estimator.vision.cues.settings import CUES, CueSettings, cues_of
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.inputs.load import Inputs

ENOUGH = 0.5  # share of frames with keypoints from which keypoints alone are used unless cues are given
CueChoice = tuple[str, ...] | None
"""The requested cues, all required; None where the input decides."""


def cue_choice(given: str | Iterable[str]) -> CueChoice:
    """A choice from "auto", "off", a comma-separated text or names; raises InputError for an unknown name."""
    names = [name.strip() for name in given.split(",")] if isinstance(given, str) else list(given)
    if names == ["auto"]:
        return None
    if names in ([], ["off"]):
        return ()
    for name in names:
        if name not in CUES:
            remedy = f"auto, off, or some of {', '.join(CUES)}, separated by commas"
            raise InputError("cues", f"there is no cue {name!r}", remedy=remedy)
    return tuple(name for name in CUES if name in names)


def chosen_cues(
    choice: CueChoice,
    inputs: Inputs,
    settings: CueSettings,
    source: str | Path | None = None,
    *,
    learning: bool = False,
) -> CueSettings | None:
    """Settings of the cues to use, None to track from keypoints alone. source: the file they are from, for errors.
    learning: whether the cues can learn from frame to frame.

    Left to decide, the cues that the settings allow are used where there are clips and most frames lack keypoints, or
    where there is depth. Where there is depth, those that were not measured beside it are left out.

    Raises
    ------
    InputError: cues without clips, or that the settings switch off; masks, backgrounds or depth without a use for
        them; depth that is requested and not given.
    """
    if choice is None:
        wanted = inputs.has_depth or keypoint_share(inputs) < ENOUGH
        known = [CUES[name] for name in names_of(settings) if learning or not CUES[name].learns]
        possible = [c.name for c in known if (c.beside_depth if inputs.has_depth else not c.needs_depth)]
        return settings.using(possible) if possible and wanted and None not in inputs.clips else None
    if inputs.has_depth and not any(CUES[name].needs_depth for name in choice):
        users = " or ".join(name for name, cue in CUES.items() if cue.needs_depth)
        raise InputError("depth", f"is for the cue {users}, which is not used", remedy=f"--cues {users}")
    extras = [path for path in (*inputs.masks, *inputs.backgrounds) if path is not None]
    takers = [cue.name for cue in CUES.values() if cue.uses_masks]
    if extras and not set(takers) & set(choice):
        problem = f"is for the {' and the '.join(takers)}, which is not used"
        raise InputError(extras[0], problem, remedy=f"--cues {takers[0]}")
    if choice and None in inputs.clips:
        raise InputError("cues", f"{', '.join(choice)} need the pictures", remedy="give the clips, or --cues off")
    for name in choice:
        if CUES[name].needs_depth and not inputs.has_depth:
            remedy = "name a pair of cameras with --stereo or a folder of depth pictures with --depth"
            raise InputError("cues", f"{name} needs depth, and none is given", remedy=remedy)
        if name not in names_of(settings):
            raise UnusedSetting(f"cues.use_{name}", f"--cues requests {name}").refused(source)
    return settings.using(choice) if choice else None


def keypoint_share(inputs: Inputs) -> float:
    """Share of the frames whose keypoints are enough for a pose."""
    return sum(o.has_enough_points for o in inputs.observations) / len(inputs.observations)


def names_of(settings: CueSettings | None) -> tuple[str, ...]:
    """The cues that are used; none for None."""
    return () if settings is None else settings.used


def notes_on(choice: CueChoice, inputs: Inputs, chosen: CueSettings | None) -> list[str]:
    """Notes on the choice."""
    usable = [o.has_enough_points for o in inputs.observations]
    count = f"keypoints in {sum(usable)} of {len(usable)} frames"
    if choice is None and chosen is not None:
        return [f"{count}: the pictures are used too ({', '.join(names_of(chosen))})"]
    if choice is None and any((*inputs.masks, *inputs.backgrounds)):
        return [f"{count}: masks and backgrounds are not used; --cues {','.join(CUES)} does"]
    return []


def doubts(reader: ReadAhead, inputs: Inputs, chosen: CueSettings) -> list[str]:
    """The cameras in which a cue is not where the first keypoints are, where there are any."""
    first = next((o for o in inputs.observations if o.has_enough_points), None)
    notes: list[str] = []
    if first is None:
        return notes
    for camera, read, pixels, confidence in zip(
        first.cameras, reader.at(first.index), first.pixels, first.confidence, strict=True
    ):
        seen = pixels[(confidence > 0.0) & np.isfinite(pixels).all(axis=-1)]
        if not len(seen):
            continue
        seen = (seen + 0.5) * np.array(read.camera.image_size) / camera.image_size - 0.5
        for cue in cues_of(read):
            if problem := cue.doubt(read, seen, first.index):
                others = ",".join(name for name in chosen.used if name != cue.name) or "off"
                notes.append(f"{camera.name}: {problem}, or leave it out: --cues {others}")
    return notes


@contextmanager
def opened_cues(subject: Subject, inputs: Inputs, chosen: CueSettings | None) -> Iterator[ReadAhead | None]:
    """The reader of the chosen cues, closed when the block ends; None where no pictures are used."""
    if chosen is None:
        yield None
        return
    clips: list[Path] = [clip for clip in inputs.clips if clip is not None]
    cameras = inputs.observations[0].cameras
    pixels, confidence = (
        np.array([getattr(o, name) for o in inputs.observations]) for name in ("pixels", "confidence")
    )
    persons = persons_before(subject, cameras, pixels, confidence, chosen)
    reader = ReadAhead(
        CueReader(
            clips,
            cameras,
            chosen,
            masks=inputs.masks,
            plates=inputs.backgrounds,
            frames=inputs.frames,
            persons=persons,
            rights=inputs.rights or None,
            depths=inputs.depths or None,
        )
    )
    try:
        yield reader
    finally:
        reader.close()
