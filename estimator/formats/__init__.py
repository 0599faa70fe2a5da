"""Files that others read and write: runs, keypoints, cameras, exports."""
