"""`--sync auto`: clocks that the user does not know, from what moves in the cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile
from estimator.data.formats.people_choice import crowded
from estimator.data.sequence import common_landmarks
from estimator.data.synchronisation import LONGEST, Synchrony, synchronised
from estimator.data.timing import SAME_RATE, CameraClock
from humanoid.support.errors import InputError
from kinemode.inputs.declared import Declared
from kinemode.inputs.named import named_pairs

_FRACTION = 0.25  # of a frame: offsets this near to whole frames are whole frames, as cameras with one trigger have


def synchronised_clocks(
    landmarks: Sequence[str],
    people: Mapping[str, PeopleFile],
    cameras: Mapping[str, Camera],
    clocks: Mapping[str, CameraClock],
    persons: Mapping[str, str],
    told: Declared,
) -> tuple[dict[str, CameraClock], list[str]]:
    """The clocks with offsets that were found for the cameras that the user gives none for, and a note on them.

    landmarks: of the body. cameras: of pictures of the size that the detectors saw. persons: who is looked at in each
    camera, "auto" for the one that its file alone would choose.

    Raises
    ------
    InputError: fewer than two cameras with keypoints, or none without an offset; an offset that is not sure.
    """
    names = list(people)
    if len(names) < 2:
        problem = "is for several cameras with keypoints"
        raise InputError("--sync auto", problem, remedy="leave it out, or give a keypoint file for each camera")
    given = {name for name, _ in named_pairs(told.offset)}
    if given >= set(names):
        raise InputError("--sync auto", "has nothing to find: every camera has an --offset", remedy="leave one out")
    held = [c for c, name in enumerate(names) if name in given] or [0]
    tracks = {name: people[name].one(persons[name]) for name in names}
    result = synchronised(
        [cameras[name] for name in names],
        _pixels(landmarks, [tracks[name] for name in names], [len(clocks[name].keypoints) for name in names]),
        [clocks[name].offset + clocks[name].keypoints for name in names],
        held,
    )
    if not result.sure.all():
        raise _unsure(names, result, several=any(crowded(file.frames) for file in people.values()))
    rates = [clocks[name].rate for name in names]
    set_to = {name: clocks[name].offset for name in names}
    for c, name in enumerate(names):
        if c not in held:
            later = set_to[name] + float(result.offsets[c])
            set_to[name] = _whole(later, set_to[names[held[0]]], float(result.errors[c]), rates)
    return {name: replace(clock, offset=set_to[name]) for name, clock in clocks.items()}, [_note(set_to, held, result)]


def _pixels(landmarks: Sequence[str], tracks: Sequence[KeypointTrack], counts: Sequence[int]) -> list[np.ndarray]:
    """Of each camera pixels (count, L, 2), NaN where missing: of all keypoints where all have one layout, else of those
    that are the body's landmarks."""
    alike = len({(track.layout, track.names) for track in tracks}) == 1
    made = []
    for track, count in zip(tracks, counts, strict=True):
        seen = np.where((track.confidence > 0.0)[..., None], track.pixels, np.nan)[:count]
        pixels = np.full((count, seen.shape[1] if alike else len(landmarks), 2), np.nan)
        here, there = (slice(None), slice(None)) if alike else common_landmarks(landmarks, track)
        pixels[: len(seen), here] = seen[:, there]
        made.append(pixels)
    return made


def _whole(offset: float, reference: float, error: float, rates: Sequence[float]) -> float:
    """The offset [s], whole frames from the reference where the cameras have one rate and nothing speaks against it."""
    if max(rates) / min(rates) - 1.0 <= SAME_RATE:
        frames = (offset - reference) * rates[0]
        if abs(frames - round(frames)) <= max(_FRACTION + 1e-6, error * rates[0]):
            return reference + round(frames) / rates[0]
    return round(offset, 4)


def _note(offsets: Mapping[str, float], held: Sequence[int], result: Synchrony) -> str:
    names = list(offsets)
    each = ", ".join(
        f"{name}={offsets[name]:.3f} (+-{result.errors[c]:.3f})" for c, name in enumerate(names) if c not in held
    )
    beside = ", ".join(f"{names[c]}={offsets[names[c]]:g}" for c in held)
    return (
        f"clocks from what moves, seconds after {beside}: {each}; there the rays of moving points pass each other by"
        f" {result.distance:.0f} px, sure (margin {result.margin.min():.1f}); --offset says it otherwise"
    )


def _unsure(names: Sequence[str], result: Synchrony, *, several: bool) -> InputError:
    """The refusal of clocks that cannot be relied on, with the best guess where there is one."""
    doubtful = [c for c in range(len(names)) if not result.sure[c]]
    which = ", ".join(names[c] for c in doubtful)
    why = "too little moves, two moments look alike, or too little time is in common"
    if several:
        why += ", or the cameras' largest people are not the same (--person CAMERA=WHO)"
    problem = f"when {which} started cannot be told for sure, up to {LONGEST:g} s from the others: {why}"
    guesses = " ".join(
        f"{names[c]}={result.offsets[c]:.2f}" if result.margin[c] > 0.0 else f"{names[c]}=SECONDS" for c in doubtful
    )
    likely = " (a guess)" if any(result.margin[c] > 0.0 for c in doubtful) else ""
    return InputError("--sync auto", problem, remedy=f"--offset {guesses}{likely}")
