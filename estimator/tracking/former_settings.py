"""Settings that run files of earlier versions keep under other names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_OF_CUES = {
    **{f"edge_{name}": f"edges.{name}" for name in ("evidence", "noise", "window", "candidates", "nu")},
    "motion_boundary": "edges.motion_boundary",
    **{f"flow_{name}": f"flow.{name}" for name in ("evidence", "leading", "noise", "share", "nu")},
    **{f"outline_{name}": f"silhouette.{name}" for name in ("evidence", "noise", "nu")},
    "depth_evidence": "depth.evidence",
    "depth_noise": "depth.surface_noise",
    "depth_slide": "depth.slide",
    "depth_nu": "depth.nu",
    **{
        name: f"surface.{name}"
        for name in (
            "nodes",
            "fineness",
            "beside_keypoints",
            "visibility_evidence",
            "back_facing",
            "occluded",
            "rounds",
        )
    },
}
FORMER = {
    **{f"cost.image.{former}": f"cues.{now}" for former, now in _OF_CUES.items()},
    "search.settled": "search.reassign_tolerance",
    "css.other_readings": "css.swapped_readings",
    "css.flips": "css.jumps",
    "css.flip_penalty": "css.jump_penalty",
    "loose_limbed.shout": "loose_limbed.part_detectors",
    "loose_limbed.part_detectors.hull.kept": "loose_limbed.part_detectors.hull.survivors",
    "loose_limbed.propagation.product.sighted": "loose_limbed.propagation.product.image_weighted",
}
"""Present names by former ones, of settings and of groups, with their groups in front."""


def with_present_names(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Nested settings with every setting by its present name."""
    for former, name in FORMER.items():
        *groups, last = former.split(".")
        holder: Any = stored
        for group in groups:
            holder = holder.get(group) if isinstance(holder, Mapping) else None
        if isinstance(holder, Mapping) and last in holder:
            stored = _with(_without(stored, former.split(".")), name.split("."), holder[last])
    return dict(stored)


def _without(settings: Mapping[str, Any], path: list[str]) -> dict[str, Any]:
    """Without a setting, and without groups that have none then."""
    first, *rest = path
    inner = _without(settings[first], rest) if rest else {}
    left = {name: value for name, value in settings.items() if name != first}
    return {**left, first: inner} if inner else left


def _with(settings: Mapping[str, Any], path: list[str], value: Any) -> dict[str, Any]:
    first, *rest = path
    return {**settings, first: _with(settings.get(first, {}), rest, value) if rest else value}
