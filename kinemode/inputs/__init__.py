"""A user's input (clips, keypoints, cameras, and what the files lack) made into observations."""
