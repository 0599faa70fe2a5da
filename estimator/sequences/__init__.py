"""Observations of a clip in order: one clock for keypoints, pictures and cameras."""
