"""Edges along the contours (CSS section 3.1.2)."""
