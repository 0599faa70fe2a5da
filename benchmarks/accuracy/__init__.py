"""Errors of tracks and of their inputs, against a reference or the truth."""
