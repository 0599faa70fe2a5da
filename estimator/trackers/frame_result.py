"""A tracker's result for one frame, its status, and the most likely way through the hypotheses of all frames."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator.data.formats.checked_arrays import Field
from estimator.inference.mixture import MODE_FIELDS
from estimator.inference.origin import Origins

RESULT_FIELDS = {"weight": Field("f", ("K",)), **{name: f for name, f in MODE_FIELDS.items() if name != "status"}}
"""The arrays of a frame's K hypotheses; of runs made before it was kept `velocity` is missing."""

_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
_KINDS = "biufU"
_MOST, _MOST_AXES = 64, 4


@dataclass(frozen=True)
class FrameResult:
    """K hypotheses for one frame, best first.

    index: number of the frame in the clip. time: seconds since the clip's start.
    status: see `estimator.trackers.frame_result`; before the first usable frame an "unobserved" one has no hypotheses.
    q (K, nq), weight (K,), energy (K,), covariance (K, nv, nv): the modes.
    parent (K,) int: index of each mode's parent in the previous frame, -1 if none.
    kkt_residual (K,), penetration (K,) [m]: certificates of each mode, see `Mode`.
    association (K): see `Mode`. velocity (K, nv): see `Mode`; None in runs made before it was kept.
    origins: where the modes came from and their penalties; None where nothing was observed, and in such runs.
    extra: the tracker's own information by name, arrays of numbers, booleans or text of at most 4 axes. Each tracker
    documents what it reports. A name may be missing in frames without such information.

    Raises
    ------
    ValueError: an extra array of another kind, or a name that is not a lower-case identifier.
    """

    index: int
    time: float
    status: str
    q: np.ndarray
    weight: np.ndarray
    energy: np.ndarray
    covariance: np.ndarray
    parent: np.ndarray
    kkt_residual: np.ndarray
    penetration: np.ndarray
    association: tuple[str, ...]
    velocity: np.ndarray | None = None
    origins: Origins | None = None
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)

    @staticmethod
    def of(
        index: int, time: float, status: str, arrays: Mapping[str, np.ndarray],
        origins: Origins | None = None, extra: Mapping[str, np.ndarray] | None = None,
    ) -> FrameResult:  # fmt: skip
        """The one whose `arrays` these are, among others."""
        own: dict[str, Any] = {name: arrays[name] for name in RESULT_FIELDS if name in arrays}
        own["association"] = tuple(own["association"].tolist())
        return FrameResult(index, time, status, **own, origins=origins, extra=extra or {})

    def arrays(self) -> dict[str, np.ndarray]:
        """The hypotheses as the arrays of `RESULT_FIELDS` that there are."""
        own = ((name, field, getattr(self, name)) for name, field in RESULT_FIELDS.items())
        return {name: field.array(value) for name, field, value in own if value is not None}

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", {name: _read_only(value) for name, value in self.extra.items()})
        check_extra(self.extra)


def check_extra(extra: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError unless these can be a frame's extra arrays."""
    if len(extra) > _MOST:
        raise ValueError(f"{len(extra)} extra arrays, at most {_MOST} are kept")
    for name, array in extra.items():
        if not _NAME.fullmatch(name):
            raise ValueError(f"extra array {name[:80]!r} is not called by a lower-case identifier")
        if array.dtype.kind not in _KINDS or array.ndim > _MOST_AXES:
            raise ValueError(f"extra array {name} has the shape {array.shape} and type {array.dtype}")


def _read_only(value: np.ndarray) -> np.ndarray:
    array = np.asarray(value)
    if array.flags.writeable:
        array = array.copy()
        array.flags.writeable = False
    return array


TRACKED, HARD = "tracked", "hard"
STATUS_MEANINGS = {
    TRACKED: "the best pose explains at least half of what was seen",
    HARD: "the best pose leaves half of the keypoints or of the outline unexplained, overlaps itself, moved"
    " faster than any body, its search ended early, or findings contradict it: examine these frames with"
    " `kinemode explain`, and at their keypoints",
    "unobserved": "too few keypoints and no pictures: poses are extrapolated from the frame before; give keypoints"
    " there, or pictures (--cues)",
}
"""Meanings of a frame's statuses, and what to do: one line each, wherever a status is printed."""


def backtrack(parent: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Index (T,) of the hypothesis each frame has on the path that ends in the best one of the last frame.

    Parameters
    ----------
    parent (T, K): index of each hypothesis' parent in the frame before, -1 if none: the path then continues from the
        best hypothesis of the frame before.
    weight (T, K): weights, NaN where there is no hypothesis.

    -1 for a frame without hypotheses. Source: Sminchisescu and Triggs 2003 (CSS), footnote 2, keeping one path.
    """
    count = len(parent)
    path = np.full(count, -1, dtype=np.int64)
    filled = np.where(np.isnan(weight), -np.inf, weight)
    wanted = -1
    for t in range(count - 1, -1, -1):
        some = filled.shape[1] > 0 and np.isfinite(filled[t]).any()
        if some and (wanted < 0 or not np.isfinite(filled[t, wanted])):
            wanted = int(np.argmax(filled[t]))
        path[t] = wanted if some else -1
        wanted = int(parent[t, wanted]) if some else -1
    return path


def backtrack_results(results: Sequence[FrameResult]) -> np.ndarray:
    """`backtrack` over a list of frame results, (T,)."""
    most = max((len(r.weight) for r in results), default=0)
    parent = np.full((len(results), most), -1, dtype=np.int64)
    weight = np.full((len(results), most), np.nan)
    for t, result in enumerate(results):
        parent[t, : len(result.parent)] = result.parent
        weight[t, : len(result.weight)] = result.weight
    return backtrack(parent, weight)
