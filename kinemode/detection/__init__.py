"""Keypoints of the people in a clip, by a detector that runs in an environment of its own."""
