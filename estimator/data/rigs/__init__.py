"""Cameras from the person who moves before them: where they stand, how their clocks run and what their lenses are."""
