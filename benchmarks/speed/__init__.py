"""Measures of time: tracking, steps, searches, loading and starting; ratios of processor time."""
