"""`--sync auto`: clocks that the user does not know, their offsets and rates, from what moves in the cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile
from estimator.data.formats.people_tracks import crowded
from estimator.data.sequence import common_landmarks
from estimator.data.synchronisation import LONGEST, SURE_MARGIN, Synchrony, synchronised
from estimator.data.timing import SAME_RATE, CameraClock
from humanoid.support.errors import InputError
from kinemode.named import named_pairs
from kinemode.request import FileOptions

_FRACTION = 0.25  # of a frame: offsets this near to whole frames are whole frames, as cameras with one trigger have


def synchronised_clocks(
    landmarks: Sequence[str],
    people: Mapping[str, PeopleFile],
    cameras: Mapping[str, Camera],
    clocks: Mapping[str, CameraClock],
    persons: Mapping[str, str],
    files: FileOptions,
) -> tuple[dict[str, CameraClock], list[str]]:
    """The clocks with offsets, and rates where these differ, that were found for the cameras that the user gives no
    offset for, and notes on them.

    landmarks: of the body. cameras: of pictures of the size that the detectors saw. persons: who is followed in each
    camera, "auto" for the one that its file alone would choose.

    Raises
    ------
    InputError: fewer than two cameras with keypoints, or none without an offset; an uncertain offset.
    """
    names = list(people)
    if len(names) < 2:
        problem = "is for several cameras with keypoints"
        raise InputError("--sync auto", problem, remedy="leave it out, or give a keypoint file for each camera")
    given = {name for name, _ in named_pairs(files.offset)}
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
        raise _unsure(names, clocks, result, several=any(crowded(file.frames) for file in people.values()))
    rates, drifting = _rates(names, clocks, result), result.rates is not None and result.rates.differ
    set_to = {name: clocks[name].offset for name in names}
    for c, name in enumerate(names):
        if c not in held:
            later = set_to[name] + float(result.offsets[c])
            set_to[name] = _whole(later, set_to[names[held[0]]], float(result.errors[c]), rates, drifting=drifting)
    notes = [_note(set_to, held, result), *_rate_notes(names, clocks, result)]
    return {
        name: replace(_scaled(clock, result, names.index(name)), offset=set_to[name]) for name, clock in clocks.items()
    }, notes


def _scaled(clock: CameraClock, result: Synchrony, c: int) -> CameraClock:
    """The clock of camera c at the rate that was found."""
    scale = 1.0 if result.rates is None else float(result.rates.scales[c])
    if scale == 1.0:
        return clock
    pictures = None if clock.pictures is None else clock.pictures * scale
    return replace(clock, pictures=pictures, keypoints=clock.keypoints * scale, rate=clock.rate / scale)


def _rates(names: Sequence[str], clocks: Mapping[str, CameraClock], result: Synchrony) -> list[float]:
    """Frames per second of each camera."""
    return [_scaled(clocks[name], result, c).rate for c, name in enumerate(names)]


def _rate_notes(names: Sequence[str], clocks: Mapping[str, CameraClock], result: Synchrony) -> list[str]:
    """Results for clocks that run at different rates."""
    if result.rates is None or not result.rates.differ:
        return []
    clauses = [
        f"{name} at {rate:.3f} (+-{rate * result.rates.stds[c]:.3f}) where {clocks[name].rate:g} is declared"
        for c, (name, rate) in enumerate(zip(names, _rates(names, clocks, result), strict=True))
        if result.rates.scales[c] != 1.0
    ]
    each = ", ".join(clauses)
    return [f"the clocks run at different rates, from what moves, frames per second: {each}; its times are scaled"]


def _pixels(landmarks: Sequence[str], tracks: Sequence[KeypointTrack], counts: Sequence[int]) -> list[np.ndarray]:
    """Pixels (count, L, 2) of each camera, NaN where missing: of all keypoints where all have one layout, else of those
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


def _whole(offset: float, reference: float, error: float, rates: Sequence[float], *, drifting: bool) -> float:
    """The offset [s], whole frames from the reference where the cameras have one rate and nothing speaks against it.

    rates: of all cameras. drifting: whether they were found to differ from what is declared.
    """
    if max(rates) / min(rates) - 1.0 <= SAME_RATE and not drifting:
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
        f" {result.distance:.0f} px, sure (margin {result.margin.min():.1f}); give another with --offset"
    )


def _reasons(names: Sequence[str], clocks: Mapping[str, CameraClock], result: Synchrony) -> str:
    """Why clocks are uncertain."""
    usual = "too little moves, two instants look alike, or too little time is in common"
    if result.rates is None:
        return usual
    if result.rates.doubtful.any():
        which = ", ".join(name for name, doubtful in zip(names, result.rates.doubtful, strict=True) if doubtful)
        parts = (
            f"parts of the clips of {which} have different offsets: clocks run at different rates (give the true ones"
            " as fps), or frames were dropped"
        )
        alone = (result.margin[result.rates.doubtful] >= SURE_MARGIN).all()
        return parts if alone else f"{usual}, or {parts}"
    if result.rates.differ:
        each = [f"{n} at about {r:.2f}" for n, r in zip(names, _rates(names, clocks, result), strict=True)]
        return f"{usual}; clocks seem to run at different rates, frames per second: {', '.join(each)}"
    return usual


def _unsure(
    names: Sequence[str], clocks: Mapping[str, CameraClock], result: Synchrony, *, several: bool
) -> InputError:  # fmt: skip
    """The refusal of clocks that cannot be relied on, with the best guess where there is one."""
    doubtful = [c for c in range(len(names)) if not result.sure[c]]
    which = ", ".join(names[c] for c in doubtful)
    why = _reasons(names, clocks, result)
    if several:
        why += ", or the cameras' largest people are not the same (--person CAMERA=WHO)"
    problem = f"when {which} started is not certain, up to {LONGEST:g} s from the others: {why}"
    guesses = " ".join(
        f"{names[c]}={result.offsets[c]:.2f}" if result.margin[c] > 0.0 else f"{names[c]}=SECONDS" for c in doubtful
    )
    likely = " (a guess)" if any(result.margin[c] > 0.0 for c in doubtful) else ""
    return InputError("--sync auto", problem, remedy=f"--offset {guesses}{likely}")
