"""Which limbs and points of a body follow which of a source."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from humanoid.support.errors import InputError, shown

_SIDES = ("left", "right")
_SEGMENTS = {
    "thigh": ("hip", "knee"), "shank": ("knee", "ankle"), "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
}  # fmt: skip
_ACROSS = {"hips": "hip", "shoulders": "shoulder"}
_ACROSS_WEIGHT = 0.5  # a line across the trunk is short, and leans with every limb that moves


@dataclass(frozen=True)
class MatchedLimb:
    """A direction: from the middle of some landmarks to that of others, of the source and of the subject, which may be
    called differently there. weight: relative to the other limbs."""

    name: str
    source_from: tuple[str, ...]
    source_to: tuple[str, ...]
    subject_from: tuple[str, ...]
    subject_to: tuple[str, ...]
    weight: float = 1.0

    @property
    def landmarks(self) -> set[str]:
        """All that it needs, under the names of either."""
        return {*self.source_from, *self.source_to, *self.subject_from, *self.subject_to}


@dataclass(frozen=True)
class MatchedPlace:
    """A landmark of the subject that is led to where one of the source is, relative to another one of each where these
    are named, in the subject's scale. weight: relative to the other places."""

    subject: str
    source: str
    subject_about: str | None = None
    source_about: str | None = None
    weight: float = 1.0


@dataclass(frozen=True)
class Correspondence:
    """limbs: directions that are alike. places: points that are led to each other, beside the hips and the feet, which
    the whole body follows. scale: lengths of the subject over those of the source; by legs, or by places, unless
    given. source: where it was written, for messages."""

    limbs: tuple[MatchedLimb, ...]
    places: tuple[MatchedPlace, ...] = ()
    scale: float | None = None
    source: str = "correspondence"


def _same(name: str, first: tuple[str, ...], last: tuple[str, ...], weight: float = 1.0) -> MatchedLimb:
    return MatchedLimb(name, first, last, first, last, weight)


def _of_a_person() -> tuple[MatchedLimb, ...]:
    limbs = [
        _same(f"{side}_{name}", (f"{side}_{a}",), (f"{side}_{b}",))
        for side in _SIDES
        for name, (a, b) in _SEGMENTS.items()
    ]
    pairs = {name: tuple(f"{side}_{joint}" for side in _SIDES) for name, joint in _ACROSS.items()}
    limbs.append(_same("trunk", pairs["hips"], pairs["shoulders"]))
    limbs.append(_same("head", pairs["shoulders"], ("head_top",)))
    limbs += [_same(name, pair[1:], pair[:1], _ACROSS_WEIGHT) for name, pair in pairs.items()]
    return tuple(limbs)


PERSON_LIMBS = _of_a_person()
"""Thighs, shanks, arms, trunk and head, and the lines across hips and shoulders, of who has COCO's landmarks."""


def common_correspondence(subject: Collection[str], source: Collection[str]) -> Correspondence:
    """By the landmarks' names (of the subject and the source) that both have: thighs, shanks, arms, feet, the trunk,
    the head, and the lines across hips and shoulders.

    Raises
    ------
    InputError: they have no limb in common.
    """
    known = person_limbs(set(subject) & set(source))
    if not known:
        raise InputError(
            "correspondence", f"no limb is named alike; the subject has {_some(subject)}, the source {_some(source)}",
            remedy="begin one with --match SUBJECT --out match.toml",
        )  # fmt: skip
    return Correspondence(known)


def person_limbs(landmarks: Collection[str]) -> tuple[MatchedLimb, ...]:
    """Those of a person whose ends are all among some landmarks."""
    return tuple(limb for limb in PERSON_LIMBS if limb.landmarks <= set(landmarks))


def _some(names: Collection[str]) -> str:
    return shown(", ".join(sorted(names)[:8]) or "none")


def check_correspondence(match: Correspondence, subject: Sequence[str], source: Sequence[str]) -> None:
    """Raise InputError for a landmark that the subject or the source does not have."""
    for limb in match.limbs:
        _check(match, f"limb {limb.name}", (*limb.subject_from, *limb.subject_to), subject, "the subject")
        _check(match, f"limb {limb.name}", (*limb.source_from, *limb.source_to), source, "the source")
    for place in match.places:
        of_subject, of_source = (place.subject, place.subject_about), (place.source, place.source_about)
        _check(match, f"place {place.subject}", [n for n in of_subject if n], subject, "the subject")
        _check(match, f"place {place.subject}", [n for n in of_source if n], source, "the source")


def _check(match: Correspondence, place: str, wanted: Sequence[str], known: Sequence[str], whose: str) -> None:
    for name in wanted:
        if name not in known:
            remedy = f"{whose} has {', '.join(sorted(known))}"
            raise InputError(match.source, f"{whose} has no landmark {shown(name)}", place=place, remedy=remedy)
