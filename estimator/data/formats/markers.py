"""Names of markers as capture software writes them, and which markers of a file are landmarks.

A landmark is a joint centre. So are points that are called joint centres (RHJC, L_HJC_reg, right_knee_center), the
middle of a joint's lateral and medial markers, and a detector's points (RHip, LKnee). A marker on the skin is not a
landmark: in a file with such markers, only explicit names of joint centres count. OpenCap's `_study` markers are places
on the skin, too.

Names may begin with a person's prefix, and some points are unlabelled. Vicon's Plug-in Gait and models like it write
joint angles, forces, moments, powers and centres of mass as points of the file (`LKneeAngles`). They are distinguished
from markers by a quantity after the name of a joint or segment. Markers may have such a word without one, such as the
angles of the scapula and of the jaw (`RInferiorAngle`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from humanoid.subject.landmarks import landmark_name
from humanoid.support.errors import InputError, shown

_LETTERS = {"h": "hip", "k": "knee", "a": "ankle", "s": "shoulder", "e": "elbow", "w": "wrist"}
_JOINTS = "|".join(_LETTERS.values())
_CENTRE = re.compile(rf"([{''.join(_LETTERS)}])jc(?:_reg)?|({_JOINTS})_(?:jc|cent(?:er|re)|joint_cent(?:er|re))")
_PAIRED = ("knee", "ankle", "elbow", "wrist")
_LATERAL = ("{}_lat", "{}_lateral", "lat_{}", "lateral_{}", "l{}", "{}")
_MEDIAL = ("{}_med", "{}_medial", "med_{}", "medial_{}", "m{}")
_OTHER_PAIRS = (("wrist", "wrist_radius", "wrist_ulna"),)
_SKIN = re.compile(
    r"[ap]sis|^(c7|t10|clav|strn|sacr|asi|psi|kne|ank|tib|thi|fhd|bhd|sho|elb|wra|wrb)$|sternum|thigh|shank|calc|meta|"
    r"humerus|forearm|radius|ulna|acrom|condyle|malleol|^[lm](knee|ankle|elbow|wrist)$|_(lat|med|lateral|medial)$|"
    rf"^[{''.join(_LETTERS)}]jc"
)
_HEAD_END = re.compile(r"head|[fb]hd|nose|ears?|eyes?|c7|neck|clav|strn|sternum|acrom|^sho|shoulder|^t10?$")
_FOOT_END = re.compile(r"heel|^hee$|toe|ankle|^ank$|malleol|calc|meta|^mt[h125]|foot|^d1m$")
_SIDES = {"l": "left", "r": "right", "left": "left", "right": "right"}
_SIDED = re.compile(r"(?:(left|right|l|r)_|([LR])(?=[A-Z]))(.+)", re.IGNORECASE)
_SPREADS = (0.05, 10.0)  # of a person's or robot's markers in a frame, from the smallest to the largest [m]


class _Marker(NamedTuple):
    side: str  # left, right, or nothing
    part: str
    predicted: bool  # by OpenCap's network, which calls it so


class NamedPoints(NamedTuple):
    """names (L): landmarks, and other markers by their names in the file. points (T, L, 3). sources: the markers of
    every landmark that has another name in the file."""

    names: tuple[str, ...]
    points: np.ndarray
    sources: Mapping[str, tuple[str, ...]]


def named_points(names: Sequence[str], points: np.ndarray) -> NamedPoints:
    """Markers (L) at points (T, L, 3) as landmarks: each that is one has its landmark's name, middles are added at the
    end."""
    places = _places(names)
    alone = {chosen[0]: landmark for landmark, chosen in places.items() if len(chosen) == 1}
    middles = {landmark: chosen for landmark, chosen in places.items() if len(chosen) == 2}
    all_names = (*(alone.get(i, name) for i, name in enumerate(names)), *middles)
    added = [points[:, list(chosen)].mean(axis=1, keepdims=True) for chosen in middles.values()]
    sources = {
        landmark: tuple(names[i] for i in chosen) for landmark, chosen in places.items() if names[chosen[0]] != landmark
    }
    return NamedPoints(all_names, np.concatenate([points, *added], axis=1), sources)


def body_ends(names: Sequence[str]) -> tuple[list[int], list[int]]:
    """Numbers of the markers that are on head, neck and shoulders, and of those on feet and ankles, by their names."""
    parts = [_marker(name).part for name in names]
    head, foot = ([i for i, part in enumerate(parts) if end.search(part)] for end in (_HEAD_END, _FOOT_END))
    return [i for i in head if i not in foot], foot


def check_spread(points: np.ndarray, unit: str, path: str | Path, option: str = "") -> None:
    """Raise InputError where the markers (T, L, 3) [m] of a frame are nearer or further apart than in any body; option:
    by which the unit can be given."""
    known = points[np.isfinite(points).all(axis=2).sum(axis=1) > 1]
    if not len(known):
        return
    spread = float(np.median(np.linalg.norm(np.nanmax(known, axis=1) - np.nanmin(known, axis=1), axis=1)))
    if not _SPREADS[0] <= spread <= _SPREADS[1]:
        problem = f"its markers are spread over {spread:.3g} m, read in {unit}"
        remedy = f"{_SPREADS[0]:g} to {_SPREADS[1]:g} m: correct the unit" + (
            f", or give it with {option}" if option else ""
        )
        raise InputError(path, problem, place="Units", remedy=remedy)


def _places(names: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """The marker, or the two whose midpoint it is, of every available landmark."""
    markers = [_marker(name) for name in names]
    of_skin = any(_SKIN.search(marker.part) for marker in markers if not marker.predicted)
    places: dict[str, tuple[int, ...]] = {}
    for i, name in enumerate(names):
        if name == landmark_name(name):
            places.setdefault(name, (i,))
    for i, marker in enumerate(markers):
        centre = _CENTRE.fullmatch(marker.part)
        if centre and marker.side:
            places.setdefault(f"{marker.side}_{_LETTERS.get(centre[1] or '', centre[2])}", (i,))
    at = {marker: i for i, marker in reversed(list(enumerate(markers)))}
    for predicted in (False, True):
        for side in ("left", "right"):
            for joint, lateral, medial in _pairs():
                pair = tuple(at.get(_Marker(side, part, predicted), -1) for part in (lateral, medial))
                if min(pair) >= 0:
                    places.setdefault(f"{side}_{joint}", pair)
    for i, name in enumerate(names):
        landmark = landmark_name(name)
        if landmark is not None and not of_skin:
            places.setdefault(landmark, (i,))
    return places


def _pairs() -> list[tuple[str, str, str]]:
    """A joint's name, and the parts that its lateral and medial markers are called."""
    spelled = [(joint, a.format(joint), b.format(joint)) for joint in _PAIRED for a in _LATERAL for b in _MEDIAL]
    return [*spelled, *_OTHER_PAIRS]


def _marker(name: str) -> _Marker:
    text = re.sub(r"[\s.\-]+", "_", name.strip())
    predicted = text.lower().endswith("_study")
    text = text[: -len("_study")] if predicted else text
    sided = _SIDED.fullmatch(text)
    side, part = (_SIDES[(sided[1] or sided[2]).lower()], sided[3]) if sided else ("", text)
    return _Marker(side, re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", part).lower(), predicted)


_UNNAMED = re.compile(r"\*.*|u\d+|(un(label+ed|named|known|identified)|new ?marker)([ _-]?\d+)?", re.IGNORECASE)

_NAMED_JOINTS = "hip|knee|ankle|elbow|wrist"
_PARTS = f"{_NAMED_JOINTS}|shoulder|neck|waist|spine|lumbar|thorax|trunk|pelvis|head"
_GAP = r"[ _\-]?"
_SIDE = f"(?:(?:left|right|l|r){_GAP})?"
_OUTPUTS = {
    "angles": rf"{_SIDE}(?:(?:abs{_GAP})?(?:{_PARTS}|foot{_GAP}progress(?:ion)?){_GAP}angles|"
    rf"(?:abs{_GAP})?(?:{_NAMED_JOINTS}|foot{_GAP}progress(?:ion)?){_GAP}angle)",
    "forces": rf"{_SIDE}(?:(?:{_PARTS}|ground{_GAP}reaction){_GAP}forces?|normali[sz]ed{_GAP}grf)",
    "moments": rf"{_SIDE}(?:{_PARTS}|ground{_GAP}reaction){_GAP}moments?",
    "powers": rf"{_SIDE}(?:{_PARTS}){_GAP}powers?",
    "centres of mass": rf"(?:total{_GAP}body{_GAP})?cent(?:re|er){_GAP}of{_GAP}mass(?:{_GAP}floor)?",
}
_KINDS = {kind: re.compile(pattern, re.IGNORECASE) for kind, pattern in _OUTPUTS.items()}


def is_unnamed(label: str) -> bool:
    """Whether a name is one that software gives to unidentified points: `*12`, `U12`, `unlabeled_3`, or nothing."""
    return not label.strip() or _UNNAMED.fullmatch(label.rpartition(":")[2].strip()) is not None


def output_kind(label: str) -> str | None:
    """Kind of a gait model's output by the name of its point, such as "angles"; None for markers."""
    name = label.rpartition(":")[2].strip()
    return next((kind for kind, pattern in _KINDS.items() if pattern.fullmatch(name)), None)


def outputs_note(labels: Sequence[str]) -> str:
    """A note on the outputs of a model among some labels, with how many there are of each kind; empty without any."""
    counts = Counter(kind for label in labels if (kind := output_kind(label)) is not None)
    kinds = ", ".join(f"{kind} {counts[kind]}" for kind in _KINDS if counts[kind])
    return f"{counts.total()} outputs of a gait model ({kinds}) are left out, by their names" if kinds else ""


def of_one_person(path: str | Path, labels: Sequence[str]) -> tuple[str, ...]:
    """Labels without the person's prefix, as in `ann:LKNE`; raises InputError where there are several people."""
    people = sorted({label.rpartition(":")[0] for label in labels} - {""})
    if len(people) > 1:
        problem = f"has the markers of several people: {shown(', '.join(people))}"
        raise InputError(path, problem, remedy="keep those of one")
    return tuple(label.rpartition(":")[2].strip() for label in labels)


def check_names(path: str | Path, names: Sequence[str], place: str = "") -> None:
    """Raise InputError where a marker appears twice."""
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise InputError(path, f"the point {shown(twice)} appears twice", place=place, remedy="rename or drop one")
