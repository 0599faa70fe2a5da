"""What a user names: clips, keypoints, cameras, and what the files do not have, made into observations."""
