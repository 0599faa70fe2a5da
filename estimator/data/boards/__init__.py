"""Cameras calibrated from pictures of a board: the board and its corners, lenses, placements."""
