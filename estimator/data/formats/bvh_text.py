"""Motions as the text of BVH files; `estimator.data.formats.bvh` reads them and says what the format is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.data.formats.bvh import END_SITE, BvhMotion


def write_bvh(path: Path, motion: BvhMotion) -> None:
    """Write a motion whose joints are in the order of the hierarchy: each one's parent before it, and what hangs on it
    directly after it. Nodes named NAME_end, after their parent NAME, become its end sites."""
    lines = ["HIERARCHY", *_joint(motion, 0, 0), "MOTION", f"Frames: {len(motion.values)}"]
    lines.append(f"Frame Time: {motion.frame_time:.9f}")
    lines += [" ".join(f"{value:.8f}" for value in row) for row in motion.values]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _joint(motion: BvhMotion, j: int, depth: int) -> list[str]:
    tab, name = "\t" * depth, motion.names[j]
    parent = int(motion.parents[j])
    offset = "OFFSET " + " ".join(f"{value:.8f}" for value in motion.offsets[j])
    if parent >= 0 and name == motion.names[parent] + END_SITE:
        return [f"{tab}End Site", f"{tab}{{", f"{tab}\t{offset}", f"{tab}}}"]
    channels = [channel for joint, channel in motion.channels if joint == j]
    head = [f"{tab}{'ROOT' if parent < 0 else 'JOINT'} {name}", f"{tab}{{", f"{tab}\t{offset}"]
    head.append(" ".join([f"{tab}\tCHANNELS", str(len(channels)), *channels]))
    children = np.flatnonzero(motion.parents == j).tolist()
    return [*head, *(line for child in children for line in _joint(motion, child, depth + 1)), f"{tab}}}"]
