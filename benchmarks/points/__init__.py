"""Tracks of points in space: errors, the certificates of their poses, and their time."""
