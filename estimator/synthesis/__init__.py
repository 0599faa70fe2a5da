"""Clips with known truth: a motion, seen by known cameras, with a detector's keypoints."""
