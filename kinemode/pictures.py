"""Whether the pictures of a clip are looked at, and what for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.imaging.ahead import ReadAhead
from estimator.imaging.cues import CueReader, CueSettings
from estimator.trackers.beginning import enough_keypoints
from estimator.tracking.idle_settings import Idle
from humanoid.support.errors import InputError
from kinemode.inputs.load import Inputs

CUES = ("edges", "flow", "silhouette")
ENOUGH = 0.5  # share of frames with keypoints from which keypoints alone are tracked unless cues are asked for
ON_SILHOUETTE = 0.6  # share of the keypoints that a silhouette has to cover to be the person's
_NEAR = 3.0  # px around it, at the cues' resolution
CueChoice = tuple[str, ...] | None
"""The cues that are asked for, none of them to go without; None where the input decides."""


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
    choice: CueChoice, inputs: Inputs, settings: CueSettings, source: str | Path | None = None
) -> CueSettings | None:
    """Settings of the cues to look at, None to track from keypoints alone. source: the file they are from, for errors.

    Left to decide, all cues that the settings allow are used where there are clips and most frames lack keypoints.

    Raises
    ------
    InputError: cues without clips, or that the settings switch off; masks or backgrounds without a use for them.
    """
    if choice is None:
        found = settings if None not in inputs.clips and keypoint_share(inputs) < ENOUGH else None
        return found if found is not None and names_of(found) else None
    extras = [path for path in (*inputs.masks, *inputs.backgrounds) if path is not None]
    if extras and "silhouette" not in choice:
        raise InputError(extras[0], "is for the silhouette, which is not looked at", remedy="--cues silhouette")
    if choice and None in inputs.clips:
        raise InputError("cues", f"{', '.join(choice)} need the pictures", remedy="give the clips, or --cues off")
    for name in choice:
        if name not in names_of(settings):
            raise Idle(f"cues.use_{name}", f"--cues asks for {name}").refused(source)
    return with_cues(settings, choice) if choice else None


def keypoint_share(inputs: Inputs) -> float:
    """Share of the frames whose keypoints are enough for a pose."""
    return sum(enough_keypoints(o) for o in inputs.observations) / len(inputs.observations)


def with_cues(settings: CueSettings, names: tuple[str, ...]) -> CueSettings:
    """Settings that use these cues and no others."""
    edges, flow, silhouette = (name in names for name in CUES)
    return replace(settings, use_edges=edges, use_flow=flow, use_silhouette=silhouette)


def names_of(settings: CueSettings | None) -> tuple[str, ...]:
    """The cues that are used; none for None."""
    if settings is None:
        return ()
    uses = (settings.use_edges, settings.use_flow, settings.use_silhouette)
    return tuple(name for name, used in zip(CUES, uses, strict=True) if used)


def notes_on(choice: CueChoice, inputs: Inputs, chosen: CueSettings | None) -> list[str]:
    """What a user should know of the choice."""
    usable = [enough_keypoints(o) for o in inputs.observations]
    count = f"keypoints in {sum(usable)} of {len(usable)} frames"
    if choice is None and chosen is not None:
        return [f"{count}: the pictures are looked at too ({', '.join(names_of(chosen))})"]
    if choice is None and any((*inputs.masks, *inputs.backgrounds)):
        return [f"{count}: masks and backgrounds are not looked at; --cues {','.join(CUES)} does"]
    return []


def notes_on_silhouettes(reader: ReadAhead, inputs: Inputs) -> list[str]:
    """The cameras whose silhouette is not where the first keypoints are, where there are any.

    A background learned from a clip takes a person who hardly moves for part of the scene.
    """
    first = next((o for o in inputs.observations if enough_keypoints(o)), None)
    notes: list[str] = []
    if first is None:
        return notes
    for camera, cues, pixels, confidence in zip(
        first.cameras, reader.at(first.index), first.pixels, first.confidence, strict=True
    ):
        seen = pixels[(confidence > 0.0) & np.isfinite(pixels).all(axis=-1)]
        if cues.silhouette is None or len(seen) == 0:
            continue
        size = np.array(cues.camera.image_size)
        at = np.clip((seen + 0.5) * size / camera.image_size, 0, size - 1).astype(int)
        share = float(np.mean(cues.silhouette.distance[at[:, 1], at[:, 0]] < _NEAR))
        if share < ON_SILHOUETTE:
            found = f"{camera.name}: the silhouette of frame {first.index} has {share:.0%} of the keypoints on it"
            notes.append(f"{found}; give masks or a picture of the empty scene, or leave it out: --cues edges,flow")
    return notes


@contextmanager
def opened_cues(inputs: Inputs, chosen: CueSettings | None) -> Iterator[ReadAhead | None]:
    """The reader of the chosen cues, closed when the block ends; None where no pictures are looked at."""
    if chosen is None:
        yield None
        return
    clips: list[Path] = [clip for clip in inputs.clips if clip is not None]
    cameras = inputs.observations[0].cameras
    reader = ReadAhead(
        CueReader(clips, cameras, chosen, masks=inputs.masks, plates=inputs.backgrounds, frames=inputs.frames)
    )
    try:
        yield reader
    finally:
        reader.close()
