"""Errors of tracks and of what they are made from, beside a reference or the truth."""
