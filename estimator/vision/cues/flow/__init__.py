"""Optical flow of the surface (CSS section 3.1.2)."""
