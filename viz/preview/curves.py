"""Content of the page's panel of curves: every joint angle over time, its interval, and the hypotheses' angles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from estimator.runs.coordinates import JointEntry, joint_entries
from viz.scene import Scene
from viz.solids.solid import side_of

_UNITS = {"turn": ("°", float(np.degrees(1.0))), "slide": ("mm", 1e3)}


def joint_curves(scene: Scene, rows: Sequence[int]) -> list[dict[str, Any]]:
    """For each joint that one number places, in the body's order: name, side, unit (degrees or millimetres), value (T),
    low and high (T), the ends of the 90 % interval, None without them; modes (T, K); limits (2).

    Numbers are rounded to tenths, and None where there is none.
    """
    return [
        _curve(scene, list(rows), entry)
        for entry in joint_entries(scene.body)
        if entry.kind in _UNITS and not entry.follows
    ]


def _curve(scene: Scene, rows: list[int], entry: JointEntry) -> dict[str, Any]:
    unit, factor = _UNITS[entry.kind]
    model, at = scene.body.model, entry.start
    limits = np.array([model.lowerPositionLimit[at], model.upperPositionLimit[at]])
    curve = {
        "name": entry.name,
        "side": side_of(entry.name),
        "unit": unit,
        "value": _numbers(factor * scene.q[rows, at]),
        "modes": [_numbers(factor * row) for row in scene.mode_q[rows, :, at]],
        "limits": _numbers(factor * limits),
    }
    if scene.interval is None:
        return curve | {"low": None, "high": None}
    low, high = factor * scene.interval[rows, :, at].T
    return curve | {"low": _numbers(low), "high": _numbers(high)}


def _numbers(values: np.ndarray) -> list[float | None]:
    return [round(float(x), 1) if np.isfinite(x) else None for x in values]
