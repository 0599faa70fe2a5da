"""Files that others read and write: keypoints, cameras, motions, settings; checked JSON."""
