"""Tracking as the pictures come: frame by frame for programs, and from a camera with a moving preview."""
