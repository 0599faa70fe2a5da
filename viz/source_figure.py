"""The person that a body's motion was made from, as a stick figure beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.retargeting.run_of import source_of
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import ROOT_TURN_Q, Body
from viz.solids.body_solids import limb_segments
from viz.solids.solid import Side, side_of

ASIDE = 1.0
"""[m] that the figure is moved to the left of the heading: a person is half a metre wide at the shoulders, and arms
that swing take the rest."""
HEAD_RADIUS = 0.08
"""[m]"""
LEGEND = ("source: sticks", "subject: solid")
"""Which of the two is which, in words."""
HEADS = ("head_top", "head", "nose")
"""Landmarks at which a head is drawn, the first of these that there is."""
_STEP, _AROUND = 0.5, 1.0  # m: between the floor's lines, and how far they extend beyond the paths
_PIECE = 0.25  # m: of a floor's line, so that what is behind an eye can be left out
_MIDDLES = (("neck", "shoulder"), ("mid_hip", "hip"))  # what lies in the middle of both sides' landmarks
_MORE = (("neck", "head"), ("head", "head_top"))
_FOOT = (("ankle", "heel"), ("heel", "big_toe"))
_INSTEAD = {"heel": "ankle"}  # of a foot without the landmark


@dataclass(frozen=True)
class SourceFigure:
    """The source that a body followed, beside it in its world, z up.

    names (L): landmarks. points (T, L, 3) [m]: `ASIDE` from where the body followed them, NaN where missing. segments
    (S, 2) int: the bones, by their ends. sides (S): of the bones. standing (T, P) bool: when the points
    `standing_names` (P) of the feet stand. level [m]: height of the floor, or of the lowest landmark where nothing is
    held on one. floor_lines (N, 2, 3) [m]: pieces of lines on it, by their ends, under both.
    """

    names: tuple[str, ...]
    points: np.ndarray
    segments: np.ndarray
    sides: tuple[Side, ...]
    standing_names: tuple[str, ...]
    standing: np.ndarray
    level: float
    floor_lines: np.ndarray

    @property
    def head(self) -> int | None:
        """Index of the landmark at which a head is drawn, None without one."""
        return next((self.names.index(name) for name in HEADS if name in self.names), None)

    def place(self, t: int) -> np.ndarray:
        """Place of the figure at instant t [m], (3,): the middle of its landmarks, NaN without any."""
        known = self.points[t][np.isfinite(self.points[t]).all(axis=1)]
        return np.asarray(known.mean(axis=0)) if len(known) else np.full(3, np.nan)

    def feet_among(self, names: tuple[str, ...]) -> list[tuple[int, int]]:
        """(column of `standing`, index in `names`) of the points of feet among landmarks `names`; for a missing heel
        the ankle."""
        pairs = []
        for k, name in enumerate(self.standing_names):
            side, part = name.split("_", 1)
            own = [n for n in (name, f"{side}_{_INSTEAD.get(part, part)}") if n in names]
            if own:
                pairs.append((k, names.index(own[0])))
        return pairs

    def standing_points(self, t: int, names: tuple[str, ...], points: np.ndarray) -> np.ndarray:
        """The landmarks (L, 3) [m] that are to stand at instant t, (N, 3) [m]."""
        own = [i for k, i in self.feet_among(names) if self.standing[t, k] and np.isfinite(points[i]).all()]
        return points[np.array(own, dtype=np.int64)]


def source_figure(run: Run) -> SourceFigure | None:
    """The figure of a run that was made from another motion; None for a tracked one.

    Raises InputError for a run without what it was made from.
    """
    if not run.header.retargeted:
        return None
    source, contacts = source_of(run)
    names, points = _with_middles(source.names, source.points)
    turn = np.radians(heading(run.body, run.q))
    aside = ASIDE * np.array([-np.sin(turn), np.cos(turn), 0.0])
    segments, sides = _bones(names)
    points = points + aside
    level = float(np.nanmin(points[..., 2])) if contacts.floor is None else contacts.floor
    lines = _floor_lines(run, points, level)
    return SourceFigure(names, points, segments, sides, contacts.names, contacts.standing, level, lines)


def heading(body: Body, q: np.ndarray) -> float:
    """Heading of a free root's x axis in the middle pose among q (T, nq), NaN without one [deg, -180 to 180]; 0 for a
    fixed one."""
    known = q[np.isfinite(q).all(axis=1)]
    if not body.has_free_root or not len(known):
        return 0.0
    x, y, z, w = known[len(known) // 2, ROOT_TURN_Q]
    return float(np.degrees(np.arctan2(2.0 * (x * y + z * w), 1.0 - 2.0 * (y * y + z * z))))


def _with_middles(names: tuple[str, ...], points: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """Landmarks (T, L, 3) with the neck and the middle of the hips, where only the points at their sides are known."""
    for middle, of in _MIDDLES:
        ends = [names.index(f"{side}_{of}") for side in ("left", "right") if f"{side}_{of}" in names]
        if middle not in names and len(ends) == 2:
            names, points = (*names, middle), np.concatenate([points, points[:, ends].mean(axis=1)[:, None]], axis=1)
    return names, points


def _bones(names: tuple[str, ...]) -> tuple[np.ndarray, tuple[Side, ...]]:
    """Pairs of landmarks (S, 2) between which a bone is drawn, and the bones' sides."""
    segments, sides = limb_segments(names)
    pairs = list(_MORE) + [(f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in _FOOT]
    more = [(names.index(a), names.index(b)) for a, b in pairs if a in names and b in names]
    own = tuple(side_of(names[a]) for a, _ in more)
    return np.concatenate([segments, np.array(more, dtype=np.int64).reshape(-1, 2)]), (*sides, *own)


def _floor_lines(run: Run, points: np.ndarray, level: float) -> np.ndarray:
    """Pieces (N, 2, 3) [m] of lines `_STEP` apart at a height [m], around points (T, L, 3) [m] and the body's path."""
    known = run.q[np.isfinite(run.q).all(axis=1)]
    around = np.concatenate([points[..., :2].reshape(-1, 2), run.body.placed(known).placements[:, 1, 9:11]])
    low = np.floor((np.nanmin(around, axis=0) - _AROUND) / _STEP) * _STEP
    high = np.ceil((np.nanmax(around, axis=0) + _AROUND) / _STEP) * _STEP
    pieces = []
    for along, across in ((0, 1), (1, 0)):
        starts = np.arange(low[along], high[along] - 0.5 * _PIECE, _PIECE)
        for at in np.arange(low[across], high[across] + 0.5 * _STEP, _STEP):
            ends = np.full((len(starts), 2, 3), level)
            ends[:, 0, along], ends[:, 1, along], ends[:, :, across] = starts, starts + _PIECE, at
            pieces.append(ends)
    return np.concatenate(pieces)
