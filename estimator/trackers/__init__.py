"""Trackers: short recipes over the parts below."""
