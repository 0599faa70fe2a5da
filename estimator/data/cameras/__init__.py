"""Cameras, projection, and what two of them have to do with each other."""
