"""The targets of a body: a source's directions and places with the body's own lengths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.retargeting.correspondence import Correspondence, MatchedPlace
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.stances import Foot, feet_of, foot_rotation
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

LIMB, HIPS, PLACE = 0.15, 0.025, 0.03
"""Standard deviations of a direction [rad], of the middle of the hips [m], of another place [m]."""
FOOT = 0.02
"""[m] of the points of a foot that does not stand."""
_LEG = (("hip", "knee"), ("knee", "ankle"))
_SIDES = ("left", "right")


class Targets(NamedTuple):
    """Linear combinations of points of the body, and where they are to be in each of T frames.

    joint (P,), local (P, 3) [m]: the points, fixed to joints, those of the feet last, three of each (see `Foot`).
    combination (R, P). target (T, R, 3), NaN where there is none, weight (T, R). feet: whose points are the last. Of
    the feet, place (T, F, 3, 3) [m]: where their points are to be; without a free root, or feet, none. scale: lengths
    of the body over those of the source. names (R): what each is.
    """

    joint: np.ndarray
    local: np.ndarray
    combination: np.ndarray
    target: np.ndarray
    weight: np.ndarray
    feet: tuple[Foot, ...]
    place: np.ndarray
    scale: float
    names: tuple[str, ...]


def targets_of(
    body: Body, source: SourceMotion, match: Correspondence, floor: float | None, flat: np.ndarray | None = None
) -> Targets:
    """The targets of a source's frames, whose floor [m] is moved to z = 0; without one there are no feet among the
    targets.

    flat (T, 2) bool: when which foot of the source, left and right, stands on heel and toes, which determines how its
    landmarks lie in a foot that is level.

    Raises InputError where neither legs nor places determine a scale.
    """
    own = {name: source.points[:, k] - np.array([0.0, 0.0, floor or 0.0]) for k, name in enumerate(source.names)}
    posed = body.at(body.neutral)
    rest = dict(zip(body.landmark_names, body.landmarks(posed), strict=True))
    feet = feet_of(body) if body.has_free_root and floor is not None else ()
    feet = tuple(foot for foot in feet if {f"{foot.side}_{p}" for p in ("hip", "knee", "ankle", "big_toe")} <= set(own))
    scale = match.scale or _scale(rest, own, feet, match)
    rows = _Rows(body, feet)
    for limb in match.limbs:
        a, b = (np.mean([own[n] for n in names], axis=0) for names in (limb.source_from, limb.source_to))
        begin, end = (np.mean([rest[n] for n in names], axis=0) for names in (limb.subject_from, limb.subject_to))
        length = float(np.linalg.norm(end - begin))
        direction = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
        shares = {**_shares(limb.subject_to, 1.0 / length), **_shares(limb.subject_from, -1.0 / length)}
        rows.add(limb.name, shares, direction, limb.weight / LIMB**2)
    for place in match.places:
        rows.add(place.subject, {place.subject: 1.0}, _place_target(place, rest, own, scale), place.weight / PLACE**2)
    place_of_feet = np.zeros((len(source.times), 0, 3, 3))
    hips = ("left_hip", "right_hip")
    if body.has_free_root and set(hips) <= set(own) and set(hips) <= set(rest):
        middle = scale * np.mean([own[n] for n in hips], axis=0)
        rows.add("hips", _shares(hips, 1.0), middle, 1.0 / HIPS**2)
        if feet:
            place_of_feet = _feet_places(rest, own, feet, middle, flat)
    return rows.targets(place_of_feet, scale)


def _shares(names: tuple[str, ...], of: float) -> dict[str, float]:
    return dict.fromkeys(names, of / len(names))


class _Rows:
    """Combinations of landmarks, one after the other."""

    def __init__(self, body: Body, feet: tuple[Foot, ...]) -> None:
        self._body, self._feet = body, feet
        self._rows: list[tuple[str, dict[str, float], np.ndarray, float]] = []

    def add(self, name: str, shares: dict[str, float], target: np.ndarray, weight: float) -> None:
        """shares: of landmarks. target (T, 3)."""
        self._rows.append((name, shares, target, weight))

    def targets(self, place: np.ndarray, scale: float) -> Targets:
        """place (T, F, 3, 3): of the feet's points."""
        body, feet = self._body, self._feet
        used = sorted({name for _, shares, _, _ in self._rows for name in shares}, key=body.landmark_names.index)
        numbers = [body.landmark_names.index(name) for name in used]
        joint = np.concatenate([body.landmark_joint[numbers], *([foot.joint] * 3 for foot in feet)]).astype(np.int64)
        local = np.concatenate([body.landmark_local[numbers], *(foot.local for foot in feet)])
        count = len(self._rows) + 3 * len(feet)
        combination = np.zeros((count, len(joint)))
        for row, (_, shares, _, _) in enumerate(self._rows):
            for name, share in shares.items():
                combination[row, used.index(name)] = share
        for k in range(3 * len(feet)):
            combination[len(self._rows) + k, len(used) + k] = 1.0
        frames = len(self._rows[0][2])
        target = np.concatenate([*(t[:, None] for _, _, t, _ in self._rows), place.reshape(frames, -1, 3)], axis=1)
        weights = [w for _, _, _, w in self._rows] + [1.0 / FOOT**2] * (3 * len(feet))
        weight = np.where(np.isfinite(target).all(axis=2), np.array(weights), 0.0)
        names = [name for name, *_ in self._rows]
        names += [f"{foot.side}_{part}" for foot in feet for part in ("heel", "big_toe", "foot_side")]
        return Targets(joint, local, combination, target, weight, feet, place, scale, tuple(names))


def _scale(
    rest: dict[str, np.ndarray], own: dict[str, np.ndarray], feet: tuple[Foot, ...], match: Correspondence
) -> float:
    """The scale by the legs down to the soles where there are feet, else by legs, or by how far places reach."""
    legs = [(f"{s}_{a}", f"{s}_{b}") for s in _SIDES for a, b in _LEG]
    known = {name for name, points in own.items() if np.isfinite(points).any()}
    legs = [pair for pair in legs if set(pair) <= known & set(rest)]
    if legs:
        of_body = sum(float(np.linalg.norm(rest[a] - rest[b])) for a, b in legs)
        of_source = sum(float(np.nanmedian(np.linalg.norm(own[a] - own[b], axis=1))) for a, b in legs)
        for foot in feet:
            if f"{foot.side}_ankle" in known:
                of_body -= float(foot.level[0, 2])
                of_source += float(np.nanpercentile(own[f"{foot.side}_ankle"][:, 2], 20.0))
        return of_body / of_source
    about = [p for p in match.places if p.subject_about and {p.source, str(p.source_about)} <= known]
    if not about:
        problem = "neither legs nor places relative to others show how large the subject is beside the source"
        raise InputError(match.source, problem, remedy="write scale = 1.0")
    ratios = [
        float(np.linalg.norm(rest[p.subject] - rest[str(p.subject_about)]))
        / float(np.nanpercentile(np.linalg.norm(own[p.source] - own[str(p.source_about)], axis=1), 90.0))
        for p in about
    ]
    return float(np.mean(ratios))


def _place_target(
    place: MatchedPlace, rest: dict[str, np.ndarray], own: dict[str, np.ndarray], scale: float
) -> np.ndarray:
    """Target places of a landmark of the body (T, 3)."""
    if place.subject_about is None or place.source_about is None:
        return np.asarray(scale * own[place.source])
    return np.asarray(rest[place.subject_about] + scale * (own[place.source] - own[place.source_about]))


def _feet_places(
    rest: dict[str, np.ndarray],
    own: dict[str, np.ndarray],
    feet: tuple[Foot, ...],
    middle: np.ndarray,
    flat: np.ndarray | None,
) -> np.ndarray:
    """Places of the feet's points (T, F, 3, 3) if all limbs of the body have the source's directions and
    the middle of its hips is at middle (T, 3)."""
    across = own["left_hip"] - own["right_hip"]
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    width = float(np.linalg.norm(rest["left_hip"] - rest["right_hip"]))
    places = []
    for foot in feet:
        ankle = middle + (0.5 if foot.side == "left" else -0.5) * width * across
        for a, b in _LEG:
            bone = own[f"{foot.side}_{b}"] - own[f"{foot.side}_{a}"]
            length = float(np.linalg.norm(rest[f"{foot.side}_{b}"] - rest[f"{foot.side}_{a}"]))
            ankle = ankle + length * bone / np.linalg.norm(bone, axis=1, keepdims=True)
        rotations = _foot_rotations(own, foot.side, None if flat is None else flat[:, foot.number])
        places.append(ankle[:, None] + np.einsum("tij,pj->tpi", rotations, foot.level))
    return np.stack(places, axis=1)


def _foot_rotations(own: dict[str, np.ndarray], side: str, flat: np.ndarray | None) -> np.ndarray:
    """R_world_foot (T, 3, 3) of a source's foot, level when it stands as in the middle of the frames that are flat."""
    back = own.get(f"{side}_heel", own[f"{side}_ankle"])
    forward = own[f"{side}_big_toe"] - back
    pitch = np.arcsin(np.clip(forward[:, 2] / np.linalg.norm(forward, axis=1), -1.0, 1.0))
    level = np.isfinite(pitch) if flat is None or not flat.any() else flat & np.isfinite(pitch)
    offset = float(np.median(pitch[level])) if level.any() else 0.0
    return np.array([foot_rotation(f, p - offset) for f, p in zip(forward, pitch, strict=True)])
