"""Statuses of a frame, for whatever writes them down or prints them."""

from __future__ import annotations

TRACKED, HARD = "tracked", "hard"
STATUS_MEANINGS = {
    TRACKED: "the best pose explains at least half of what was seen",
    HARD: "the best pose leaves half of the keypoints or of the outline unexplained, overlaps itself, moved"
    " faster than any body, its search ended early, or the findings speak against it: look at these frames with"
    " `kinemode explain`, and at their keypoints",
    "unobserved": "too few keypoints and no pictures: poses are extrapolated from the frame before; give keypoints"
    " there, or pictures (--cues)",
}
"""Meanings of a frame's statuses, and what to do: one line each, wherever a status is printed."""
