"""Clips with known truth, rendered into files."""
