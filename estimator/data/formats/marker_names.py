"""Names of markers as capture software writes them: the person's prefix, unlabelled points, and outputs of a model.

Vicon's Plug-in Gait and models like it write joint angles, forces, moments, powers and centres of mass as points of the
file (`LKneeAngles`). They are distinguished from markers by a quantity after the name of a joint or segment. Markers
may have such a word without one, such as the angles of the scapula and of the jaw (`RInferiorAngle`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from humanoid.support.errors import InputError, shown

_UNNAMED = re.compile(r"\*.*|u\d+|(un(label+ed|named|known|identified)|new ?marker)([ _-]?\d+)?", re.IGNORECASE)

_JOINTS = "hip|knee|ankle|elbow|wrist"
_PARTS = f"{_JOINTS}|shoulder|neck|waist|spine|lumbar|thorax|trunk|pelvis|head"
_GAP = r"[ _\-]?"
_SIDE = f"(?:(?:left|right|l|r){_GAP})?"
_OUTPUTS = {
    "angles": rf"{_SIDE}(?:(?:abs{_GAP})?(?:{_PARTS}|foot{_GAP}progress(?:ion)?){_GAP}angles|"
    rf"(?:abs{_GAP})?(?:{_JOINTS}|foot{_GAP}progress(?:ion)?){_GAP}angle)",
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
